"""Smooth interfaces of two media: bare, of a given reflectance, or coated."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from raymap.jit.kernels import inline_kernel, inner_kernel, unsigned
from raymap.laws.law import Law as StoredLaw
from raymap.laws.radial import RadialScatter
from raymap.laws.smooth import FresnelLaw
from raymap.laws.stack import StackLaw, StoredLayer
from raymap.laws.table import TableLaw, measured_at_channels
from raymap.optics.fresnel import cos2_refracted, partial_reflectance
from tracer.compiled import (
    DIELECTRIC,
    M_DISPERSIVE,
    S_COATING,
    S_COATING_STEP,
    S_MODEL,
    S_SCATTER,
    SURFACE_ROW,
)
from tracer.description.fields import Finite, Length, Node, Positive, Share, Spectral
from tracer.rays.colors import COLORS, pick_channel, recolor
from tracer.rays.random import advance, uniform
from tracer.surfaces.interaction import (
    ABSORBED,
    GLOSSY_REFLECTION,
    GLOSSY_TRANSMISSION,
    SELECT,
    SPECULAR_REFLECTION,
    SPECULAR_REFRACTION,
    TIR,
    Interaction,
    Interface,
    Light,
    Optics,
    Way,
    reflected_way,
)
from tracer.surfaces.scatter import Scatter
from tracer.surfaces.specular import scatter_specular, smooth_shares
from tracer.surfaces.surface import Surface, SurfaceRow

__all__ = [
    "Coating",
    "CoatingLayer",
    "Dielectric",
    "changes_by_channel",
    "meet_dielectric",
    "recolor_reflected",
    "scatter_if_specular",
]

Array = NDArray[np.float64]


_SPECULAR = SPECULAR_REFLECTION | SPECULAR_REFRACTION | TIR


@inline_kernel
def meet_dielectric(
    optics: Optics, at: Interface, way: Way, light: Light, follow: int
) -> Interaction:
    """Smooth interface, bare or coated: reflection or refraction by roulette.

    Where the index depends on the channel, a channel is drawn first. If the ray is refracted it
    goes on in that channel alone; if it is reflected, all channels are, each with its reflectance.
    """
    code, colors, state = light.code, light.colors, light.state
    n_channels = colors.shape[1]
    model = optics.surface_i[at.surface, S_MODEL]
    select = code >= n_channels and changes_by_channel(optics, at)
    k = code if code < n_channels else 0
    if select:
        state = advance(state)
        k = pick_channel(colors, code, uniform(state))
    channel = unsigned(k)
    n1, n2 = optics.medium_f[at.medium, channel], optics.medium_f[at.other, channel]
    eta = n1 / n2
    cos2_t = cos2_refracted(eta, at.cos_i)
    if cos2_t > 0.0:
        state = advance(state)
        cos_t = math.sqrt(cos2_t)
        u = uniform(state)
        if model == 0:
            # What `smooth_shares` says, with the root that is at hand
            reflectance = partial_reflectance(n1, n2, at.cos_i, cos_t)
        elif model != 2:
            reflectance = optics.surface_f[at.surface, SURFACE_ROW + channel]
        else:
            reflectance, transmittance = smooth_shares(optics, at, k)
            if u >= reflectance + transmittance and follow == 0:
                return ABSORBED, False, way.dx, way.dy, way.dz, k if select else code, state
        if u >= reflectance or follow == 1:
            event = SPECULAR_REFRACTION
            if select:
                event |= SELECT
                code = k
            along = eta * at.cos_i - cos_t
            return (
                event, True, eta * way.dx + along * way.nx, eta * way.dy + along * way.ny,
                eta * way.dz + along * way.nz, code, state,
            )  # fmt: skip
        event = SPECULAR_REFLECTION
    else:
        event = TIR
        if model == 2:
            # A coating that absorbs frustrates total reflection
            state = advance(state)
            reflectance, _ = smooth_shares(optics, at, k)
            if uniform(state) >= reflectance:
                return ABSORBED, False, way.dx, way.dy, way.dz, k if select else code, state
    if select:
        code = recolor_reflected(optics, at, light)
    way = reflected_way(at, way)
    return event, False, way.dx, way.dy, way.dz, code, state


@inline_kernel
def changes_by_channel(optics: Optics, at: Interface) -> bool:
    """Whether an interface treats the channels unlike."""
    dispersive = optics.medium_i[at.medium, M_DISPERSIVE] | optics.medium_i[at.other, M_DISPERSIVE]
    return bool(dispersive != 0 or optics.surface_i[at.surface, S_MODEL] >= 2)


@inner_kernel
def recolor_reflected(optics: Optics, at: Interface, light: Light) -> int:
    """Colour after reflection where each channel has its own reflectance; total stays total."""
    spare = light.counters[COLORS] + 1
    for j in range(light.colors.shape[1]):
        light.colors[spare, j], _ = smooth_shares(optics, at, j)
    return recolor(light.colors, light.code, light.colors, spare, np.int64(0), light.counters)


@inner_kernel
def scatter_if_specular(
    optics: Optics, at: Interface, way: Way, light: Light, met: Interaction
) -> Interaction:
    """Give the surface's scatter its share of light that was reflected or refracted."""
    happened, crosses, dx, dy, dz, code, state = met
    if optics.surface_i[at.surface, S_SCATTER] < 0 or happened & _SPECULAR == 0:
        return met
    side = -1.0 if crosses else 1.0
    leaving = Way(dx, dy, dz, side * way.nx, side * way.ny, side * way.nz)
    light = Light(code, light.colors, light.counters, state)
    scattered, dx, dy, dz, code, state = scatter_specular(optics, at, crosses, leaving, light)
    if scattered:
        glossy = GLOSSY_TRANSMISSION if crosses else GLOSSY_REFLECTION
        happened = (happened & SELECT) | glossy
    return happened, crosses, dx, dy, dz, code, state


class CoatingLayer(Node):
    """A layer of a stack: index n + i k and thickness [nm]."""

    index: Spectral
    extinction: Spectral | None = None
    thickness_nm: Annotated[Length, Field(ge=0)]


_Rows = tuple[tuple[float, ...], ...]
_NATURAL = ("reflectance", "transmittance")
_POLARISED = ("reflectance_s", "reflectance_p", "transmittance_s", "transmittance_p")


class Coating(Node):
    """A stack of ``layers`` from the first of two media ``between`` to the second, or a
    measurement: reflectance and transmittance, a row per wavelength with a value per angle, of
    natural light or of s and p."""

    layers: tuple[CoatingLayer, ...] = ()
    between: tuple[str, str] | None = None
    wavelength_nm: tuple[Positive, ...] = ()
    angle_deg: tuple[Finite, ...] = ()
    reflectance: tuple[tuple[Share, ...], ...] = ()
    transmittance: tuple[tuple[Share, ...], ...] = ()
    reflectance_s: tuple[tuple[Share, ...], ...] = ()
    reflectance_p: tuple[tuple[Share, ...], ...] = ()
    transmittance_s: tuple[tuple[Share, ...], ...] = ()
    transmittance_p: tuple[tuple[Share, ...], ...] = ()

    def model_post_init(self, context: Any) -> None:
        if bool(self.layers) == bool(self.angle_deg):
            raise ValueError("give either layers and between, or a table over angle_deg")
        if bool(self.layers) != (self.between is not None):
            raise ValueError(
                "layers need the media that they lie between: between = [first, second]"
            )
        measured = {"wavelength_nm", *_NATURAL, *_POLARISED} & self.model_fields_set
        if self.layers and measured:
            raise ValueError(
                f"{', '.join(sorted(measured))} belongs to a table over angle_deg; layers are "
                "computed: drop either"
            )
        polarised = set(_POLARISED) & self.model_fields_set
        if polarised and (len(polarised) < 4 or set(_NATURAL) & self.model_fields_set):
            raise ValueError(
                f"a table of polarised light has all of {', '.join(_POLARISED)}, and natural light "
                "is their mean: leave reflectance and transmittance out"
            )

    def stated(self, row: SurfaceRow, scatter: RadialScatter | None) -> StackLaw | TableLaw:
        """Its shares by channel and angle, in the form in which maps store it.

        Raises
        ------
        SceneError
        """
        if self.between is not None:
            first, second = (row.medium(item, "coating.between") for item in self.between)
            layers = tuple(
                StoredLayer(
                    thickness_nm=layer.thickness_nm,
                    n=row.listed(layer.index),
                    k=row.listed(layer.extinction),
                )
                for layer in self.layers
            )
            return StackLaw(between=(first, second), layers=layers, scatter=scatter)
        if not self.reflectance_s:
            back, through = self._measured(row, self.reflectance, self.transmittance)
            return _table(self.angle_deg, back, through, scatter)
        s_back, s_through = self._measured(row, self.reflectance_s, self.transmittance_s)
        p_back, p_through = self._measured(row, self.reflectance_p, self.transmittance_p)
        natural = _table(
            self.angle_deg, 0.5 * (s_back + p_back), 0.5 * (s_through + p_through), scatter
        )
        return natural.model_copy(
            update={
                "reflectance_s": tuple(map(tuple, s_back.tolist())),
                "transmittance_s": tuple(map(tuple, s_through.tolist())),
            }
        )

    def _measured(
        self, row: SurfaceRow, reflectance: _Rows, transmittance: _Rows
    ) -> tuple[Array, Array]:
        return measured_at_channels(
            row.wavelengths_nm,
            self.wavelength_nm,
            self.angle_deg,
            reflectance,
            transmittance,
            name=row.name,
        )

    def table(self, row: SurfaceRow) -> Array:
        """What the engine looks up, a row per channel.

        Raises
        ------
        SceneError
        """
        law = self.stated(row, None)
        return law.tables(row, row.name) if isinstance(law, StackLaw) else law.tables()


def _table(
    angle_deg: tuple[float, ...], back: Array, through: Array, scatter: RadialScatter | None
) -> TableLaw:
    return TableLaw(
        angle_deg=angle_deg,
        reflectance=tuple(map(tuple, back.tolist())),
        transmittance=tuple(map(tuple, through.tolist())),
        scatter=scatter,
    )


class Dielectric(Surface):
    """Smooth interface of both media; bare, with a ``reflectance``, or with a ``coating``.

    ``scatter`` is a BSDF about the specular directions; what it scatters is taken from them.
    """

    kind: Literal["dielectric"] = "dielectric"
    reflectance: Spectral | None = None
    coating: Coating | None = None
    scatter: Scatter | None = None
    number = DIELECTRIC

    def model_post_init(self, context: Any) -> None:
        if self.coating is not None and self.reflectance is not None:
            raise ValueError("give either a reflectance or a coating")

    def compile(self, row: SurfaceRow) -> None:
        row.set_shares(self.reflectance, None)
        if self.reflectance is not None:
            row.integers[S_MODEL] = 1 if np.ptp(row.reflectance) == 0.0 else 3
        if self.coating is not None:
            table = self.coating.table(row)
            row.integers[S_MODEL] = 2
            row.integers[S_COATING] = row.pool.add(table)
            row.integers[S_COATING_STEP] = table.shape[1]
        if self.scatter is not None:
            self.scatter.compile(row)

    def stated(self, row: SurfaceRow) -> StoredLaw | None:
        scatter = None
        if self.scatter is not None:
            scatter = self.scatter.stated()
            if scatter is None:
                return None
        if self.coating is not None:
            return self.coating.stated(row, scatter)
        if self.reflectance is not None:
            even = row.reflectance[:, None]
            return _table((0.0,), even, 1.0 - even, scatter)
        return FresnelLaw(scatter=scatter)

    def transmits(self) -> bool:
        return True


KINDS = (Dielectric,)

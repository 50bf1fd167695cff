"""Smooth interfaces of two media: bare, of a given reflectance, or coated."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from raymap.jit.kernels import inline_kernel, inner_kernel, unsigned
from raymap.jit.types import F64, I64
from raymap.laws.law import Law as StoredLaw
from raymap.laws.radial import RadialScatter
from raymap.laws.smooth import FresnelLaw
from raymap.laws.stack import StackLaw, StoredLayer
from raymap.laws.table import TableLaw, coating_share, measured_at_channels
from raymap.model.events import Event
from raymap.optics.fresnel import cos2_refracted, fresnel_reflectance, partial_reflectance
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
from tracer.surfaces.interaction import ABSORBED, GLOSSY_REFLECTION, GLOSSY_TRANSMISSION
from tracer.surfaces.scatter import Scatter
from tracer.surfaces.specular import scatter_specular
from tracer.surfaces.surface import Surface, SurfaceRow

__all__ = [
    "Coating",
    "CoatingLayer",
    "Dielectric",
    "coating",
    "meet_dielectric",
    "scatter_if_specular",
]

Array = NDArray[np.float64]


_REFLECTED = int(Event.SPECULAR_REFLECTION)
_REFRACTED = int(Event.SPECULAR_REFRACTION)
_TIR = int(Event.TIR)
_SELECT = int(Event.DISPERSIVE_SELECT)
_SPECULAR = _REFLECTED | _REFRACTED | _TIR


@inline_kernel
def meet_dielectric(
    surface_i: I64, surface_f: F64, medium_i: I64, medium_f: F64, tables: F64 | None,
    surface: int, medium: int, other: int, dx: float, dy: float, dz: float,
    nx: float, ny: float, nz: float, cos_i: float, code: int, colors: F64, counters: I64,
    state: np.uint64, follow: int,
) -> tuple[int, bool, float, float, float, int, np.uint64]:  # fmt: skip
    """Smooth interface, bare or coated: reflection or refraction by roulette.

    Where the index depends on the channel, a channel is drawn first. If the ray is refracted it
    goes on in that channel alone; if it is reflected, all channels are, each with its reflectance.
    """
    n_channels = colors.shape[1]
    select = code >= n_channels and (
        medium_i[medium, M_DISPERSIVE] | medium_i[other, M_DISPERSIVE] != 0
        or surface_i[surface, S_MODEL] >= 2
    )
    k = code if code < n_channels else 0
    if select:
        state = advance(state)
        k = pick_channel(colors, code, uniform(state))
    channel = unsigned(k)
    n1, n2 = medium_f[medium, channel], medium_f[other, channel]
    eta = n1 / n2
    cos2_t = cos2_refracted(eta, cos_i)
    if cos2_t > 0.0:
        state = advance(state)
        cos_t = math.sqrt(cos2_t)
        u = uniform(state)
        model = surface_i[surface, S_MODEL]
        if model == 0:
            reflectance = partial_reflectance(n1, n2, cos_i, cos_t)
        elif model != 2:
            reflectance = surface_f[surface, SURFACE_ROW + channel]
        else:
            place = surface_i[surface, S_COATING] + k * surface_i[surface, S_COATING_STEP]
            reflectance, transmittance = coating(tables, place, n1, n2, cos_i)
            if u >= reflectance + transmittance and follow == 0:
                return ABSORBED, False, dx, dy, dz, k if select else code, state
        if u >= reflectance or follow == 1:
            event = _REFRACTED
            if select:
                event |= _SELECT
                code = k
            along = eta * cos_i - cos_t
            return event, True, eta * dx + along * nx, eta * dy + along * ny, eta * dz + along * nz, code, state  # fmt: skip # noqa: E501
        event = _REFLECTED
    else:
        event = _TIR
        if surface_i[surface, S_MODEL] == 2:
            # A coating that absorbs frustrates total reflection
            state = advance(state)
            place = surface_i[surface, S_COATING] + k * surface_i[surface, S_COATING_STEP]
            reflectance, _ = coating(tables, place, n1, n2, cos_i)
            if uniform(state) >= reflectance:
                return ABSORBED, False, dx, dy, dz, k if select else code, state
    if select:
        code = _recolor_reflected(
            surface_i,
            surface_f,
            medium_f,
            tables,
            surface,
            medium,
            other,
            cos_i,
            code,
            colors,
            counters,
        )
    along = 2.0 * cos_i
    return event, False, dx + along * nx, dy + along * ny, dz + along * nz, code, state


@inner_kernel
def _recolor_reflected(
    surface_i: I64, surface_f: F64, medium_f: F64, tables: F64 | None, surface: int, medium: int,
    other: int, cos_i: float, code: int, colors: F64, counters: I64,
) -> int:  # fmt: skip
    """Colour after reflection where each channel has its own reflectance; total stays total."""
    spare = counters[COLORS] + 1
    for j in range(colors.shape[1]):
        reflectance = fresnel_reflectance(medium_f[medium, j], medium_f[other, j], cos_i)
        if surface_i[surface, S_MODEL] == 2:
            place = surface_i[surface, S_COATING] + j * surface_i[surface, S_COATING_STEP]
            reflectance, _ = coating(tables, place, medium_f[medium, j], medium_f[other, j], cos_i)
        elif reflectance < 1.0 and surface_i[surface, S_MODEL] != 0:
            reflectance = surface_f[surface, SURFACE_ROW + j]
        colors[spare, j] = reflectance
    return recolor(colors, code, colors, spare, np.int64(0), counters)


@inline_kernel
def coating(
    tables: F64 | None, place: int, n1: float, n2: float, cos_i: float
) -> tuple[float, float]:
    """Reflectance and transmittance from a coating's table."""
    if tables is None:
        return 0.0, 1.0
    return coating_share(tables, place, n1, n2, cos_i)


@inner_kernel
def scatter_if_specular(
    surface_i: I64, surface_f: F64, medium_f: F64, tables: F64, surface: int, medium: int,
    other: int, cos_i: float, happened: int, crosses: bool, nx: float, ny: float, nz: float,
    dx: float, dy: float, dz: float, code: int, colors: F64, counters: I64, state: np.uint64,
) -> tuple[int, float, float, float, int, np.uint64]:  # fmt: skip
    """Give the surface's scatter its share of light that was reflected or refracted."""
    if surface_i[surface, S_SCATTER] < 0 or happened & _SPECULAR == 0:
        return happened, dx, dy, dz, code, state
    side = -1.0 if crosses else 1.0
    scattered, dx, dy, dz, code, state = scatter_specular(
        surface_i, surface_f, medium_f, tables, surface, medium, other, cos_i, crosses, side * nx,
        side * ny, side * nz, dx, dy, dz, code, colors, counters, state,
    )  # fmt: skip
    if scattered:
        glossy = GLOSSY_TRANSMISSION if crosses else GLOSSY_REFLECTION
        happened = (happened & _SELECT) | glossy
    return happened, dx, dy, dz, code, state


class CoatingLayer(Node):
    """A layer of a stack: index n + i k and thickness [nm]."""

    index: Spectral
    extinction: Spectral | None = None
    thickness_nm: Annotated[Length, Field(ge=0)]


class Coating(Node):
    """A stack of ``layers`` from the first of two media ``between`` to the second, or a
    measurement: reflectance and transmittance, a row per wavelength with a value per angle."""

    layers: tuple[CoatingLayer, ...] = ()
    between: tuple[str, str] | None = None
    wavelength_nm: tuple[Positive, ...] = ()
    angle_deg: tuple[Finite, ...] = ()
    reflectance: tuple[tuple[Share, ...], ...] = ()
    transmittance: tuple[tuple[Share, ...], ...] = ()

    def model_post_init(self, context: Any) -> None:
        if bool(self.layers) == bool(self.angle_deg):
            raise ValueError("give either layers and between, or a table over angle_deg")
        if bool(self.layers) != (self.between is not None):
            raise ValueError(
                "layers need the media that they lie between: between = [first, second]"
            )
        measured = {"wavelength_nm", "reflectance", "transmittance"} & self.model_fields_set
        if self.layers and measured:
            raise ValueError(
                f"{', '.join(sorted(measured))} belongs to a table over angle_deg; layers are "
                "computed: drop either"
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
        back, through = measured_at_channels(
            row.wavelengths_nm,
            self.wavelength_nm,
            self.angle_deg,
            self.reflectance,
            self.transmittance,
            name=row.name,
        )
        return _table(self.angle_deg, back, through, scatter)

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

    def splits_polarisation(self) -> tuple[str, str] | None:
        if self.coating is not None:
            return "coating", "a coating reflects s and p unlike"
        if self.scatter is not None:
            return "scatter", "scatter takes its share from the s and p light that is reflected"
        return None


KINDS = (Dielectric,)

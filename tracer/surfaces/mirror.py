"""Mirrors: of a reflectance, or of a metal."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inner_kernel
from raymap.jit.types import F64, I64
from raymap.laws.law import Law as StoredLaw
from raymap.laws.mirror import MirrorLaw
from raymap.model.events import Event
from tracer.compiled import MIRROR, S_METAL, S_SCATTER
from tracer.description.fields import Node, Spectral
from tracer.rays.random import advance, uniform
from tracer.surfaces.interaction import ABSORBED, GLOSSY_REFLECTION
from tracer.surfaces.metals import survive_metal
from tracer.surfaces.scatter import Scatter
from tracer.surfaces.specular import scatter_specular
from tracer.surfaces.surface import Surface, SurfaceRow

__all__ = ["METAL_SPLITS", "Metal", "Mirror", "meet_mirror"]

Array = NDArray[np.float64]

METAL_SPLITS = "a metal n + i k reflects s and p unlike"


_REFLECTED = int(Event.SPECULAR_REFLECTION)


@inner_kernel
def meet_mirror(
    surface_i: I64, surface_f: F64, medium_f: F64, tables: F64, surface: int, medium: int,
    dx: float, dy: float, dz: float, nx: float, ny: float, nz: float, cos_i: float, code: int,
    colors: F64, counters: I64, state: np.uint64,
) -> tuple[int, bool, float, float, float, int, np.uint64]:  # fmt: skip
    """Reflection, scatter about it, or absorption."""
    state = advance(state)
    reflected, code = survive_metal(
        surface_i, surface_f, medium_f, tables, surface, medium, cos_i, code, colors, counters,
        uniform(state),
    )  # fmt: skip
    if not reflected:
        return ABSORBED, False, dx, dy, dz, code, state
    along = 2.0 * cos_i
    dx, dy, dz = dx + along * nx, dy + along * ny, dz + along * nz
    event = _REFLECTED
    if surface_i[surface, S_SCATTER] >= 0:
        scattered, dx, dy, dz, code, state = scatter_specular(
            surface_i, surface_f, medium_f, tables, surface, medium, medium, cos_i, False, nx, ny,
            nz, dx, dy, dz, code, colors, counters, state,
        )  # fmt: skip
        event = GLOSSY_REFLECTION if scattered else _REFLECTED
    return event, False, dx, dy, dz, code, state


class Metal(Node):
    """Refractive index n + i k of a metal."""

    n: Spectral
    k: Spectral

    def at(self, row: SurfaceRow) -> tuple[Array, Array]:
        """n and k at the channels.

        Raises
        ------
        SceneError
        """
        return row.at(self.n), row.at(self.k)

    def listed(self, row: SurfaceRow) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """n and k as a stored law lists them."""
        return row.listed(self.n), row.listed(self.k)

    def compile(self, row: SurfaceRow) -> None:
        """Put n and k of every channel into the tables."""
        row.integers[S_METAL] = row.pool.add(np.column_stack(self.at(row)))


class Mirror(Surface):
    """Specular ``reflectance`` or that of a ``metal``; the rest is absorbed.

    ``scatter`` is a BSDF about the specular direction; what it scatters is taken from it.
    """

    kind: Literal["mirror"] = "mirror"
    reflectance: Spectral | None = None
    metal: Metal | None = None
    scatter: Scatter | None = None
    number = MIRROR

    def model_post_init(self, context: Any) -> None:
        if (self.reflectance is None) == (self.metal is None):
            raise ValueError("a mirror surface needs either a reflectance or a metal")

    def compile(self, row: SurfaceRow) -> None:
        row.set_shares(self.reflectance, None)
        if self.metal is not None:
            self.metal.compile(row)
        if self.scatter is not None:
            self.scatter.compile(row)

    def stated(self, row: SurfaceRow) -> StoredLaw | None:
        n, k = ((), ()) if self.metal is None else self.metal.listed(row)
        scatter = None if self.scatter is None else self.scatter.stated()
        if scatter is None and self.scatter is not None:
            return None
        return MirrorLaw(reflectance=row.listed(self.reflectance), n=n, k=k, scatter=scatter)

    def splits_polarisation(self) -> tuple[str, str] | None:
        return ("metal", METAL_SPLITS) if self.metal is not None else None


KINDS = (Mirror,)

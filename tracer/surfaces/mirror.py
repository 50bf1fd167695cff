"""Mirrors: of a reflectance, or of a metal."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inner_kernel
from raymap.laws.law import Law as StoredLaw
from raymap.laws.mirror import MirrorLaw
from tracer.compiled import MIRROR, S_METAL, S_SCATTER
from tracer.description.fields import Node, Spectral
from tracer.rays.random import advance, uniform
from tracer.surfaces.interaction import (
    ABSORBED,
    GLOSSY_REFLECTION,
    SPECULAR_REFLECTION,
    Interaction,
    Interface,
    Light,
    Optics,
    Way,
    reflected_way,
)
from tracer.surfaces.metals import survive_metal
from tracer.surfaces.scatter import Scatter
from tracer.surfaces.specular import scatter_specular
from tracer.surfaces.surface import Surface, SurfaceRow

__all__ = ["Metal", "Mirror", "meet_mirror", "reflect_at_mirror"]

Array = NDArray[np.float64]


@inner_kernel
def meet_mirror(optics: Optics, at: Interface, way: Way, light: Light) -> Interaction:
    """Reflection, scatter about it, or absorption."""
    reflected, way, light = reflect_at_mirror(optics, at, way, light)
    if not reflected:
        return ABSORBED, False, way.dx, way.dy, way.dz, light.code, light.state
    if optics.surface_i[at.surface, S_SCATTER] < 0:
        return SPECULAR_REFLECTION, False, way.dx, way.dy, way.dz, light.code, light.state
    scattered, dx, dy, dz, code, state = scatter_specular(optics, at, False, way, light)
    event = GLOSSY_REFLECTION if scattered else SPECULAR_REFLECTION
    return event, False, dx, dy, dz, code, state


@inner_kernel
def reflect_at_mirror(
    optics: Optics, at: Interface, way: Way, light: Light
) -> tuple[bool, Way, Light]:
    """Whether light is reflected, the way on which it goes, and its colour and state."""
    state = advance(light.state)
    reflected, code = survive_metal(optics, at.surface, at.medium, at.cos_i, light, uniform(state))
    light = Light(code, light.colors, light.counters, state)
    if not reflected:
        return False, way, light
    return True, reflected_way(at, way), light


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


KINDS = (Mirror,)

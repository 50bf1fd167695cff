"""The weighted mode: what happens at a surface, and with which weight the ray goes on.

Nothing here changes a flux: an outcome that is chosen with another probability than light has
carries the ratio of both as a factor of its weight.

- A reflection at a smooth interface, a scatter by a law of ABg or Harvey-Shack, and light that a
  diffuse surface sends on are chosen with at least the probability ``settings[R_LEAST]``.
- Where the ray may still split (`tracer.transport.splitting`), the reflected part becomes a ray of
  its own and the other part goes on, each with its share.
- Scattered light is aimed with the probability ``settings[R_AIM]``
  (`tracer.transport.weighted.balance`).

References
----------
J. Arvo, D. Kirk, Particle transport and image synthesis, SIGGRAPH 1990 (roulette, splitting).
"""

from __future__ import annotations

import numpy as np

from raymap.jit.kernels import inline_kernel, inner_kernel
from raymap.jit.types import F64
from raymap.model.events import Event
from tracer.compiled import (
    DIELECTRIC,
    LAMBERTIAN,
    MIRROR,
    S_DRAW,
    S_KIND,
    S_MEET,
    VarianceReduction,
)
from tracer.surfaces.interaction import (
    ABSORBED,
    GLOSSY_REFLECTION,
    SPECULAR_REFLECTION,
    Interface,
    Light,
    Optics,
    Way,
)
from tracer.surfaces.mirror import reflect_at_mirror
from tracer.surfaces.surface_hit import meet_by_kind, meet_surface
from tracer.transport.splitting import SplitRays
from tracer.transport.weighted.balance import Flight, aim_scattered, roulette
from tracer.transport.weighted.ray import Weighted, WeightedRay
from tracer.transport.weighted.scattered import scatter_aimed, scatter_if_any
from tracer.transport.weighted.smooth import meet_smooth

__all__ = ["aim_in_volume", "end_faint_ray", "meet"]

Directed = tuple[float, float, float, float, np.uint64]

_VOLUME_SCATTER = int(Event.VOLUME_SCATTER)


@inline_kernel
def meet(
    reduction: VarianceReduction | None, split: SplitRays | None, ray: WeightedRay, optics: Optics,
    tables: F64 | None, at: Interface, way: Way, light: Light, follow: int,
) -> Weighted:  # fmt: skip
    """Let a ray meet a surface: as `meet_surface` in the analog mode, where its weight stays."""
    if reduction is None:
        happened, crosses, dx, dy, dz, code, state = meet_surface(
            optics, tables, at, way, light, follow
        )
        return happened, crosses, dx, dy, dz, code, state, ray.weight
    return _meet_weighted(reduction, split, ray, optics, tables, at, way, light)


@inline_kernel
def aim_in_volume(
    reduction: VarianceReduction | None, event: int, flight: Flight, medium_f: F64,
    tables: F64 | None, medium: int, n_channels: int, weight: float, state: np.uint64,
) -> Directed:  # fmt: skip
    """Aim light that a medium has scattered: direction, weight, state."""
    if reduction is None or tables is None:
        return flight.dx, flight.dy, flight.dz, weight, state
    if event != _VOLUME_SCATTER:
        return flight.dx, flight.dy, flight.dz, weight, state
    return aim_scattered(
        reduction, flight, medium_f[medium, 3 * n_channels :], tables, weight, state
    )


@inline_kernel
def end_faint_ray(
    reduction: VarianceReduction | None, event: int, weight: float, state: np.uint64
) -> tuple[int, float, np.uint64]:
    """Roulette for rays of little weight: one in a few goes on and carries the light of all."""
    if reduction is None:
        return event, weight, state
    return roulette(reduction, event, weight, state)


@inline_kernel
def _meet_weighted(
    reduction: VarianceReduction, split: SplitRays | None, ray: WeightedRay, optics: Optics,
    tables: F64 | None, at: Interface, way: Way, light: Light,
) -> Weighted:  # fmt: skip
    kind = optics.surface_i[at.surface, S_KIND]
    if kind == DIELECTRIC:
        return meet_smooth(reduction, split, ray, optics, tables, at, way, light)
    if kind == LAMBERTIAN:
        return scatter_aimed(reduction, ray, optics, None, at, way, light)
    if tables is not None and optics.surface_i[at.surface, S_DRAW] != 0:
        return _scatter_by_kind(reduction, ray, optics, at, way, light)
    if tables is None or (kind != MIRROR and optics.surface_i[at.surface, S_MEET] == 0):
        return ABSORBED, False, way.dx, way.dy, way.dz, light.code, light.state, ray.weight
    return _meet_analog(reduction, ray, optics, at, way, light)


@inner_kernel
def _scatter_by_kind(
    reduction: VarianceReduction, ray: WeightedRay, optics: Optics, at: Interface, way: Way,
    light: Light,
) -> Weighted:  # fmt: skip
    """Kinds that are called by address: apart, as the loop over rays is slower with them in it."""
    return scatter_aimed(reduction, ray, optics, optics.tables, at, way, light)


@inner_kernel
def _meet_analog(
    reduction: VarianceReduction, ray: WeightedRay, optics: Optics, at: Interface, way: Way,
    light: Light,
) -> Weighted:  # fmt: skip
    """Kinds that reflect or pass light as it comes; what a mirror scatters is aimed."""
    if optics.surface_i[at.surface, S_KIND] != MIRROR:
        happened, crosses, dx, dy, dz, code, state = meet_by_kind(optics, at, way, light)
        return happened, crosses, dx, dy, dz, code, state, ray.weight
    reflected, way, light = reflect_at_mirror(optics, at, way, light)
    if not reflected:
        return ABSORBED, False, way.dx, way.dy, way.dz, light.code, light.state, ray.weight
    scattered, dx, dy, dz, code, state, weight = scatter_if_any(
        reduction, ray, optics, optics.tables, at, False, way, light
    )
    event = GLOSSY_REFLECTION if scattered else SPECULAR_REFLECTION
    return event, False, dx, dy, dz, code, state, weight

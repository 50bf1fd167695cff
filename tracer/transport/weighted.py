"""The weighted mode: what happens at a surface, and with which weight the ray goes on.

Nothing here changes a flux: an outcome that is chosen with another probability than light has
carries the ratio of both as a factor of its weight.

- A reflection at a smooth interface, a scatter by a law of ABg or Harvey-Shack, and light that a
  diffuse surface sends on are chosen with at least the probability ``settings[R_LEAST]``.
- Where the ray may still split (`tracer.transport.splitting`), the reflected part becomes a ray of
  its own and the other part goes on, each with its share.
- Scattered light is aimed with the probability ``settings[R_AIM]``
  (`tracer.transport.weighted_aim`).

References
----------
J. Arvo, D. Kirk, Particle transport and image synthesis, SIGGRAPH 1990 (roulette, splitting).
"""

from __future__ import annotations

import numpy as np

from raymap.jit.kernels import inline_kernel, inner_kernel
from raymap.jit.types import F64, I64
from raymap.model.events import Event
from tracer.compiled import (
    DIELECTRIC,
    FILTER,
    LAMBERTIAN,
    MIRROR,
    RETROREFLECTOR,
    ROUGH_DIELECTRIC,
    ROUGH_MIRROR,
    S_KIND,
    S_SAMPLE,
    TABULATED,
    RareLight,
)
from tracer.rays.random import advance, uniform
from tracer.surfaces.filter import pass_filter
from tracer.surfaces.interaction import Hit, Light, Optics
from tracer.surfaces.meeting import meet_surface
from tracer.surfaces.metals import survive_metal
from tracer.transport.splitting import Twins
from tracer.transport.weighted_aim import aim_scattered, thin_out
from tracer.transport.weighted_law import scatter
from tracer.transport.weighted_rough import meet_diffuse, meet_law, meet_measured, meet_rough
from tracer.transport.weighted_smooth import meet_smooth

__all__ = ["aim_in_volume", "end_faint_ray", "meet"]

Weighted = tuple[int, bool, float, float, float, int, np.uint64, float]
Directed = tuple[float, float, float, float, np.uint64]

_ABSORBED = int(Event.SURFACE_ABSORPTION)
_REFLECTED = int(Event.SPECULAR_REFLECTION)
_GLOSSY_REFLECTION = int(Event.GLOSSY_REFLECTION)
_VOLUME_SCATTER = int(Event.VOLUME_SCATTER)


@inline_kernel
def meet(
    rare: RareLight | None, twins: Twins | None, ray: int, deep: bool, x: float, y: float, z: float,
    weight: float, surface_i: I64, surface_f: F64, medium_i: I64, medium_f: F64,
    tables: F64 | None, surface: int, medium: int, other: int, dx: float, dy: float, dz: float,
    nx: float, ny: float, nz: float, cosine: float, code: int, colors: F64, counters: I64,
    state: np.uint64, follow: int,
) -> Weighted:  # fmt: skip
    """Let a ray meet a surface: as `meet_surface` in the analog mode, where its weight stays."""
    if rare is None:
        happened, crosses, dx, dy, dz, code, state = meet_surface(
            surface_i, surface_f, medium_i, medium_f, tables, surface, medium, other, dx, dy, dz,
            nx, ny, nz, cosine, code, colors, counters, state, follow,
        )  # fmt: skip
        return happened, crosses, dx, dy, dz, code, state, weight
    return _meet_weighted(
        rare, twins, ray, deep, x, y, z, weight, surface_i, surface_f, medium_i, medium_f, tables,
        surface, medium, other, dx, dy, dz, nx, ny, nz, cosine, code, colors, counters, state,
    )  # fmt: skip


@inline_kernel
def aim_in_volume(
    rare: RareLight | None, event: int, x: float, y: float, z: float, ux: float, uy: float,
    uz: float, dx: float, dy: float, dz: float, weight: float, medium_f: F64, tables: F64 | None,
    medium: int, n_channels: int, state: np.uint64,
) -> Directed:  # fmt: skip
    """Aim light that a medium has scattered at (x, y, z) from the direction u to d."""
    if rare is None or tables is None:
        return dx, dy, dz, weight, state
    if event != _VOLUME_SCATTER:
        return dx, dy, dz, weight, state
    return aim_scattered(
        rare, x, y, z, ux, uy, uz, dx, dy, dz, weight, medium_f, tables, medium, n_channels, state
    )


@inline_kernel
def end_faint_ray(
    rare: RareLight | None, event: int, weight: float, state: np.uint64
) -> tuple[int, float, np.uint64]:
    """Roulette for rays of little weight: one in a few goes on and carries the light of all."""
    if rare is None:
        return event, weight, state
    return thin_out(rare, event, weight, state)


@inner_kernel
def _meet_weighted(
    rare: RareLight, twins: Twins | None, ray: int, deep: bool, x: float, y: float, z: float,
    weight: float, surface_i: I64, surface_f: F64, medium_i: I64, medium_f: F64,
    tables: F64 | None, surface: int, medium: int, other: int, dx: float, dy: float, dz: float,
    nx: float, ny: float, nz: float, cosine: float, code: int, colors: F64, counters: I64,
    state: np.uint64,
) -> Weighted:  # fmt: skip
    if cosine > 0.0:
        nx, ny, nz = -nx, -ny, -nz
    cos_i = min(1.0, abs(cosine))
    kind = surface_i[surface, S_KIND]
    if kind == DIELECTRIC:
        return meet_smooth(
            rare, twins, ray, deep, x, y, z, weight, surface_i, surface_f, medium_i, medium_f,
            tables, surface, medium, other, dx, dy, dz, nx, ny, nz, cos_i, code, colors, counters,
            state,
        )  # fmt: skip
    if kind == LAMBERTIAN:
        return meet_diffuse(
            rare, x, y, z, weight, surface_f, surface, dx, dy, dz, nx, ny, nz, code, colors,
            counters, state,
        )  # fmt: skip
    if tables is None:
        return _ABSORBED, False, dx, dy, dz, code, state, weight
    return _meet_scatterer(
        rare, x, y, z, weight, surface_i, surface_f, medium_i, medium_f, tables, surface, medium,
        other, dx, dy, dz, nx, ny, nz, cos_i, code, colors, counters, state,
    )  # fmt: skip


@inner_kernel
def _meet_scatterer(
    rare: RareLight, x: float, y: float, z: float, weight: float, surface_i: I64, surface_f: F64,
    medium_i: I64, medium_f: F64, tables: F64, surface: int, medium: int, other: int, dx: float,
    dy: float, dz: float, nx: float, ny: float, nz: float, cos_i: float, code: int, colors: F64,
    counters: I64, state: np.uint64,
) -> Weighted:  # fmt: skip
    kind = surface_i[surface, S_KIND]
    if kind == MIRROR:
        state = advance(state)
        reflected, code = survive_metal(
            surface_i, surface_f, medium_f, tables, surface, medium, cos_i, code, colors, counters,
            uniform(state),
        )  # fmt: skip
        if not reflected:
            return _ABSORBED, False, dx, dy, dz, code, state, weight
        along = 2.0 * cos_i
        scattered, dx, dy, dz, code, state, weight = scatter(
            rare, x, y, z, weight, surface_i, surface_f, medium_f, tables, surface, medium, other,
            cos_i, False, nx, ny, nz, dx + along * nx, dy + along * ny, dz + along * nz, code,
            colors, counters, state,
        )  # fmt: skip
        event = _GLOSSY_REFLECTION if scattered else _REFLECTED
        return event, False, dx, dy, dz, code, state, weight
    if kind in (ROUGH_DIELECTRIC, ROUGH_MIRROR):
        return meet_rough(
            rare, x, y, z, weight, surface_i, surface_f, medium_i, medium_f, tables, surface,
            medium, other, dx, dy, dz, nx, ny, nz, cos_i, code, colors, counters, state,
        )  # fmt: skip
    if kind == FILTER:
        happened, _, _, _, code, state = pass_filter(
            Optics(surface_i, surface_f, medium_f, tables),
            Hit(surface, medium, other, 0.0, 0.0, cos_i),
            Light(code, colors, counters, state),
        )
        return happened, happened != _ABSORBED, dx, dy, dz, code, state, weight
    if kind in (TABULATED, RETROREFLECTOR):
        return meet_measured(
            rare, x, y, z, weight, surface_i, surface_f, medium_f, tables, surface, medium, other,
            dx, dy, dz, nx, ny, nz, cos_i, code, colors, counters, state,
        )  # fmt: skip
    if surface_i[surface, S_SAMPLE] != 0:
        return meet_law(
            rare, x, y, z, weight, surface_i, surface_f, medium_f, tables, surface, medium, other,
            dx, dy, dz, nx, ny, nz, cos_i, code, colors, counters, state,
        )  # fmt: skip
    return _ABSORBED, False, dx, dy, dz, code, state, weight

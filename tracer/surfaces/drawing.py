"""Scattered light by its density: draw a direction, and weigh one that was chosen otherwise.

One way for all kinds that scatter: Lambertian surfaces are part of the loop that asks, other kinds
are called by address. Nothing is known here of why a direction is chosen.
"""

from __future__ import annotations

from raymap.jit.kernels import inline_kernel, inner_kernel, number
from raymap.jit.types import F64
from tracer.compiled import LAMBERTIAN, S_DRAW, S_KIND, S_WEIGH
from tracer.surfaces.interaction import (
    ABSORBED,
    DIFFUSE_REFLECTION,
    DIFFUSE_TRANSMISSION,
    DRAW,
    GLOSSY_REFLECTION,
    GLOSSY_TRANSMISSION,
    WEIGH,
    Hit,
    Light,
    Optics,
    Outcome,
)
from tracer.surfaces.lambertian import draw_lambertian, weigh_lambertian

__all__ = ["draw_scattered", "event_towards", "weigh_scattered"]

_draw, _weigh = DRAW.call, WEIGH.call

_DIFFUSE = DIFFUSE_REFLECTION | DIFFUSE_TRANSMISSION
_BACK = DIFFUSE_REFLECTION | GLOSSY_REFLECTION
_THROUGH = DIFFUSE_TRANSMISSION | GLOSSY_TRANSMISSION


@inline_kernel
def draw_scattered(optics: Optics, tables: F64 | None, hit: Hit, light: Light) -> Outcome:
    """`tracer.surfaces.interaction.DRAW` of the surface's kind."""
    if optics.surface_i[hit.surface, S_KIND] == LAMBERTIAN:
        return draw_lambertian(optics, hit, light)
    if tables is None:
        return ABSORBED, 0.0, 0.0, 1.0, light.code, light.state
    happened, x, y, z, code, state = _draw(
        optics.surface_i[hit.surface, S_DRAW], (optics, hit, light)
    )
    return happened, x, y, z, code, state


@inline_kernel
def weigh_scattered(
    optics: Optics, tables: F64 | None, hit: Hit, light: Light, x: float, y: float, z: float,
    row: int,
) -> float:  # fmt: skip
    """`tracer.surfaces.interaction.WEIGH` of the surface's kind."""
    if optics.surface_i[hit.surface, S_KIND] == LAMBERTIAN:
        return weigh_lambertian(optics, hit, light, z, row)
    if tables is None:
        return 0.0
    density: float = _weigh(
        optics.surface_i[hit.surface, S_WEIGH], (optics, hit, light, x, y, z, number(row))
    )
    return density


@inner_kernel
def event_towards(event: int, z: float) -> int:
    """What is said to have happened where a direction that was drawn was changed for another."""
    back, through = GLOSSY_REFLECTION, GLOSSY_TRANSMISSION
    if event & _DIFFUSE != 0:
        back, through = DIFFUSE_REFLECTION, DIFFUSE_TRANSMISSION
    return (event & ~(_BACK | _THROUGH)) | (back if z > 0.0 else through)

"""How much light a surface sends in a given direction.

Where the engine draws a direction, this gives the density of all directions: light of unit flux
that arrives becomes ``out[k]`` per solid angle in channel k. Directions without width (mirrors,
smooth interfaces) give nothing.
"""

from __future__ import annotations

import math

from raymap.jit.kernels import inner_kernel, number
from raymap.jit.types import F64
from raymap.optics.frames import frame_about
from tracer.compiled import (
    DIELECTRIC,
    LAMBERTIAN,
    MIRROR,
    S_KIND,
    S_SCATTER,
    S_TOWARDS,
    SURFACE_ROW,
)
from tracer.surfaces.interaction import TOWARDS, Hit, Interface, Optics, Way
from tracer.surfaces.specular import around_specular

__all__ = ["scattered_towards"]

_towards = TOWARDS.call


@inner_kernel
def scattered_towards(
    optics: Optics, tables: F64 | None, at: Interface, way: Way, ox: float, oy: float, oz: float,
    out: F64,
) -> bool:  # fmt: skip
    """Light that goes on its way to o at a surface, per solid angle; False where there is none."""
    cos_o = ox * way.nx + oy * way.ny + oz * way.nz
    kind = optics.surface_i[at.surface, S_KIND]
    n_channels = len(out)
    if kind == LAMBERTIAN:
        share = SURFACE_ROW if cos_o > 0.0 else SURFACE_ROW + n_channels
        for k in range(n_channels):
            out[k] = optics.surface_f[at.surface, share + k] * abs(cos_o) / math.pi
        return True
    if tables is None or at.cos_i <= 0.0 or cos_o == 0.0:
        return False
    # Local frame: z along the normal on the side of the incident ray
    ux, uy, uz, vx, vy, vz = frame_about(way.nx, way.ny, way.nz)
    wx = -(way.dx * ux + way.dy * uy + way.dz * uz)
    wy = -(way.dx * vx + way.dy * vy + way.dz * vz)
    px, py = ox * ux + oy * uy + oz * uz, ox * vx + oy * vy + oz * vz
    hit = Hit(number(at.surface), number(at.medium), number(at.other), wx, wy, at.cos_i)
    if kind in (MIRROR, DIELECTRIC):
        if optics.surface_i[at.surface, S_SCATTER] < 0:
            return False
        return around_specular(optics, hit, px, py, cos_o, out)
    if optics.surface_i[at.surface, S_TOWARDS] == 0:
        return False
    return bool(
        _towards(optics.surface_i[at.surface, S_TOWARDS], (optics, hit, px, py, cos_o, out))
    )

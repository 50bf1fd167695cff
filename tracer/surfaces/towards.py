"""How much light a surface sends in a given direction.

Where the engine draws a direction, this gives the density of all directions: light of unit flux
that arrives becomes ``out[k]`` per solid angle in channel k. Directions without width (mirrors,
smooth interfaces) give nothing.
"""

from __future__ import annotations

import math

from raymap.jit.kernels import inner_kernel, number
from raymap.jit.types import F64, I64
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
from tracer.surfaces.interaction import TOWARDS, Hit, Optics
from tracer.surfaces.specular import around_specular

__all__ = ["scattered_towards"]

_towards = TOWARDS.call


@inner_kernel
def scattered_towards(
    surface_i: I64, surface_f: F64, medium_f: F64, tables: F64 | None, surface: int, medium: int,
    world: int, dx: float, dy: float, dz: float, nx: float, ny: float, nz: float, ox: float,
    oy: float, oz: float, out: F64,
) -> bool:  # fmt: skip
    """Light that goes from d to o at a surface, per solid angle; False where there is none.

    The normal stands outward. Light that crosses is taken to come out into the world's medium:
    elsewhere another face hides the point.
    """
    cosine = dx * nx + dy * ny + dz * nz
    if cosine > 0.0:
        nx, ny, nz = -nx, -ny, -nz
    cos_i = min(1.0, abs(cosine))
    cos_o = ox * nx + oy * ny + oz * nz
    kind = surface_i[surface, S_KIND]
    n_channels = len(out)
    if kind == LAMBERTIAN:
        share = SURFACE_ROW if cos_o > 0.0 else SURFACE_ROW + n_channels
        for k in range(n_channels):
            out[k] = surface_f[surface, share + k] * abs(cos_o) / math.pi
        return True
    if tables is None or cos_i <= 0.0 or cos_o == 0.0:
        return False
    # Local frame: z along the normal on the side of the incident ray
    ux, uy, uz, vx, vy, vz = frame_about(nx, ny, nz)
    ix, iy = -(dx * ux + dy * uy + dz * uz), -(dx * vx + dy * vy + dz * vz)
    px, py = ox * ux + oy * uy + oz * uz, ox * vx + oy * vy + oz * vz
    if kind in (MIRROR, DIELECTRIC):
        if surface_i[surface, S_SCATTER] < 0:
            return False
        return around_specular(
            surface_i, surface_f, medium_f, tables, surface, medium, world, ix, iy, cos_i, px, py,
            cos_o, out,
        )  # fmt: skip
    if surface_i[surface, S_TOWARDS] == 0:
        return False
    return bool(
        _towards(
            surface_i[surface, S_TOWARDS],
            (
                Optics(surface_i, surface_f, medium_f, tables),
                Hit(number(surface), number(medium), number(world), ix, iy, cos_i),
                px,
                py,
                cos_o,
                out,
            ),
        )
    )

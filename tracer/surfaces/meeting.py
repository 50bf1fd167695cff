"""What a surface does with a ray that meets it: one door.

Dielectrics, absorbers, Lambertian surfaces and mirrors are part of the loop that asks; other kinds
are called by address. The ray's direction and the outward normal are as they stand; ``cosine`` is
their product (negative where the ray comes from outside).
"""

from __future__ import annotations

import numpy as np

from raymap.jit.kernels import inline_kernel, inner_kernel, number
from raymap.jit.types import F64, I64
from raymap.optics.frames import frame_about
from tracer.compiled import ABSORBER, DIELECTRIC, LAMBERTIAN, MIRROR, S_KIND, S_MEET
from tracer.surfaces.dielectric import meet_dielectric, scatter_if_specular
from tracer.surfaces.interaction import ABSORBED, MEET, Hit, Light, Optics
from tracer.surfaces.lambertian import meet_lambertian
from tracer.surfaces.mirror import meet_mirror

__all__ = ["Outcome", "by_kind", "meet_surface"]

Outcome = tuple[int, bool, float, float, float, int, np.uint64]
"""Event, whether the ray goes to the other side, direction, colour code, random state."""

_meet = MEET.call


@inline_kernel
def meet_surface(
    surface_i: I64, surface_f: F64, medium_i: I64, medium_f: F64, tables: F64 | None,
    surface: int, medium: int, other: int, dx: float, dy: float, dz: float,
    nx: float, ny: float, nz: float, cosine: float, code: int, colors: F64, counters: I64,
    state: np.uint64, follow: int,
) -> Outcome:  # fmt: skip
    """Let a ray in ``medium`` meet a surface with ``other`` beyond it."""
    # Turn the normal against the ray
    if cosine > 0.0:
        nx, ny, nz = -nx, -ny, -nz
    cos_i = min(1.0, abs(cosine))
    kind = surface_i[surface, S_KIND]
    if kind == DIELECTRIC:
        happened, crosses, dx, dy, dz, code, state = meet_dielectric(
            surface_i, surface_f, medium_i, medium_f, tables, surface, medium, other, dx, dy, dz,
            nx, ny, nz, cos_i, code, colors, counters, state, follow,
        )  # fmt: skip
        if tables is not None:
            happened, dx, dy, dz, code, state = scatter_if_specular(
                surface_i, surface_f, medium_f, tables, surface, medium, other, cos_i, happened,
                crosses, nx, ny, nz, dx, dy, dz, code, colors, counters, state,
            )  # fmt: skip
        return happened, crosses, dx, dy, dz, code, state
    if kind == ABSORBER:
        return ABSORBED, False, dx, dy, dz, code, state
    if kind == LAMBERTIAN:
        return meet_lambertian(
            surface_f, surface, dx, dy, dz, nx, ny, nz, code, colors, counters, state
        )
    if tables is None:
        return ABSORBED, False, dx, dy, dz, code, state
    if kind == MIRROR:
        return meet_mirror(
            surface_i, surface_f, medium_f, tables, surface, medium, dx, dy, dz, nx, ny, nz, cos_i,
            code, colors, counters, state,
        )  # fmt: skip
    return by_kind(
        surface_i, surface_f, medium_f, tables, surface, medium, other, dx, dy, dz, nx, ny, nz,
        cos_i, code, colors, counters, state,
    )  # fmt: skip


@inner_kernel
def by_kind(
    surface_i: I64, surface_f: F64, medium_f: F64, tables: F64, surface: int, medium: int,
    other: int, dx: float, dy: float, dz: float, nx: float, ny: float, nz: float, cos_i: float,
    code: int, colors: F64, counters: I64, state: np.uint64,
) -> Outcome:  # fmt: skip
    """Ask the kind of the surface; the normal stands against the ray."""
    # Local frame: z along the normal on the side of the incident ray
    ux, uy, uz, vx, vy, vz = frame_about(nx, ny, nz)
    wx, wy = -(dx * ux + dy * uy + dz * uz), -(dx * vx + dy * vy + dz * vz)
    happened, x, y, z, code, state = _meet(
        surface_i[surface, S_MEET],
        (
            Optics(surface_i, surface_f, medium_f, tables),
            Hit(number(surface), number(medium), number(other), wx, wy, cos_i),
            Light(number(code), colors, counters, state),
        ),
    )
    if happened == ABSORBED:
        return happened, False, dx, dy, dz, code, state
    if x == 0.0 and y == 0.0 and z == 0.0:
        return happened, True, dx, dy, dz, code, state
    dx, dy, dz = x * ux + y * vx + z * nx, x * uy + y * vy + z * ny, x * uz + y * vz + z * nz
    return happened, z < 0.0, dx, dy, dz, code, state

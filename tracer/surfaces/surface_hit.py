"""What a surface does with a ray that meets it: one door for light that is drawn as it behaves.

Dielectrics, absorbers, Lambertian surfaces and mirrors are part of the loop that asks; other kinds
are called by address.
"""

from __future__ import annotations

from raymap.jit.kernels import inline_kernel, inner_kernel, number
from raymap.jit.types import F64
from raymap.optics.frames import frame_about
from tracer.compiled import ABSORBER, DIELECTRIC, LAMBERTIAN, MIRROR, S_KIND, S_MEET
from tracer.surfaces.dielectric import meet_dielectric, scatter_if_specular
from tracer.surfaces.interaction import (
    ABSORBED,
    MEET,
    Hit,
    Interaction,
    Interface,
    Light,
    Optics,
    Way,
)
from tracer.surfaces.lambertian import meet_lambertian
from tracer.surfaces.mirror import meet_mirror

__all__ = ["meet_by_kind", "meet_surface"]

_meet = MEET.call


@inline_kernel
def meet_surface(
    optics: Optics, tables: F64 | None, at: Interface, way: Way, light: Light, follow: int
) -> Interaction:
    """Let a ray meet a surface. The compiler leaves out what no scene without ``tables`` needs."""
    kind = optics.surface_i[at.surface, S_KIND]
    if kind == DIELECTRIC:
        met = meet_dielectric(optics, at, way, light, follow)
        if tables is not None:
            met = scatter_if_specular(optics, at, way, light, met)
        return met
    if kind == ABSORBER:
        return ABSORBED, False, way.dx, way.dy, way.dz, light.code, light.state
    if kind == LAMBERTIAN:
        return meet_lambertian(optics, at.surface, way, light)
    if tables is None:
        return ABSORBED, False, way.dx, way.dy, way.dz, light.code, light.state
    if kind == MIRROR:
        return meet_mirror(optics, at, way, light)
    return meet_by_kind(optics, at, way, light)


@inner_kernel
def meet_by_kind(optics: Optics, at: Interface, way: Way, light: Light) -> Interaction:
    """Ask the kind of the surface."""
    # Local frame: z along the normal on the side of the incident ray
    nx, ny, nz = way.nx, way.ny, way.nz
    ux, uy, uz, vx, vy, vz = frame_about(nx, ny, nz)
    wx = -(way.dx * ux + way.dy * uy + way.dz * uz)
    wy = -(way.dx * vx + way.dy * vy + way.dz * vz)
    happened, x, y, z, code, state = _meet(
        optics.surface_i[at.surface, S_MEET],
        (
            optics,
            Hit(number(at.surface), number(at.medium), number(at.other), wx, wy, at.cos_i),
            Light(number(light.code), light.colors, light.counters, light.state),
        ),
    )
    if happened == ABSORBED:
        return happened, False, way.dx, way.dy, way.dz, code, state
    if x == 0.0 and y == 0.0 and z == 0.0:
        return happened, True, way.dx, way.dy, way.dz, code, state
    dx, dy, dz = x * ux + y * vx + z * nx, x * uy + y * vy + z * ny, x * uz + y * vz + z * nz
    return happened, z < 0.0, dx, dy, dz, code, state

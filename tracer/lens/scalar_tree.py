"""The tree of an unpolarised ray in a lens, compiled: fluxes only.

Every hit takes the mean of both reflectances. That forgets that a first refraction polarises
light, which the next hit feels: `tracer.lens.forward` offers the exact mean of two orthogonal
polarised trees beside it. Schlick's approximation is here for comparison.
"""

from __future__ import annotations

import math

from raymap.jit.kernels import inner_kernel, lean_kernel
from raymap.optics.fresnel import fresnel_reflectance, reflect, refract, schlick_reflectance
from tracer.lens.arrays import (
    NodeArrays,
    RayArrays,
    TreeOptions,
    starting_distance,
    to_lens,
    to_world,
)
from tracer.lens.hits import cap_normal, enter, inner_hit, unit
from tracer.lens.shape import BACK, RIM, LensShape

__all__ = ["SCHLICK_RULES", "grow_scalar"]

SCHLICK_RULES = 1


@inner_kernel
def _clear(nodes: NodeArrays, ray: int, level: int) -> None:
    nodes.face[ray, level] = -1
    nodes.flux[ray, level] = 0.0
    nodes.path[ray, level] = 0.0
    for axis in range(3):
        nodes.point[ray, level, axis] = 0.0
        nodes.direction[ray, level, axis] = 0.0


@inner_kernel
def _grow_one(
    shape: LensShape, rays: RayArrays, options: TreeOptions, nodes: NodeArrays, ray: int
) -> None:
    frame = rays.frame
    depth = options.depth
    code = rays.medium[ray]
    n_out, n_glass, mu = (
        rays.outside_index[code],
        rays.glass_index[code],
        rays.absorption[code],
    )

    # Bring the ray into the frame of the lens and meet it from outside
    x, y, z = to_lens(
        frame,
        rays.origin[ray, 0] - frame[3, 0],
        rays.origin[ray, 1] - frame[3, 1],
        rays.origin[ray, 2] - frame[3, 2],
    )
    dx, dy, dz = to_lens(
        frame, rays.direction[ray, 0], rays.direction[ray, 1], rays.direction[ray, 2]
    )
    inx, iny, inz = dx, dy, dz
    inside = rays.flux[ray]
    threshold = options.min_share * inside
    skip = starting_distance(shape, x, y, z, dx, dy, dz)
    x, y, z = x + skip * dx, y + skip * dy, z + skip * dz
    face, t = enter(shape, x, y, z, dx, dy, dz)
    nodes.status[ray] = face
    nodes.absorbed_rim[ray] = 0.0
    if face < 0:
        for rest in range(depth):
            _clear(nodes, ray, rest)
        nodes.absorbed_glass[ray] = 0.0
        nodes.suppressed[ray] = 0.0
        nodes.remainder[ray] = 0.0
        return
    x, y, z = x + t * dx, y + t * dy, z + t * dz
    path = rays.path[ray]
    if options.path_from_origin:
        path += n_out * (skip + t)

    n1, n2 = n_out, n_glass
    absorbed, suppressed = 0.0, 0.0
    level = 0
    while True:
        # Note the hit
        _clear(nodes, ray, level)
        wx, wy, wz = to_world(frame, x, y, z)
        nodes.face[ray, level] = face
        nodes.point[ray, level, 0] = wx + frame[3, 0]
        nodes.point[ray, level, 1] = wy + frame[3, 1]
        nodes.point[ray, level, 2] = wz + frame[3, 2]
        if face == RIM:
            nodes.absorbed_rim[ray] = inside
            inside = 0.0
            break

        # Split the light at the cap, the normal turned against the ray
        curvature, zv = shape.curvature_front, z
        if face == BACK:
            curvature, zv = shape.curvature_back, z - shape.thickness
        nx, ny, nz = cap_normal(curvature, x, y, zv)
        if dx * nx + dy * ny + dz * nz > 0.0:
            nx, ny, nz = -nx, -ny, -nz
        cos_i = -(dx * nx + dy * ny + dz * nz)
        if options.rules == SCHLICK_RULES:
            reflectance = schlick_reflectance(n1, n2, cos_i)
        else:
            reflectance = fresnel_reflectance(n1, n2, cos_i)
        ux, uy, uz = reflect(dx, dy, dz, nx, ny, nz)
        vx, vy, vz, cos_t = refract(dx, dy, dz, nx, ny, nz, n1 / n2)
        reflected = reflectance * inside
        refracted = inside - reflected if cos_t > 0.0 else 0.0

        # At the first level the reflected ray leaves, then the refracted one
        if level == 0:
            out, ox, oy, oz = reflected, ux, uy, uz
            inside, dx, dy, dz = refracted, vx, vy, vz
            keep = options.keep_reflection
            n1, n2 = n_glass, n_out
        else:
            out, ox, oy, oz = refracted, vx, vy, vz
            inside, dx, dy, dz = reflected, ux, uy, uz
            keep = True
        if not options.keep_backward and ox * inx + oy * iny + oz * inz < 0.0:
            keep = False
        if keep and out > threshold:
            wx, wy, wz = to_world(frame, ox, oy, oz)
            nodes.direction[ray, level, 0] = wx
            nodes.direction[ray, level, 1] = wy
            nodes.direction[ray, level, 2] = wz
            nodes.flux[ray, level] = out
            nodes.path[ray, level] = path
        else:
            suppressed += out
        dx, dy, dz = unit(dx, dy, dz)
        level += 1
        if level == depth or inside <= threshold:
            break

        # Go on inside the glass
        face, t = inner_hit(shape, face, x, y, z, dx, dy, dz)
        x, y, z = x + t * dx, y + t * dy, z + t * dz
        path += n_glass * t
        if mu > 0.0 and t > 0.0:
            left = inside * math.exp(-mu * t)
            absorbed += inside - left
            inside = left

    for rest in range(level + 1 if face == RIM else level, depth):
        _clear(nodes, ray, rest)
    nodes.absorbed_glass[ray] = absorbed
    nodes.suppressed[ray] = suppressed
    nodes.remainder[ray] = inside


@lean_kernel
def grow_scalar(
    shape: LensShape, rays: RayArrays, options: TreeOptions, nodes: NodeArrays,
    start: int, stop: int,
) -> None:  # fmt: skip
    """Grow the trees of rays start .. stop."""
    for ray in range(start, stop):
        _grow_one(shape, rays, options, nodes, ray)

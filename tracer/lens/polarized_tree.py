"""The tree of a polarised ray in a lens, compiled: one call for a batch.

The lens is convex or a meniscus with one inner ray at a time, so the tree is a chain: each hit
of a cap lets at most one ray out and keeps at most one inside. Level k is the k-th hit.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inner_kernel, lean_kernel
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
from tracer.optics.polarization_fresnel import Wave, split_field

__all__ = ["PUBLISHED_RULES", "grow_polarized"]

PUBLISHED_RULES = 1


@inner_kernel
def power(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> float:
    """Squared length of a field a + i b."""
    return ax * ax + ay * ay + az * az + bx * bx + by * by + bz * bz


@inner_kernel
def _clear(nodes: NodeArrays, ray: int, level: int) -> None:
    """Zero the exit of a node that lets no light out."""
    nodes.half_waves[ray, level] = 0
    nodes.flux[ray, level] = 0.0
    nodes.path[ray, level] = 0.0
    nodes.tube[ray, level] = 0.0
    for axis in range(3):
        nodes.direction[ray, level, axis] = 0.0
        nodes.field[ray, level, axis] = 0.0


@inner_kernel
def _end(nodes: NodeArrays, ray: int, level: int, depth: int) -> None:
    """Zero the places of a tree from a level on."""
    for rest in range(level, depth):
        _clear(nodes, ray, rest)
        nodes.face[ray, rest] = -1
        for axis in range(3):
            nodes.point[ray, rest, axis] = 0.0


@inner_kernel
def _meet(
    nodes: NodeArrays, frame: NDArray[np.float64], ray: int, level: int, face: int,
    x: float, y: float, z: float,
) -> None:  # fmt: skip
    """Note a hit of a face."""
    wx, wy, wz = to_world(frame, x, y, z)
    nodes.face[ray, level] = face
    nodes.point[ray, level, 0] = wx + frame[3, 0]
    nodes.point[ray, level, 1] = wy + frame[3, 1]
    nodes.point[ray, level, 2] = wz + frame[3, 2]


@inner_kernel
def _leave(
    nodes: NodeArrays, frame: NDArray[np.float64], ray: int, level: int, wave: Wave, flux: float,
    path: float, tube: float, half_waves: int,
) -> None:  # fmt: skip
    """Write the exit of a node."""
    ax, ay, az, bx, by, bz, dx, dy, dz = wave
    wx, wy, wz = to_world(frame, dx, dy, dz)
    nodes.direction[ray, level, 0] = wx
    nodes.direction[ray, level, 1] = wy
    nodes.direction[ray, level, 2] = wz
    rx, ry, rz = to_world(frame, ax, ay, az)
    ix, iy, iz = to_world(frame, bx, by, bz)
    nodes.field[ray, level, 0] = complex(rx, ix)
    nodes.field[ray, level, 1] = complex(ry, iy)
    nodes.field[ray, level, 2] = complex(rz, iz)
    nodes.flux[ray, level] = flux
    nodes.path[ray, level] = path
    nodes.tube[ray, level] = tube
    nodes.half_waves[ray, level] = half_waves


@inner_kernel
def _grow_one(
    shape: LensShape, rays: RayArrays, options: TreeOptions, nodes: NodeArrays, ray: int
) -> None:
    frame = rays.frame
    depth = options.depth
    published = options.rules == PUBLISHED_RULES
    code = rays.medium[ray]
    n_out, n_glass, mu = (
        rays.outside_index[code],
        rays.glass_index[code],
        rays.absorption[code],
    )

    # Bring the ray into the frame of the lens
    x, y, z = to_lens(
        frame,
        rays.origin[ray, 0] - frame[3, 0],
        rays.origin[ray, 1] - frame[3, 1],
        rays.origin[ray, 2] - frame[3, 2],
    )
    dx, dy, dz = to_lens(
        frame, rays.direction[ray, 0], rays.direction[ray, 1], rays.direction[ray, 2]
    )
    fx, fy, fz = rays.field[ray, 0], rays.field[ray, 1], rays.field[ray, 2]
    ax, ay, az = to_lens(frame, fx.real, fy.real, fz.real)
    bx, by, bz = to_lens(frame, fx.imag, fy.imag, fz.imag)
    inx, iny, inz = dx, dy, dz
    incident = power(ax, ay, az, bx, by, bz)
    threshold = options.min_share * incident

    # Meet the lens from outside
    skip = starting_distance(shape, x, y, z, dx, dy, dz)
    x, y, z = x + skip * dx, y + skip * dy, z + skip * dz
    face, t = enter(shape, x, y, z, dx, dy, dz)
    nodes.status[ray] = face
    nodes.absorbed_glass[ray] = 0.0
    nodes.absorbed_rim[ray] = 0.0
    nodes.suppressed[ray] = 0.0
    nodes.remainder[ray] = 0.0
    if face < 0:
        _end(nodes, ray, 0, depth)
        return
    x, y, z = x + t * dx, y + t * dy, z + t * dz
    path = rays.path[ray]
    if options.path_from_origin:
        path += n_out * (skip + t)

    n1, n2 = n_out, n_glass
    tube, half_waves = 1.0, 0
    absorbed, suppressed = 0.0, 0.0
    inside = incident
    level = 0
    while True:
        _meet(nodes, frame, ray, level, face, x, y, z)
        if face == RIM:
            _clear(nodes, ray, level)
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
        (
            rcx, rcy, rcz, rdx, rdy, rdz, ux, uy, uz,
            tax, tay, taz, tbx, tby, tbz, vx, vy, vz, factor, jumped,
        ) = split_field(
            Wave(ax, ay, az, bx, by, bz, dx, dy, dz), nx, ny, nz, n1, n2, published
        )  # fmt: skip

        # What leaves: at the first level the reflected ray, then the refracted one
        if level == 0:
            out_flux = power(rcx, rcy, rcz, rdx, rdy, rdz)
            keep = options.keep_reflection and out_flux > threshold
            if not options.keep_backward and ux * inx + uy * iny + uz * inz < 0.0:
                keep = False
            if keep:
                wave = Wave(rcx, rcy, rcz, rdx, rdy, rdz, ux, uy, uz)
                turns = 1 if jumped else 0
                _leave(nodes, frame, ray, level, wave, out_flux, path, 1.0, turns)
            ax, ay, az, bx, by, bz, dx, dy, dz = tax, tay, taz, tbx, tby, tbz, vx, vy, vz
            tube = factor
            n1, n2 = n_glass, n_out
        else:
            out_flux = power(tax, tay, taz, tbx, tby, tbz)
            keep = out_flux > threshold
            if not options.keep_backward and vx * inx + vy * iny + vz * inz < 0.0:
                keep = False
            if keep:
                wave = Wave(tax, tay, taz, tbx, tby, tbz, vx, vy, vz)
                _leave(nodes, frame, ray, level, wave, out_flux, path, tube * factor, half_waves)
            ax, ay, az, bx, by, bz, dx, dy, dz = rcx, rcy, rcz, rdx, rdy, rdz, ux, uy, uz
            half_waves += 1 if jumped else 0
        if not keep:
            suppressed += out_flux
            _clear(nodes, ray, level)
        dx, dy, dz = unit(dx, dy, dz)
        inside = power(ax, ay, az, bx, by, bz)
        level += 1
        if level == depth or inside <= threshold:
            break

        # Go on inside the glass
        face, t = inner_hit(shape, face, x, y, z, dx, dy, dz)
        x, y, z = x + t * dx, y + t * dy, z + t * dz
        path += n_glass * t
        if mu > 0.0 and t > 0.0:
            fade = math.exp(-0.5 * mu * t)
            ax, ay, az, bx, by, bz = (
                fade * ax, fade * ay, fade * az, fade * bx, fade * by, fade * bz
            )  # fmt: skip
            left = inside * (fade * fade)
            absorbed += inside - left
            inside = left

    _end(nodes, ray, level + 1 if face == RIM else level, depth)
    nodes.absorbed_glass[ray] = absorbed
    nodes.suppressed[ray] = suppressed
    nodes.remainder[ray] = inside


@lean_kernel
def grow_polarized(
    shape: LensShape, rays: RayArrays, options: TreeOptions, nodes: NodeArrays,
    start: int, stop: int,
) -> None:  # fmt: skip
    """Grow the trees of rays start .. stop."""
    for ray in range(start, stop):
        _grow_one(shape, rays, options, nodes, ray)

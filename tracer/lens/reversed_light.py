"""Light against the rays of a tree: from an exit back to where the tree was started, compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inner_kernel, lean_kernel
from raymap.optics.fresnel import reflect, refract
from tracer.lens.arrays import RayArrays, starting_distance, to_lens, to_world
from tracer.lens.hits import cap_normal, enter, inner_hit, unit
from tracer.lens.shape import BACK, RIM, LensShape
from tracer.optics.polarization_fresnel import Wave, split_field

__all__ = ["ArrivingLight", "Chain", "send_back"]

Real = NDArray[np.float64]


@inner_kernel
def _chain(
    shape: LensShape, rays: RayArrays, ray: int, level: int, normals: Real, directions: Real,
    lengths: Real,
) -> bool:  # fmt: skip
    """Follow the ray of a tree to a level: outward sense, no light yet.

    Writes for every hit the normal against the ray, the ray's direction before it and the
    length of the piece before it; the last row of ``directions`` is the exit.
    """
    frame = rays.frame
    code = rays.medium[ray]
    n_out, n_glass = rays.outside_index[code], rays.glass_index[code]
    x, y, z = to_lens(
        frame,
        rays.origin[ray, 0] - frame[3, 0],
        rays.origin[ray, 1] - frame[3, 1],
        rays.origin[ray, 2] - frame[3, 2],
    )
    dx, dy, dz = to_lens(
        frame, rays.direction[ray, 0], rays.direction[ray, 1], rays.direction[ray, 2]
    )
    skip = starting_distance(shape, x, y, z, dx, dy, dz)
    x, y, z = x + skip * dx, y + skip * dy, z + skip * dz
    face, t = enter(shape, x, y, z, dx, dy, dz)
    if face < 0 or face == RIM:
        return False
    x, y, z = x + t * dx, y + t * dy, z + t * dz
    lengths[0] = skip + t
    for step in range(level):
        curvature, zv = shape.curvature_front, z
        if face == BACK:
            curvature, zv = shape.curvature_back, z - shape.thickness
        nx, ny, nz = cap_normal(curvature, x, y, zv)
        if dx * nx + dy * ny + dz * nz > 0.0:
            nx, ny, nz = -nx, -ny, -nz
        normals[step, 0], normals[step, 1], normals[step, 2] = nx, ny, nz
        directions[step, 0], directions[step, 1], directions[step, 2] = dx, dy, dz
        first, last = step == 0, step == level - 1
        through = first != last  # a reflection at once, and every inner one, stays on its side
        if through:
            eta = n_out / n_glass if first else n_glass / n_out
            dx, dy, dz, cos_t = refract(dx, dy, dz, nx, ny, nz, eta)
            if cos_t <= 0.0:
                return False
        else:
            dx, dy, dz = reflect(dx, dy, dz, nx, ny, nz)
        dx, dy, dz = unit(dx, dy, dz)
        if not last:
            face, t = inner_hit(shape, face, x, y, z, dx, dy, dz)
            if face == RIM:
                return False
            x, y, z = x + t * dx, y + t * dy, z + t * dz
            lengths[step + 1] = t
    directions[level, 0], directions[level, 1], directions[level, 2] = dx, dy, dz
    return True


class ArrivingLight(NamedTuple):
    """Light that arrives at exits of trees, a row each.

    root, level, field : ray of the tree, level of the exit, (n, 3) field that arrives
    path : optical path, to which the way through the lens is added
    sent, half_waves : (n, 3) field at the root and its half waves, written
    """

    root: NDArray[np.int64]
    level: NDArray[np.int64]
    field: NDArray[np.complex128]
    path: Real
    sent: NDArray[np.complex128]
    half_waves: NDArray[np.int64]


class Chain(NamedTuple):
    """Normals, directions and lengths along one way through the lens, down to its level."""

    normals: Real
    directions: Real
    lengths: Real


@lean_kernel
def send_back(
    shape: LensShape, rays: RayArrays, published: bool, to_origin: bool, light: ArrivingLight,
    chain: Chain, start: int, stop: int,
) -> int:  # fmt: skip
    """Carry arriving light through the lens to the roots of its trees.

    Fills fields and half waves and adds to paths in rows start .. stop. ``chain`` is scratch.
    Returns the first row whose tree has no such exit, or -1.
    """
    root, levels, arriving = light.root, light.level, light.field
    path, field, half_waves = light.path, light.sent, light.half_waves
    normals, directions, lengths = chain
    frame = rays.frame
    for row in range(start, stop):
        ray, level = root[row], levels[row]
        if not _chain(shape, rays, ray, level, normals, directions, lengths):
            return row
        code = rays.medium[ray]
        n_out, n_glass, mu = (
            rays.outside_index[code],
            rays.glass_index[code],
            rays.absorption[code],
        )
        fx, fy, fz = arriving[row, 0], arriving[row, 1], arriving[row, 2]
        ax, ay, az = to_lens(frame, fx.real, fy.real, fz.real)
        bx, by, bz = to_lens(frame, fx.imag, fy.imag, fz.imag)
        turns = 0
        for step in range(level - 1, -1, -1):
            # Light runs against the direction of the tree; the normal against the light
            dx, dy, dz = (
                -directions[step + 1, 0],
                -directions[step + 1, 1],
                -directions[step + 1, 2],
            )
            nx, ny, nz = normals[step, 0], normals[step, 1], normals[step, 2]
            if dx * nx + dy * ny + dz * nz > 0.0:
                nx, ny, nz = -nx, -ny, -nz
            first, last = step == 0, step == level - 1
            n1, n2 = n_glass, n_out
            if last:
                n1, n2 = n_out, n_glass
            # Columns 0 .. 5 hold the reflected field, 9 .. 14 the refracted one
            wave = Wave(ax, ay, az, bx, by, bz, dx, dy, dz)
            parts = split_field(wave, nx, ny, nz, n1, n2, published)
            if first != last:
                ax, ay, az, bx, by, bz = (
                    parts[9], parts[10], parts[11], parts[12], parts[13], parts[14]
                )  # fmt: skip
            else:
                ax, ay, az, bx, by, bz = (
                    parts[0], parts[1], parts[2], parts[3], parts[4], parts[5]
                )  # fmt: skip
                turns += 1 if parts[19] else 0
            if step > 0:
                length = lengths[step]
                path[row] += n_glass * length
                if mu > 0.0 and length > 0.0:
                    fade = math.exp(-0.5 * mu * length)
                    ax, ay, az, bx, by, bz = (
                        fade * ax, fade * ay, fade * az, fade * bx, fade * by, fade * bz
                    )  # fmt: skip
        if to_origin:
            path[row] += n_out * lengths[0]
        rx, ry, rz = to_world(frame, ax, ay, az)
        ix, iy, iz = to_world(frame, bx, by, bz)
        field[row, 0], field[row, 1], field[row, 2] = (
            complex(rx, ix),
            complex(ry, iy),
            complex(rz, iz),
        )
        half_waves[row] = turns
    return -1

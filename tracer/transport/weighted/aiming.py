"""Directions aimed at targets, and their density.

A target is a rectangle, a flat ring, or the sphere about anything else. From where a target can be
met on the wanted side of a surface it is a candidate; one candidate is drawn, and a direction to a
place on it, so that the density of a direction is the mean over the candidates. Rectangles and
rings are sampled by area (density distance² / (area · cosine)), spheres by solid angle.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from raymap.jit.kernels import inner_kernel, lean_kernel
from raymap.jit.types import F64
from raymap.optics.angles import turned
from tracer.compiled import TARGET_RECTANGLE, TARGET_SPHERE
from tracer.rays.directions import about, sample_uniform_cone, sine_of

__all__ = ["Start", "aim_at", "count_targets", "pdf_aim"]


class Start(NamedTuple):
    """Where aimed light starts: a point, the normal n of a surface there, and whether light goes
    only to its side."""

    x: float
    y: float
    z: float
    nx: float
    ny: float
    nz: float
    horizon: bool


@inner_kernel
def _is_candidate(s: F64, start: Start) -> bool:
    """Whether light from a point can reach a target: above the horizon, on its seeing side."""
    wx, wy, wz = s[1] - start.x, s[2] - start.y, s[3] - start.z
    reach = s[15]
    if s[0] == TARGET_SPHERE:
        if wx * wx + wy * wy + wz * wz <= reach * reach * (1.0 + 1e-9):
            return False
    elif s[16] > 0.0 and wx * s[4] + wy * s[5] + wz * s[6] >= 0.0:
        return False
    return not start.horizon or wx * start.nx + wy * start.ny + wz * start.nz > -reach


@lean_kernel
def count_targets(targets: F64, start: Start) -> int:
    """How many targets can be met from a point."""
    count = 0
    for k in range(len(targets)):
        count += _is_candidate(targets[k], start)
    return count


@lean_kernel
def aim_at(
    targets: F64, start: Start, count: int, u0: float, u1: float, u2: float
) -> tuple[float, float, float]:
    """Unit direction from a point to a place on one of its ``count`` candidates (at least one)."""
    wanted = min(count - 1, int(u0 * count))
    chosen = 0
    for k in range(len(targets)):
        if _is_candidate(targets[k], start):
            if wanted == 0:
                chosen = k
                break
            wanted -= 1
    s = targets[chosen]
    wx, wy, wz = s[1] - start.x, s[2] - start.y, s[3] - start.z
    if s[0] == TARGET_SPHERE:
        square = wx * wx + wy * wy + wz * wz
        scale = 1.0 / math.sqrt(square)
        cos_max = math.sqrt(1.0 - s[15] * s[15] / square)
        cosine = sample_uniform_cone(u1, cos_max)
        return about(wx * scale, wy * scale, wz * scale, cosine, sine_of(cosine), u2)
    if s[0] == TARGET_RECTANGLE:
        a, b = (2.0 * u1 - 1.0) * s[13], (2.0 * u2 - 1.0) * s[14]
    else:
        radius = math.sqrt(s[13] * s[13] + u1 * (s[14] * s[14] - s[13] * s[13]))
        cosine, sine = turned(u2)
        a, b = radius * cosine, radius * sine
    wx += a * s[7] + b * s[10]
    wy += a * s[8] + b * s[11]
    wz += a * s[9] + b * s[12]
    scale = 1.0 / math.sqrt(wx * wx + wy * wy + wz * wz)
    return wx * scale, wy * scale, wz * scale


@lean_kernel
def pdf_aim(targets: F64, start: Start, count: int, dx: float, dy: float, dz: float) -> float:
    """Density of `aim_at` per solid angle at the unit direction d."""
    total = 0.0
    for k in range(len(targets)):
        s = targets[k]
        if not _is_candidate(s, start):
            continue
        wx, wy, wz = s[1] - start.x, s[2] - start.y, s[3] - start.z
        if s[0] == TARGET_SPHERE:
            square = wx * wx + wy * wy + wz * wz
            share = s[15] * s[15] / square
            cos_max = math.sqrt(1.0 - share)
            if (wx * dx + wy * dy + wz * dz) / math.sqrt(square) >= cos_max:
                total += (1.0 + cos_max) / (2.0 * math.pi * share)
            continue
        # Find where the direction meets the plane of the target
        cosine = dx * s[4] + dy * s[5] + dz * s[6]
        t = (wx * s[4] + wy * s[5] + wz * s[6]) / cosine
        if not 0.0 < t < math.inf:
            continue
        px, py, pz = t * dx - wx, t * dy - wy, t * dz - wz
        if s[0] == TARGET_RECTANGLE:
            a = abs(px * s[7] + py * s[8] + pz * s[9])
            b = abs(px * s[10] + py * s[11] + pz * s[12])
            met = a <= s[13] and b <= s[14]
            area = 4.0 * s[13] * s[14]
        else:
            square = px * px + py * py + pz * pz
            met = s[13] * s[13] <= square <= s[14] * s[14]
            area = math.pi * (s[14] * s[14] - s[13] * s[13])
        if met:
            total += t * t / (area * abs(cosine))
    return total / count

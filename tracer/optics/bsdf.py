"""Draws directions from diffuse, retroreflecting and measured surfaces (`raymap.laws`).

Frame and convention as in `tracer.optics.microfacet`: z = normal on the side of the incident ray,
``wi`` back along it, ``wo`` along the scattered ray, wo_z < 0 where it is transmitted; ``pdf_*`` is
the density per solid angle of ``sample_*``.
"""

from __future__ import annotations

import math

from raymap.jit.kernels import lean_kernel
from raymap.jit.types import F64
from raymap.laws.tabulated import (
    BSDF_HEAD,
    N_AZIMUTHS,
    N_INCIDENT,
    N_SCATTERED,
    PHI_SPAN,
    eval_tabulated,
    incidence_slice,
    tabulated_share,
)
from raymap.optics.angles import turned
from raymap.optics.frames import frame_about

__all__ = [
    "pdf_lambert",
    "pdf_tabulated",
    "sample_lambert",
    "sample_retro",
    "sample_tabulated",
]

Vector = tuple[float, float, float]


@lean_kernel
def sample_lambert(u1: float, u2: float, side: float) -> Vector:
    """A direction with density cos / pi; ``side`` = 1 reflected, -1 transmitted."""
    radius = math.sqrt(u1)
    cosine, sine = turned(u2)
    return radius * cosine, radius * sine, side * math.sqrt(max(0.0, 1.0 - u1))


@lean_kernel
def pdf_lambert(wo_z: float, side: float) -> float:
    """Density of `sample_lambert` per solid angle."""
    return max(0.0, side * wo_z) / math.pi


@lean_kernel
def sample_retro(
    wi_x: float, wi_y: float, wi_z: float, cos_spread: float, u1: float, u2: float
) -> Vector:
    """A direction uniform in the cone of cosine ``cos_spread`` about the way back.

    Directions behind the surface are mirrored to the front. ``cos_spread`` = 1: exactly back.
    """
    if cos_spread >= 1.0:
        return wi_x, wi_y, wi_z
    cosine = 1.0 - u1 * (1.0 - cos_spread)
    sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
    along, across = turned(u2)
    x, y = sine * along, sine * across
    ux, uy, uz, vx, vy, vz = frame_about(wi_x, wi_y, wi_z)
    ox = x * ux + y * vx + cosine * wi_x
    oy = x * uy + y * vy + cosine * wi_y
    oz = x * uz + y * vz + cosine * wi_z
    return ox, oy, abs(oz)


@lean_kernel
def sample_tabulated(
    table: F64, first: int, wi_x: float, wi_y: float, wi_z: float, u1: float, u2: float, u3: float,
    side: float,
) -> Vector:  # fmt: skip
    """A direction scattered by a tabulated BSDF.

    Parameters
    ----------
    table, first : flat pool and where the table of `tabulated_bsdf` stands in it
    wi_x, wi_y, wi_z : direction back along the incident ray
    u1, u2, u3 : uniform numbers
    side : 1 for a table of reflection, -1 of transmission

    Returns
    -------
    wo_x, wo_y, wo_z : its density is f |wo_z| / `tabulated_share`
    """
    n = int(table[first + N_INCIDENT])
    n_o, n_phi = int(table[first + N_SCATTERED]), int(table[first + N_AZIMUTHS])
    # Between two angles of incidence f is a mixture: choose one of the slices
    low, weight = incidence_slice(table, first, wi_z)
    if weight > 0.0:
        at = first + BSDF_HEAD + n
        upper = weight * table[at + low + 1]
        total = (1.0 - weight) * table[at + low] + upper
        share = upper / total if total > 0.0 else 1.0
        if u1 < share:
            low += 1
            u1 /= share
        else:
            u1 = (u1 - share) / (1.0 - share)
    # Choose a cell of the slice
    edges = first + BSDF_HEAD + 2 * n
    cells = n_o * n_phi
    cumulative = edges + n_o + 1 + low * 2 * cells
    a, b = -1, cells - 1
    while b - a > 1:
        middle = (a + b) // 2
        if table[cumulative + middle] <= u1:
            a = middle
        else:
            b = middle
    row, column = b // n_phi, b % n_phi
    # Within it the projected solid angle is uniform
    below = table[cumulative + b - 1] if b > 0 else 0.0
    part = table[cumulative + b] - below
    u = (u1 - below) / part if part > 0.0 else 0.5
    square = table[edges + row] + u2 * (table[edges + row + 1] - table[edges + row])
    phi = (column + u3) * table[first + PHI_SPAN] / n_phi
    if table[first + PHI_SPAN] < 4.0:
        # Half of the azimuths are given, the other half mirrors them
        phi = phi if u < 0.5 else -phi
    radius = math.sqrt(square)
    # Azimuth 0 is the plane of incidence, on the side of the specular ray
    sine = math.hypot(wi_x, wi_y)
    cx, cy = (-wi_x / sine, -wi_y / sine) if sine > 0.0 else (1.0, 0.0)
    x, y = radius * math.cos(phi), radius * math.sin(phi)
    return x * cx - y * cy, x * cy + y * cx, side * math.sqrt(max(0.0, 1.0 - square))


@lean_kernel
def pdf_tabulated(
    table: F64, first: int, wi_x: float, wi_y: float, wi_z: float, wo_x: float, wo_y: float,
    wo_z: float, side: float,
) -> float:  # fmt: skip
    """Density of `sample_tabulated` per solid angle."""
    share = tabulated_share(table, first, wi_z)
    if share <= 0.0:
        return 0.0
    value = eval_tabulated(table, first, wi_x, wi_y, wi_z, wo_x, wo_y, wo_z, side)
    return value * abs(wo_z) / share

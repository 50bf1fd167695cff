"""Diffuse, tabulated and retroreflecting surfaces, diffuser sheets and thin filters.

Frame and convention as in `tracer.optics.microfacet`: z = normal on the side of the incident ray,
``wi`` back along it, ``wo`` along the scattered ray, wo_z < 0 where it is transmitted; ``eval_*``
is the BSDF [1/sr] without the cosine, ``pdf_*`` the density per solid angle of ``sample_*``.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.jit.kernels import inner_kernel, lean_kernel
from raymap.model.errors import SceneError
from tracer.rays.directions import turned

__all__ = [
    "check_energy",
    "eval_lambert",
    "eval_tabulated",
    "filter_transmittance",
    "pdf_lambert",
    "pdf_retro",
    "pdf_tabulated",
    "sample_lambert",
    "sample_retro",
    "sample_tabulated",
    "tabulated_bsdf",
    "tabulated_share",
]

F64 = NDArray[np.float64]
Vector = tuple[float, float, float]


@lean_kernel
def sample_lambert(u1: float, u2: float, side: float) -> Vector:
    """A direction with density cos / pi; ``side`` = 1 reflected, -1 transmitted."""
    radius = math.sqrt(u1)
    cosine, sine = turned(u2)
    return radius * cosine, radius * sine, side * math.sqrt(max(0.0, 1.0 - u1))


@lean_kernel
def eval_lambert(albedo: float) -> float:
    """BSDF of an ideal diffuser that scatters the share ``albedo`` to this side [1/sr]."""
    return albedo / math.pi


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
    # Basis about wi (Duff et al., JCGT 6(1), 2017)
    a = -1.0 / (1.0 + wi_z)
    b = wi_x * wi_y * a
    ox = x * (1.0 + wi_x * wi_x * a) + y * b + cosine * wi_x
    oy = x * b + y * (1.0 + wi_y * wi_y * a) + cosine * wi_y
    oz = -x * wi_x - y * wi_y + cosine * wi_z
    return ox, oy, abs(oz)


@lean_kernel
def pdf_retro(
    wi_x: float, wi_y: float, wi_z: float, wo_x: float, wo_y: float, wo_z: float, cos_spread: float
) -> float:
    """Density of `sample_retro` per solid angle; 0 for an exact retroreflector."""
    if cos_spread >= 1.0 or wo_z <= 0.0:
        return 0.0
    across = wi_x * wo_x + wi_y * wo_y
    density = 1.0 / (2.0 * math.pi * (1.0 - cos_spread))
    total = density if across + wi_z * wo_z >= cos_spread else 0.0
    if across - wi_z * wo_z >= cos_spread:
        total += density
    return total


@lean_kernel
def filter_transmittance(normal: float, cos_i: float, n_i: float, n_filter: float) -> float:
    """Internal transmittance of a thin absorbing sheet at an angle.

    Parameters
    ----------
    normal : internal transmittance at normal incidence
    cos_i : cosine of the angle of incidence
    n_i, n_filter : indices of the medium around and of the sheet; the path inside is longer by
        1 / cos of the refracted angle
    """
    if normal <= 0.0:
        return 0.0
    sine = n_i / n_filter
    square = 1.0 - sine * sine * (1.0 - cos_i * cos_i)
    if square <= 0.0:
        return 0.0
    return float(normal ** (1.0 / math.sqrt(square)))


# A table of a BSDF: head, then for each angle of incidence the scattered share, then cumulative
# shares and values of its cells. Cells are constant in projected solid angle: sin² theta_o and phi.
_THETA_I, _THETA_O, _PHI, _PHI_SPAN = 0, 1, 2, 3
_HEAD = 4


@inner_kernel
def _slice(table: F64, first: int, wi_z: float) -> tuple[int, float]:
    """Slice below an angle of incidence and the share of the slice above."""
    n = int(table[first + _THETA_I])
    theta = math.acos(min(1.0, max(-1.0, wi_z)))
    at = first + _HEAD
    low, high = 0, n - 1
    if n == 1 or theta <= table[at]:
        return 0, 0.0
    if theta >= table[at + n - 1]:
        return n - 2, 1.0
    while high - low > 1:
        middle = (low + high) // 2
        if table[at + middle] <= theta:
            low = middle
        else:
            high = middle
    return low, (theta - table[at + low]) / (table[at + low + 1] - table[at + low])


@lean_kernel
def tabulated_share(table: F64, first: int, wi_z: float) -> float:
    """Share of light that the table scatters at an angle of incidence."""
    n = int(table[first + _THETA_I])
    low, weight = _slice(table, first, wi_z)
    at = first + _HEAD + n
    if weight == 0.0:
        return float(table[at + low])
    return float((1.0 - weight) * table[at + low] + weight * table[at + low + 1])


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
    n = int(table[first + _THETA_I])
    n_o, n_phi = int(table[first + _THETA_O]), int(table[first + _PHI])
    # Between two angles of incidence f is a mixture: choose one of the slices
    low, weight = _slice(table, first, wi_z)
    if weight > 0.0:
        at = first + _HEAD + n
        upper = weight * table[at + low + 1]
        total = (1.0 - weight) * table[at + low] + upper
        share = upper / total if total > 0.0 else 1.0
        if u1 < share:
            low += 1
            u1 /= share
        else:
            u1 = (u1 - share) / (1.0 - share)
    # Choose a cell of the slice
    edges = first + _HEAD + 2 * n
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
    phi = (column + u3) * table[first + _PHI_SPAN] / n_phi
    if table[first + _PHI_SPAN] < 4.0:
        # Half of the azimuths are given, the other half mirrors them
        phi = phi if u < 0.5 else -phi
    radius = math.sqrt(square)
    # Azimuth 0 is the plane of incidence, on the side of the specular ray
    sine = math.hypot(wi_x, wi_y)
    cx, cy = (-wi_x / sine, -wi_y / sine) if sine > 0.0 else (1.0, 0.0)
    x, y = radius * math.cos(phi), radius * math.sin(phi)
    return x * cx - y * cy, x * cy + y * cx, side * math.sqrt(max(0.0, 1.0 - square))


@lean_kernel
def eval_tabulated(
    table: F64, first: int, wi_x: float, wi_y: float, wi_z: float, wo_x: float, wo_y: float,
    wo_z: float, side: float,
) -> float:  # fmt: skip
    """BSDF of a table [1/sr], 0 on the other side."""
    if side * wo_z <= 0.0:
        return 0.0
    n = int(table[first + _THETA_I])
    n_o, n_phi = int(table[first + _THETA_O]), int(table[first + _PHI])
    low, weight = _slice(table, first, wi_z)
    edges = first + _HEAD + 2 * n
    cells = n_o * n_phi
    # Find the cell
    square = wo_x * wo_x + wo_y * wo_y
    row = 0
    while row < n_o - 1 and table[edges + row + 1] <= square:
        row += 1
    sine = math.hypot(wi_x, wi_y)
    cx, cy = (-wi_x / sine, -wi_y / sine) if sine > 0.0 else (1.0, 0.0)
    phi = math.atan2(wo_y * cx - wo_x * cy, wo_x * cx + wo_y * cy)
    span = table[first + _PHI_SPAN]
    if span < 4.0:
        phi = abs(phi)
    elif phi < 0.0:
        phi += 2.0 * math.pi
    column = min(n_phi - 1, int(phi / span * n_phi))
    k = edges + n_o + 1 + low * 2 * cells + cells + row * n_phi + column
    if weight == 0.0:
        return float(table[k])
    return float((1.0 - weight) * table[k] + weight * table[k + 2 * cells])


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


def tabulated_bsdf(
    theta_i_deg: ArrayLike,
    theta_o_deg: ArrayLike,
    phi_deg: ArrayLike,
    values: ArrayLike,
    *,
    name: str = "",
) -> F64:
    """Table of a measured isotropic BSDF of one side, for the flat pool of tables.

    Parameters
    ----------
    theta_i_deg : (n_i,) angles of incidence, rising, 0 .. 90 [deg]
    theta_o_deg : (n_o,) angles of scattering from the normal of that side, rising [deg]
    phi_deg : (n_phi,) equally spaced azimuths, of which 0 is the side of the specular ray: either
        from 0 to 180 (the plane of incidence is a plane of symmetry) or from 0 up to, without, 360
    values : (n_i, n_o, n_phi) BSDF [1/sr]
    name : of the surface, for messages

    Returns
    -------
    table : f is constant in cells about the given directions, linear in the angle of incidence

    Raises
    ------
    SceneError
        if angles are not in order, values negative, or more light is scattered than arrives
    """
    theta_i, theta_o = np.asarray(theta_i_deg, np.float64), np.asarray(theta_o_deg, np.float64)
    phi, f = np.asarray(phi_deg, np.float64), np.asarray(values, np.float64)
    label = f"surface {name!r}: its BSDF table"
    if f.shape != (theta_i.size, theta_o.size, phi.size):
        raise SceneError(
            f"{label} needs {theta_i.size} x {theta_o.size} x {phi.size} values, got {f.shape}"
        )
    for angles, what in ((theta_i, "angles of incidence"), (theta_o, "angles of scattering")):
        if angles.size == 0 or np.any(np.diff(angles) <= 0.0):
            raise SceneError(f"{label}: {what} must rise")
        if angles[0] < 0.0 or angles[-1] > 90.0:
            raise SceneError(f"{label}: {what} lie within 0 and 90 degrees")
    if not (np.all(np.isfinite(f)) and np.all(f >= 0.0)):
        raise SceneError(f"{label}: values must be finite and not negative")
    span, columns = _azimuths(phi, f, label)
    # Cells about the directions, in sin² theta
    middles = np.sin(np.radians(0.5 * (theta_o[1:] + theta_o[:-1]))) ** 2
    edges = np.concatenate(([0.0], middles, [1.0]))
    n_phi = columns.shape[2]
    projected = 0.5 * np.diff(edges)[:, None] * (2.0 * math.pi / n_phi) * np.ones(n_phi)
    flux = columns * projected
    shares = flux.sum(axis=(1, 2))
    worst = int(np.argmax(shares))
    if shares[worst] > 1.0 + 1e-9:
        raise SceneError(
            f"{label} creates energy: at {theta_i[worst]:g} degrees it scatters "
            f"{shares[worst]:.4g} times the light that arrives; scale the values down"
        )
    rows = []
    for k in range(theta_i.size):
        cumulative = np.cumsum(flux[k].ravel())
        scale = 1.0 / cumulative[-1] if cumulative[-1] > 0.0 else 1.0
        rows += [np.minimum(1.0, cumulative * scale), columns[k].ravel()]
    head = [float(theta_i.size), float(theta_o.size), float(n_phi), span]
    return np.concatenate((head, np.radians(theta_i), np.minimum(1.0, shares), edges, *rows))


def _azimuths(phi: F64, f: F64, label: str) -> tuple[float, F64]:
    """Span of the azimuths and values on cells of equal width."""
    if phi.size == 1:
        return math.pi, f
    step = np.diff(phi)
    if np.any(step <= 0.0) or np.ptp(step) > 1e-6 or phi[0] != 0.0:
        raise SceneError(f"{label}: azimuths must rise from 0 in equal steps")
    if abs(phi[-1] - 180.0) < 1e-6:
        # Cells between the given azimuths: their means keep the energy of the trapezoidal rule
        return math.pi, 0.5 * (f[:, :, 1:] + f[:, :, :-1])
    if abs(phi[-1] + step[0] - 360.0) < 1e-6:
        return 2.0 * math.pi, 0.5 * (f + np.roll(f, -1, axis=2))
    raise SceneError(
        f"{label}: azimuths must end at 180, or one step before 360 degrees; they end at "
        f"{phi[-1]:g}"
    )


def check_energy(
    share: Callable[[float], float], *, name: str = "", angles: int = 91, tolerance: float = 1e-6
) -> None:
    """Refuse a surface that sends out more light than arrives.

    Parameters
    ----------
    share : reflected and transmitted share of the light over the cosine of the angle of incidence
    name : of the surface, for messages

    Raises
    ------
    SceneError
        naming the worst angle
    """
    degrees = np.linspace(0.0, 89.9, angles)
    shares = np.array([share(math.cos(math.radians(angle))) for angle in degrees])
    bad = ~np.isfinite(shares) | (shares < -tolerance)
    if np.any(bad):
        raise SceneError(
            f"surface {name!r}: the share of light that it sends out is not a number at "
            f"{degrees[bad][0]:.1f} degrees"
        )
    worst = int(np.argmax(shares))
    if shares[worst] > 1.0 + tolerance:
        raise SceneError(
            f"surface {name!r} creates energy: it sends out {shares[worst]:.4g} times the light "
            f"that arrives at {degrees[worst]:.1f} degrees; lower its reflectance or transmittance"
        )

"""Measured isotropic BSDF of one side of a surface.

Frame: z = normal on the side of the incident ray, ``wi`` back along it, ``wo`` along the scattered
ray, wo_z < 0 where it is transmitted; ``eval_*`` is the BSDF [1/sr] without the cosine.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.jit.kernels import inner_kernel, lean_kernel
from raymap.laws.law import InChannels, Law, Part, Shares
from raymap.model.errors import SceneError

__all__ = [
    "BSDF_HEAD",
    "N_AZIMUTHS",
    "N_INCIDENT",
    "N_SCATTERED",
    "PHI_SPAN",
    "MeasuredBsdf",
    "TabulatedLaw",
    "check_energy",
    "eval_tabulated",
    "incidence_slice",
    "tabulated_bsdf",
    "tabulated_share",
]

F64 = NDArray[np.float64]


class MeasuredBsdf(Part):
    """BSDF of one side; see `tabulated_bsdf`."""

    theta_i_deg: tuple[float, ...]
    theta_o_deg: tuple[float, ...]
    phi_deg: tuple[float, ...]
    values: tuple[tuple[tuple[float, ...], ...], ...]

    def table(self, name: str = "") -> F64:
        """For `eval_tabulated`."""
        return tabulated_bsdf(
            self.theta_i_deg, self.theta_o_deg, self.phi_deg, self.values, name=name
        )


class TabulatedLaw(Law):
    """Measured scatter, the same in all channels."""

    law: Literal["tabulated"] = "tabulated"
    reflected: MeasuredBsdf | None = None
    transmitted: MeasuredBsdf | None = None

    def _shares(self, channels: InChannels, n_i: F64, n_o: F64, cos_i: F64) -> Shares:
        sides = []
        for side in (self.reflected, self.transmitted):
            if side is None:
                sides.append(np.zeros((len(n_i), len(cos_i))))
                continue
            table = side.table()
            row = [tabulated_share(table, 0, float(cosine)) for cosine in cos_i]
            sides.append(np.tile(row, (len(n_i), 1)))
        return sides[0], sides[1]


# A table of a BSDF: head, then for each angle of incidence the scattered share, then cumulative
# shares and values of its cells. Cells are constant in projected solid angle: sin² theta_o and phi.
N_INCIDENT, N_SCATTERED, N_AZIMUTHS, PHI_SPAN = 0, 1, 2, 3
BSDF_HEAD = 4


@inner_kernel
def incidence_slice(table: F64, first: int, wi_z: float) -> tuple[int, float]:
    """Slice below an angle of incidence and the share of the slice above."""
    n = int(table[first + N_INCIDENT])
    theta = math.acos(min(1.0, max(-1.0, wi_z)))
    at = first + BSDF_HEAD
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
    n = int(table[first + N_INCIDENT])
    low, weight = incidence_slice(table, first, wi_z)
    at = first + BSDF_HEAD + n
    if weight == 0.0:
        return float(table[at + low])
    return float((1.0 - weight) * table[at + low] + weight * table[at + low + 1])


@lean_kernel
def eval_tabulated(
    table: F64, first: int, wi_x: float, wi_y: float, wi_z: float, wo_x: float, wo_y: float,
    wo_z: float, side: float,
) -> float:  # fmt: skip
    """BSDF of a table [1/sr], 0 on the other side."""
    if side * wo_z <= 0.0:
        return 0.0
    n = int(table[first + N_INCIDENT])
    n_o, n_phi = int(table[first + N_SCATTERED]), int(table[first + N_AZIMUTHS])
    low, weight = incidence_slice(table, first, wi_z)
    edges = first + BSDF_HEAD + 2 * n
    cells = n_o * n_phi
    # Find the cell
    square = wo_x * wo_x + wo_y * wo_y
    row = 0
    while row < n_o - 1 and table[edges + row + 1] <= square:
        row += 1
    sine = math.hypot(wi_x, wi_y)
    cx, cy = (-wi_x / sine, -wi_y / sine) if sine > 0.0 else (1.0, 0.0)
    phi = math.atan2(wo_y * cx - wo_x * cy, wo_x * cx + wo_y * cy)
    span = table[first + PHI_SPAN]
    if span < 4.0:
        phi = abs(phi)
    elif phi < 0.0:
        phi += 2.0 * math.pi
    column = min(n_phi - 1, int(phi / span * n_phi))
    k = edges + n_o + 1 + low * 2 * cells + cells + row * n_phi + column
    if weight == 0.0:
        return float(table[k])
    return float((1.0 - weight) * table[k] + weight * table[k + 2 * cells])


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
    label = f"surface {name!r}: its BSDF table"
    theta_i, theta_o = np.asarray(theta_i_deg, np.float64), np.asarray(theta_o_deg, np.float64)
    phi = np.asarray(phi_deg, np.float64)
    try:
        f = np.asarray(values, np.float64)
    except ValueError:
        raise SceneError(f"{label} has rows of different lengths") from None
    if f.shape != (theta_i.size, theta_o.size, phi.size):
        raise SceneError(
            f"{label} needs {theta_i.size} x {theta_o.size} x {phi.size} values, got {f.shape}"
        )
    for angles, what in ((theta_i, "angles of incidence"), (theta_o, "angles of scattering")):
        if angles.size == 0 or np.any(angles[1:] <= angles[:-1]):
            raise SceneError(f"{label}: {what} must rise")
        if angles[0] < 0.0 or angles[-1] > 90.0:
            raise SceneError(f"{label}: {what} lie within 0 and 90 degrees")
    if phi.size == 0 or not np.all((phi >= 0.0) & (phi <= 360.0)):
        raise SceneError(f"{label}: azimuths lie within 0 and 360 degrees")
    if not (np.all(np.isfinite(f)) and np.all(f >= 0.0)):
        raise SceneError(f"{label}: values must be finite and not negative")
    span, columns = _azimuths(phi, f, label)
    # Cells about the directions, in sin² theta
    middles = np.sin(np.radians(0.5 * (theta_o[1:] + theta_o[:-1]))) ** 2
    edges = np.concatenate(([0.0], middles, [1.0]))
    n_phi = columns.shape[2]
    projected = 0.5 * np.diff(edges)[:, None] * (2.0 * math.pi / n_phi) * np.ones(n_phi)
    with np.errstate(over="ignore"):
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

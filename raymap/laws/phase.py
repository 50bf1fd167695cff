"""Phase functions: where a scattering event in a medium sends the light.

Every model is a density p(mu) per solid angle [1/sr] over the cosine ``mu`` of the angle between
the directions before and after, normalised over the sphere; the azimuth is uniform.

A medium's phase function is a row of `PHASE_ROW` numbers ``(kind, g, gamma, first, count)``;
tables stand in one flat array ``tables`` from ``first`` on.

References
----------
L. G. Henyey, J. L. Greenstein, Astrophysical Journal 93, 70 (1941).
L. O. Reynolds, N. J. McCormick, J. Opt. Soc. Am. 70, 1206 (1980).
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import FailFast

from raymap.jit.kernels import inner_kernel, lean_kernel
from raymap.laws.law import Part
from raymap.model.errors import SceneError

__all__ = [
    "GENERALIZED",
    "HENYEY_GREENSTEIN",
    "ISOTROPIC",
    "PHASE_ROW",
    "RAYLEIGH",
    "TABULATED",
    "PhaseLaw",
    "eval_generalized",
    "eval_henyey_greenstein",
    "eval_phase",
    "eval_rayleigh",
    "eval_tabulated_phase",
    "generalized_row",
    "henyey_greenstein_row",
    "interval",
    "isotropic_row",
    "legendre_moments",
    "mean_cosine",
    "rayleigh_row",
    "tabulated_phase",
]

ISOTROPIC = 0
HENYEY_GREENSTEIN = 1
GENERALIZED = 2
RAYLEIGH = 3
TABULATED = 4

PHASE_ROW = 5
"""Numbers in the parameter row of a phase function."""

_FOUR_PI = 4.0 * math.pi


class PhaseLaw(Part):
    """A phase function as maps store it.

    Attributes
    ----------
    kind : of the function
    g, gamma : its shape, as far as it has one
    angle_deg, value : of a tabulated one (`tabulated_phase`)
    """

    kind: Literal["isotropic", "henyey_greenstein", "generalized", "rayleigh", "tabulated"]
    g: float = 0.0
    gamma: float = 1.5
    angle_deg: Annotated[tuple[float, ...], FailFast()] = ()
    value: Annotated[tuple[float, ...], FailFast()] = ()

    def row(
        self, *, first: int = 0, name: str = ""
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Parameter row and table for `eval_phase`, the table to stand at ``first``."""
        empty = np.zeros(0)
        if self.kind == "henyey_greenstein":
            return henyey_greenstein_row(self.g), empty
        if self.kind == "generalized":
            return generalized_row(self.g, self.gamma), empty
        if self.kind == "rayleigh":
            return rayleigh_row(), empty
        if self.kind == "tabulated":
            return tabulated_phase(self.angle_deg, self.value, first=first, name=name)
        return isotropic_row(), empty

    def density(self, mu: ArrayLike) -> NDArray[np.float64]:
        """(...) density [1/sr] at cosines of the angle of scattering.

        Raises
        ------
        SceneError
            The numbers say none.
        """
        row, table = self.row()
        cosines = np.asarray(mu, np.float64)
        flat = np.array([eval_phase(row, table, float(value)) for value in cosines.ravel()])
        if not np.all(np.isfinite(flat) & (flat >= 0.0)):
            raise SceneError(f"phase function {self.kind!r}: its numbers say no density")
        return flat.reshape(cosines.shape)


@lean_kernel
def eval_henyey_greenstein(g: float, mu: float) -> float:
    """Henyey–Greenstein density [1/sr]; ``g`` in -1 .. 1 is the mean cosine."""
    denominator = 1.0 + g * g - 2.0 * g * mu
    return (1.0 - g * g) / (_FOUR_PI * denominator * math.sqrt(denominator))


@lean_kernel
def eval_generalized(g: float, gamma: float, mu: float) -> float:
    """Density A / (1 + g² - 2 g mu)^gamma [1/sr], for every real gamma.

    ``gamma`` = 3/2 is Henyey–Greenstein; ``g`` is a shape parameter, the mean cosine only there.
    """
    # Turn backward peaks forward
    if g < 0.0:
        g = -g
        mu = -mu
    if abs(g) < 1e-100:
        return 1.0 / _FOUR_PI
    # Normalise at the end of the range where the power cannot overflow
    a = gamma - 1.0
    spread = 4.0 * math.atanh(g)
    denominator = (1.0 - g) * (1.0 - g) + 2.0 * g * (1.0 - mu)
    if abs(a * spread) < 1e-14:
        return g / (math.pi * spread * denominator)
    if a > 0.0:
        ratio = (1.0 - g) * (1.0 - g) / denominator
        return float(-g * a * ratio**a / (math.pi * math.expm1(-a * spread) * denominator))
    ratio = (1.0 + g) * (1.0 + g) / denominator
    return float(g * a * ratio**a / (math.pi * math.expm1(a * spread) * denominator))


@lean_kernel
def eval_rayleigh(mu: float) -> float:
    """Rayleigh density for unpolarised light, 3 (1 + mu²) / 16 pi [1/sr]."""
    return 3.0 * (1.0 + mu * mu) / (4.0 * _FOUR_PI)


@lean_kernel
def eval_tabulated_phase(tables: NDArray[np.float64], first: int, count: int, mu: float) -> float:
    """Density [1/sr], linear in mu between the rows of a table of `tabulated_phase`."""
    low = interval(tables, first, count, mu)
    mu_0, mu_1 = tables[first + low], tables[first + low + 1]
    p_0, p_1 = tables[first + count + low], tables[first + count + low + 1]
    share = (mu - mu_0) / (mu_1 - mu_0)
    return float(p_0 + (p_1 - p_0) * min(1.0, max(0.0, share)))


@inner_kernel
def interval(table: NDArray[np.float64], first: int, count: int, value: float) -> int:
    """Largest i <= count - 2 with table[first + i] <= value."""
    low, high = 0, count - 1
    while high - low > 1:
        middle = (low + high) // 2
        if table[first + middle] <= value:
            low = middle
        else:
            high = middle
    return low


@lean_kernel
def eval_phase(row: NDArray[np.float64], tables: NDArray[np.float64], mu: float) -> float:
    """Phase function of a parameter row [1/sr]."""
    kind = int(row[0])
    if kind == HENYEY_GREENSTEIN:
        return eval_henyey_greenstein(row[1], mu)
    if kind == GENERALIZED:
        return eval_generalized(row[1], row[2], mu)
    if kind == RAYLEIGH:
        return eval_rayleigh(mu)
    if kind == TABULATED:
        return eval_tabulated_phase(tables, int(row[3]), int(row[4]), mu)
    return 1.0 / _FOUR_PI


def isotropic_row() -> NDArray[np.float64]:
    """Parameter row of the isotropic phase function."""
    return np.zeros(PHASE_ROW)


def rayleigh_row() -> NDArray[np.float64]:
    """Parameter row of the Rayleigh phase function."""
    return np.array([RAYLEIGH, 0.0, 0.0, 0.0, 0.0])


def henyey_greenstein_row(g: float) -> NDArray[np.float64]:
    """Parameter row of Henyey–Greenstein; -1 < g < 1."""
    _require_shape(g)
    return np.array([HENYEY_GREENSTEIN, g, 1.5, 0.0, 0.0])


def generalized_row(g: float, gamma: float) -> NDArray[np.float64]:
    """Parameter row of A / (1 + g² - 2 g mu)^gamma; -1 < g < 1, any finite gamma."""
    _require_shape(g)
    if not math.isfinite(gamma):
        raise SceneError(f"phase function: gamma must be a finite number, got {gamma}")
    return np.array([GENERALIZED, g, gamma, 0.0, 0.0])


def tabulated_phase(
    angle_deg: ArrayLike, density: ArrayLike, *, first: int = 0, name: str = ""
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Row and table of a measured phase function.

    Parameters
    ----------
    angle_deg : (n,) scattering angles, rising from 0 to 180 [deg]
    density : (n,) values >= 0 in any unit; they are normalised over the sphere. Between the rows
        the density is linear in the cosine.
    first : where the table will stand in the flat array of all tables
    name : of the medium, for messages

    Returns
    -------
    row : (PHASE_ROW,) float64
    table : (3 n,) float64, cosines rising, densities [1/sr], cumulative probabilities
    """
    angle = np.asarray(angle_deg, np.float64)
    value = np.asarray(density, np.float64)
    label = f"phase function of {name!r}" if name else "phase function"
    if angle.ndim != 1 or angle.size < 2 or angle.shape != value.shape:
        raise SceneError(f"{label}: needs two or more angles and as many values")
    if not (np.all(angle[1:] > angle[:-1]) and angle[0] == 0.0 and angle[-1] == 180.0):
        raise SceneError(
            f"{label}: angles must rise from 0 to 180 degrees without gaps, they run from "
            f"{angle[0]:g} to {angle[-1]:g}"
        )
    if not (np.all(np.isfinite(value)) and np.all(value >= 0.0) and np.any(value > 0.0)):
        raise SceneError(f"{label}: values must be finite, not negative and not all 0")
    mu = np.cos(np.radians(angle))[::-1].copy()
    mu[0], mu[-1] = -1.0, 1.0
    if not np.all(mu[1:] > mu[:-1]):
        raise SceneError(f"{label}: angles are so close that their cosines are equal")
    # Scaled first, so that sums of the largest and of the smallest numbers are numbers
    p = value[::-1] / value.max()
    parts = math.pi * (p[1:] + p[:-1]) * np.diff(mu)
    total = float(parts.sum())
    cumulative = np.concatenate(([0.0], np.cumsum(parts) / total))
    cumulative[-1] = 1.0
    row = np.array([TABULATED, 0.0, 0.0, float(first), float(mu.size)])
    return row, np.concatenate((mu, p / total, cumulative))


def legendre_moments(
    row: NDArray[np.float64], tables: NDArray[np.float64] | None = None, *, order: int
) -> NDArray[np.float64]:
    """Moments <P_k(mu)> for k = 0 .. order, by Gauss quadrature on panels that resolve the peak.

    Parameters
    ----------
    row : (PHASE_ROW,) parameter row
    tables : flat array of all tables, for tabulated functions
    order : highest k

    Returns
    -------
    moments : (order + 1,) float64; Henyey–Greenstein gives g^k
    """
    flat = np.zeros(0) if tables is None else tables
    # Panels that halve towards mu = 1, or the intervals of a table
    if int(row[0]) == TABULATED:
        first, count = int(row[3]), int(row[4])
        edges = flat[first : first + count]
    else:
        halves = 2.0 ** np.arange(1.0, -48.0, -1.0)
        edges = np.concatenate((1.0 - halves, [1.0]))
    nodes, weights = np.polynomial.legendre.leggauss(max(32, order // 2 + 16))
    half = 0.5 * np.diff(edges)[:, None]
    mu = (0.5 * (edges[1:] + edges[:-1])[:, None] + half * nodes).ravel()
    mass = (half * weights).ravel()
    # Integrate with the peak at mu = 1; odd moments change sign for backward peaks
    forward = row.copy()
    forward[1] = abs(row[1])
    density = np.array([eval_phase(forward, flat, value) for value in mu])
    polynomials = np.polynomial.legendre.legvander(mu, order)
    moments = 2.0 * math.pi * (polynomials * (density * mass)[:, None]).sum(axis=0)
    if row[1] < 0.0:
        moments[1::2] *= -1.0
    return np.asarray(moments)


def mean_cosine(row: NDArray[np.float64], tables: NDArray[np.float64] | None = None) -> float:
    """Mean cosine of the scattering angle of a parameter row."""
    return float(legendre_moments(row, tables, order=1)[1])


def _require_shape(g: float) -> None:
    if not -1.0 < g < 1.0:
        raise SceneError(f"phase function: g must lie between -1 and 1, exclusive, got {g:g}")

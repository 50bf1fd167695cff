"""Directions of the exact plate model: nodes, Fresnel coefficients, Legendre functions.

Everything here depends on the index and on the directions asked for, not on the medium, so that a
fit computes it once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raymap.optics.fresnel import reflectance_column

__all__ = ["PlateDirections", "legendre_functions", "plate_directions"]


@dataclass(frozen=True, kw_only=True)
class PlateDirections:
    """Nodes inside the plate: Gauss nodes first, then the watched directions.

    A watched direction carries next to no weight: it sees the field without disturbing it, which
    makes its radiance the exact integral of the source function along it.

    Attributes
    ----------
    index : refractive index of the plate
    cosines, weights : (n,) nodes on (0, 1] and their weights
    watched : number of watched directions, the last of the nodes
    fresnel : (n,) internal reflectance at the nodes, 1 beyond the critical angle
    order : highest Legendre order that the nodes integrate
    """

    index: float
    cosines: NDArray[np.float64]
    weights: NDArray[np.float64]
    watched: int
    fresnel: NDArray[np.float64]
    order: int


def plate_directions(
    index: float,
    outside_cosines: NDArray[np.float64],
    nodes: int,
    *,
    watch_weight: float = 1e-12,
) -> PlateDirections:
    """Nodes for a plate in air, ``nodes`` on each side of the critical angle.

    Parameters
    ----------
    index : refractive index of the plate, >= 1
    outside_cosines : (k,) cosines of the watched directions in air
    nodes : Gauss nodes per interval
    watch_weight : weight of the watched directions
    """
    x, w = np.polynomial.legendre.leggauss(nodes)
    critical = float(np.sqrt(1.0 - 1.0 / index**2))
    # Split where total reflection begins; an index near 1 leaves one interval
    if critical > 0.02:
        edges = np.array([0.0, critical, 1.0])
    else:
        edges = np.array([0.0, 0.5, 1.0])
    half = 0.5 * np.diff(edges)[:, None]
    cosines = (edges[:-1, None] + half * (x + 1.0)).ravel()
    weights = (half * w).ravel()
    inside = np.sqrt(1.0 - (1.0 - outside_cosines**2) / index**2)
    cosines = np.concatenate((cosines, inside))
    weights = np.concatenate((weights, np.full(inside.size, watch_weight)))
    return PlateDirections(
        index=index,
        cosines=cosines,
        weights=weights,
        watched=inside.size,
        fresnel=reflectance_column(index, 1.0, cosines),
        order=2 * nodes,
    )


def legendre_functions(mode: int, order: int, cosines: NDArray[np.float64]) -> NDArray[np.float64]:
    """Functions sqrt((l-m)!/(l+m)!) P_l^m(mu), l = m .. order, without the Condon–Shortley sign.

    Returns
    -------
    functions : (order - mode + 1, n) float64
    """
    functions = np.zeros((order - mode + 1, cosines.size))
    # P_m^m, then the three-term recurrence in l
    factors = np.arange(1, mode + 1)
    start = np.sqrt(np.prod((2 * factors - 1) / (2 * factors)))
    functions[0] = start * (1.0 - cosines**2) ** (0.5 * mode)
    if order > mode:
        functions[1] = np.sqrt(2 * mode + 1) * cosines * functions[0]
    for l in range(mode + 1, order):  # noqa: E741
        up = np.sqrt((l + 1.0) ** 2 - mode**2)
        down = np.sqrt(float(l * l - mode * mode))
        row = l - mode
        functions[row + 1] = (
            (2 * l + 1) * cosines * functions[row] - down * functions[row - 1]
        ) / up
    return functions

"""The intensity of a far field, its peak and the angles of its beam, each with its error."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from query.answers.images.lit import LitCells
from query.answers.images.local_fits import Joined, join_windows, largest, shares_of
from query.answers.images.pictures import DetectorImage
from query.answers.images.sphere_fits import harmonics_shown, sphere_fits
from query.engine.tally import sums as sums_of
from raymap.model.directory import Detector
from raymap.model.errors import RayMapError

__all__ = ["Beam", "BeamPlane", "beam_of", "full_angle"]

Floats = NDArray[np.float64]
Measured = tuple[float, float]
"""A number and its standard error."""

_MOST_AROUND, _MOST_ROWS = 72, 180
"""Cells in C and rows in gamma from which on neighbours are joined beforehand."""

_MOST_CELLS = 2**18
"""Cells that are fitted at most."""

_COUNTED = 30.0
"""Rays from which on a cell says by itself what the intensity is at least."""

_EDGE = 0.7
"""Share of the peak within three cells from which on a fall is an edge between two cells."""


@dataclass(frozen=True, kw_only=True)
class BeamPlane:
    """The intensity in a plane through the axis of a far field.

    Attributes
    ----------
    name : "C0–C180"; "all C" where the detector has one cell around its axis
    gamma_deg : (n,) from the one side, negative, to the other
    values, se : (n,) intensity and its standard error
    peak : largest intensity of the plane
    beam_deg, field_deg : full angle between half, and a tenth, of ``peak``, and its standard error;
        None where the intensity does not fall as far within the detector, or nothing is known of it
    """

    name: str
    gamma_deg: Floats
    values: Floats
    se: Floats
    peak: Measured
    beam_deg: Measured | None
    field_deg: Measured | None


@dataclass(frozen=True, kw_only=True)
class Beam:
    """The intensity of a far field at the corners of its cells.

    Attributes
    ----------
    gamma_deg, c_deg : (n_gamma,), (n_c,) of the corners; c from 0 on, without 360
    values, se : (n_gamma, n_c) intensity and its standard error
    peak : largest intensity, and its standard error with that of looking for the largest
    planes : C0–C180 and C90–C270
    """

    gamma_deg: Floats
    c_deg: Floats
    values: Floats
    se: Floats
    peak: Measured
    planes: tuple[BeamPlane, ...]


def beam_of(image: DetectorImage, quantity: str | None = None) -> Beam:
    """Estimate the intensity of a far field from cells joined as far as their errors ask.

    Parameters
    ----------
    quantity : intensity or candela; None: that in the unit of the map

    Raises
    ------
    RayMapError
        the detector is no far field whose angles are known, or has no such quantity
    """
    lit, angles = image.lit, image.detector.parameters.get("gamma_deg")
    if image.detector.kind != "far_field" or image.measure is None or angles is None:
        raise RayMapError(f"detector {image.detector.name!r} is no far field: it has no beam")
    density, errors, _ = lit.quantity(quantity)
    total, squares = float((density * lit.size).sum()), float(((errors * lit.size) ** 2).sum())
    rays = total**2 / squares if squares > 0.0 else 0.0
    low, high = (float(angle) for angle in angles)
    flux, variance = _fewer_cells(lit, density * lit.size, (errors * lit.size) ** 2)
    harmonics = harmonics_shown(flux, variance)
    fits = sphere_fits(shares_of(flux, variance), variance, (low, high), harmonics)
    joined = join_windows(fits, rays)
    peak = _at_least(largest(joined), _densest(density, errors, image.detector))
    n_gamma, n_c = flux.shape
    gamma = np.linspace(low, high, n_gamma + 1)
    grid = np.arange((n_gamma + 1) * n_c).reshape(n_gamma + 1, n_c)
    planes = []
    for c in (0.0, 90.0) if n_c > 1 else (0.0,):
        name = f"C{c:g}–C{c + 180:g}" if n_c > 1 else "all C"
        planes.append(_plane(name, joined, grid, gamma, c))
    return Beam(
        gamma_deg=gamma,
        c_deg=np.arange(n_c) * 360.0 / n_c,
        values=np.maximum(joined.values, 0.0).reshape(grid.shape),
        se=joined.se.reshape(grid.shape),
        peak=peak,
        planes=tuple(planes),
    )


def _densest(density: Floats, se: Floats, detector: Detector) -> Measured:
    """The intensity of a lit cell, of all that which is largest beyond doubt, and its error.

    Nowhere less than the mean of a cell is the largest intensity.
    """
    # Chance brings so many errors among so many cells, and few rays scatter more
    sure = np.where(se > 0.0, density**2 >= _COUNTED * se**2, True)
    chance = math.sqrt(2.0 * math.log(math.prod(detector.cells) + 1.0))
    beyond = np.where(sure, density - chance * se, 0.0)
    if not beyond.max(initial=0.0) > 0.0:
        return 0.0, 0.0
    index = int(np.argmax(beyond))
    return float(density[index]), float(se[index])


def _at_least(peak: Measured, cell: Measured) -> Measured:
    """A peak that is no less than a cell; what it lay below is what the cells do not resolve."""
    missed = cell[0] - peak[0]
    if missed <= 3.0 * math.hypot(peak[1], cell[1]):
        return peak
    return cell[0], math.hypot(cell[1], missed)


def _fewer_cells(lit: LitCells, flux: Floats, variance: Floats) -> tuple[Floats, Floats]:
    """The light in as few cells as its beam needs: work grows with their cube.

    Cells are joined evenly, to no fewer than half of the most, as long as the rows, and the
    columns, above half of the brightest are at least six.

    Parameters
    ----------
    flux, variance : (n,) of the lit cells

    Returns
    -------
    (rows, columns) flux and variance
    """
    n_c, n_gamma = lit.detector.cells
    high, wide = (
        _joinable(sums_of(index, flux, n), sums_of(index, variance, n), most)
        for index, n, most in (
            (lit.row, n_gamma, _MOST_ROWS),
            (lit.column, n_c, _MOST_AROUND),
        )
    )
    # Of beams that are too narrow for so many cells the peak is that of their brightest cell
    while (n_gamma // high) * (n_c // wide) > _MOST_CELLS:
        if n_gamma // high > n_c // wide:
            high = next(d for d in range(high + 1, n_gamma + 1) if n_gamma % d == 0)
        else:
            wide = next(d for d in range(wide + 1, n_c + 1) if n_c % d == 0)
    shape = n_gamma // high, n_c // wide
    index = lit.row // high * shape[1] + lit.column // wide
    joined = (sums_of(index, values, math.prod(shape)) for values in (flux, variance))
    flux, variance = (values.reshape(shape) for values in joined)
    return flux, variance


def _joinable(light: Floats, variance: Floats, most: int) -> int:
    """How many rows (columns) of this light make one."""
    limit = _divisor(len(light), most)
    for seen in range(1, limit + 1):
        if len(light) % seen:
            continue
        flux, squares = (values.reshape(-1, seen).sum(axis=1) for values in (light, variance))
        top = int(np.argmax(flux))
        # Which rows are bright is only seen where the brightest holds some rays
        if flux[top] ** 2 >= _COUNTED * squares[top]:
            bright = seen * int(np.count_nonzero(flux > 0.5 * flux[top]))
            joined = min(limit, max(1, bright // 6))
            while len(light) % joined:
                joined -= 1
            return joined
    return limit


def _divisor(n: int, most: int) -> int:
    """The smallest divisor of n that leaves at most so many parts, n itself kept in halves."""
    return next((d for d in range(1, n + 1) if n % d == 0 and n // d <= most), 1)


def _plane(
    name: str, joined: Joined, grid: NDArray[np.int64], gamma: Floats, c_deg: float
) -> BeamPlane:
    """Intensity over gamma in one plane, from C + 180° to C."""
    far, near = (_half_plane(joined, grid, c) for c in (c_deg + 180.0, c_deg))
    skip = 1 if gamma[0] == 0.0 else 0
    curve = Joined.of([far.reversed(), near.part(slice(skip, None))])
    angles = np.concatenate((-gamma[::-1], gamma[skip:]))
    peak = largest(curve)
    return BeamPlane(
        name=name,
        gamma_deg=angles,
        values=np.maximum(curve.values, 0.0),
        se=curve.se,
        peak=peak,
        beam_deg=_angle(curve, angles, peak, 0.5),
        field_deg=_angle(curve, angles, peak, 0.1),
    )


def _half_plane(joined: Joined, grid: NDArray[np.int64], c_deg: float) -> Joined:
    """Nodes of one azimuth, linear between two of them."""
    n = grid.shape[1]
    place = c_deg / 360.0 * n
    first = math.floor(place + 1e-9)
    share = max(place - first, 0.0)
    own = joined.part(grid[:, first % n])
    if share < 1e-9:
        return own
    return own.mixed(joined.part(grid[:, (first + 1) % n]), share)


def _angle(curve: Joined, gamma: Floats, peak: Measured, share: float) -> Measured | None:
    """Full angle at a share of the peak; its error by slopes and by leaving shares out."""
    found = _ends(gamma, curve.values, curve.se, share * peak[0])
    if found is None:
        return None
    sides, edges = found
    step = float(np.diff(gamma).max())
    variance = unresolved = 0.0
    slopes = []
    for place, is_edge in zip(sides, edges, strict=True):
        if is_edge:
            unresolved += 0.5 * step
            continue
        width = 2.0 * step
        inner, outer = (np.interp(place + side * width, gamma, curve.values) for side in (-1, 1))
        slope = max(abs(outer - inner) / (2.0 * width), 1e-300)
        slopes.append(slope)
        # A fall by much of the threshold within three cells may be an edge in one of them
        steep = min(1.5 * step * slope / (share * peak[0]), 1.0)
        unresolved += 0.5 * step * steep**2
        variance += (float(np.interp(place, gamma, curve.se)) / slope) ** 2
    variance += (share * peak[1] * sum(1.0 / slope for slope in slopes)) ** 2
    variance += unresolved**2
    without = [_ends(gamma, part, curve.se, share * peak[0]) for part in curve.without_each()]
    angles = np.array([ends[0][1] - ends[0][0] for ends in without if ends is not None])
    if len(angles) > 1:
        spread = (len(angles) - 1) / len(angles) * float(((angles - angles.mean()) ** 2).sum())
        variance = max(variance, spread)
    angle, se = sides[1] - sides[0], math.sqrt(variance)
    # An error of half a turn: nothing is known of the angle
    return (angle, se) if angle > 0.0 and se < 180.0 else None


def full_angle(gamma_deg: Floats, values: Floats, share: float) -> float | None:
    """Angle between the outermost places where a curve has this share of its largest value.

    Linear between the points of the curve, within 90° of the axis; None where the curve ends above
    the share, of a curve that is largest behind the source, and of one without light.

    >>> full_angle(np.array([-2.0, -1.0, 0.0, 1.0, 2.0]), np.array([0.0, 1, 2, 1, 0]), 0.25)
    3.0
    """
    found = _ends(gamma_deg, values, np.zeros(len(values)), share * float(values.max()))
    return None if found is None else found[0][1] - found[0][0]


def _ends(
    gamma: Floats, values: Floats, se: Floats, threshold: float
) -> tuple[tuple[float, float], tuple[bool, bool]] | None:
    """Outermost places where a curve falls to a threshold, and whether they are edges.

    What lies above the threshold by less than twice its error may be noise.
    """
    ahead = np.abs(gamma) <= 90.0 + 1e-9
    if values[ahead].max(initial=0.0) < values.max() or threshold <= 0.0:
        return None
    gamma, values, se = gamma[ahead], values[ahead], se[ahead]
    above = np.flatnonzero((values >= threshold) & (values - 2.0 * se >= 0.8 * threshold))
    if not len(above):
        return None
    left = _end(-gamma[::-1], values[::-1], len(values) - 1 - int(above[0]), threshold)
    right = _end(gamma, values, int(above[-1]), threshold)
    if left is None or right is None:
        return None
    return (-left[0], right[0]), (left[1], right[1])


def _end(gamma: Floats, values: Floats, last: int, threshold: float) -> tuple[float, bool] | None:
    """Where a curve falls to a threshold beyond a place, and whether it is an edge."""
    below = np.flatnonzero(values[last:] < threshold)
    if not len(below):
        return None
    outer = last + int(below[0])
    inner = outer - 1
    # An edge between cells lies where as much light is missing within as is found without
    begin, end = max(outer - 3, 0), min(outer + 3, len(values))
    high, low = float(values[begin:outer].max()), float(values[outer:end].min())
    if high - low >= _EDGE * float(values.max()) and end - begin == 6:
        excess = np.clip((values[begin:end] - low) / (high - low), 0.0, 1.0)
        place = gamma[begin] + float(np.trapezoid(excess, gamma[begin:end]))
        return place, True
    part = (values[inner] - threshold) / (values[inner] - values[outer])
    return float(gamma[inner] + part * (gamma[outer] - gamma[inner])), False

"""What is read off a detector: peak, evenness, and the angles of a beam."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query import DetectorImage

__all__ = ["BeamPlane", "beam_planes", "full_angle", "numbers_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class BeamPlane:
    """The intensity in a plane through the axis of a far field.

    Attributes
    ----------
    name : "C0–C180"; "all C" where the detector has one cell around its axis
    gamma_deg : (n,) from the one side, negative, to the other
    values : (n,) intensity
    beam_deg, field_deg : full angle between half, and a tenth, of the largest value of the plane;
        None where the intensity does not fall as far within the detector
    """

    name: str
    gamma_deg: Array
    values: Array
    beam_deg: float | None
    field_deg: float | None


def beam_planes(image: DetectorImage, density: Array) -> list[BeamPlane]:
    """The planes C0 and C90 of a far field.

    Parameters
    ----------
    density : (cells_v, cells_u) intensity, a row per gamma and a column per C
    """
    low, high = image.detector.parameters["gamma_deg"]
    n_gamma, n_c = density.shape
    gamma = low + (np.arange(n_gamma) + 0.5) * (high - low) / n_gamma
    planes = []
    for c in (0.0, 90.0) if n_c > 1 else (0.0,):
        sides = (_half_plane(density, c + 180.0)[::-1], _half_plane(density, c))
        angles = np.concatenate((-gamma[::-1], gamma))
        values = np.concatenate(sides)
        planes.append(
            BeamPlane(
                name=f"C{c:g}–C{c + 180:g}" if n_c > 1 else "all C",
                gamma_deg=angles,
                values=values,
                beam_deg=full_angle(angles, values, 0.5),
                field_deg=full_angle(angles, values, 0.1),
            )
        )
    return planes


def _half_plane(density: Array, c_deg: float) -> Array:
    """Intensity over gamma at an azimuth, linear between the middles of cells."""
    n = density.shape[1]
    place = c_deg / 360.0 * n - 0.5
    first = math.floor(place)
    share = place - first
    return np.asarray((1.0 - share) * density[:, first % n] + share * density[:, (first + 1) % n])


def full_angle(gamma_deg: Array, values: Array, share: float) -> float | None:
    """Angle between the outermost places where a curve has this share of its largest value.

    Linear between the points of the curve, within 90° of the axis; None where the curve ends above
    the share, of a curve that is largest behind the source, and of one without light.

    >>> full_angle(np.array([-2.0, -1.0, 0.0, 1.0, 2.0]), np.array([0.0, 1, 2, 1, 0]), 0.25)
    3.0
    """
    ahead = np.abs(gamma_deg) <= 90.0
    threshold = share * float(values.max())
    if values[ahead].max(initial=0.0) < values.max():
        return None
    gamma_deg, values = gamma_deg[ahead], values[ahead]
    above = np.flatnonzero(values >= threshold)
    if threshold <= 0.0 or above[0] == 0 or above[-1] == len(values) - 1:
        return None
    ends = []
    for inner, outer in ((above[0], above[0] - 1), (above[-1], above[-1] + 1)):
        part = (values[inner] - threshold) / (values[inner] - values[outer])
        ends.append(gamma_deg[inner] + part * (gamma_deg[outer] - gamma_deg[inner]))
    return float(ends[1] - ends[0])


def numbers_of(image: DetectorImage, density: Array, unit: str) -> dict[str, Any]:
    """Flux, peak, mean and evenness of a picture; the angles of a far field's beam.

    ``mean``, ``min_over_mean`` and ``min_over_max`` are over all cells that have a size, weighed by
    it.
    """
    sized = np.ones(density.shape) if image.measure is None else image.measure.values
    shown = density[sized > 0.0]
    mean = float(np.average(shown, weights=sized[sized > 0.0]))
    peak, least = float(shown.max()), float(shown.min())
    numbers: dict[str, Any] = {
        "detector": image.detector.name,
        "flux": image.total,
        "flux_unit": image.flux_unit,
        "registrations": int(image.rays.sum()),
        "unit": unit,
        "peak": peak,
        "mean": mean,
        "min_over_mean": least / mean if mean > 0.0 else None,
        "min_over_max": least / peak if peak > 0.0 else None,
    }
    if image.detector.kind == "far_field" and image.measure is not None:
        numbers["planes"] = [
            {"plane": plane.name, "beam_deg": plane.beam_deg, "field_deg": plane.field_deg}
            for plane in beam_planes(image, density)
        ]
    return numbers

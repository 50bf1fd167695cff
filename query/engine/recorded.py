"""Quantities from columns that polarised traces store: state of polarisation, optical path."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.engine.context import RayContext

__all__ = ["LINEAR_LIMIT", "ellipse_of", "recorded_values"]

LINEAR_LIMIT = 1e-6
"""Linear part of the light below which it has no azimuth; float32 keeps about 1e-7."""

Ints = NDArray[np.integer[Any]]


def recorded_values(context: RayContext, word: str, points: Ints | None) -> NDArray[np.float64]:
    """A recorded quantity of rays or of points; NaN where it is undefined.

    Parameters
    ----------
    word : "degree_of_polarisation", "angle_of_polarisation" [deg], "optical_path" [scene units]
    points : indices among the points of the context, None for the end of every ray

    Returns
    -------
    (n_rays,) or (n_points_chosen,) float64
    """
    if word == "optical_path":
        column = context.optional("optical_path", 1)
        # The way out of the scene is no part of a path's length.
        ends = np.maximum(context.ends - context.left, context.starts)
        rows = ends if points is None else context.records[points]
        return np.full(len(rows), np.nan) if column is None else column[rows].astype(np.float64)
    column = context.optional("stokes", 3)
    has_segment = context.lengths > 1 if points is None else _goes_on(context, points)
    rows = context.ends - 1 if points is None else context.records[points]
    if column is None:
        return np.full(len(rows), np.nan)
    stokes = column[np.where(has_segment, rows, 0)].astype(np.float64)
    values = _degree(stokes) if word == "degree_of_polarisation" else _angle(stokes)
    return np.where(has_segment, values, np.nan)


def _goes_on(context: RayContext, points: Ints) -> NDArray[np.bool_]:
    """Whether a segment starts at a point, which it does at all but the last of a ray."""
    is_last = np.zeros(context.n_points, np.bool_)
    is_last[context.last_rows] = True
    return ~is_last[points]


def _degree(stokes: NDArray[np.float64]) -> NDArray[np.float64]:
    degree: NDArray[np.float64] = np.sqrt((stokes**2).sum(axis=-1))
    return degree


def _angle(stokes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Azimuth in (-90, 90] degrees, NaN for light without a linear part."""
    angle = np.degrees(0.5 * np.arctan2(stokes[..., 1], stokes[..., 0]))
    angle = np.where(angle <= -90.0, 90.0, angle)
    return np.where(np.hypot(stokes[..., 0], stokes[..., 1]) > LINEAR_LIMIT, angle, np.nan)


def ellipse_of(stokes: NDArray[np.floating[Any]]) -> dict[str, float | str | None]:
    """Degree and angle of polarisation, axis ratio and handedness of the polarised part.

    Parameters
    ----------
    stokes : (3,), s1, s2, s3 over s0

    Returns
    -------
    dict
        ``degree``; ``angle_deg``, None for light without a linear part; ``axis_ratio``, minor over
        major axis of the ellipse, and ``handedness``, both None for natural light

    References
    ----------
    Born & Wolf, 7th ed., 1.4.2: sin 2χ = s3 / s0 of the polarised part, axis ratio |tan χ|.
    """
    s = np.asarray(stokes, np.float64)
    degree, angle = float(_degree(s)), float(_angle(s))
    found: dict[str, float | str | None] = {
        "degree": degree,
        "angle_deg": None if np.isnan(angle) else angle,
        "axis_ratio": None,
        "handedness": None,
    }
    if degree > LINEAR_LIMIT:
        chi = 0.5 * np.arctan2(s[2], np.hypot(s[0], s[1]))
        ratio = float(abs(np.tan(chi)))
        found["axis_ratio"] = ratio
        found["handedness"] = (
            "linear" if ratio < LINEAR_LIMIT else ("right" if s[2] > 0 else "left")
        )
    return found

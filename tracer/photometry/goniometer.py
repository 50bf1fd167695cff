"""Photometry of types A and B turned into C planes.

The types differ in the axis about which a goniometer turns. In the frame of the luminaire as it is
measured, x towards C0 (its length), y towards C90 (its width), z from nadir up, an angle pair of
vertical V and horizontal H is the direction

    C:  V = gamma, H = C:     ( sin V cos H,   sin V sin H,  -cos V )
    B:  axis y, horizontal:   ( sin V cos H,  -sin H,        -cos V cos H )
    A:  axis z, upright:      ( cos V cos H,  -cos V sin H,   sin V )

so that nadir is V = 0, H = 0 in types B and C and V = -90 in type A, and photometric horizontal,
which is C0, is V = 90, H = 0 in types B and C and V = 0, H = 0 in type A. Horizontal angles turn
clockwise for someone above in types A and B, counter-clockwise in type C.

References
----------
ANSI/IESNA LM-63-02, definitions of section 3; CIE 121-1996, 4.1 (B planes:
tan B = cos C tan gamma, sin beta = sin C sin gamma).
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import SceneError

__all__ = ["Readings", "grid_of_type_a", "grid_of_type_b"]

Array = NDArray[np.float64]

_EDGE = 1e-3
"""Degrees in which light falls to 0 behind the last angle that was measured."""

_FINEST, _COARSEST = 0.1, 1.0
_MOST_VALUES = 4_000_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Readings:
    """Intensities over the two angles of a goniometer.

    Attributes
    ----------
    name : for messages
    vertical_deg : (n,) rising
    horizontal_deg : (m,) rising
    intensity : (n, m)
    """

    name: str
    vertical_deg: Array
    horizontal_deg: Array
    intensity: Array


def grid_of_type_a(readings: Readings) -> Readings:
    """Readings of type A over gamma and C, exactly: gamma = V + 90, C = -H.

    Raises
    ------
    SceneError
        for angles that are none of type A
    """
    whole = _mirrored(readings, "A")
    planes, values = -whole.horizontal_deg[::-1], whole.intensity[:, ::-1]
    gamma = whole.vertical_deg + 90.0
    # What was not measured is dark
    if gamma[0] > 0.0:
        low = max(0.0, gamma[0] - _EDGE)
        gamma = np.concatenate([[low], gamma])
        values = np.concatenate([0.0 * values[:1], values])
    if planes[-1] - planes[0] < 360.0 - _EDGE:
        dark = np.zeros((len(gamma), 1))
        ends = [planes[:1] - _EDGE, planes, planes[-1:] + _EDGE, planes[:1] + 360.0 - _EDGE]
        planes = np.concatenate(ends)
        values = np.concatenate([dark, values, dark, dark], axis=1)
    return replace(whole, vertical_deg=gamma, horizontal_deg=planes, intensity=values)


def grid_of_type_b(readings: Readings) -> Readings:
    """Readings of type B over gamma and C, interpolated between the angles that were measured.

    One horizontal angle alone is read as a distribution that is round about V = 0, H = 0.

    Raises
    ------
    SceneError
        for angles that are none of type B
    """
    if len(readings.horizontal_deg) == 1:
        return _round(readings)
    whole = _mirrored(readings, "B")
    vertical, horizontal = whole.vertical_deg, whole.horizontal_deg
    step = min(float(np.diff(vertical).min()), float(np.diff(horizontal).min()))
    step = min(max(step / 2.0, _FINEST), _COARSEST)
    # Reach to the farthest corner that was measured, then a little farther into the dark
    v, h = np.meshgrid(np.radians(vertical), np.radians(horizontal), indexing="ij")
    farthest = float(np.degrees(np.arccos(np.clip(np.cos(v) * np.cos(h), -1.0, 1.0))).max())
    gamma = np.linspace(0.0, farthest, max(2, int(np.ceil(farthest / step)) + 1))
    if farthest < 180.0 - 2.0 * _EDGE:
        gamma = np.append(gamma, farthest + _EDGE)
    turns = 4 * int(np.clip(90.0 / step, 36, _MOST_VALUES / 4 / len(gamma)))
    planes = np.linspace(0.0, 360.0, turns + 1)
    g, c = np.meshgrid(np.radians(gamma), np.radians(planes), indexing="ij")
    found_v = np.degrees(np.arctan2(np.sin(g) * np.cos(c), np.cos(g)))
    found_h = np.degrees(np.arcsin(np.clip(-np.sin(g) * np.sin(c), -1.0, 1.0)))
    values = _between(whole, found_v, found_h)
    return replace(whole, vertical_deg=gamma, horizontal_deg=planes, intensity=values)


def _round(readings: Readings) -> Readings:
    vertical, values = readings.vertical_deg, readings.intensity
    if vertical[0] < 0.0:
        # Both halves of the one plane, C0 and C180
        if not np.allclose(vertical, -vertical[::-1]):
            raise SceneError(
                f"{readings.name}: one horizontal angle of type B with vertical angles from "
                f"{vertical[0]:g} to {vertical[-1]:g} degrees; they must run from 0, or alike to "
                "both sides of it"
            )
        kept = vertical >= 0.0
        values = (0.5 * (values + values[::-1]))[kept]
        vertical = vertical[kept]
    warnings.warn(
        f"{readings.name}: photometric type B with one horizontal angle: its intensities are taken "
        "to be the same all round the direction V = 0, H = 0",
        stacklevel=5,
    )
    return replace(readings, vertical_deg=vertical, horizontal_deg=np.zeros(1), intensity=values)


def _mirrored(readings: Readings, kind: str) -> Readings:
    """Readings to both sides, where angles that begin at 0 say that both are alike."""
    name = readings.name
    vertical, horizontal = readings.vertical_deg, readings.horizontal_deg
    # Only an angle about the goniometer's axis may run all the way round
    reach_v, reach_h = (180.0, 90.0) if kind == "B" else (90.0, 180.0)
    for word, angles, reach in (
        ("vertical", vertical, reach_v),
        ("horizontal", horizontal, reach_h),
    ):
        if len(angles) < 2 or np.any(np.diff(angles) <= 0.0) or np.abs(angles).max() > reach + 1e-6:
            raise SceneError(
                f"{name}: photometric type {kind} needs two or more {word} angles that rise within "
                f"-{reach:g} .. {reach:g} degrees, given are {len(angles)} from {angles[0]:g} to "
                f"{angles[-1]:g}"
            )
    values = readings.intensity
    if vertical[0] == 0.0:
        vertical = np.concatenate([-vertical[:0:-1], vertical])
        values = np.concatenate([values[:0:-1], values], axis=0)
    if horizontal[0] == 0.0:
        horizontal = np.concatenate([-horizontal[:0:-1], horizontal])
        values = np.concatenate([values[:, :0:-1], values], axis=1)
    return Readings(name=name, vertical_deg=vertical, horizontal_deg=horizontal, intensity=values)


def _between(readings: Readings, vertical: Array, horizontal: Array) -> Array:
    """Bilinear values; 0 outside of what was measured."""
    v, h, values = readings.vertical_deg, readings.horizontal_deg, readings.intensity
    i = np.clip(np.searchsorted(v, vertical, side="right") - 1, 0, len(v) - 2)
    j = np.clip(np.searchsorted(h, horizontal, side="right") - 1, 0, len(h) - 2)
    s = (vertical - v[i]) / (v[i + 1] - v[i])
    t = (horizontal - h[j]) / (h[j + 1] - h[j])
    found = (1.0 - s) * ((1.0 - t) * values[i, j] + t * values[i, j + 1])
    found = found + s * ((1.0 - t) * values[i + 1, j] + t * values[i + 1, j + 1])
    margin = 1e-9
    outside = (np.minimum(s, t) < -margin) | (np.maximum(s, t) > 1.0 + margin)
    return np.where(outside, 0.0, np.maximum(found, 0.0))

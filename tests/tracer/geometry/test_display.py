"""Meshes that bodies are drawn with follow their surfaces."""

from __future__ import annotations

import numpy as np
import pytest

from tracer.geometry.shapes import Conic, sag_at


@pytest.mark.parametrize(
    ("curvature", "conic", "semi_diameter", "aspheric"),
    [
        (0.5, -1.0, 7.5, ()),  # a collimator: steep
        (0.02, 0.5, 10.0, ()),
        (0.0, 0.0, 10.0, (1e-3, -1e-5)),  # turns both ways
    ],
)
def test_the_profile_of_a_conic_stays_by_its_mesh(
    curvature: float, conic: float, semi_diameter: float, aspheric: tuple[float, ...]
) -> None:
    axis = np.array([0.0, 0.0, 1.0])
    shape = Conic(np.zeros(3), axis, curvature, conic, semi_diameter, 1.0, aspheric)
    vertices, _ = shape.mesh()
    radii, index = np.unique(np.round(np.hypot(*vertices[:, :2].T), 9), return_index=True)
    assert radii[[0, -1]] == pytest.approx([0.0, semi_diameter])
    heights = vertices[index, 2]
    r = np.linspace(0.0, semi_diameter, 400)
    sag = np.array([sag_at(x, curvature, conic, aspheric) for x in r])
    # Distance from the profile to the chords, across them
    drawn = np.interp(r, radii, heights)
    slope = np.interp(r, 0.5 * (radii[1:] + radii[:-1]), np.diff(heights) / np.diff(radii))
    assert np.abs((sag - drawn) / np.hypot(1.0, slope)).max() < 0.003 * semi_diameter

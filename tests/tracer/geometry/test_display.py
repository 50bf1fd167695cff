"""Meshes that bodies are drawn with follow their surfaces."""

from __future__ import annotations

import numpy as np
import pytest

from tracer.geometry.shapes import Conic, Cylinder, Frustum, Shape, SphereCap, sag_at


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


def _gradient(shape: Shape, points: np.ndarray) -> np.ndarray:
    """Outward gradient of the implicit form that the map's directory states for a face."""
    quadric = shape.quadric()
    assert quadric is not None
    xx, yy, zz, xy, xz, yz, x, y, z, _ = quadric.coefficients
    matrix = np.array([[2 * xx, xy, xz], [xy, 2 * yy, yz], [xz, yz, 2 * zz]])
    return np.asarray(points @ matrix + np.array([x, y, z]))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_triangles_are_wound_about_the_outward_normal(side: float) -> None:
    axis = np.array([0.6, 0.0, 0.8])
    o = np.array([1.0, 2.0, 3.0])
    for shape in (
        SphereCap(o, axis, 5.0, 10.0, side),
        SphereCap(o, axis, 5.0, 3.0, side),
        Cylinder(o, axis, 2.0, -1.0, 3.0, side),
        Frustum(o, axis, 2.0, 0.5, 0.0, 3.0, side),
        Frustum(o, axis, 2.0, -0.5, 0.0, 3.0, side),
        Conic(o, axis, 0.02, -1.0, 10.0, side),
        Conic(o, axis, -0.02, 0.5, 10.0, side),
    ):
        vertices, triangles = shape.mesh()
        a, b, c = (vertices[triangles[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        outward = (normals * _gradient(shape, (a + b + c) / 3)).sum(axis=1)
        area = np.linalg.norm(normals, axis=1)
        assert (outward[area > 1e-9] > 0).all(), shape

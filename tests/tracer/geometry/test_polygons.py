"""Polygons of mesh files: areas and volumes are those of the polygons, concave or not."""

from __future__ import annotations

import struct
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tracer.geometry.mesh_files import load_mesh
from tracer.geometry.polygon_files import UncutPolygons
from tracer.geometry.polygons import crosses_itself, cut_ears, is_convex

L_SHAPE = [(2, 0), (2, 1), (1, 1), (1, 2), (0, 2), (0, 0)]
"""From a corner whose fan leaves the polygon; area 3."""

KEYHOLE = [
    (0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1),
]  # fmt: skip
"""A square of 4 with a square hole of 2 that a bridge joins to its edge; area 12."""


def area(points: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0)


def flat(outline: list[tuple[float, float]]) -> np.ndarray:
    return np.array([(x, y, 0.0) for x, y in outline])


@pytest.mark.parametrize(("outline", "right"), [(L_SHAPE, 3.0), (KEYHOLE, 12.0)])
def test_triangles_cover_what_the_polygon_covers(
    outline: list[tuple[float, float]], right: float
) -> None:
    for turn in range(len(outline)):
        points = flat(outline[turn:] + outline[:turn])
        for given_points in (points, points[::-1], points[:, [1, 2, 0]]):
            triangles = cut_ears(given_points)
            assert triangles is not None
            assert not crosses_itself(given_points)
            assert area(given_points, triangles) == pytest.approx(right)


@given(
    st.lists(st.floats(0.2, 1.0), min_size=4, max_size=40),
    st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)),
)
def test_stars_are_cut_whole(radii: list[float], tilt: tuple[float, float, float]) -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, len(radii), endpoint=False)
    x, y = np.array(radii) * [np.cos(angles), np.sin(angles)]
    points = np.column_stack([x, y, tilt[0] * x + tilt[1] * y + tilt[2]])
    # Shoelace formula, and how much larger than its shadow the tilted polygon is
    shadow = float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2.0)
    triangles = cut_ears(points)
    assert triangles is not None
    assert not crosses_itself(points)
    assert area(points, triangles) == pytest.approx(
        shadow * np.sqrt(1.0 + tilt[0] ** 2 + tilt[1] ** 2), rel=1e-9
    )


def test_pentagram_is_neither_convex_nor_simple() -> None:
    angles = 0.8 * np.pi * np.arange(5)
    points = flat(list(zip(np.cos(angles), np.sin(angles), strict=True)))
    assert not is_convex(points)
    assert crosses_itself(points)


def prism(kind: str) -> bytes:
    """An L-shaped prism of volume 3 with two concave ends, in one of the formats."""
    n = len(L_SHAPE)
    points = [(x, y, z) for z in (0, 1) for x, y in L_SHAPE]
    faces = [list(range(n))[::-1], list(range(n, 2 * n))]
    faces += [[k, (k + 1) % n, n + (k + 1) % n, n + k] for k in range(n)]
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in points)
    if kind == "obj":
        lines = "".join(f"v {row}\n" for row in rows.splitlines())
        for number, face in enumerate(faces):
            lines += f"g part_{number % 2}\n" if number < 2 else ""
            count = len(points) if number % 2 else -1
            words = [str(k + 1) if count < 0 else str(k - count) for k in face]
            lines += f"f {' '.join(words[:3])} \\\n {' '.join(words[3:])}\n"
        return lines.encode()
    listed = "".join(f"{len(face)} {' '.join(map(str, face))}\n" for face in faces)
    if kind == "off":
        return f"OFF # a prism\n{len(points)} {len(faces)} 0\n{rows}{listed}".encode()
    order = {"ply": "ascii", "ply<": "binary_little_endian", "ply>": "binary_big_endian"}[kind]
    head = (
        f"ply\nformat {order} 1.0\nelement vertex {len(points)}\nproperty float x\n"
        f"property float y\nproperty float z\nelement face {len(faces)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    ).encode()
    if kind == "ply":
        return head + (rows + listed).encode()
    mark = kind[-1]
    body = b"".join(struct.pack(f"{mark}3f", *point) for point in points)
    body += b"".join(struct.pack(f"{mark}B{len(f)}i", len(f), *f) for f in faces)
    return head + body


@pytest.mark.parametrize("kind", ["obj", "off", "ply", "ply<", "ply>"])
def test_concave_ends_of_a_prism_in_every_format(kind: str, tmp_path: Path) -> None:
    path = tmp_path / f"prism.{kind.rstrip('<>')}"
    path.write_bytes(prism(kind))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mesh = load_mesh(path)
    assert mesh.volume == pytest.approx(3.0)
    # Twice the end, and 1 high around an outline of 8
    assert area(mesh.vertices, mesh.triangles) == pytest.approx(2 * 3.0 + 8.0)
    assert len(mesh.triangles) == 2 * 4 + 6 * 2
    if kind == "obj":
        assert sorted(mesh.face_names) == ["part_0", "part_1"]


def test_only_polygons_that_cross_themselves_are_warned_about(tmp_path: Path) -> None:
    path = tmp_path / "bow.obj"
    path.write_text("v 0 0 0\nv 1 1 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3 4\nf 1 2 5\n")
    with pytest.warns(UncutPolygons, match="bow.obj: 1 polygons cross themselves"):
        load_mesh(path, solid=False)

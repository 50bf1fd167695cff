"""Scenes of very many bodies: the same pairs, the same hits as when each is compared with each."""

from __future__ import annotations

import itertools
import tracemalloc
from collections.abc import Sequence

import numpy as np
import pytest

from raymap.model.errors import SceneError
from tests.tracer.transport.test_decided import crowd
from tracer.bodies.lens import LensBody
from tracer.geometry.kinds import ANNULUS, CYLINDER, POLYGON, RECTANGLE, SPHERE
from tracer.geometry.shape_columns import ShapeColumns
from tracer.geometry.shapes import Annulus, Cylinder, Polygon, Rectangle, Shape, SphereCap
from tracer.scene.arrangement import candidates
from tracer.scene.arrangement.coincident_faces import find_coincident_faces
from tracer.scene.box_pairs import overlapping_boxes
from tracer.scene.checks import check_lenses, on_common_axis
from tracer.scene.compile import compile_scene
from tracer.scene.load import parse_scene
from tracer.transport.wavefront import Wavefront

Pairs = set[tuple[int, int]]

KINDS = {
    "box": 'kind = "box"\nsize = [2, 2, 2]\nmedium = "glass"',
    "sphere": 'kind = "sphere"\nradius = 1\nmedium = "glass"',
    "disc": 'kind = "disc"\nouter = 1\nsurface = "white"',
    "lens": (
        'kind = "lens"\nthickness = 1\nmedium = "glass"\ndiameter = 3\n'
        "front = { radius = 10 }\nback = { radius = -10 }"
    ),
}
HEAD = """
length_unit = "mm"
[media.glass]
index = 1.5
[surfaces.white]
kind = "lambertian"
reflectance = 0.5
[sources.sun]
kind = "collimated"
position = [50, 50, -50]
direction = [0.1, 0, 1]
diameter = 100
"""


def field(kind: str, side: int, step: float = 5.0) -> str:
    """A square field of bodies."""
    return (
        f"{HEAD}[bodies.b]\n{KINDS[kind]}\n"
        f"copies = {{ count = [{side}, {side}], step = [[{step}, 0, 0], [0, {step}, 0]] }}\n"
    )


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("n", [0, 1, 40, 1200])
def test_pairs_of_boxes_are_those_of_comparing_each_with_each(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    middle, half = rng.uniform(0.0, 20.0, (n, 3)), rng.uniform(0.0, 1.0, (n, 3))
    if seed % 3 == 1:  # in rows that touch
        middle, half = np.round(middle), np.full((n, 3), 0.5)
    if seed % 3 == 2:  # long ones
        half[:, seed % 2] *= 40.0
    low, high = middle - half, middle + half
    found = [pair for ones, others in overlapping_boxes(low, high, 1e-9)
             for pair in zip(ones.tolist(), others.tolist(), strict=True)]  # fmt: skip
    meets = (np.maximum(low[:, None], low) <= np.minimum(high[:, None], high) + 1e-9).all(axis=2)
    expected = set(zip(*(k.tolist() for k in np.nonzero(np.triu(meets, 1))), strict=True))
    assert len(found) == len(set(found))
    assert set(found) == expected


def same_surface(a: Shape, b: Shape, reach: float) -> bool:
    """Whether both are parts of one plane, sphere or cylinder, by their definitions."""
    flat = (ANNULUS, RECTANGLE, POLYGON)
    one, other = a.row(), b.row()
    apart = other[0:3] - one[0:3]
    if a.kind in flat and b.kind in flat:
        return bool(
            np.linalg.norm(np.cross(one[3:6], other[3:6])) < 1e-6 and abs(apart @ one[3:6]) <= reach
        )
    if a.kind != b.kind:
        return False
    if a.kind == SPHERE:
        centers = [row[0:3] + row[6] * row[3:6] for row in (one, other)]
        return bool(np.abs(centers[0] - centers[1]).max() <= reach and abs(one[6] - other[6]) <= reach)  # fmt: skip # noqa: E501
    assert a.kind == CYLINDER
    return bool(
        np.linalg.norm(np.cross(one[3:6], other[3:6])) < 1e-6
        and np.linalg.norm(np.cross(apart, one[3:6])) <= reach
        and abs(one[6] - other[6]) <= reach
    )


def shapes_at_random(rng: np.random.Generator, n: int) -> list[Shape]:
    """Faces on a few planes, spheres and cylinders, so that many share one."""
    axes = [*np.eye(3), np.array([0.6, 0.0, 0.8]), np.array([0.5773, -0.7887, 0.2115])]
    axes = [axis / np.linalg.norm(axis) for axis in axes]
    found: list[Shape] = []
    for _ in range(n):
        axis = axes[rng.integers(len(axes))] * rng.choice([-1.0, 1.0])
        u = np.cross(axis, [0.3, 0.4, 0.5])
        u /= np.linalg.norm(u)
        v = np.cross(axis, u)
        place = rng.integers(-2, 3) * axis
        inside = place + rng.uniform(-4, 4) * u + rng.uniform(-4, 4) * v
        kind = rng.integers(5)
        if kind == 0:
            found.append(Annulus(inside, axis, 0.0, 1.0))
        elif kind == 1:
            found.append(Rectangle(inside, u, v, (1.0, 2.0)))
        elif kind == 2:
            found.append(Polygon(np.array([inside, inside + u, inside + v])))
        elif kind == 3:
            middle, radius = rng.integers(-1, 2, 3) * 1.0, float(rng.integers(1, 3))
            found.append(SphereCap(middle - radius * axis, axis, radius, 2.5 * radius))
        else:
            found.append(Cylinder(rng.integers(-3, 3) * axis, axis, 1.0, 0.0, 2.5))
    return found


def coincident_faces_of(shapes: Sequence[Shape], size: float) -> Pairs:
    """Pairs that are found, all faces being of solids, each of its own."""
    n = len(shapes)
    found = find_coincident_faces(ShapeColumns.of_shapes(shapes), range(n), [True] * n, size)
    assert found is not None
    pairs = {
        (k, int(other))
        for k in range(n)
        for other in found.face[found.first[k] : found.first[k + 1]]
    }
    assert all((other, k) in pairs for k, other in pairs)
    return {pair for pair in pairs if pair[0] < pair[1]}


@pytest.mark.parametrize("seed", range(4))
def test_coincident_faces_are_those_of_one_surface_whose_boxes_meet(seed: int) -> None:
    shapes = shapes_at_random(np.random.default_rng(seed), 400)
    size, reach = 10.0, 1e-8
    expected = set()
    for (k, a), (m, b) in itertools.combinations(enumerate(shapes), 2):
        (low, high), (lower, higher) = a.bounds(), b.bounds()
        if (low > higher + reach).any() or (lower > high + reach).any():
            continue
        if not same_surface(a, b, reach):
            continue
        if isinstance(a, Cylinder) and isinstance(b, Cylinder):
            # More than an edge of the stretch along their axis
            middles = [c.origin + 1.25 * c.axis for c in (a, b)]
            if abs((middles[0] - middles[1]) @ a.axis) >= 2.5 - reach:
                continue
        expected.add((k, m))
    assert len(expected) > 300
    assert coincident_faces_of(shapes, size) == expected


def test_lenses_on_one_axis_are_compared_wherever_they_are() -> None:
    rng = np.random.default_rng(5)
    axis = np.array([0.36, 0.48, 0.8])
    for far in (0.0, 1e4):
        for overlaps in (False, True):
            places = [far * axis + 3.0 * k * axis for k in rng.permutation(40)]
            if overlaps:
                places[17] = places[3] + 0.4 * axis
            lenses = {
                f"L{k}": LensBody.model_validate(
                    {
                        "kind": "lens",
                        "medium": "g",
                        "thickness": 1.0,
                        "diameter": 3.0,
                        "front": {"radius": 10.0},
                        "back": {"radius": -10.0},
                        "position": place.tolist(),
                        "axis": axis.tolist(),
                    }
                )
                for k, place in enumerate(places)
            }
            assert on_common_axis(lenses["L0"], lenses["L1"])
            if overlaps:
                with pytest.raises(SceneError, match=r"L17.*overlaps 'L3' by"):
                    check_lenses(dict(lenses), "scene")
            else:
                check_lenses(dict(lenses), "scene")


@pytest.mark.parametrize("seed", range(3))
def test_faces_that_share_lists_are_met_as_with_lists_of_their_own(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = parse_scene(crowd(seed))
    monkeypatch.setattr(candidates, "_FEW_FACES", 0)
    own = compile_scene(scene).arrays
    monkeypatch.setattr(candidates, "_ENTRIES", 900)
    shared = compile_scene(scene).arrays
    assert len(own.first) == len(own.list_of) + 1
    assert 8 < len(shared.first) < len(own.first) / 2
    found, expected = (Wavefront(item, 3).trace(0, 20_000) for item in (shared, own))
    for column in ("position", "object", "triangle", "event", "medium", "records_per_ray"):
        np.testing.assert_array_equal(getattr(found, column), getattr(expected, column))


@pytest.mark.parametrize("kind", ["box", "disc"])
def test_memory_grows_with_the_number_of_bodies_and_no_faster(kind: str) -> None:
    peaks = []
    for side in (12, 24):
        scene = parse_scene(field(kind, side))
        tracemalloc.start()
        compilation = compile_scene(scene)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert len(compilation.directory.objects) == side * side
    assert peaks[1] < 4.5 * peaks[0] + 2e8
    assert peaks[1] < 3e8


def test_boxes_side_by_side_touch_their_neighbours_alone() -> None:
    arrays = compile_scene(parse_scene(field("box", 30, step=2.0))).arrays
    assert arrays.coincident is not None
    counts = np.diff(arrays.coincident.first).reshape(30, 30, 6)
    # A side meets the neighbour's side and, at its edges, those of the neighbour's neighbours
    inner = counts[1:-1, 1:-1]
    assert (inner == inner[0, 0]).all()
    assert inner.max() < 30

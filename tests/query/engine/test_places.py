"""Detectors placed after the trace against recorded ones, and against geometry."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import query
import raymap
from query.answers.images.obstructed import ended_before
from query.engine.places import parse_place
from raymap.model.errors import CriterionError, RayMapError
from raymap.passes.crossings import Segments
from tests.query.answers.what_if.test_what_if import SCENE, traced

SEEN = """
[detectors.odd]
position = [2, 1, 8]
looks = [0.3, 0.1, -1]
up = [0, 1, 0.2]
size = [30, 20]
cells = [12, 9]
acceptance_deg = 50
[detectors.far]
kind = "far_field"
axis = [0, 1, 0.5]
gamma_deg = [10, 130]
cells = [24, 12]
[detectors.hole]
kind = "pinhole"
position = [0, 0, 18]
looks = [0, 0, -1]
cells = [8, 8]
field_deg = 40
"""
SAME = {
    "wall": "plane(z=15, size=[40, 40], cells=[4, 4])",
    "odd": "plane(center=[2, 1, 8], looks=[0.3, 0.1, -1], up=[0, 1, 0.2], size=[30, 20], "
    "cells=[12, 9], acceptance_deg=50)",
    "far": "far_field(axis=[0, 1, 0.5], gamma_deg=[10, 130], cells=[24, 12])",
}
CRITERIA = (None, 'hit("plate")', 'count(hit("*", reflected)) >= 2', 'detected("odd")')


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Iterator[raymap.RayMap]:
    text = SCENE.replace("UNIT", "lm").replace("[limits]", SEEN + "[limits]")
    with traced(tmp_path_factory.mktemp("base") / "a.raymap", text, 1, rays=15_000) as ray_map:
        yield ray_map


@pytest.mark.parametrize("name", SAME)
@pytest.mark.parametrize("how", ["described", "moved"])
def test_placed_detectors_are_those_that_were_recorded(base: Any, name: str, how: str) -> None:
    """Cell by cell: only a ray within the rounding of positions of an edge may change its cell."""
    text = SAME[name] if how == "described" else f"moved(detector='{name}')"
    for criterion in CRITERIA:
        recorded = query.detector_image(base, name, criterion)
        placed = query.detector_image(base, text, criterion)
        rays = placed.rays
        if (name, how) == ("wall", "described"):
            # It looks the other way, so that u runs the other way
            rays = rays[:, ::-1]
        assert np.abs(rays - recorded.rays).sum() <= 4
        assert placed.flux.sum() == pytest.approx(recorded.flux.sum(), rel=1e-3)
        assert placed.lit.quantity()[2] == recorded.lit.quantity()[2]
        assert placed.total_variance is not None
        assert recorded.total_variance is not None
        for unit, variance in placed.total_variance.items():
            assert variance == pytest.approx(recorded.total_variance[unit], rel=1e-2)


def test_the_view_answers_as_a_map_with_the_detector(base: Any) -> None:
    text = SAME["odd"]
    view = query.with_detectors(base, text, "sphere(radius=3)")
    asked = f'detected("{text}")'
    both = query.select(view, f'{asked} & detected("odd")')
    assert both.matched == query.select(base, 'detected("odd")').matched
    for criterion in ('detected("odd")', 'detected("wall")', 'event(absorbed) & hit("plate")'):
        mine, own = query.select(view, criterion), query.select(base, criterion)
        assert mine.matched == own.matched
        assert mine.flux == pytest.approx(own.flux, rel=1e-9)
        assert mine.flux_se == pytest.approx(own.flux_se, rel=1e-9)
    np.testing.assert_allclose(query.audit(view).flux, query.audit(base).flux, rtol=1e-9)
    table = query.path_table(view, asked)
    assert table.total == pytest.approx(query.select(base, 'detected("odd")').flux, rel=1e-9)
    [lamp, _] = query.sweep(base, text)
    assert lamp.flux == pytest.approx(query.sweep(base, "odd")[0].flux, rel=1e-9)
    ray = int(both.ray_ids[0])
    named = [
        {met["detector"] for met in point["detectors"]}
        for point in query.report(view, ray)["points"]
    ]
    assert any({"odd", text} <= names for names in named)


def test_changed_maps_have_placed_detectors(base: Any) -> None:
    changed = query.what_if(base, {"paint.reflectance": 0.2})
    for criterion in (None, 'hit("screen", reflected)'):
        own = query.detector_image(changed, "odd", criterion).flux
        np.testing.assert_allclose(
            query.detector_image(changed, SAME["odd"], criterion).flux, own, rtol=1e-6, atol=1e-9
        )


def test_criteria_ask_for_places(base: Any) -> None:
    for name, text in SAME.items():
        for more in ("", ' & hit("plate")'):
            crosses = query.select(base, f"crosses({text.replace(chr(39), chr(34))}){more}")
            recorded = query.select(base, f'detected("{name}"){more}')
            assert crosses.matched == recorded.matched > 0
            assert crosses.flux == pytest.approx(recorded.flux, rel=1e-12)
    node = query.crosses("plane(z=1,  size=[3, 4])", 'moved(detector="odd", by=[0, 0, 1])')
    assert query.parse(str(node)) == node == query.from_json(node.to_json())
    assert query.select(base, ~node).matched == base.rays - query.select(base, node).matched


def test_light_counts_once_per_crossing(base: Any) -> None:
    """Of all segments that end on different sides of a plane or sphere: one crossing each."""
    [portion] = base.portions
    offsets, position = portion.record_offsets(), portion.column("position").astype(np.float64)
    inside = np.ones(len(position), np.bool_)
    inside[offsets[1:] - 1] = False
    begin = np.flatnonzero(inside)
    event = portion.column("event")
    leaves = np.isin(begin + 1, np.flatnonzero(event & int(raymap.Event.LEFT_SCENE)))
    segments = Segments(portion)
    for text, side in (
        ("plane(z=1, size=[1e9, 1e9])", position[:, 2] - 1.0),
        # In the plane of a face: light that comes and goes has one side
        ("plane(z=2, size=[1e9, 1e9])", position[:, 2] - 2.0),
        ("sphere(radius=6)", np.linalg.norm(position, axis=1) - 6.0),
    ):
        found = segments.cross(parse_place(text, base.directory)).record
        once = (side[begin] < 0.0) != (side[begin + 1] < 0.0)
        odd = np.bincount(found, minlength=len(position))[begin] % 2 == 1
        # What leaves the scene goes on beyond its last point
        np.testing.assert_array_equal(odd[~leaves], once[~leaves])
        assert once[~leaves].sum() > 1000


def test_light_that_leaves_goes_on(base: Any) -> None:
    """A sphere around everything is crossed once by all that leaves; far planes are reached."""
    left = query.select(base, "event(left)")
    around = query.select(base, "crosses(sphere(radius=1e6))")
    assert around.matched == left.matched
    image = query.detector_image(base, "sphere(radius=1e6, cells=[1, 8])")
    far = query.detector_image(base, "far_field(cells=[1, 8])")
    # Seen from afar places on a sphere are directions; cells of the sphere are equal in solid angle
    edges = np.degrees(np.arccos(np.linspace(1.0, -1.0, 9)))
    assert image.flux.sum() == pytest.approx(far.flux.sum(), rel=1e-9)
    assert edges[4] == pytest.approx(90.0)
    assert image.flux[4:].sum() == pytest.approx(far.flux[:4].sum(), rel=1e-3)
    assert image.lit.size.sum() == pytest.approx(4.0 * math.pi * 1e6, rel=0.5, abs=1e13)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("plane(z=1)", "size is missing"),
        ("plane(z=1, x=2, size=[1, 1])", "one of x, y, z"),
        ("plane(center=[0, 0, 0], size=[1, 1])", "looks is missing"),
        ("plane(z=1, size=[1, 0])", "lies from"),
        ("plane(z=1, size=[1, 1], cells=[0, 4])", "greater than or equal"),
        ("plane(z=1, size=[1, 1], celsl=[2, 4])", "nearest: cells"),
        ("plane(z=nan, size=[1, 1])", "lies from"),
        ("plane(z=1 size=2)", "cannot be read"),
        ("plane(z=1, size=[1, 1], looks=[1, 0, 0])", "looks along z"),
        ("sphere(cells=[2, 2])", "radius is missing"),
        ("sphere(radius=-1)", "lies from"),
        ("far_field(gamma_deg=[90, 10])", "rises"),
        ("far_field(axis=[0, 0, 0])", "no direction"),
        ("moved(detector='hole', by=[0, 0, 1])", "pinhole"),
        ("moved(detector='wal')", "wall"),
        ("moved(detector='wall', turn=3)", "about is missing"),
        ("moved(detector='far', size=[1, 1])", "has no size"),
    ],
)
def test_what_describes_no_place_is_refused_in_one_line(base: Any, text: str, said: str) -> None:
    with pytest.raises(RayMapError, match=said) as caught:
        query.with_detectors(base, text)
    assert "\n" not in str(caught.value)
    if "'" not in text and said != "cannot be read":
        with pytest.raises(CriterionError):
            query.select(base, f"crosses({text})")


def test_moved_detectors_are_turned_and_resized(base: Any) -> None:
    text = (
        "moved(detector='odd', by=[1, 2, 3], turn=90, about=[0, 0, 1], size=[3, 2], cells=[6, 5])"
    )
    own = next(d for d in base.directory.detectors if d.name == "odd")
    moved = parse_place(text, base.directory)
    assert moved.detector.center == (3.0, 3.0, 11.0)
    x, y, z = own.axis_u
    np.testing.assert_allclose(moved.detector.axis_u, (-y, x, z), atol=1e-12)
    assert moved.detector.size == (3.0, 2.0)
    assert moved.detector.cells == (6, 5)
    assert moved.least_cosine == pytest.approx(math.cos(math.radians(50.0)))
    assert not moved.both_sides


def test_light_of_a_point_has_its_focus_there(base: Any) -> None:
    found = query.focus(base, "plane(z=-5, size=[90, 90])", 'source("lamp") & !hit("*")')
    assert found.rays > 100
    assert found.best is not None
    # The lamp stands at z = -10; positions are float32
    assert found.best.distance == pytest.approx(-5.0, abs=1e-5)
    assert found.best.rms < 1e-4
    assert found.best.centroid == pytest.approx((0.0, 0.0), abs=1e-5)


def test_spots_along_the_axis_are_those_of_planes_there(base: Any) -> None:
    """Light on its way to the screen, between two planes that nothing stands before."""
    criterion = 'source("beam") & crosses(plane(z=15, size=[30, 30])) & bounces == 2'
    planes = [query.focus(base, f"plane(z={z}, size=[60, 60])", criterion) for z in (15, 17)]
    moved = query.focus(base, "plane(z=15, size=[60, 60])", criterion, distances=[0.0, 2.0])
    there = query.focus(base, "plane(z=17, size=[60, 60])", criterion, distances=[0.0]).rows[0]
    assert planes[0].rays == planes[1].rays > 500
    assert moved.rows[1].rms == pytest.approx(there.rms, rel=1e-6)
    assert moved.rows[1].rms_se == pytest.approx(there.rms_se, rel=1e-6)
    assert moved.rows[1].radius == pytest.approx(there.radius, rel=1e-5)
    assert moved.best is not None
    assert planes[1].best is not None
    assert moved.best.distance == pytest.approx(planes[1].best.distance + 2.0, rel=1e-5)
    assert all(row.rms >= moved.best.rms for row in (*moved.rows, *planes[0].rows))


def test_what_a_body_ended_before_is_said(base: Any) -> None:
    """Behind the screen, which is larger than the plane: only what ended on it is told."""
    place = "plane(z=22, size=[40, 40], cells=[4, 4])"
    told = ended_before(base, place)
    front = query.select(base, 'last(hit("screen.z_min")) & crosses(plane(z=18, size=[40, 40]))')
    assert next(iter(told)) == "screen"
    assert told["screen"] == pytest.approx(front.flux, rel=0.25)
    assert query.detector_image(base, place).rays.sum() == 0
    assert ended_before(base, "wall") == {}

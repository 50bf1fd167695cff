"""The PyVista view holds the same rays and bodies as the painted picture."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import raymap
from raymap.model.errors import RayMapError
from viewer import Section, ViewState, picture, plotter
from viewer.drawn.answers import draw_rays
from viewer.drawn.scene import load_bodies
from viewer.drawn.state import Clip
from viewer.paint.painter import Painter
from viewer.shown.plotting import PlottedScene

pyvista = pytest.importorskip("pyvista")

GHOST = 'count(hit("L1", reflected)) == 2'


def test_all_rays_are_one_mesh_with_their_numbers(small_map: raymap.RayMap) -> None:
    view = plotter(small_map, GHOST, rays=50, off_screen=True, window_size=(320, 200))
    try:
        assert {"L1", "tube", "sensor", "rays"} <= set(view.actors)
        mesh = view.actors["rays"].mapper.dataset
        drawn = np.unique(mesh.cell_data["ray_id"])
        assert 0 < len(drawn) <= 50
        for ray_id in drawn[:5].tolist():
            portion, ray = small_map.find_ray(ray_id)
            stored = small_map.portions[portion]
            first, last = stored.record_offsets()[ray : ray + 2]
            places = stored.column("position")[first:last]
            ends = mesh.lines.reshape(-1, 3)[mesh.cell_data["ray_id"] == ray_id, 1:]
            segments = np.asarray(mesh.points)[ends]
            np.testing.assert_array_equal(segments[:, 0], places[:-1])
            np.testing.assert_array_equal(segments[:, 1], places[1:])
    finally:
        view.close()


def test_it_renders_what_the_painter_paints(small_map: raymap.RayMap) -> None:
    view = plotter(small_map, GHOST, rays=50, off_screen=True, window_size=(320, 200))
    try:
        rendered = np.asarray(view.screenshot(None, return_img=True))[..., :3]
    finally:
        view.close()
    painted = picture(small_map, GHOST, rays=50, size=(320, 200), legend=False)
    covered = [
        np.abs(image - image[0, 0].astype(int)).sum(axis=2) > 60 for image in (rendered, painted)
    ]
    # Bodies and rays stand in the same part of both pictures
    both = (covered[0] & covered[1]).sum()
    assert both > 0.5 * min(covered[0].sum(), covered[1].sum()) > 100


def test_an_unknown_color_rule_is_refused(small_map: raymap.RayMap) -> None:
    with pytest.raises(RayMapError, match="no colour rule 'rainbow'"):
        plotter(small_map, color="rainbow")


class Shown:
    """A plotter that follows a session, as a window does."""

    def __init__(self, small_map: raymap.RayMap) -> None:
        bodies = load_bodies(small_map.directory, small_map.meshes)
        self.painter = Painter(bodies, small_map.directory)
        self.drawing = draw_rays(small_map, GHOST, 50)
        self.rays = self.drawing.rays
        self.plotter = pyvista.Plotter(off_screen=True, window_size=(320, 200))
        self.scene = PlottedScene(self.plotter, self.painter)

    def to(self, state: ViewState) -> tuple[str, ...]:
        return self.scene.show(state, self.drawing)

    def pixels(self) -> np.ndarray[Any, Any]:
        return np.asarray(self.plotter.screenshot(None, return_img=True))[..., :3].astype(int)


@pytest.fixture
def shown(small_map: raymap.RayMap) -> Iterator[Shown]:
    made = Shown(small_map)
    yield made
    made.plotter.close()


def _places(actor: Any) -> tuple[str, int]:
    """The points that an actor shows, and when they were made."""
    points = actor.mapper.GetInput().GetPoints()
    return points.GetAddressAsString("vtkPoints"), points.GetMTime()


def test_changes_of_looks_leave_the_meshes_alone(shown: Shown) -> None:
    state = ViewState(opacity=1.0)
    shown.to(state)
    places = {name: _places(actor) for name, actor in shown.plotter.actors.items()}
    changed = shown.to(replace(state, hidden=("tube",), color="source", body_opacity=0.5))
    assert set(changed) == {"looks", "colors"}
    assert not shown.plotter.actors["tube"].visibility
    assert shown.plotter.actors["L1"].prop.opacity == pytest.approx(0.11, abs=0.01)
    assert {name: _places(actor) for name, actor in shown.plotter.actors.items()} == places
    # Sources have one colour each
    rgba = shown.plotter.actors["rays"].mapper.dataset.cell_data["rgba"]
    assert len(np.unique(rgba, axis=0)) == len(np.unique(shown.rays.source))


def test_a_clip_leaves_the_segments_that_it_says(shown: Shown) -> None:
    shown.to(ViewState())
    shown.to(ViewState(clip=Clip(after=2)))
    mesh = shown.plotter.actors["rays"].mapper.dataset
    counts = np.bincount(np.searchsorted(shown.rays.ray_ids, mesh.cell_data["ray_id"]))
    reflected = (shown.rays.event & int(raymap.Event.SPECULAR_REFLECTION)) != 0
    for ray, count in enumerate(counts.tolist()):
        own = reflected[shown.rays.offsets[ray] : shown.rays.offsets[ray + 1]]
        second = np.flatnonzero(own)[1]
        assert count == len(own) - 1 - second


def test_a_section_cuts_bodies_and_rays_in_the_picture(shown: Shown) -> None:
    """Seen along z, nothing is left on one side of the plane x = 0."""
    state = ViewState(opacity=1.0, hidden=("sensor",))
    shown.to(state)
    front = shown.painter.standard("front", None, 1.6)
    shown.to(replace(state, camera=front))
    whole = shown.pixels()
    shown.to(replace(state, camera=front, section=Section(on=True, normal=(1, 0, 0))))
    cut = shown.pixels()
    ground = whole[:, :1]
    for pixels, both in ((whole, True), (cut, False)):
        drawn = np.abs(pixels - ground).sum(axis=2) > 30
        sides = drawn[:, :155].sum(), drawn[:, 165:].sum()
        assert max(sides) > 500
        assert bool(min(sides) > 500) is both

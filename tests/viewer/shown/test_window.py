"""The window: what is clicked, hidden and cut; opened without a screen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import raymap
from raymap.cli import application
from raymap.model.errors import RayMapError
from viewer.app.session import Session
from viewer.drawn.answers import draw_rays
from viewer.drawn.camera import view_matrix
from viewer.drawn.state import Camera, ViewState
from viewer.shown.window import Window, camera_of, open_window

pyvista = pytest.importorskip("pyvista")

SIZE = (320, 240)
BESIDE = Camera(position=(90, 30, 40), focal_point=(0, 0, 20), view_up=(0, 1, 0), height=40)


@pytest.fixture(params=[True, False], ids=["parallel", "perspective"])
def window(request: pytest.FixtureRequest, small_map: raymap.RayMap) -> Iterator[Window]:
    state = ViewState(rays=100, camera=replace(BESIDE, parallel=request.param), hidden=("tube",))
    opened = open_window(small_map, state, off_screen=True, window_size=SIZE)
    opened.plotter.show(auto_close=False)
    yield opened
    opened.plotter.close()


def test_a_click_finds_what_the_application_finds(window: Window, small_map: raymap.RayMap) -> None:
    state = window.state
    session = Session(small_map, state)
    session.drawing = draw_rays(small_map, "", 100)
    segments = session.shown().lines.segments
    matrix = view_matrix(session.camera(*SIZE), *SIZE, 1.0)
    found = 0
    for ends in segments[::29]:
        x, y, _, w = matrix @ np.append(ends.mean(axis=0), 1.0)
        if 0 < x / w < SIZE[0] and 0 < y / w < SIZE[1]:
            picked = window.click(x / w, y / w)
            assert picked == session.pick(x / w, y / w, *SIZE)
            found += picked.ray is not None
    assert found > 5


def test_rays_are_drawn_where_they_are_clicked(window: Window) -> None:
    """A pixel on a ray shows a ray: VTK's camera is the session's, to a pixel."""
    window.scene.change(hidden=("tube", "L1", "sensor"), opacity=1.0, width=3.0)
    pixels = np.asarray(window.plotter.screenshot(None, return_img=True))[..., :3].astype(int)
    lines = window.scene.now.colored.lines
    assert window.state.camera is not None
    matrix = view_matrix(window.state.camera, *SIZE, 1.0)
    checked = 0
    for ends in lines.segments[::7]:
        x, y, _, w = matrix @ np.append(ends.mean(axis=0), 1.0)
        column, row = int(x / w), int(y / w)
        if 5 < column < SIZE[0] - 5 and 5 < row < 180:
            around = pixels[row - 1 : row + 2, column - 1 : column + 2]
            assert around.sum(axis=2).max() > 200
            checked += 1
    assert checked > 10


def test_keys_hide_what_was_clicked_and_cut(window: Window) -> None:
    window.scene.change(hidden=())
    assert window.state.camera is not None
    x, y, _, w = view_matrix(window.state.camera, *SIZE, 1.0) @ np.array([9.0, 0, 2.0, 1])
    window.scene.change(hidden=("tube",))
    assert str(window.click(x / w, y / w).face).startswith("L1.")
    window.hide()
    assert window.state.hidden == ("L1", "tube")
    assert not window.plotter.actors["L1"].visibility
    window.show_all()
    assert window.plotter.actors["L1"].visibility
    window.cut()
    assert window.plotter.actors["L1"].mapper.GetClippingPlanes().GetNumberOfItems() == 1
    window.cut()
    planes = window.plotter.actors["L1"].mapper.GetClippingPlanes()
    assert planes is None or planes.GetNumberOfItems() == 0


def test_the_camera_of_the_window_is_the_sessions(window: Window) -> None:
    seen = camera_of(window.plotter)
    wanted = window.state.camera
    assert wanted is not None
    assert seen.height == pytest.approx(wanted.height)
    np.testing.assert_allclose(seen.focal_point, wanted.focal_point)
    assert seen.parallel is wanted.parallel


def test_the_command_opens_it(small_map: raymap.RayMap, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pyvista, "OFF_SCREEN", True)
    monkeypatch.setenv("PYVISTA_OFF_SCREEN", "true")
    done = CliRunner().invoke(application(), ["view", str(small_map.path), "--window"])
    assert done.exit_code == 0, done.output


def test_without_a_screen_it_says_what_to_do(
    small_map: raymap.RayMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "PYVISTA_OFF_SCREEN"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    with pytest.raises(RayMapError, match="leave out --window"):
        open_window(small_map, ViewState())

"""The scene drawn by the page: WebGL in software, which is asserted, so that no painter hides it.

One page is opened for all of these tests; each leaves the camera as it finds it or sets its own.
"""

from __future__ import annotations

import base64
import os
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import raymap
from tests.viewer.page import Page
from viewer.app.server import RunningServer, run_in_thread
from viewer.drawn import camera as arithmetic
from viewer.drawn.camera import view_matrix
from viewer.drawn.state import Section, ViewState, read_camera

playwright = pytest.importorskip("playwright.sync_api")

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(
        not (shutil.which("chromium") or shutil.which("chromium-browser") or "CI" in os.environ),
        reason="no Chromium (Debian: apt-get install chromium)",
    ),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]

SOFTWARE = [
    "--headless", "--no-sandbox", "--no-first-run", "--disable-background-networking",
    "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist",
]  # fmt: skip

# Counts what a page sends and uploads, and draw calls between two pictures
COUNTERS = """
window.counted = {sent: 0, uploads: 0, draws: 0};
const send = WebSocket.prototype.send;
WebSocket.prototype.send = function (...a) { window.counted.sent++; return send.apply(this, a); };
const gl = WebGL2RenderingContext.prototype;
for (const name of ["bufferData", "bufferSubData", "texImage2D", "texSubImage2D"]) {
  const own = gl[name];
  gl[name] = function (...a) { window.counted.uploads++; return own.apply(this, a); };
}
for (const name of ["drawArrays", "drawElements", "drawArraysInstanced"]) {
  const own = gl[name];
  gl[name] = function (...a) { window.counted.draws++; return own.apply(this, a); };
}
const extension = gl.getExtension;
gl.getExtension = function (name) {
  const found = extension.call(this, name);
  if (name === "WEBGL_multi_draw" && found && !found.counted) {
    const own = found.multiDrawArraysWEBGL.bind(found);
    found.multiDrawArraysWEBGL = (...a) => { window.counted.draws++; return own(...a); };
    found.counted = true;
  }
  return found;
};
"""
VIEW = "document.querySelector('[data-testid=view]')"
SCENE = f"{VIEW}.raymapScene"


class Drawn(Page):
    """A page that draws its scene itself."""

    def camera(self) -> dict[str, Any]:
        found: dict[str, Any] = self.tab.evaluate(f"({SCENE}).camera")
        return found

    def pixels(self) -> np.ndarray[Any, Any]:
        """The picture as (height, width, 3) uint8."""
        text, width, height = self.tab.evaluate(
            f"""() => {{
                const scene = {SCENE}, gl = scene.gl;
                scene.paint();
                const w = gl.drawingBufferWidth, h = gl.drawingBufferHeight;
                const data = new Uint8Array(4 * w * h);
                gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, data);
                let text = "";
                for (let i = 0; i < data.length; i += 8192)
                    text += String.fromCharCode(...data.subarray(i, i + 8192));
                return [btoa(text), w, h];
            }}"""
        )
        flat = np.frombuffer(base64.b64decode(text), np.uint8).reshape(height, width, 4)
        return flat[::-1, :, :3]


@pytest.fixture(scope="module")
def server(map_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(tmp_path_factory.mktemp("config")))
        with raymap.open(map_path) as ray_map:
            state = ViewState(rays=50, opacity=1.0, width=2.0, body_opacity=3.0)
            running = run_in_thread(ray_map, state, render="client")
            yield running
            running.stop()


@pytest.fixture(scope="module")
def page(server: RunningServer) -> Iterator[Drawn]:
    path = shutil.which("chromium") or shutil.which("chromium-browser")
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=path, args=SOFTWARE)
        context = opened.new_context(viewport={"width": 900, "height": 640})
        context.add_init_script(COUNTERS)
        page = Drawn(opened, server.url, context)
        assert "SwiftShader" in page.tab.evaluate(f"({SCENE}).drawnBy")
        yield page
        assert page.errors == []
        opened.close()


def look(page: Drawn, server: RunningServer, **changes: Any) -> None:
    """Change the session as another panel would, and wait for the picture."""
    core = server.application

    async def change() -> None:
        core.session.update(**changes)
        core.repaint()

    import asyncio

    assert server._loop is not None
    asyncio.run_coroutine_threadsafe(change(), server._loop).result(10)
    page.tab.wait_for_timeout(50)
    page.settle()


def silhouette(pixels: np.ndarray[Any, Any], ground: np.ndarray[Any, Any]) -> Any:
    """Where there is anything."""
    return np.abs(pixels.astype(int) - ground.astype(int)).sum(axis=2) > 24


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"section": Section(on=True, normal=(1, 0, 0.2), offset=1.0)},
        {"section": Section(on=True, normal=(0, 1, 0), rays=False)},
        {"hidden": ("tube",), "opacities": {"L1": 1.0}, "width": 3.0},
        {"parallel": False},
        {"dark": False},
    ],
    ids=["plain", "section", "section of bodies", "opaque", "perspective", "light"],
)
def test_page_and_painter_show_the_same(
    page: Drawn, server: RunningServer, changes: dict[str, Any]
) -> None:
    """Both pictures have their bodies and rays at the same places: IoU of at least 0.95."""
    session = server.application.session
    before = session.state
    page.get("view-tilted").click()
    page.settle()
    changes = dict(changes)
    camera = replace(
        session.camera(*server.application._size), parallel=changes.pop("parallel", True)
    )
    try:
        look(page, server, camera=camera, **changes)
        drawn = page.pixels()
        height, width = drawn.shape[:2]
        size = (session.shown(), session.camera(width, height), width, height)
        painted = session.painter.paint(session.state, *size, supersampling=2)
        page.shot(f"client-{'-'.join(changes) or 'plain'}")
        # The ground alone: a look past everything
        past = replace(camera, focal_point=(1e5, 0, 0), position=(1e5, 0, 1))
        nothing = session.painter.paint(session.state, size[0], past, width, height)
    finally:
        look(page, server, **{name: getattr(before, name) for name in (*changes, "camera")})
    one, other = (silhouette(picture, nothing) for picture in (drawn, painted))
    assert one.sum() > 2000
    assert (one & other).sum() / (one | other).sum() >= 0.95


def test_the_camera_turns_as_the_programs_does(page: Drawn) -> None:
    seen = {
        "position": [80.0, 30, 5], "focal_point": [1.0, 2, 3], "view_up": [0.1, 1, 0.2],
        "height": 44.0, "parallel": False,
    }  # fmt: skip
    moves = page.tab.evaluate(
        """camera => { const C = RaymapScene.Camera; return [
            C.orbit(camera, 13, -7, 480), C.pan(camera, 13, -7, 480),
            C.zoom(camera, 1.3, 100, 50, 640, 480)]; }""",
        seen,
    )
    own = read_camera(seen)
    expected = [
        arithmetic.orbit(own, 13, -7, 480),
        arithmetic.pan(own, 13, -7, 480),
        arithmetic.zoom(own, 1.3, 100, 50, 640, 480),
    ]
    for found, wanted in zip(moves, expected, strict=True):
        for name in ("position", "focal_point", "view_up", "height"):
            np.testing.assert_allclose(found[name], getattr(wanted, name), rtol=1e-12, atol=1e-12)


def test_turning_sends_nothing_and_uploads_nothing(page: Drawn) -> None:
    box = page.get("canvas").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    mouse = page.tab.mouse
    mouse.move(x, y)
    mouse.down()
    mouse.move(x + 10, y)
    page.tab.wait_for_timeout(100)
    before = page.camera()
    page.tab.evaluate(
        f"counted.sent = counted.uploads = counted.draws = 0; counted.first = ({SCENE}).frames"
    )
    for step in range(12):
        mouse.move(x + 10 + 4 * step, y + step)
        page.tab.wait_for_timeout(10)
    page.tab.wait_for_timeout(100)
    # A ray map may be open in other tabs: what is looked at is between press and release
    counted = page.tab.evaluate("counted")
    frames = page.tab.evaluate(f"({SCENE}).frames") - counted["first"]
    mouse.up()
    assert page.camera()["position"] != before["position"]
    assert frames >= 2
    assert counted["uploads"] == 0
    assert counted["draws"] / frames <= 20
    assert counted["sent"] == 0


def test_the_program_learns_where_the_page_looks_from(page: Drawn, server: RunningServer) -> None:
    page.get("view").focus()
    page.tab.keyboard.press("ArrowLeft")
    session = server.application.session
    for _ in range(50):
        page.tab.wait_for_timeout(100)
        if session.state.camera == read_camera(page.camera()):
            break
    assert session.state.camera == read_camera(page.camera())


def test_a_click_opens_the_ray_that_is_drawn_there(page: Drawn, server: RunningServer) -> None:
    page.get("view-side").click()
    page.settle()
    page.get("view").focus()
    page.tab.keyboard.press("ArrowUp")
    page.tab.wait_for_timeout(300)
    session = server.application.session
    box = page.get("canvas").bounding_box()
    width, height = round(box["width"]), round(box["height"])
    matrix = view_matrix(read_camera(page.camera()), width, height, 1.0)
    ends = session.shown().lines.segments[7]
    x, y, _, w = matrix @ np.append(ends.mean(axis=0), 1.0)
    page.tab.mouse.click(box["x"] + x / w, box["y"] + y / w)
    page.wait_text("report-facts", "star" if session.shown().rays.source[0] == 0 else "")
    number = int(page.get("ray-number").input_value())
    picked = session.pick(x / w, y / w, width, height, read_camera(page.camera()))
    assert picked.ray is not None
    assert number == picked.ray[0]
    page.settle()
    assert page.tab.evaluate(f"({SCENE}).parts.chosen.count") > 1


def test_a_criterion_draws_its_rays_alone(page: Drawn, server: RunningServer) -> None:
    page.ask('source("lamp")')
    lines = server.application.session.colored().lines
    assert page.tab.evaluate(f"({SCENE}).ends") == 2 * len(lines) > 0
    page.ask("")
    page.get("criterion").press("Escape")
    assert page.tab.evaluate(f"({SCENE}).ends") > 2 * len(lines)


def test_names_and_scale_are_written_over_the_picture(page: Drawn, server: RunningServer) -> None:
    page.get("view-side").click()
    page.settle()
    look(page, server, names=True)
    page.shot("client-names")
    page.pixels()
    written = page.tab.evaluate(f"({SCENE}).written")
    assert written["names"] == 3
    # The bar is the longest of 1, 2, 5 × 10ⁿ units that has at most 110 pixels
    number, unit = written["scale"].split()
    height = page.get("canvas").bounding_box()["height"]
    share = float(number) / (page.camera()["height"] / height * 110)
    assert unit == "mm"
    assert 0.4 <= share <= 1
    look(page, server, names=False)
    page.pixels()
    assert page.tab.evaluate(f"({SCENE}).written.names") == 0


def point_at(page: Drawn, server: RunningServer, place: tuple[float, float, float]) -> Any:
    """The pixel of the page where a place is seen."""
    box = page.get("canvas").bounding_box()
    width, height = round(box["width"]), round(box["height"])
    matrix = view_matrix(read_camera(page.camera()), width, height, 1.0)
    x, y, _, w = matrix @ np.append(np.array(place), 1.0)
    return box["x"] + x / w, box["y"] + y / w


def alphas(page: Drawn) -> list[int]:
    found: list[int] = page.tab.evaluate(f"Array.from(({SCENE}).alphas)")
    return found


def test_a_right_click_offers_what_can_be_done_with_a_face(
    page: Drawn, server: RunningServer
) -> None:
    look(page, server, hidden=("tube",))
    page.get("view-side").click()
    page.settle()
    rim = point_at(page, server, (0, 9.2, 2.0))
    page.tab.mouse.click(*rim, button="right")
    page.get("scene-menu").wait_for()
    page.shot("client-menu")
    assert page.get("scene-menu").locator("h4").first.inner_text() == "L1.rim"
    # Keys move in the menu and close it
    page.tab.keyboard.press("ArrowDown")
    page.tab.keyboard.press("Escape")
    assert page.get("scene-menu").count() == 0
    for word, text in (
        ("must", 'hit("L1.rim")'),
        ("never", '!hit("L1.rim")'),
        ("reflected", 'hit("L1.rim", reflected)'),
        ("ended", 'last(hit("L1.rim"))'),
    ):
        page.tab.mouse.click(*rim, button="right")
        page.get(f"gesture-{word}").click()
        page.tab.wait_for_function(
            "text => document.querySelector('[data-testid=criterion]').value === text", arg=text
        )
        page.settle()
        page.get("undo").click()
        page.tab.wait_for_function("document.querySelector('[data-testid=criterion]').value === ''")
        page.settle()
    look(page, server, hidden=())


def test_hide_and_isolate_are_undone(page: Drawn, server: RunningServer) -> None:
    look(page, server, hidden=("tube",))
    page.get("view-side").click()
    page.settle()
    before = alphas(page)
    rim = point_at(page, server, (0, 9.2, 2.0))
    for word, shown in (("hide", [False, False, True]), ("isolate", [True, False, False])):
        page.tab.mouse.click(*rim, button="right")
        page.get(f"gesture-{word}").click()
        page.tab.wait_for_function(
            f"shown => ({SCENE}).alphas.every((a, i) => (a > 0) === shown[i])", arg=shown
        )
        page.get("view").focus()
        page.tab.keyboard.press("Control+z")
        page.tab.wait_for_function(
            f"before => ({SCENE}).alphas.every((a, i) => a === before[i])", arg=before
        )
    page.tab.keyboard.press("Control+Shift+z")
    page.tab.wait_for_function(f"({SCENE}).alphas[2] === 0")
    page.tab.mouse.click(*rim, button="right")
    page.get("gesture-show").click()
    page.tab.wait_for_function(f"({SCENE}).alphas.every(a => a > 0)")


def test_the_path_of_a_ray_is_selected_and_left_out(page: Drawn, server: RunningServer) -> None:
    page.get("view-side").click()
    page.settle()
    session = server.application.session
    middles = session.shown().lines.segments.mean(axis=1)
    # One behind the lens, which is in the picture
    ends = session.shown().lines.segments[int(np.argmax(middles[:, 2] > 15))]
    spot = point_at(page, server, tuple(ends.mean(axis=0)))
    counts = []
    for word in ("path", "not_path"):
        page.tab.mouse.click(*spot, button="right")
        page.get(f"gesture-{word}").click()
        page.tab.wait_for_function(
            "document.querySelector('[data-testid=undo]').disabled === false"
        )
        page.tab.wait_for_function(
            "document.querySelector('[data-testid=criterion]').value.includes('path(')"
        )
        page.settle()
        counts.append(int(page.text("answer").split(" of ")[0].replace(",", "")))
        page.get("undo").click()
        page.tab.wait_for_function("document.querySelector('[data-testid=criterion]').value === ''")
        page.settle()
    assert sum(counts) == session.map.rays
    assert min(counts) > 0


def test_what_comes_too_late_is_dropped(page: Drawn) -> None:
    took = page.tab.evaluate(
        f"""() => {{
            const scene = {SCENE}, style = scene.parts.style;
            const late = {{name: "style", revision: scene.have.style - 1, arrays: [],
                           header: {{...style, dark: !style.dark}}}};
            return [scene.take(late, new Uint8Array(0)), scene.parts.style.dark === style.dark];
        }}"""
    )
    assert took == [False, True]


def test_a_page_that_loses_its_card_takes_pictures(page: Drawn) -> None:
    """The last of these tests: the page draws no more."""
    page.tab.evaluate(f"({SCENE}).gl.getExtension('WEBGL_lose_context').loseContext()")
    page.tab.wait_for_timeout(100)
    page.get("view-front").click()
    page.tab.wait_for_function(f"{VIEW}.dataset.drawnBy === 'server'")
    page.settle()
    assert page.get("view").locator("img").is_visible()
    page.tab.close()

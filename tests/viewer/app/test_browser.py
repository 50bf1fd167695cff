"""The application in a real browser: what a person does, and what they then see."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import raymap
from query import select
from query.answers.reports.ray_report import report
from tests.viewer.page import WINDOW, Page
from tests.viewer.small_map import make_directory, make_portion, rgb_channels, write_map
from viewer.app.server import RunningServer, run_in_thread
from viewer.drawn.state import ViewState, state_from_address

playwright = pytest.importorskip("playwright.sync_api")

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(
        not (shutil.which("chromium") or shutil.which("chromium-browser") or "CI" in os.environ),
        reason="no Chromium (Debian: apt-get install chromium)",
    ),
    # Playwright and aiohttp leave closing their sockets to the collector
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]

ARGUMENTS = [
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
]  # fmt: skip
SEEN = 'detected("sensor")'
MIRRORED = 'hit("L1.back", reflected)'
TUBE = 'hit("tube")'
GHOSTS = 'count(hit("*", reflected)) == 2 & detected("sensor")'


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    path = shutil.which("chromium") or shutil.which("chromium-browser")
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=path, args=ARGUMENTS)
        yield opened
        opened.close()


@pytest.fixture(scope="module")
def server(map_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(tmp_path_factory.mktemp("config")))
        with raymap.open(map_path) as ray_map:
            running = run_in_thread(ray_map, ViewState(rays=500))
            yield running
            running.stop()


@pytest.fixture(scope="module")
def context(browser: Any) -> Iterator[Any]:
    """The one browser of most of these tests, as the server knows it by its cookie."""
    opened = browser.new_context(**WINDOW)
    yield opened
    opened.close()


@pytest.fixture
def page(browser: Any, context: Any, server: RunningServer) -> Iterator[Page]:
    opened = Page(browser, server.url, context)
    if opened.get("criterion").input_value():
        opened.ask("")
    yield opened
    assert opened.errors == []
    opened.close()


def matched(server: RunningServer, criterion: str) -> int:
    return select(server.application.session.map, criterion or None).matched


def count_of(server: RunningServer, criterion: str) -> str:
    """How the page says how many rays match."""
    return f"{matched(server, criterion):,} of"


def test_it_opens_without_the_internet(page: Page, server: RunningServer) -> None:
    assert {host.split(":")[0] for host in page.hosts} == {"localhost"}
    assert page.text("answer").startswith("1,200 of 1,200 rays")
    assert page.text("drawn").startswith("500 rays")
    assert page.tab.evaluate("document.fonts.check('18px \"Material Design Icons\"')")
    page.shot("1-opened")


def test_the_address_needs_its_token(browser: Any, server: RunningServer) -> None:
    context = browser.new_context()
    tab = context.new_page()
    answer = tab.goto(server.url.split("?")[0])
    assert answer.status == 403
    assert "token" in tab.inner_text("body")
    context.close()


def test_the_token_leaves_the_address_and_a_cookie_stands_for_it(
    page: Page, server: RunningServer
) -> None:
    page.ask(GHOSTS)
    page.tab.wait_for_function("location.hash.length > 10")
    assert server.token not in page.tab.url
    assert "secret" not in page.tab.url
    assert server.token not in page.tab.content()
    assert page.tab.evaluate("document.cookie") == ""
    page.tab.reload()
    page.settle()
    assert page.get("criterion").input_value() == GHOSTS
    assert page.text("answer").startswith(count_of(server, GHOSTS))
    page.ask("")


def test_a_criterion_is_typed_completed_and_answered(page: Page, server: RunningServer) -> None:
    box = page.get("criterion")
    box.click()
    box.press_sequentially("dete")
    page.get("completions").wait_for()
    box.press("Tab")
    page.wait_text("completions", "sensor")
    page.shot("2-completion")
    box.press("Tab")
    box.press("Enter")
    page.wait_text("answer", count_of(server, SEEN))
    page.settle()
    assert box.input_value() == 'detected("sensor")'


def test_errors_show_their_place_and_the_server_goes_on(page: Page, server: RunningServer) -> None:
    page.get("criterion").fill('hit("L9")')
    page.get("criterion").press("Enter")
    page.wait_text("criterion-error", "L9")
    assert "^" in page.text("criterion-error")
    page.shot("3-error")
    page.ask(GHOSTS)
    assert page.text("answer").startswith(count_of(server, GHOSTS))


def test_the_tree_and_the_text_edit_each_other(page: Page, server: RunningServer) -> None:
    page.ask('detected("sensor")')
    page.show("criterion")
    page.get("atom-kind").select_option("hit")
    page.get("atom-name").select_option("L1.back")
    page.get("atom-event").select_option("reflected")
    page.get("add-and").click()
    both = 'detected("sensor") & hit("L1.back", reflected)'
    page.tab.wait_for_function(
        "text => document.querySelector('[data-testid=criterion]').value === text", arg=both
    )
    page.settle()
    page.wait_text("tree", f"{matched(server, MIRRORED):,}")
    page.shot("4-tree")
    page.get("tree").get_by_text('detected("sensor")').hover()
    page.get("remove-0").click()
    page.tab.wait_for_function(
        "document.querySelector('[data-testid=criterion]').value === 'hit(\"L1.back\", reflected)'"
    )
    page.get("save-name").fill("back mirror")
    page.get("save-criterion").click()
    page.wait_text("panel-criterion", "back mirror")
    page.settle()


def test_a_rectangle_on_the_detector_selects(page: Page, server: RunningServer) -> None:
    page.show("detector")
    image = page.get("image-full")
    image.wait_for()
    page.tab.wait_for_function(
        "document.querySelector('[data-testid=image-full] img').naturalWidth === 36"
    )
    box = image.bounding_box()
    x, y, w, h = (box[key] for key in ("x", "y", "width", "height"))
    page.tab.mouse.move(x + 0.1 * w, y + 0.3 * h)
    page.tab.mouse.down()
    page.tab.mouse.move(x + 0.3 * w, y + 0.6 * h)
    page.tab.mouse.move(x + 0.45 * w, y + 0.95 * h)
    page.tab.mouse.up()
    page.tab.wait_for_function(
        "document.querySelector('[data-testid=criterion]').value.includes('rect(')"
    )
    page.settle()
    text = page.get("criterion").input_value()
    numbers = [float(n) for n in re.findall(r"[\d.]+", text.partition("rect(")[2])]
    np.testing.assert_allclose(numbers, [3.6, 0.05 * 24, 0.45 * 36, 0.7 * 24], atol=0.2)
    found = matched(server, text)
    assert 0 < found < 200
    page.wait_text("answer", f"{found:,} of")
    page.shot("5-region")
    page.get("region-clear").click()
    page.wait_text("answer", "1,200 of")


def test_the_path_table_fills_its_panel(page: Page) -> None:
    def bottoms() -> tuple[float, float, float]:
        """Lower edges of the table's part, of its last row, and of the panel."""
        return tuple(
            page.tab.evaluate(
                """() => ['.rm-paths .rm-scroll', '.rm-paths tr:last-child', '.rm-paths']
                    .map(name => [...document.querySelectorAll(name)].at(-1)
                        .getBoundingClientRect().bottom)"""
            )
        )

    page.show("paths")
    page.get("path-table").wait_for()
    page.get("ghost-matrix").wait_for()
    page.ask('count(hit("*", reflected)) < 2')
    page.get("ghost-matrix").wait_for(state="hidden")
    page.get("path-0").wait_for()
    # What is shorter than the panel stands there whole
    table, row, panel = bottoms()
    assert row <= table + 1 < panel
    # What is longer reaches its lower end; only the padding is left
    page.tab.set_viewport_size({"width": 1440, "height": 400})
    table, row, panel = bottoms()
    assert row > table
    assert panel - 13 <= table <= panel + 1
    # Beside the ghost matrix the table keeps some rows, and the panel scrolls
    page.ask("")
    page.get("ghost-matrix").wait_for()
    height = page.tab.evaluate("document.querySelector('.rm-scroll').clientHeight")
    assert height >= 195


def test_paths_are_shown_alone_and_together(page: Page, server: RunningServer) -> None:
    page.ask(GHOSTS)
    page.show("paths")
    rows = page.get("path-table").locator("tbody tr")
    rows.first.wait_for()
    count = rows.count()
    assert count == 2
    rays = [int(rows.nth(k).locator("td").nth(2).inner_text()) for k in range(count)]
    assert sum(rays) == matched(server, GHOSTS)
    rows.nth(1).click()
    page.wait_text("drawn", f"{rays[1]} rays")
    page.get("check-0").click()
    page.wait_text("legend", "↩")
    assert page.get("legend").locator("i").count() == 2
    page.settle()
    page.shot("6-paths")
    page.get("paths-clear").click()
    page.wait_text("drawn", f"{sum(rays)} rays")
    page.get("ghost-matrix").locator("rect").first.click()
    page.tab.wait_for_function(
        "document.querySelector('[data-testid=criterion]').value.includes('->')"
    )
    page.settle()


def pick_a_ray(page: Page, server: RunningServer) -> None:
    """Click where the program says that a ray is drawn."""
    session = server.application.session
    box = page.get("view").bounding_box()
    width, height = round(box["width"]), round(box["height"])
    shown = session.shown()
    from viewer.drawn.camera import view_matrix

    matrix = view_matrix(session.camera(width, height), width, height, 1.0)
    middles = shown.lines.segments.mean(axis=1)
    flat = np.c_[middles, np.ones(len(middles))] @ matrix.T
    pixels = flat[:, :2] / flat[:, 3:]
    # Away from the buttons and the legend on the picture
    free = (pixels > [60, 120]) & (pixels < [width - 60, height - 250])
    x, y = pixels[np.flatnonzero(free.all(axis=1))[0]]
    page.tab.mouse.click(box["x"] + x, box["y"] + y)


def test_a_ray_is_picked_and_reported(page: Page, server: RunningServer) -> None:
    page.ask(GHOSTS)
    pick_a_ray(page, server)
    page.get("report-facts").wait_for()
    number = int(page.get("ray-number").input_value())
    assert number in select(server.application.session.map, GHOSTS).ray_ids
    expected = report(server.application.session.map, number)
    steps = page.get("report-points").locator(".rm-step")
    assert steps.count() == len(expected["points"])
    page.get("point-2").click()
    page.wait_text("point-facts", f"{expected['points'][2]['incidence_deg']:.4g}")
    assert page.get("spectrum").locator("svg").count() == 1
    page.settle()
    page.shot("7-report")
    page.get("ray-next").click()
    page.tab.wait_for_function(
        "n => document.querySelector('[data-testid=ray-number]').value !== n", arg=str(number)
    )
    page.get("ray-number").fill("99999999")
    page.get("ray-number").press("Enter")
    page.wait_text("report-error", "no ray 99999999")


def test_the_scene_turns_and_changes(page: Page) -> None:
    page.show("paths")
    before = page.get("view").locator("img").get_attribute("src")
    box = page.get("view").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.tab.mouse.move(x, y)
    page.tab.mouse.down()
    page.tab.mouse.move(x + 60, y + 20)
    page.tab.mouse.move(x + 90, y + 40)
    page.tab.mouse.up()
    page.tab.mouse.wheel(0, -240)
    page.tab.wait_for_function(
        "src => document.querySelector('[data-testid=view] img').src !== src", arg=before
    )
    page.get("view-tilted").click()
    page.get("section").check()
    page.get("color").select_option("source")
    page.wait_text("legend", "lamp")
    page.get("eye-tube").click()
    page.settle()
    page.shot("8-scene")
    page.get("eye-tube").click()
    page.get("section").uncheck()
    page.get("color").select_option("natural")
    page.settle()


def test_files_are_saved(page: Page, tmp_path: Path) -> None:
    page.ask(GHOSTS)
    for kind, begins in (("session", b"{"), ("png", b"\x89PNG"), ("glb", b"glTF"), ("vtp", b"<?x")):
        page.get("menu").click()
        with page.tab.expect_download() as caught:
            page.get(f"export-{kind}").click()
        path = tmp_path / caught.value.suggested_filename
        caught.value.save_as(path)
        assert path.read_bytes().startswith(begins)
    session = tmp_path / "small.json"
    assert json.loads(session.read_text())["criterion"] == GHOSTS
    page.ask("")
    page.get("menu").click()
    page.get("session-file").set_input_files(session)
    page.wait_text("answer", "of 1,200")
    page.tab.wait_for_function(
        "text => document.querySelector('[data-testid=criterion]').value === text", arg=GHOSTS
    )
    page.settle()


def test_two_tabs_share_a_session_and_one_may_close(
    browser: Any, context: Any, page: Page, server: RunningServer
) -> None:
    page.ask(GHOSTS)
    page.tab.wait_for_function("location.hash.length > 10")
    other = Page(browser, f"{server.url}#{page.tab.url.partition('#')[2]}", context)
    assert other.get("criterion").input_value() == GHOSTS
    page.wait_text("messages", "2 tabs")
    other.ask(TUBE)
    page.wait_text("answer", count_of(server, TUBE))
    other.close()
    page.ask("")
    assert page.text("answer").startswith("1,200 of")


def test_each_browser_has_a_session_of_its_own(
    browser: Any, map_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    with raymap.open(map_path) as ray_map:
        running = run_in_thread(ray_map, ViewState(rays=100))
        running.browsers.most = 2
        mine = Page(browser, running.url)
        mine.ask(GHOSTS)
        mine.show("detector")
        # Another browser begins where the command said, and sees nothing of the first
        theirs = Page(browser, running.url)
        assert theirs.get("criterion").input_value() == ""
        assert theirs.text("answer").startswith("1,200 of 1,200")
        theirs.show("criterion")
        assert "None yet" in theirs.text("recent")
        theirs.ask(TUBE)
        theirs.get("dark").click()
        assert mine.get("criterion").input_value() == GHOSTS
        assert mine.text("answer").startswith(f"{select(ray_map, GHOSTS).matched:,} of")
        assert running.application.session.state.criterion == GHOSTS
        assert running.application.session.state.dark
        mine.tab.reload()
        mine.settle()
        assert mine.get("criterion").input_value() == GHOSTS
        theirs.shot("11-another-browser")
        # There is a bound, and it is said
        late = browser.new_context()
        tab = late.new_page()
        answer = tab.goto(running.url)
        assert answer.status == 503
        assert "Other browsers show this map already" in tab.inner_text("body")
        # Who is there may go on, and who went makes room
        mine.ask(TUBE)
        monkeypatch.setattr("viewer.app.browsers._KEPT_SECONDS", 0.0)
        theirs.close()
        tab.wait_for_timeout(500)
        again = Page(browser, running.url, late)
        assert again.get("criterion").input_value() == ""
        assert len(running.browsers) == 2
        assert mine.errors == again.errors == []
        late.close()
        mine.close()
        running.stop()


def test_the_address_restores_a_session(browser: Any, server: RunningServer, page: Page) -> None:
    page.ask(TUBE)
    page.show("criterion")
    page.settle()
    page.tab.wait_for_function("location.hash.length > 10")
    # The address follows the page: wait until it has the panel, too
    for _ in range(300):
        address = page.tab.evaluate("location.href")
        kept = state_from_address(address.partition("#")[2])
        if (kept.criterion, kept.panel) == (TUBE, "criterion"):
            break
        page.tab.wait_for_timeout(100)
    page.ask("")
    page.show("paths")
    again = Page(browser, f"{server.url}#{address.partition('#')[2]}")
    again.tab.wait_for_function(
        "document.querySelector('[data-testid=criterion]').value === 'hit(\"tube\")'"
    )
    again.get("panel-criterion").wait_for()
    again.tab.goto(server.url + "#broken!")
    again.close()


def test_damaged_bare_and_empty_maps_say_so(
    browser: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bare = write_map(tmp_path / "bare.raymap", portions=2, rays=100, meshes=False, detect=False)
    with raymap.open(bare) as ray_map:
        middle = ray_map.portions[1].offset + ray_map.portions[1].stored_bytes // 2
    data = bytearray(bare.read_bytes())
    data[middle] ^= 0xFF
    bare.write_bytes(data)
    with raymap.open(bare, on_damage="skip") as ray_map:
        running = run_in_thread(ray_map, ViewState(panel="detector"))
        opened = Page(browser, running.url)
        opened.wait_text("messages", "portion 1")
        opened.wait_text("detector-note", "No ray")
        opened.wait_text("objects", "no mesh")
        opened.shot("9-damaged")
        assert opened.errors == []
        opened.close()
        running.stop()


def test_a_map_that_is_recorded_grows_on_the_page(
    browser: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("viewer.app.core.REFRESH_SECONDS", 0.1)
    path = tmp_path / "growing.raymap"
    writer = raymap.RayMapWriter.create(path, make_directory())
    writer.add_channel_set(rgb_channels())
    writer.start_run(seed=1, parameters={})
    writer.append(make_portion(100))
    with raymap.open(path) as ray_map:
        running = run_in_thread(ray_map)
        pages = [Page(browser, running.url) for _ in range(2)]
        for opened in pages:
            opened.wait_text("app", "recording")
            opened.wait_text("answer", "100 of 100")
        writer.append(make_portion(150, 100))
        for opened in pages:
            opened.wait_text("answer", "250 of 250")
        writer.finish()
        for opened in pages:
            opened.tab.wait_for_function("!document.body.innerText.includes('recording')")
            assert opened.errors == []
            opened.close()
        running.stop()
    writer.close()

"""Names of a stranger's map are text wherever they are shown: page, drawings, files, terminal."""

from __future__ import annotations

import json
import os
import re
import shutil
import unicodedata
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import raymap
from raymap.model.directory import Directory
from raymap.model.plaintext import plain_text
from tests.viewer.small_map import make_directory, make_meshes, make_portion, rgb_channels
from viewer.app.server import run_in_thread
from viewer.drawn.state import ViewState

MARKUP = (
    "<img src=x onerror=window.ran=1>",
    "{{ constructor.constructor('window.ran=1')() }}",
    "]]><script>window.ran=1</script>",
    "\"><svg onload=window.ran=1>' onmouseover='window.ran=1",
    "[red]x[/red][link=http://evil.example]y[/link]",
    "</title></text><foreignObject><iframe srcdoc='<script>parent.ran=1</script>'>",
    "javascript:window.ran=1//&lt;b&gt;&#60;i&#62;",
    "${window.ran=1}`\\",
)
ACTIVE = (
    "a\x1b[2Jb", "a\x1b]0;title\x07b", "a\x9b2Jb", "a\r\nb", "a\x00b", "a\x08\x08b",
    "a\u202eb", "a\u2066b\u2069", "a\u200fb", "a\u2028b", "a\ud800b", "\ufeffab",
)  # fmt: skip
NAMES = (*MARKUP, *ACTIVE)


def renamed(entry: dict[str, Any], name: str) -> dict[str, Any]:
    return {**entry, "name": name}


def strange_directory(first: int) -> Directory:
    """The small directory with strange names in all places, as a file would bring them."""
    plain = make_directory().model_dump()
    names = iter([f"{NAMES[(first + n) % len(NAMES)]}{n}" for n in range(20)])
    for kind in ("sources", "media", "surfaces", "detectors"):
        plain[kind] = [renamed(entry, next(names)) for entry in plain[kind]]
    plain["objects"] = [
        {**renamed(entry, next(names)), "kind": NAMES[first],
         "faces": [renamed(face, next(names)) for face in entry["faces"]]}
        for entry in plain["objects"]
    ]  # fmt: skip
    plain["title"] = NAMES[first]
    plain["length_unit"] = NAMES[first][:30]
    return Directory.model_validate(plain)


def strange_map(path: Path, first: int) -> Path:
    writer = raymap.RayMapWriter.create(path, strange_directory(first), meshes=make_meshes())
    writer.add_channel_set(rgb_channels())
    writer.start_run(seed=1, parameters={})
    writer.append(make_portion(150))
    writer.finish()
    writer.close()
    return path


def is_active(letter: str) -> bool:
    """By the database of Unicode: controls, surrogates, and what sets a direction."""
    directions = {"LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"}
    return (
        unicodedata.category(letter) in ("Cc", "Cs", "Zl", "Zp")
        or unicodedata.bidirectional(letter) in directions
        or letter in "\u061c\u200e\u200f\ufeff"
    )


def test_every_character_that_acts_is_spelt_out() -> None:
    for code in range(0x110000):
        shown = plain_text(chr(code))
        assert (shown != chr(code)) == is_active(chr(code)), hex(code)
        if shown != chr(code):
            assert re.fullmatch(r"\\(x[0-9a-f]{2}|u[0-9a-f]{4})", shown)
    assert plain_text("Linse Ø 3 µm – 镜头 שלום") == "Linse Ø 3 µm – 镜头 שלום"


@pytest.mark.parametrize("first", range(len(NAMES)))
def test_terminal_and_files(first: int, run: Any, tmp_path: Path) -> None:
    path = strange_map(tmp_path / "strange.raymap", first)
    with raymap.open(path) as opened:
        directory = opened.directory
        names = [
            item.name
            for kind in (directory.objects, directory.sources, directory.detectors)
            for item in kind
        ]
    assert not any(is_active(letter) for name in names for letter in name)
    detector = names[-1]
    commands = [
        ("info", path), ("paths", path), ("paths", path, "--by", "object"), ("query", path),
        ("report", path, 1), ("verify", path), ("ghosts", path), ("query", path, 'hit("nothing")'),
        ("image", path, "nothing", "-o", tmp_path / "no.png"),
    ]  # fmt: skip
    for words in commands:
        _, out, err = run(*words)
        for text in (out, err):
            assert "Traceback" not in text, words
            assert not any(is_active(letter) for letter in text.replace("\n", "")), words
    # What rich takes for colours and links stays text
    if first == 4:
        assert "[red]x[/red]" in run("info", path)[1]
    for kind in ("svg", "png", "pdf"):
        code, _, err = run("chart", path, detector, "-o", tmp_path / f"chart.{kind}")
        assert (code, "Traceback" in err) == (0, False), err
    tree = ElementTree.parse(tmp_path / "chart.svg")
    assert not [
        item for item in tree.iter()
        if item.tag.rpartition("}")[2] in ("script", "foreignObject", "iframe", "img")
        or any(name.lower().startswith("on") for name in item.attrib)
    ]  # fmt: skip


def test_drawings_of_the_page_are_text_and_shapes() -> None:
    import numpy as np

    from viewer.paint.plots import bars, heat_map, profile

    for name in map(plain_text, NAMES):
        drawn = [
            profile([(name, np.ones(3), "#fff")], caption=name),
            bars([name, name], [1, 2], caption=name),
            heat_map([name], [name], np.ones((1, 1)), unit=name),
        ]
        for text in drawn:
            tree = ElementTree.fromstring(text)
            tags = {item.tag for item in tree.iter()}
            assert tags <= {"svg", "text", "title", "rect", "path", "polyline"}
            assert not any(key.startswith("on") for item in tree.iter() for key in item.attrib)
            whole = "".join(tree.itertext())
            assert name[:15] in whole


def test_exported_files_hold_names_as_text(tmp_path: Path) -> None:
    from viewer.app.session import Session
    from viewer.export.gltf import to_glb
    from viewer.export.vtp import to_vtp

    for first in range(len(NAMES)):
        with raymap.open(strange_map(tmp_path / f"{first}.raymap", first)) as opened:
            session = Session(opened, ViewState(rays=20))
            shown = session.shown()
            # Rays have numbers only, and raw bytes behind the XML
            assert b"window" not in to_vtp(shown.rays, shown.lines, shown.rgba)
            data = to_glb(session.painter.bodies, shown.lines, shown.rgba,
                          length_unit="mm", title=opened.directory.title)  # fmt: skip
            length = int.from_bytes(data[12:16], "little")
            json.loads(data[20 : 20 + length])
            assert session.picture(320, 200)[:4] == b"\x89PNG"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api")
    path = shutil.which("chromium") or shutil.which("chromium-browser")
    if not path and "CI" not in os.environ:
        pytest.skip("no Chromium (Debian: apt-get install chromium)")
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(
            executable_path=path, args=["--headless", "--no-sandbox", "--disable-gpu"]
        )
        yield opened
        opened.close()


@pytest.mark.browser
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.parametrize("first", [0, 3, 6, 9])
def test_nothing_of_it_runs_in_the_page(browser: Any, tmp_path: Path, first: int) -> None:
    from tests.viewer.page import Page

    with raymap.open(strange_map(tmp_path / "strange.raymap", first)) as opened:
        running = run_in_thread(opened, ViewState(rays=50, names=True))
        page = Page(browser, running.url)
        names = [item.name for item in opened.directory.objects]
        page.wait_text("objects", names[0])
        for panel in ("paths", "detector", "criterion", "report"):
            page.show(panel)
            page.settle()
        page.get("color").select_option("source")
        page.wait_text("legend", opened.directory.sources[0].name)
        page.get("ray-number").fill("7")
        page.get("ray-number").press("Enter")
        page.get("report-facts").wait_for()
        page.get("point-1").click()
        page.show("paths")
        page.get("path-table").wait_for()
        page.get("criterion").fill("hit(")
        page.get("criterion").click()
        page.get("completions").wait_for()
        page.get("criterion").fill(f'hit("{names[0]}")')
        page.get("criterion").press("Enter")
        page.settle()
        page.tab.mouse.move(500, 450)
        page.tab.wait_for_timeout(500)
        assert page.tab.evaluate("window.ran") is None
        assert (
            page.tab.evaluate(
                "document.querySelectorAll('#app iframe, #app script, #app foreignObject').length"
            )
            == 0
        )
        assert {host.split(":")[0] for host in page.hosts} <= {"localhost", ""}
        assert page.errors == []
        # The policy itself stops what would run if a name came through after all
        page.tab.evaluate(
            "document.querySelector('#app').insertAdjacentHTML('beforeend', "
            "'<img src=x onerror=window.ran=1>')"
        )
        page.tab.wait_for_timeout(500)
        assert page.tab.evaluate("window.ran") is None
        assert any("Content Security Policy" in error for error in page.errors)
        page.close()
        running.stop()

"""Make the pictures and figures of docs/viewer.md, docs/find_the_ghost.md and the README.

    python docs/viewer_pictures.py [MAP]

Records the double Gauss (2 million rays, seed 1) unless a map of it is given, and once more with
the strongest pair of ghost surfaces coated; prints the figures of the page and writes
docs/images/*.png. The screenshots need a Chromium and Playwright (extra ``dev``).
"""

from __future__ import annotations

import io
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from PIL import Image

import query
import raymap
from query.answers.paths.ghosts import ghost_matrix
from viewer import Section, ViewState, picture
from viewer.app.server import RunningServer, run_in_thread

ROOT = Path(__file__).resolve().parent.parent
IMAGES = ROOT / "docs" / "images"
SCENE = ROOT / "samples" / "double_gauss.toml"
GHOSTS = 'count(hit("L*", reflected)) == 2 & !event(scattered) & detected("sensor")'
RAYS = 2_000_000
LARGEST = 300_000

COATED = {
    "back = { radius = -37.92546, semi_diameter = 19.5 }": (
        'back = { radius = -37.92546, semi_diameter = 19.5, surface = "coated" }'
    ),
    "back = { radius = -79.41143, semi_diameter = 22.1 }": (
        'back = { radius = -79.41143, semi_diameter = 22.1, surface = "coated" }'
    ),
    "[surfaces.black] ": (
        '[surfaces.coated]\nkind = "dielectric"\nreflectance = 0.005\n\n[surfaces.black] '
    ),
}
"""What changes in the scene: the backs of L5 and L6 get a coating of 0.5 %."""


def save(pixels: Any, name: str) -> None:
    """Write a PNG with as many colours as fit into the largest size."""
    image = Image.fromarray(pixels) if not isinstance(pixels, Image.Image) else pixels
    for colors in (256, 160, 96, 64, 40):
        buffer = io.BytesIO()
        image.convert("RGB").quantize(colors, dither=Image.Dither.NONE).save(
            buffer, "PNG", optimize=True
        )
        if buffer.tell() < LARGEST:
            break
    (IMAGES / name).write_bytes(buffer.getvalue())
    print(f"{name}: {image.size[0]} x {image.size[1]}, {buffer.tell() / 1000:.0f} kB")


def record(scene: Path, target: Path) -> None:
    """Record a scene with the command that a person would type."""
    command = [str(Path(sys.executable).with_name("raymap")), "record", str(scene), "-o"]
    subprocess.run([*command, str(target), "--rays", str(RAYS), "--force"], check=True)


def coat(folder: Path) -> Path:
    """The scene with the pair coated."""
    text = SCENE.read_text(encoding="utf-8")
    for old, new in COATED.items():
        if text.count(old) != 1:
            raise SystemExit(f"{SCENE} has changed: {old!r} is not in it once")
        text = text.replace(old, new)
    target = folder / "coated.toml"
    target.write_text(text, encoding="utf-8")
    return target


def figures(path: Path) -> None:
    """Print what the page says of a map."""
    with raymap.open(path) as lens:
        seen = query.select(lens, 'detected("sensor")', rays=False)
        ghosts = query.select(lens, GHOSTS, rays=False)
        print(f"\n{path.name}: {lens.rays:,} rays, {lens.records:,} records")
        print(f"sensor {seen.flux:.5f} ± {seen.flux_se:.1g} W")
        print(f"ghosts {ghosts.flux:.5f} ± {ghosts.flux_se:.1g} W, {ghosts.matched:,} rays, "
              f"{ghosts.flux / seen.flux:.2%} of the light, {ghosts.seconds:.3f} s")  # fmt: skip
        matrix = ghost_matrix(lens, "sensor")
        for pair in matrix.pairs(6):
            print(f"  {pair['first']:9} {pair['second']:9} {pair['rays']:6,} rays "
                  f"{pair['flux']:.6f} ± {pair['flux_se']:.1g} W {pair['share']:.1%}")  # fmt: skip
        for place, face in enumerate(matrix.faces):
            mine = matrix.flux[place].sum() + matrix.flux[:, place].sum()
            mine -= matrix.flux[place, place]
            print(f"  {face:9} takes part in {mine / matrix.total:.1%}")


def stills(path: Path) -> None:
    """Pictures without the application."""
    with raymap.open(path) as lens:
        section = ViewState(section=Section(on=True, rays=False), opacity=0.35)
        save(picture(lens, GHOSTS, rays=300, size=(1280, 640), state=section), "ghost_rays.png")
        best = ghost_matrix(lens, "sensor").pairs(1)[0]
        state = ViewState(section=Section(on=True, rays=False), opacity=0.3, names=True)
        whole = f'{best["criterion"]} & detected("sensor")'
        save(picture(lens, whole, rays=120, size=(1280, 640), state=state), "ghost_pair.png")


class Tab:
    """A browser tab that waits for answers."""

    def __init__(self, page: Any, running: RunningServer) -> None:
        self.page = page
        page.goto(running.url)
        self.settle()

    def settle(self) -> None:
        self.page.wait_for_function(
            """() => {
                const app = document.querySelector('[data-testid=app]');
                const view = document.querySelector('[data-testid=view]');
                const busy = document.querySelector('.rm-busy');
                return app && app.dataset.searching === 'false' && Number(app.dataset.answered) > 0
                    && view.dataset.busy === '0' && view.dataset.painted === view.dataset.version
                    && !busy.classList.contains('on');
            }""",
            timeout=120_000,
        )

    def click(self, name: str) -> None:
        self.page.get_by_test_id(name).click()
        self.settle()

    def shot(self, name: str) -> None:
        self.settle()
        self.page.mouse.move(700, 880)
        self.page.wait_for_timeout(300)
        with Image.open(io.BytesIO(self.page.screenshot())) as image:
            save(image.convert("RGB"), name)


def screenshots(path: Path) -> None:
    """The application at work."""
    from playwright.sync_api import sync_playwright

    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    options = ["--no-sandbox", "--disable-gpu"]
    with raymap.open(path) as lens, sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=options)
        state = ViewState(
            criterion=GHOSTS, section=Section(on=True, rays=False), rays=500, opacity=0.35
        )
        running = run_in_thread(lens, state)
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        page.set_default_timeout(120_000)
        tab = Tab(page, running)
        for row in (0, 1, 2):
            tab.click(f"check-{row}")
        tab.shot("view_paths.png")
        tab.click("paths-clear")
        tab.click("tab-detector")
        page.wait_for_function(
            "document.querySelector('[data-testid=image-full] img')?.naturalWidth > 0"
        )
        page.wait_for_timeout(2000)
        tab.shot("view_detector.png")
        tab.click("tab-paths")
        tab.click("path-0")
        tab.click("tab-report")
        page.get_by_test_id("ray-next").click()
        page.get_by_test_id("report-facts").wait_for()
        tab.click("point-10")
        tab.shot("view_report.png")
        tab.click("tab-criterion")
        tab.shot("view_criterion.png")
        running.stop()
        browser.close()


def main() -> None:
    IMAGES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["XDG_CONFIG_HOME"] = name
        bare = Path(sys.argv[1]) if len(sys.argv) > 1 else folder / "lens.raymap"
        if len(sys.argv) <= 1:
            record(SCENE, bare)
        figures(bare)
        coated = folder / "coated.raymap"
        record(coat(folder), coated)
        figures(coated)
        stills(bare)
        screenshots(bare)


if __name__ == "__main__":
    main()

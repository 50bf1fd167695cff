"""What a person draws in the application that a client opened comes back to the client."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from raymap.remote.client import Service

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


def test_a_rectangle_drawn_on_the_detector(
    client: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    path = shutil.which("chromium") or shutil.which("chromium-browser")
    there = client.open("small.raymap")
    arguments = ["--headless", "--no-sandbox", "--disable-gpu"]
    with there.view(detector="sensor") as view, playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=arguments)
        tab = browser.new_page(viewport={"width": 1440, "height": 900})
        tab.set_default_timeout(60_000)
        tab.goto(view.url)
        tab.get_by_test_id("tab-detector").click()
        tab.wait_for_function(
            "document.querySelector('[data-testid=image-full] img')?.naturalWidth === 36"
        )
        view.look()
        box = tab.get_by_test_id("image-full").bounding_box()
        assert box is not None
        x, y, w, h = (box[key] for key in ("x", "y", "width", "height"))
        tab.mouse.move(x + 0.1 * w, y + 0.3 * h)
        tab.mouse.down()
        tab.mouse.move(x + 0.3 * w, y + 0.6 * h)
        tab.mouse.move(x + 0.45 * w, y + 0.95 * h)
        tab.mouse.up()
        assert view.wait(60)
        browser.close()
        region = view.drawn["region"]
        assert region["shape"] == "rect"
        np.testing.assert_allclose(
            region["values"], [3.6, 0.05 * 24, 0.45 * 36, 0.7 * 24], atol=0.2
        )
        assert view.drawn["detector"] == "sensor"
        found = there.query(view.drawn["criterion"])
        assert 0 < found.matched < there.rays

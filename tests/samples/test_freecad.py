"""The FreeCAD macro, run by FreeCAD's own command line where it is installed."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FREECAD = next(filter(None, map(shutil.which, ("freecadcmd", "FreeCADCmd"))), None)
SERVE = (
    "import typer; from service.cli import register; app = typer.Typer();"
    "app.callback()(lambda: None); register(app); app()"
)


@pytest.mark.peers
@pytest.mark.skipif(FREECAD is None, reason="FreeCAD's command line is not installed")
def test_lens_traced_from_freecad(tmp_path: Path) -> None:
    """Bodies of a CAD document become a map; the rays asked for become wires in it."""
    served = tmp_path / "served"
    served.mkdir()
    with subprocess.Popen(
        [sys.executable, "-c", SERVE, "serve", str(served), "--json"],
        stdout=subprocess.PIPE, text=True, cwd=ROOT,
    ) as service:  # fmt: skip
        try:
            assert service.stdout is not None
            said = json.loads(service.stdout.readline())
            places = [str(ROOT), *(place for place in sys.path if "site-packages" in place)]
            environment = {
                **os.environ,
                "PYTHONPATH": os.pathsep.join(places),
                "RAYMAP_SERVICE": said["address"],
                "RAYMAP_TOKEN": said["token"],
                "RAYMAP_MACRO": str(ROOT / "samples" / "freecad" / "Raymap.FCMacro"),
                "RAYMAP_ANSWER": str(tmp_path / "answer.json"),
                "RAYMAP_CRITERION": 'hit("Lens") & detected("Screen")',
                "QT_QPA_PLATFORM": "offscreen",
                "HOME": str(tmp_path),
            }
            script = Path(__file__).with_name("freecad_session.py")
            subprocess.run(
                [str(FREECAD), str(script)], env=environment, timeout=240, check=True,
                stdin=subprocess.DEVNULL, capture_output=True, cwd=tmp_path,
            )  # fmt: skip
        finally:
            service.terminate()
    answer = json.loads((tmp_path / "answer.json").read_text())
    assert "error" not in answer, answer["error"]
    assert answer["roles"] == {
        "Lens": "RaymapBody", "Stop_1": "RaymapBody", "Lamp": "RaymapSource",
        "Screen": "RaymapDetector",
    }  # fmt: skip
    # The stop of 10 mm lets 40 % of the square beam through, the lens brings it to the screen
    assert 0.3 * 4_000 < answer["matched"] < 0.42 * 4_000
    assert answer["wires"] == min(answer["matched"], 2_000)
    assert answer["highest"] == pytest.approx(29, abs=1e-3)
    assert answer["lens_inside"]
    assert answer["paths"][0].startswith("Lamp Lens.Face")
    assert (served / "Bench" / "rays.raymap").exists()

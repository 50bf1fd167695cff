"""What the commands and the Python of a page find in their folder: small scenes, files and maps."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

from tests.docs.blocks import ROOT, blocks
from tests.raymap.foreign.test_zrd import TREES, write_zrd

Run = Callable[..., tuple[int, str, str]]

FEW_RAYS = 20_000
RECORDED = 2_000_000
"""Rays of the map that the pages call lens.raymap, and of the one that stands in for it."""

LAMP = """
length_unit = "mm"
flux_unit = "lm"
[sources.lamp]
kind = "lambertian"
size = [2, 2]
flux = 100
[detectors.far]
kind = "far_field"
axis = [0, 0, 1]
cells = [1, 45]
gamma_deg = [0, 90]
"""

PLATE_AND_SHEET = """
length_unit = "mm"
[media.glass]
index = 1.5
[media.air]
index = 1.0
[sources.sun]
kind = "collimated"
position = [0, 0, -20]
direction = [0, 0.832, 0.555]
diameter = 2
[surfaces.clear]
kind = "dielectric"
[bodies.plate]
kind = "box"
position = [0, 30, 0]
size = [40, 40, 2]
medium = "glass"
[bodies.sheet]
kind = "rectangle"
position = [0, 40, -20]
size = [60, 60]
axis = [0, 0, -1]
surface = "clear"
"""


def did(run: Run, *words: object) -> None:
    code, _, error = run(*words)
    assert code == 0, error


def lens_map(folder: Path, run: Run, rays: int) -> None:
    did(run, "record", ROOT / "samples/double_gauss.toml", "-o", folder / "lens.raymap",
        "--rays", rays)  # fmt: skip


def step_part(folder: Path, run: Run) -> None:
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox

    from tests.tracer.importers.step_files import Part, write_step

    lightguide = BRepPrimAPI_MakeBox(10.0, 20.0, 30.0).Shape()
    screw = BRepPrimAPI_MakeBox(1.0, 1.0, 5.0).Shape()
    parts = [Part("lightguide", lightguide), Part("screw_1", screw, places=((50.0, 0.0, 0.0),))]
    write_step(folder / "housing.step", parts)


def cluster(folder: Path, run: Run) -> None:
    text = (ROOT / "samples/double_gauss.toml").read_text(encoding="utf-8")
    (folder / "lens.toml").write_text(text, encoding="utf-8")


def zemax_lens(folder: Path, run: Run) -> None:
    shutil.copy(ROOT / "tests/data/lenses/US05831776-1.zmx", folder / "lens.zmx")


def database(folder: Path, run: Run) -> None:
    page = (ROOT / "docs/other_tracers.md").read_text(encoding="utf-8")
    names = page.partition("```toml\n")[2].partition("```")[0]
    (folder / "names.toml").write_text(names, encoding="utf-8")
    rows = {2: 3, 5: 7}
    moved = [
        [
            step
            | {
                key: rows.get(step[key], step[key])
                for key in ("hit_object", "in_object")
                if key in step
            }
            for step in tree
        ]
        for tree in TREES
    ]
    write_zrd(folder / "run.zrd", moved)


def keyboard(folder: Path, run: Run) -> None:
    did(run, "record", ROOT / "samples/keyboard/keyboard.toml", "-o", folder / "keyboard.raymap",
        "--rays", 20_000)  # fmt: skip


def lamp(folder: Path, run: Run) -> None:
    (folder / "lamp.toml").write_text(LAMP, encoding="utf-8")
    did(run, "record", folder / "lamp.toml", "-o", folder / "lamp.raymap", "--rays", 20_000)


def plate(folder: Path, run: Run) -> None:
    """A plate and a sheet, which the table of the page makes a polariser."""
    [table] = [b for b in blocks("toml") if b.key == ("docs/polarization.md", "[trace]")]
    (folder / "scene.toml").write_text(PLATE_AND_SHEET + table.text, encoding="utf-8")


def luminaire(folder: Path, run: Run) -> None:
    page = (ROOT / "docs/scenes.md").read_text(encoding="utf-8")
    blocks = page.split("```toml\n")[1:]
    [scene] = [text.partition("```")[0] for text in blocks if "[detectors.eye]" in text]
    (folder / "luminaire.toml").write_text(scene, encoding="utf-8")


def material(folder: Path, run: Run) -> None:
    page = (ROOT / "docs/scattering.md").read_text(encoding="utf-8")
    [text] = [b for b in re.findall(r"```toml\n(.*?)```", page, re.S) if b.startswith("[media.")]
    (folder / "fitted").mkdir()
    (folder / "fitted" / "opal_B.material.toml").write_text(text, encoding="utf-8")


PREPARE: dict[str, Callable[[Path, Run], None]] = {
    "docs/cad.md": step_part,
    "docs/cluster.md": cluster,
    "docs/lens_files.md": zemax_lens,
    "docs/other_tracers.md": database,
    "docs/photometry.md": lamp,
    "docs/polarization.md": plate,
    "docs/ray_files.md": keyboard,
    "docs/scattering.md": material,
    "docs/scenes.md": luminaire,
    "docs/viewer.md": lamp,
}


def own_folder(page: str, own: Path, folder: Path, run: Run) -> Path:
    """A folder for one page with the samples, a map of the lens, and what the page needs."""
    if not (folder / "few").exists():
        (folder / "few").mkdir()
        lens_map(folder / "few", run, FEW_RAYS)
    own.mkdir()
    (own / "samples").symlink_to(folder / "samples", target_is_directory=True)
    shutil.copy(folder / "few" / "lens.raymap", own)
    if page in PREPARE:
        PREPARE[page](own, run)
    return own

"""TOML blocks of the pages are accepted by what reads such files.

A block with a length unit is a scene; a fragment stands in the scene that its page speaks of.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import query
import raymap
from tests.docs.blocks import ROOT, Block, blocks
from tests.docs.prepared import Run, did, own_folder
from tests.tracer.importers.lens_texts import zemax

BLOCKS = blocks("toml")

UNIT = 'length_unit = "mm"\n'
EYE = "[detectors.NAME]\nposition = [0, 0, 90]\nlooks = [0, 0, -1]\nsize = [1, 1]\ncells = [1, 1]\n"
SENSOR = EYE.replace("NAME", "sensor")
BOX = '[bodies."NAME"]\nkind = "box"\nposition = [PLACE, 0, 0]\nsize = [1, 1, 1]\n'
ABSORBER = 'surface = "absorber"\n'
LAMP = '[sources.NAME]\nkind = "lambertian"\nposition = [0, 0, PLACE]\nsize = [1, 1]\n'


def accepted(folder: Path, run: Run, text: str, *options: str) -> None:
    """The command line reads and compiles the scene, without a warning."""
    (folder / "page.toml").write_text(text, encoding="utf-8")
    code, _, error = run("check", folder / "page.toml", *options)
    assert (code, error) == (0, ""), error


def scene(block: Block, folder: Path, run: Run) -> None:
    light = "" if "[sources." in block.text else LAMP.replace("NAME", "any").replace("PLACE", "-9")
    accepted(folder, run, block.text + light)


def choice(block: Block, folder: Path, run: Run) -> None:
    """The choice of simulations, in a scene that has what it names."""
    bodies = "".join(
        BOX.replace("NAME", name).replace("PLACE", str(10 * k)) + ABSORBER
        for k, name in enumerate(("cable_1", "window"))
    )
    lamps = "".join(
        LAMP.replace("NAME", name).replace("PLACE", str(30 + k))
        for k, name in enumerate(("lamp_led", "other"))
    )
    variant = '[variants.spectral.sources.lamp_led]\nspectrum = "A"\n'
    fragment = block.text.replace("lamp.cable*", "cable*")
    rest = bodies + lamps + EYE.replace("NAME", "eye") + variant
    head, _, tables = fragment.partition("\n[")
    accepted(folder, run, UNIT + head + "\n[" + tables + rest, "--simulation", "night")


def spectra(block: Block, folder: Path, run: Run) -> None:
    """Each row is what stands behind ``spectrum =``."""
    rows = [row for row in block.text.splitlines() if row.strip()]
    assert len(rows) == 7
    for row in rows:
        accepted(folder, run, UNIT + LAMP.replace("NAME", "lamp").replace("PLACE", "0") +
                 f"spectrum = {row}\n")  # fmt: skip


def trace(block: Block, folder: Path, run: Run) -> None:
    baffle = BOX.replace("NAME", "baffle").replace("PLACE", "5") + ABSORBER
    lamp = LAMP.replace("NAME", "lamp").replace("PLACE", "-9")
    accepted(folder, run, UNIT + block.text + baffle + SENSOR + lamp)


def in_a_scene(block: Block, folder: Path, run: Run) -> None:
    accepted(folder, run, UNIT + block.text)


def medium(block: Block, folder: Path, run: Run) -> None:
    plate = BOX.replace("NAME", "plate").replace("PLACE", "5") + 'medium = "opal B"\n'
    lamp = LAMP.replace("NAME", "lamp").replace("PLACE", "-9")
    accepted(folder, run, UNIT + block.text + plate + lamp)


def polarised(block: Block, folder: Path, run: Run) -> None:
    """A table of a scene that `own_folder` has written."""
    text = (folder / "scene.toml").read_text(encoding="utf-8")
    assert block.text in text
    accepted(folder, run, text)


def in_lumen(block: Block, folder: Path, run: Run) -> None:
    luminaire = ROOT / "tests" / "data" / "photometry" / "road_luminaire.ldt"
    (folder / luminaire.name).write_bytes(luminaire.read_bytes())
    accepted(folder, run, 'length_unit = "m"\nflux_unit = "lm"\n' + block.text)


def ray_file(block: Block, folder: Path, run: Run) -> None:
    with raymap.open(folder / "lens.raymap") as lens:
        query.write_ray_file(
            query.select(lens, 'detected("sensor")'), folder / "LED_white_5M.tm25ray", "sensor"
        )
    accepted(folder, run, UNIT + block.text)


def lens_file(block: Block, folder: Path, run: Run) -> None:
    """A lens of two glasses, which the block explains."""
    glass = "TYPE STANDARD;CURV {};DISZ 5;GLAS {} 0 0 1.6 40;DIAM 10 0"
    air = "TYPE STANDARD;CURV -0.01;DISZ {};DIAM 10 0"
    (folder / "lens.zmx").write_text(
        zemax(
            "STOP;" + glass.format(0.01, "HOUSE-1"), air.format(2),
            glass.format(0.012, "OLD-7"), air.format(40), "TYPE STANDARD;CURV 0;DISZ 0;DIAM 9 0",
        ), encoding="utf-8",
    )  # fmt: skip
    accepted(folder, run, block.text)


def of_the_sample(block: Block, folder: Path, run: Run) -> None:
    """An excerpt of the sample: each table of it stands there."""
    sample = tomllib.loads((ROOT / "samples" / "double_gauss.toml").read_text(encoding="utf-8"))
    for name, table in tomllib.loads(block.text)["variants"].items():
        assert sample["variants"][name] == table


def to_the_sample(block: Block, folder: Path, run: Run) -> None:
    text = (ROOT / "samples" / "double_gauss.toml").read_text(encoding="utf-8")
    accepted(folder, run, text + "\n" + block.text, "--variant", "pair")


def names(block: Block, folder: Path, run: Run) -> None:
    """Names of a ray database; `own_folder` has written the block beside one."""
    assert (folder / "names.toml").read_text(encoding="utf-8") == block.text
    did(run, "import", folder / "run.zrd", "--names", folder / "names.toml",
        "-o", folder / "run.raymap")  # fmt: skip


def measurement(block: Block, folder: Path, run: Run) -> None:
    from tracer.scattering.measured.datafile import load_measurement

    for table in (ROOT / "samples" / "opal").glob("b_2.05_*.csv"):
        (folder / table.name).write_bytes(table.read_bytes())
    (folder / "page.toml").write_text(block.text, encoding="utf-8")
    material, settings = load_measurement(folder / "page.toml")
    assert material.plates_mm.tolist() == [2.05]
    assert {table.side for table in material.scatter} == {"brdf", "btdf"}
    assert settings.gamma == "search"


FRAGMENTS: dict[tuple[str, str], Callable[[Block, Path, Run], None]] = {
    ("docs/cad.md", 'leave_out = ["lamp.cable*"]'): choice,
    ("docs/crystals.md", 'spectrum = { kind = "spectral", wavelengths_nm = [589.3] }'): in_a_scene,
    ("docs/find_the_ghost.md", "[variants.pair.surfaces.half_percent]"): to_the_sample,
    ("docs/other_tracers.md", '1 = "lamp"            # sources'): names,
    ("docs/photometry.md", "[sources.street_lamp]"): in_lumen,
    ("docs/polarization.md", "[trace]"): polarised,
    ("docs/ray_files.md", "[sources.led]"): ray_file,
    ("docs/lens_files.md", 'length_unit = "mm"'): lens_file,
    ("docs/samples/double_gauss.md", "[variants.ghosts]"): of_the_sample,
    ("docs/scattering.md", 'name = "opal B"'): measurement,
    ("docs/scattering.md", '[media."opal B"]'): medium,
    ("docs/scenes.md", "{ blackbody = 3000 }                                        # kelvin"):
        spectra,
    ("docs/scenes.md", "[trace]"): trace,
}  # fmt: skip
"""What reads the blocks that are no scenes of their own."""


@pytest.mark.parametrize("block", BLOCKS, ids=str)
def test_toml_blocks(block: Block, folder: Path, run: Any) -> None:
    own = own_folder(block.page, folder / f"toml_{BLOCKS.index(block)}", folder, run)
    FRAGMENTS.get(block.key, scene)(block, own, run)


def test_every_fragment_stands_on_its_page() -> None:
    assert set(FRAGMENTS) <= {block.key for block in BLOCKS}

"""What both builds are asked to do."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.oracle.scenes import generated_scenes, write_files

__all__ = ["OTHER_DRAWS", "QUESTIONS", "WAS_WRONG", "Job", "jobs"]

SAMPLES = Path(__file__).parents[2] / "samples"

_SPLIT = "errors of split light from the sums of each emission; the rays of one were taken apart"
WAS_WRONG: dict[str, str] = {
    "without_rays": "12,816 rays on the sensor, as the audit says; a source that is switched off "
    "took half of them",
    "generated_22": _SPLIT,
    "generated_34": _SPLIT,
}
"""Jobs that the earlier build gets wrong, with what is right. Columns are compared all the same."""

_OTHER = "scattered and split light of the weighted mode is drawn in one way for all kinds"
OTHER_DRAWS: dict[str, str] = dict.fromkeys(
    [
        "double_gauss+ghosts",
        *(f"generated_{k:02}" for k in (2, 3, 6, 7, 9, 10, 11, 14, 18, 19)),
        *(f"generated_{k:02}" for k in (21, 23, 25, 29, 30, 33, 37, 38)),
    ],
    _OTHER,
)
"""Weighted and split light that is drawn otherwise by decision, and why: fluxes are compared."""

QUESTIONS: dict[str, tuple[str, ...]] = {
    "info": ("info", "MAP", "--json"),
    "audit": ("audit", "MAP", "--json"),
    "paths": ("paths", "MAP", "--json", "--limit", "40"),
    "bounced": ("query", "MAP", "bounces >= 2 & event(reflected)", "--json", "--limit", "50"),
    "long": ("query", "MAP", "length > 100 | count(event(refracted)) > 2", "--json", "--count"),
}
"""What every map is asked."""

POLARISED = """
length_unit = "mm"
[media.glass]
index = 1.6
[bodies.plate]
kind = "box"
size = [20, 20, 4]
position = [0, 0, 10]
axis = [0.5, 0.2, 1]
medium = "glass"
[bodies.cube]
kind = "box"
size = [8, 8, 8]
position = [1, 0, 25]
medium = "glass"
[surfaces.silvery]
kind = "mirror"
reflectance = 0.9
[bodies.fold]
kind = "rectangle"
size = [30, 30]
position = [0, 0, 45]
axis = [0, 1, -1]
surface = "silvery"
[sources.lamp]
kind = "collimated"
position = [0, 0, -10]
direction = [0, 0, 1]
diameter = 8
polarisation = [1, 0, 0]
[detectors.screen]
position = [0, 60, 45]
looks = [0, -1, 0]
size = [80, 80]
cells = [8, 8]
"""


@dataclass(frozen=True)
class Job:
    """Arguments of ``raymap``, in which OUT is the file to write; ``new`` where they changed."""

    name: str
    kind: str
    arguments: tuple[str, ...]
    new: tuple[str, ...] | None = None
    map: bool = True

    def for_build(self, which: str, output: Path) -> list[str]:
        """The arguments that one of the builds, ``old`` or ``new``, takes."""
        chosen = self.new if which == "new" and self.new is not None else self.arguments
        return [str(output) if word == "OUT" else word for word in chosen]


def jobs(folder: Path, rays: int) -> Iterator[Job]:
    """All jobs; the scenes that they name are written to ``folder``."""
    yield from _sample_jobs(rays)
    write_files(folder)
    for name, text in generated_scenes():
        scene = folder / f"{name}.toml"
        scene.write_text(text)
        yield _record(name, "A", scene, rays)
    yield from _polarised_jobs(folder, rays)
    yield from _studies()


def _record(name: str, kind: str, scene: Path, rays: int, *more: str) -> Job:
    words = ("record", str(scene), "-o", "OUT", "--rays", str(rays), "--seed", "7", "--json")
    return Job(name, kind, (*words, *more))


def _sample_jobs(rays: int) -> Iterator[Job]:
    """Every sample that is a scene of the recorder, plain and in each of its variants."""
    for scene in sorted(SAMPLES.rglob("*.toml")):
        tree = tomllib.loads(scene.read_text())
        if "sources" not in tree or "render" in tree or "camera" in tree:
            continue
        crystals = any("crystal" in medium for medium in tree.get("media", {}).values())
        kind, count = ("B", min(rays, 2_000)) if crystals else ("A", rays)
        yield _record(scene.stem, kind, scene, count)
        for variant in tree.get("variants", {}):
            name = f"{scene.stem}+{variant}"
            yield _record(name, kind, scene, count, "--variant", variant)
    lens = SAMPLES / "double_gauss.toml"
    yield _record("raw", "A", lens, rays, "--raw")
    yield _record("one_thread", "A", lens, rays, "--threads", "1")
    yield _record("without_rays", "A", lens, rays, "--no-rays")


def _polarised_jobs(folder: Path, rays: int) -> Iterator[Job]:
    """The earlier build took from the command line what a scene says now."""
    lens = (SAMPLES / "double_gauss.toml").read_text()
    for name, text, option, said, count in (
        ("polarised", POLARISED, (), 'light = "polarised"', rays),
        ("polarised_natural", POLARISED, ("--states", "natural"),
         'light = "polarised"\nstates = "natural"', rays),
        ("polarised_phases", POLARISED, ("--phases",), 'light = "polarised"\nphases = true', rays),
        ("polarised_lens", lens, (), 'light = "polarised"', rays),
        ("lens_trees", LENS, ("--lens-trees", "5"), "lens_trees = 5", 500),
    ):  # fmt: skip
        before, now = folder / f"{name}.toml", folder / f"{name}_new.toml"
        before.write_text(text)
        now.write_text(f"{text}\n[trace]\n{said}\n")
        given = ("-o", "OUT", "--rays", str(count), "--seed", "7", "--json")
        yield Job(
            name,
            "B",
            ("record-polarized", str(before), *given, *option),
            ("record", str(now), *given),
        )


LENS = (
    'length_unit = "mm"\n'
    "[media.glass]\nindex = 1.5\n"
    '[bodies.lens]\nkind = "lens"\nmedium = "glass"\nthickness = 5\ndiameter = 20\n'
    "front = { radius = 40 }\nback = { radius = -60 }\n"
    '[sources.lamp]\nkind = "collimated"\nposition = [0, 0, -10]\n'
    "direction = [0, 0.1, 1]\ndiameter = 15\n"
    "[detectors.screen]\nposition = [0, 0, 50]\nlooks = [0, 0, -1]\n"
    "size = [40, 40]\ncells = [8, 8]\nblocking = true\n"
)


def _studies() -> Iterator[Job]:
    """Commands that print numbers and record nothing."""
    lens = str(SAMPLES / "double_gauss.toml")
    for name, words in (
        ("check_lens", ("check", lens, "--json")),
        ("lens_levels", ("lens-levels", "--json", "--rays", "400")),
        ("lens_vignetting", ("lens-vignetting", "--json", "--rays", "200", "--steps", "4")),
        ("lens_cone", ("lens-cone", "--json")),
    ):
        yield Job(name, "B", words, map=False)


def to_json(path: Path, todo: list[tuple[str, list[str]]]) -> None:
    """Write commands for `tests/oracle/running.py`."""
    path.write_text(json.dumps([{"name": name, "arguments": words} for name, words in todo]))

"""The table of ways to follow light by features, made by trying each pair.

A pair *works* if the detector of the feature sees what analog natural light makes it see (both
within their errors), and something else than without the feature. It is *refused* if one line names
a key of the scene. Everything else is silent, and an error.
"""

from __future__ import annotations

import math
import tempfile
import warnings
from dataclasses import dataclass
from pathlib import Path

from raymap.model.errors import RayMapError
from tests.composition.features import FEATURES, Feature, write_files
from tracer import record

__all__ = ["MODES", "Cell", "apart", "counted", "filled", "page", "signs", "tried"]

RAYS = 6000
_AGREE, _DIFFER = 4.5, 6.0
"""Standard errors within which two results agree (the worst of some 150), and beyond which they
differ."""

_WEIGHTED = 'mode = "weighted"\nmin_reflection = 0.2\n'
_SPLIT = 'mode = "weighted"\nsplit_depth = 1\nroulette_weight = 0.01\n'
_POLARISED = 'light = "polarised"\nstates = "natural"\n'
_CRYSTAL = """
[media.calcite]
crystal = { material = "calcite" }
[bodies.rhomb]
kind = "rhomb"
medium = "calcite"
edge = 4
position = [0, 300, 20]
"""
"""A crystal that stands aside: rays carry their polarisation, and see what they see without it."""

MODES: dict[str, tuple[str, str]] = {
    "analog": ("", ""),
    "weighted": (_WEIGHTED, ""),
    "splitting": (_SPLIT, ""),
    "polarised": (_POLARISED, ""),
    "polarised, weighted": (_POLARISED + _WEIGHTED, ""),
    "polarised, splitting": (_POLARISED + _SPLIT, ""),
    "crystals": ("", _CRYSTAL),
    "crystals, weighted": (_WEIGHTED, _CRYSTAL),
}
"""Rows: what stands in ``[trace]``, and what stands in the scene besides."""


@dataclass(frozen=True)
class Cell:
    """What came of a pair: ``works``, ``refused`` with its line, or what is wrong."""

    state: str
    line: str = ""


def counted(
    text: str, detector: str, *, mode: str = "analog", seed: int = 1, rays: int = RAYS
) -> tuple[float, float]:
    """Flux on a detector and its standard error, of a scene followed in one way."""
    trace, more = MODES[mode]
    text += more + (f"[trace]\n{trace}" if trace else "")
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        write_files(Path(folder))
        path = Path(folder) / "scene.toml"
        path.write_text(text, encoding="utf-8")
        result = record(path, None, no_rays=True, rays=rays, seed=seed, threads=1)
    row = result.fluxes["detectors"][detector]
    return row["flux"], row["flux_se"]


def apart(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Difference in standard errors; what both see of every ray has none."""
    return abs(a[0] - b[0]) / max(math.hypot(a[1], b[1]), 1e-6)


def tried(name: str, mode: str, *, forgotten: bool = False) -> Cell:
    """Try a pair; a way of following light that has ``forgotten`` the feature must not pass."""
    feature: Feature = FEATURES[name]
    followed = feature.off if forgotten else feature.on
    try:
        found = counted(followed, feature.detector, mode=mode, seed=2)
    except RayMapError as error:
        line = str(error).partition("scene.toml: ")[2] or str(error)
        return Cell("refused", line)
    right = counted(feature.on, feature.detector)
    without = counted(feature.off, feature.detector)
    if apart(found, right) > _AGREE:
        return Cell("differs", f"{found} against {right}")
    if apart(found, without) < _DIFFER:
        return Cell("idle", f"{found} is what stands there without it: {without}")
    return Cell("works")


def signs(table: dict[str, dict[str, Cell]]) -> str:
    """A row for each name, a column for each way of following light.

    Raises
    ------
    AssertionError
        a pair that neither works nor is refused
    """
    lines = ["| |" + "".join(f" {mode} |" for mode in MODES), "|---|" + "---|" * len(MODES)]
    for name, row in table.items():
        for mode, cell in row.items():
            assert cell.state in ("works", "refused"), (name, mode, cell)
        found = ("yes" if cell.state == "works" else "–" for cell in row.values())
        lines.append(f"| {name} |" + "".join(f" {sign} |" for sign in found))
    return "\n".join(lines) + "\n"


def page(table: dict[str, dict[str, Cell]]) -> str:
    """The rows of the page, and below them what is refused and why."""
    refused: dict[str, list[str]] = {}
    for name, row in table.items():
        for mode, cell in row.items():
            if cell.state == "refused":
                refused.setdefault(cell.line, []).append(f"{name} ({mode})")
    lines = ["", "What is refused, in the words that say so:", ""]
    lines += [f"- `{line}`: {', '.join(pairs)}" for line, pairs in refused.items()]
    return signs(table) + "\n".join(lines) + "\n"


def filled() -> dict[str, dict[str, Cell]]:
    """All pairs, by feature and way."""
    return {name: {mode: tried(name, mode) for mode in MODES} for name in FEATURES}

"""Every command that prints a flux with its error marks what is less sure than 30 %, no other."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import query
import raymap
from raymap.model.doubt import FOOTNOTE, MARK, is_doubtful, with_doubts, with_error
from tests.query.random_maps import write_random_map
from tracer import parse_scene
from tracer.run.recording import record

SCENE = """
length_unit = "mm"
flux_unit = "W"

[sources.lamp]
kind = "point"
flux = 1.0

[detectors.wide]
kind = "plane"
position = [0, 0, 10]
looks = [0, 0, -1]
size = [40, 40]
cells = [4, 4]

[detectors.small]
kind = "plane"
position = [0, 0, 10]
looks = [0, 0, -1]
size = [8, 8]
cells = [4, 4]
"""
PLATE = """
[media.glass]
index = 1.5
absorption = 0.001

[bodies.plate]
kind = "box"
position = [0, 0, 5]
size = [30, 30, 2]
medium = "glass"
"""
MATERIAL = """
[media.opal]
index = 1.5
absorption = 0.5

[media.opal.scattering]
coefficient = 1.0
phase = { kind = "henyey_greenstein", g = 0.0 }
"""

NOISY = {
    "query": ["query", "MAP", 'hit("L1")', "--limit", "3"],
    "paths": ["paths", "MAP", "--top", "9"],
    "audit": ["audit", "MAP"],
    "ghosts": ["ghosts", "MAP", "--top", "9"],
    "illuminated": ["illuminated", "MAP", "screen"],
    "sweep": ["sweep", "MAP", "screen", "event(tir)"],
    "compare": ["compare", "MAP", "OTHER", "--top", "9"],
    "what-if": ["what-if", "MAP", 'hit("L1")', "--set", "lamp.flux=5", "--top", "9"],
    "improve": ["improve", "PLATE", "event(reflected)", "--reflectance", "0.1%", "--faces", "1"],
    "sensitivity": ["sensitivity", "PLATE", "event(reflected)", "--top", "99"],
    "focus": ["focus", "MAP", "screen", "--from", "-1", "--to", "1"],
    "histogram": ["histogram", "MAP", "length"],
    "image": ["image", "MAP", "screen", "event(tir)", "-o", "OUT.png"],
    "chart": ["chart", "MAP", "screen", "-o", "OUT.png"],
    "record": ["record", "SCENE", "--rays", "60", "--no-rays", "-o", "OUT.raymap", "--force"],
    "goniophotometer": ["goniophotometer", "MATERIAL", "--thickness", "4", "--rays", "400"],
}
"""Command lines whose answers are partly doubtful."""

WITHOUT = {
    *(
        "info",
        "verify",
        "repair",
        "mix",
        "report",
        "picture",
        "view",
        "export",
        "export-3d",
        "import",
    ),
    *("check", "doctor", "kinds", "faces", "serve", "token", "rayfile", "check-rays"),
    *("lens-levels", "lens-cone", "lens-vignetting", "lens-picture", "microscope", "render"),
    *("record-polarized", "verify-crystals", "fit-scattering"),
}
"""Commands that print no number with a standard error of rays."""


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("marks")
    for name, seed in (("MAP", 21), ("OTHER", 22)):
        write_random_map(folder / f"{name}.raymap", seed, rays=70, paths=40)
    (folder / "scene.toml").write_text(SCENE, encoding="utf-8")
    (folder / "opal.toml").write_text(MATERIAL, encoding="utf-8")
    record(parse_scene(SCENE + PLATE), folder / "PLATE.raymap", rays=300, seed=1)
    return {
        "MAP": str(folder / "MAP.raymap"),
        "PLATE": str(folder / "PLATE.raymap"),
        "OTHER": str(folder / "OTHER.raymap"),
        "SCENE": str(folder / "scene.toml"),
        "MATERIAL": str(folder / "opal.toml"),
        "OUT.png": str(folder / "out.png"),
        "OUT.raymap": str(folder / "out.raymap"),
    }


def rows_with_errors(answer: Any) -> Iterator[tuple[dict[str, Any], list[str]]]:
    """Dictionaries of an answer that hold a number beside its error, and which are doubtful."""
    if isinstance(answer, list):
        for item in answer:
            yield from rows_with_errors(item)
    if not isinstance(answer, dict):
        return
    doubtful, found = [], False
    pairs = {name: f"{name}_se" for name in answer}
    # A comparison calls its errors by the map
    pairs |= {"flux_a": "se_a", "flux_b": "se_b", "difference": "se"} if "se_a" in answer else {}
    for name, error in pairs.items():
        value, se = answer.get(name), answer.get(error)
        of = value if isinstance(value, dict) else {name: value}
        for key, own in (se if isinstance(se, dict) else {name: se}).items():
            if isinstance(own, int | float):
                found = True
                doubtful += [key] * (own > 0.3 * abs(of[key]))
    if found:
        yield answer, doubtful
    for value in answer.values():
        yield from rows_with_errors(value)


def test_every_command_is_known() -> None:
    import typer.main

    from raymap.cli import application

    commands = set(typer.main.get_command(application()).commands)  # type: ignore[attr-defined]
    assert commands == NOISY.keys() | WITHOUT


@pytest.mark.parametrize("command", NOISY)
def test_noisy_rows_are_marked(run: Any, files: dict[str, str], command: str) -> None:
    words = [files.get(word, word) for word in NOISY[command]]
    code, out, err = run(*words, "--json")
    assert code == 0, err
    rows = list(rows_with_errors(json.loads(out)))
    assert rows
    assert any(doubtful for _, doubtful in rows)
    for row, doubtful in rows:
        assert sorted(row["doubtful"]) == sorted(doubtful), row
    code, out, err = run(*words)
    assert code == 0, err
    assert FOOTNOTE in " ".join(re.sub(r"[\s│]+", " ", out).split())
    # Numbers that stand together with their error are marked where, and only where, it is large
    number = r"-?\d[\d.]*(?:e[+-]\d+)?"
    unit = r"(?:°|\s[a-zA-Z][a-zA-Z/²]*)?"
    pairs = re.findall(rf"({number}){unit} ± ({number}){unit}( \{MARK})?", out)
    for value, se, mark in pairs:
        # A few digits are printed
        assert mark or float(se) < 0.32 * abs(float(value)), (value, se)
        assert not mark or float(se) > 0.28 * abs(float(value)), (value, se)
    assert out.count(f" {MARK}") >= 1


def test_marks_of_table_rows_are_those_of_the_json(run: Any, files: dict[str, str]) -> None:
    for command in ("paths", "audit", "ghosts", "illuminated", "sweep", "compare"):
        words = [files.get(word, word) for word in NOISY[command]]
        answer = json.loads(run(*words, "--json")[1])
        if command == "compare":
            answer = {"paths": answer["paths"]}
        if command == "ghosts":
            # The rows are listed once more as pairs, and all of them
            answer = answer["rows"][:9]
        expected = sum(len(doubtful) for _, doubtful in rows_with_errors(answer))
        table = [line for line in run(*words)[1].splitlines() if line.startswith("│")]
        assert sum(line.count(f" {MARK} ") for line in table) == expected, command


def test_sure_numbers_carry_no_mark(run: Any, files: dict[str, str], tmp_path: Path) -> None:
    words = ["record", files["SCENE"], "--rays", "20000", "--no-rays", "-o", tmp_path / "a.raymap"]
    for out in (
        run(*words)[1],
        run("chart", tmp_path / "a.raymap", "wide", "-o", tmp_path / "a.png")[1],
    ):
        assert MARK not in out


def test_notebooks_and_names_carry_the_mark(files: dict[str, str]) -> None:
    with raymap.open(files["MAP"]) as map:
        matrix = query.ghost_matrix(map)
        assert matrix._repr_html_().count(f" {MARK}</td>") == matrix.doubtful.sum() > 0
        few = query.select(map, 'hit("L1")', limit=1)
        for shown in (repr(few), few._repr_html_()):
            assert f" {MARK}" in shown
        every = query.select(map)
        assert MARK not in repr(every) + every._repr_html_()


def test_what_is_doubtful() -> None:
    # 11 rays of equal flux have an error of 1 / sqrt(11) = 30.2 %, 12 rays 28.9 %
    assert is_doubtful(11.0, math.sqrt(11.0))
    assert not is_doubtful(12.0, math.sqrt(12.0))
    assert not is_doubtful(0.0, 0.0)
    assert is_doubtful(0.0, 1.0)
    assert not is_doubtful(None, None)
    for bad in (math.nan, math.inf):
        assert is_doubtful(bad, 1.0)
        assert is_doubtful(1.0, bad)
        assert with_error(bad, bad, " W").endswith(MARK)
    assert with_doubts({"flux": -1.0, "flux_se": 0.29, "rays": 3})["doubtful"] == []
    assert with_doubts({"a": {"x": 1.0, "y": 1.0}, "a_se": {"y": 0.5}})["doubtful"] == ["y"]

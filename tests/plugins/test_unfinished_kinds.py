"""Kinds of another distribution that leave a method out: one error that names both."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.plugins.installing import install, run
from tests.query.random_maps import write_random_map

MODULE = """
from typing import ClassVar, Literal

from query.engine.bound import BoundCrossing, BoundNode, BoundPoint, BoundValue
from query.expression.atom import Condition, Quantity
from tracer.bodies.body import Body
from tracer.media.phases.phase import Phase
from tracer.surfaces.surface import Surface


class Unbound(Condition):
    word, title = "unbound", "nothing"


class Unmeasured(Quantity):
    word, title = "unmeasured", "nothing"


class Half(Condition):
    word, title = "half", "nothing"
    made: ClassVar = BoundNode

    def bind(self, binder, text):
        return self.made(text=text)


class HalfPoint(Half):
    word, made = "half_point", BoundPoint


class HalfCrossing(Half):
    word, made = "half_crossing", BoundCrossing


class HalfValue(Quantity):
    word, title = "half_value", "nothing"

    def bind(self, binder, comparison, text):
        return BoundValue(text=text, operator=comparison.operator, value=comparison.value)


class WithStreams(BoundValue):
    def own_streams(self):
        return ("position",)


class HalfNumber(Quantity):
    word, title = "half_number", "nothing"

    def bind(self, binder, comparison, text):
        return WithStreams(text=text, operator=comparison.operator, value=comparison.value)


class HalfBody(Body):
    kind: Literal["half_body"]


class HalfSurface(Surface):
    kind: Literal["half_surface"] = "half_surface"


class HalfPhase(Phase):
    kind: Literal["half_phase"]
"""
POINTS = {
    "raymap.atoms": {
        "unbound": "Unbound", "unmeasured": "Unmeasured", "half": "Half",
        "half_point": "HalfPoint", "half_crossing": "HalfCrossing", "half_value": "HalfValue",
        "half_number": "HalfNumber",
    },
    "tracer.bodies": {"half_body": "HalfBody"},
    "tracer.surfaces": {"half_surface": "HalfSurface"},
    "tracer.phases": {"half_phase": "HalfPhase"},
}  # fmt: skip
BEAM = 'length_unit = "mm"\n[sources.beam]\nkind = "collimated"\ndiameter = 1\n'


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    points = {
        group: {word: f"raymap_example_kinds.unfinished:{name}" for word, name in entries.items()}
        for group, entries in POINTS.items()
    }
    found = install(tmp_path_factory.mktemp("site"), points)
    (found / "raymap_example_kinds" / "unfinished.py").write_text(MODULE, encoding="utf-8")
    return found


def said(done: subprocess.CompletedProcess[str], message: str) -> None:
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert " ".join(message.split()) in " ".join(done.stderr.split())


@pytest.mark.parametrize(
    ("criterion", "kind", "method"),
    [
        ("unbound", "raymap_example_kinds.unfinished.Unbound", "bind"),
        ("unmeasured > 1", "raymap_example_kinds.unfinished.Unmeasured", "bind"),
    ],
)
def test_words_of_criteria(
    site: Path, tmp_path: Path, criterion: str, kind: str, method: str
) -> None:
    write_random_map(tmp_path / "a.raymap", 5, rays=80, paths=30)
    done = run(site, "-m", "raymap", "query", "a.raymap", criterion, folder=tmp_path)
    said(done, f"{kind} of the distribution 'raymap-example-kinds' does not say its method")
    said(done, f"{method!r}, which every kind of its sort must; upgrade or uninstall raymap-exam")


@pytest.mark.parametrize(
    ("criterion", "method"),
    [
        ("half", "on_rays"), ("half_point", "on_points"), ("half_crossing", "on_crossings"),
        ("half_value > 1", "own_streams"), ("half_number > 1", "values"),
    ],
)  # fmt: skip
def test_what_answers(site: Path, tmp_path: Path, criterion: str, method: str) -> None:
    # Where the class that answers is ours, there is nobody to be named but the method
    write_random_map(tmp_path / "a.raymap", 5, rays=80, paths=30)
    done = run(site, "-m", "raymap", "query", "a.raymap", criterion, folder=tmp_path)
    said(done, f"does not say its method {method!r}, which every kind of its sort must")


@pytest.mark.parametrize(
    ("text", "kind", "method"),
    [
        ('[bodies.b]\nkind = "half_body"\nsurface = "absorber"', "HalfBody", "plan"),
        (
            '[surfaces.s]\nkind = "half_surface"\n[bodies.b]\nkind = "sphere"\nradius = 1\n'
            'position = [0, 0, 9]\nsurface = "s"',
            "HalfSurface",
            "compile",
        ),
        (
            '[media.m]\nindex = 1\nscattering = { mean_free_path = 1, phase = { kind = "half_phase"'
            ' } }\n[world]\nmedium = "m"',
            "HalfPhase",
            "density",
        ),
    ],
)
def test_kinds_of_scenes(site: Path, tmp_path: Path, text: str, kind: str, method: str) -> None:
    (tmp_path / "scene.toml").write_text(BEAM + text, encoding="utf-8")
    done = run(site, "-m", "raymap", "check", "scene.toml", folder=tmp_path)
    said(done, f"raymap_example_kinds.unfinished.{kind} of the distribution 'raymap-example-kinds'")
    said(done, f"does not say its method {method!r}")

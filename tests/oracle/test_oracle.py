"""The comparison of builds finds what differs, and its scenes use every kind."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import pytest

import tracer
from tests.oracle.comparing import answer_differences, end_probability, map_differences
from tests.oracle.jobs import jobs
from tests.oracle.scenes import BODIES, DETECTORS, MEDIA, SOURCES, SURFACES, write_files
from tests.scenes import MIRROR_BALL
from tracer.bodies.body import Body
from tracer.bodies.mesh import MeshBody
from tracer.media.phases.phase import PHASES
from tracer.registries import REGISTRIES


def recorded(path: Path, seed: int, reflectance: float = 0.7) -> Path:
    text = MIRROR_BALL.replace("0.7", str(reflectance))
    tracer.record(tracer.parse_scene(text), path, rays=4000, seed=seed)
    return path


def test_differences_are_found(tmp_path: Path) -> None:
    one = recorded(tmp_path / "one.raymap", 1)
    assert map_differences(one, recorded(tmp_path / "again.raymap", 1)) == []
    other = recorded(tmp_path / "other.raymap", 2)
    assert map_differences(one, other) != []
    assert end_probability(one, other) > 1e-3
    darker = recorded(tmp_path / "darker.raymap", 1, 0.6)
    assert "scene hash" in map_differences(one, darker)
    assert end_probability(one, darker) < 1e-6


def test_answers_are_compared_without_clock_and_file() -> None:
    old = {"status": 0, "out": '{"rays": 3, "seconds": 1, "paths": [1, 2]}', "err": ""}
    new = {"status": 0, "out": '{"rays": 3, "seconds": 2, "paths": [1, 4]}', "err": ""}
    assert answer_differences(old, new) == ["paths[1]: 2 and 4"]
    assert answer_differences(old, old) == []
    assert answer_differences(old, {**new, "status": 1}) != []


def kinds(model: type, field: str = "kind") -> set[str]:
    return set(get_args(model.model_fields[field].annotation))  # type: ignore[attr-defined]


def leaves(model: type) -> set[str]:
    """Kinds of a model and those below it, without those of plug-ins that other tests load."""
    own = [child for child in model.__subclasses__() if child.__module__.startswith("tracer.")]
    below = [leaves(child) for child in own]
    return set().union(*below, kinds(model) if "kind" in model.model_fields else ())  # type: ignore[attr-defined]


NEWER = {"surfaces": {"polariser", "retarder"}, "sources": {"elliptical"}}
"""Kinds that the earlier build does not know."""


def test_scenes_use_every_kind() -> None:
    for room, tables in (("surfaces", SURFACES), ("sources", SOURCES)):
        used = {table["kind"] for table in tables.values()}
        assert used == set(REGISTRIES[room]) - NEWER[room], room
    used = {table.get("kind", "plane") for table in DETECTORS.values()} | {"surface"}
    assert used == set(REGISTRIES["detectors"])
    phases = {
        table["scattering"].get("phase", {"kind": "isotropic"})["kind"]
        for table in MEDIA.values()
        if "scattering" in table
    }
    assert phases == set(PHASES)
    # A rhomb is a body of crystals, which have samples; solids of CAD files need their reader
    assert set(BODIES) | {"rhomb", "cad"} >= leaves(Body)
    assert "mesh" in kinds(MeshBody)


@pytest.mark.slow
def test_all_scenes_compile(tmp_path: Path) -> None:
    write_files(tmp_path)
    names = [job.name for job in jobs(tmp_path, 100)]
    assert len(names) == len(set(names))
    for scene in sorted(tmp_path.glob("generated_*.toml")):
        tracer.compile_scene(tracer.load_scene(scene))

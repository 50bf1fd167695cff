"""Rooms do without those that they do not know: a specialist deleted, the tracer not installed.

The default run leaves packages out of a process (`tests.without`), on the sources as they are. The
slow run deletes folders from a copy, and runs whole suites.
"""

from __future__ import annotations

import ast
import functools
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SPECIALISTS = ("tracer.lens", "tracer.polarized", "tracer.render")
ASKS_FOR = {
    "tracer.lens": (ROOT / "samples" / "double_gauss.toml", "[trace]\nlens_trees = 8\n"),
    "tracer.polarized": (ROOT / "samples" / "double_gauss.toml", '[trace]\nlight = "polarised"\n'),
}
"""Scenes that only the specialist can record, with what is added to them."""

OWN_TESTS = {
    "tracer.lens": (
        "tests/tracer/lens", "tests/tracer/studies", "tests/tracer/run/test_one_run.py",
        "tests/tracer/run/test_provenance.py", "tests/tracer/scene/test_obeyed.py",
        "tests/tracer/scene/test_bad_input.py", "tests/tracer/scene/test_no_key_is_idle.py",
        # A train of lenses is one of their oracles
        "tests/tracer/optics/test_interference.py", "tests/tracer/optics/test_states.py",
        "tests/tracer/polarized/test_polarized_record.py",
    ),
    "tracer.polarized": (
        "tests/tracer/polarized", "tests/tracer/run/test_one_run.py",
        "tests/tracer/run/test_provenance.py", "tests/tracer/scene/test_obeyed.py",
        "tests/tracer/scene/test_bad_input.py", "tests/tracer/scene/test_no_key_is_idle.py",
        # One of its oracles
        "tests/tracer/lens/test_record.py",
        # Records a polarised map for a sample
        "tests/tracer/test_samples.py",
    ),
    "tracer.render": (
        "tests/tracer/render", "tests/tracer/studies", "tests/tracer/run/test_one_run.py",
        "tests/tracer/run/test_provenance.py", "tests/tracer/scene/test_obeyed.py",
        "tests/tracer/scene/test_no_key_is_idle.py",
        # The tree of the renderer, and its bodies, are oracles of recorded paths
        "tests/tracer/crystals",
    ),
}  # fmt: skip
"""Tests of a specialist itself, and those that use it beside others."""

NEED_THE_TRACER = {
    "tests/query/answers/what_if": "traces the changed scenes",
    "tests/query/answers/test_beams.py": "reads luminaires back as the tracer does",
    "tests/query/answers/test_ies_file.py": "reads luminaires back as the tracer does",
    "tests/query/answers/test_comparison.py": "records pairs of scenes",
    "tests/query/answers/test_histograms.py": "spreads the light of scenes",
    "tests/query/answers/test_images.py": "records a scene in one of its tests",
    "tests/query/answers/test_rays_at_place.py": "records a scene, and rays handed on to another",
    "tests/query/engine/test_places.py": "places detectors in scenes that have them",
}
"""Tests of queries that are of the tracer as well; all others run on maps that they write."""


HERE_ALONE = """
import sys

def elsewhere(finder):
    return "__editable__" in str(getattr(finder, "__module__", ""))

sys.meta_path[:] = [finder for finder in sys.meta_path if not elsewhere(finder)]
"""
"""As sitecustomize.py: what is deleted here is not found where the sources are installed from."""


def imported(file: Path) -> set[str]:
    """Names of the modules that a source imports when it is loaded, and of what is in them."""
    found = set()
    waiting: list[ast.stmt] = list(ast.parse(file.read_text(encoding="utf-8")).body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{name.name}" for name in node.names)}
        elif isinstance(node, ast.Try):
            waiting += node.body
    return found


@functools.cache
def reached() -> dict[Path, set[str]]:
    """By source of the product and its tests: all modules that are loaded with it."""
    rooms = ("raymap", "tracer", "query", "viewer", "service", "tests")
    files = {
        ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): file
        for room in rooms
        for file in (ROOT / room).rglob("*.py")
    }
    direct = {name: imported(file) & files.keys() for name, file in files.items()}
    for name in direct:
        # The packages in which it stands are loaded first
        parts = name.split(".")
        direct[name] |= {".".join(parts[:n]) for n in range(1, len(parts))} & files.keys()
    answer = {}
    for name, file in files.items():
        known, waiting = {name}, [name]
        while waiting:
            more = direct[waiting.pop()] - known
            known |= more
            waiting += more
        answer[file] = known
    return answer


def process(folder: Path, *words: object) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(folder)}
    return subprocess.run(
        [sys.executable, "-m", *map(str, words)], cwd=folder, env=environment,
        capture_output=True, text=True, check=False,
    )  # fmt: skip


def without(name: str, *words: object) -> subprocess.CompletedProcess[str]:
    return process(ROOT, "tests.without", name, *words)


@pytest.mark.parametrize("name", SPECIALISTS)
def test_scenes_are_checked_and_recorded_without_a_specialist(name: str, tmp_path: Path) -> None:
    for sample in ("double_gauss", "room"):
        path, scene = tmp_path / f"{sample}.raymap", ROOT / "samples" / f"{sample}.toml"
        done = without(name, "raymap", "record", scene, "-o", path, "--rays", 500, "--json")
        assert done.returncode == 0, done.stderr
        assert json.loads(done.stdout)["rays"] == 500
    done = without(name, "raymap", "check", ROOT / "samples" / "double_gauss.toml", "--json")
    assert done.returncode == 0, done.stderr
    done = without(name, "raymap", "kinds", "--json")
    assert done.returncode == 0, done.stderr
    done = without(name, "raymap", "--help")
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", ASKS_FOR)
def test_scenes_that_need_it_are_refused_in_one_line(name: str, tmp_path: Path) -> None:
    sample, more = ASKS_FOR[name]
    scene = tmp_path / "scene.toml"
    scene.write_text(sample.read_text(encoding="utf-8") + more, encoding="utf-8")
    done = without(name, "raymap", "record", scene, "-o", tmp_path / "a.raymap", "--rays", 10)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert "nothing is installed that follows the light" in done.stderr


def test_words_of_criteria_and_pictures_do_without_the_tracer() -> None:
    done = without("tracer", "pytest", "tests/query/atoms", "tests/viewer/export", "-q")
    assert done.returncode == 0, done.stdout + done.stderr


LISTS = {("tests/raymap", "tests/query", "tests/viewer", "tests/tracer"): OWN_TESTS} | {
    ("tests/query", "tests/viewer"): {"tracer": tuple(NEED_THE_TRACER)}
}


@pytest.mark.parametrize(
    ("folders", "name"), [(folders, name) for folders, of in LISTS.items() for name in of]
)
def test_the_lists_name_the_tests_that_load_a_room(folders: tuple[str, ...], name: str) -> None:
    listed = [ROOT / path for path in LISTS[folders][name]]
    for file, modules in reached().items():
        if not file.name.startswith("test_") or any(file.is_relative_to(path) for path in listed):
            continue
        if any(file.is_relative_to(ROOT / folder) for folder in folders):
            assert not any(f"{each}.".startswith(f"{name}.") for each in modules), file


@pytest.mark.slow
def test_suites_of_query_and_viewer_run_without_the_tracer() -> None:
    ignored = [f"--ignore={path}" for path in NEED_THE_TRACER]
    done = without("tracer", "pytest", "tests/query", "tests/viewer", "-q", *ignored)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("name", SPECIALISTS)
def test_the_core_suites_pass_with_a_specialist_deleted(name: str, tmp_path: Path) -> None:
    gone = name.replace(".", "/")
    for part in ("raymap", "tracer", "query", "viewer", "service", "samples", "tests", "docs"):
        shutil.copytree(
            ROOT / part, tmp_path / part, ignore=shutil.ignore_patterns("__pycache__"),
            symlinks=True,
        )  # fmt: skip
    for file in ("pyproject.toml", "README.md", "CHANGELOG.md"):
        shutil.copy(ROOT / file, tmp_path / file)
    shutil.rmtree(tmp_path / gone)
    (tmp_path / "sitecustomize.py").write_text(HERE_ALONE, encoding="utf-8")
    left_out = [f"--ignore={path}" for path in OWN_TESTS[name]]
    done = process(
        tmp_path, "pytest", "tests/raymap", "tests/query", "tests/viewer", "tests/tracer", "-q",
        *left_out,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr

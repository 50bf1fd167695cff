"""What `raymap doctor` finds wrong, each made on purpose, and that it finds nothing else."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from raymap.examination.packages import _requirement
from raymap.jit.compilecache import fingerprint
from tests.plugins.installing import install

_ROOT = Path(__file__).resolve().parents[3]


def doctor(folder: Path, *places: Path, **variables: str) -> tuple[int, list[dict[str, Any]]]:
    """Exit status and problems, with folders on Python's path behind ours."""
    path = os.pathsep.join(map(str, (_ROOT, *places)))
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    environment |= {"PYTHONPATH": path, "XDG_CACHE_HOME": str(folder / "cache"), **variables}
    done = subprocess.run(
        [sys.executable, "-m", "raymap", "doctor", "--quick", "--json"],
        cwd=folder, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.stderr == ""
    told = json.loads(done.stdout)
    problems = [finding for finding in told["findings"] if "problem" in finding]
    assert told["well"] == (not problems) == (done.returncode == 0)
    assert all(finding["remedy"] for finding in problems)
    return done.returncode, problems


def test_a_sound_installation_has_no_problem(tmp_path: Path) -> None:
    assert doctor(tmp_path) == (0, [])


def test_a_module_of_our_name_in_the_current_folder(tmp_path: Path) -> None:
    (tmp_path / "query.py").write_text("raise SystemExit('executed')", encoding="utf-8")
    (tmp_path / "viewer").mkdir()  # a folder without __init__.py hides nothing
    code, [problem] = doctor(tmp_path)
    assert code == 1
    assert str(tmp_path / "query.py") in problem["problem"]
    assert "rename it" in problem["remedy"]


def test_another_distribution_with_our_name(tmp_path: Path) -> None:
    site = tmp_path / "site"
    (site / "tracer").mkdir(parents=True)
    (site / "tracer" / "__init__.py").write_text("", encoding="utf-8")
    info = site / "opentracer-3.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: opentracer\nVersion: 3\n")
    (info / "top_level.txt").write_text("tracer\n")
    code, [problem] = doctor(tmp_path, site)
    assert code == 1
    assert "of the distribution opentracer has the import name 'tracer'" in problem["problem"]
    assert "uninstall opentracer" in problem["remedy"]


def test_a_plug_in_that_cannot_be_loaded(tmp_path: Path) -> None:
    site = tmp_path / "site"
    install(site, {"raymap.atoms": {"wrong": "raymap_example_kinds.nothing:A"}})
    code, [problem] = doctor(tmp_path, site)
    assert code == 1
    assert "raymap_example_kinds.nothing" in problem["problem"]
    assert "uninstall raymap-example-kinds" in problem["remedy"]


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="owners of files")
def test_a_folder_of_compiled_code_that_another_could_exchange(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    folder = tmp_path / "cache" / "raymap" / f"compiled-{fingerprint()}"
    folder.parent.mkdir(parents=True, mode=0o700)
    folder.symlink_to(tmp_path / "elsewhere")
    code, [problem] = doctor(tmp_path)
    assert code == 1
    assert "compiled code cannot be kept" in problem["problem"]
    assert "NUMBA_CACHE_DIR" in problem["remedy"]


def test_numba_without_compiling(tmp_path: Path) -> None:
    code, [problem] = doctor(tmp_path, NUMBA_DISABLE_JIT="1")
    assert code == 1
    assert "NUMBA_DISABLE_JIT" in problem["problem"]


@pytest.mark.parametrize(
    ("requirement", "fits"),
    [
        ("numpy>=1.2", True),
        ("numpy>=999", False),
        ("numba>=0.1,<0.2", False),
        ("nothing-x>1", False),
    ],
)
def test_versions_are_compared(requirement: str, fits: bool) -> None:
    finding = _requirement("versions", requirement, needed=True)
    assert (finding.problem == "") == fits
    if not fits:
        assert finding.remedy == f"pip install '{requirement}'"

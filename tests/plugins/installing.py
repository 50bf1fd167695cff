"""Installs the distribution of this folder for a process, without a package index."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
ROOT = HERE.parents[1]


def project() -> dict[str, Any]:
    return tomllib.loads((HERE / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def install(site: Path, points: dict[str, dict[str, str]] | None = None) -> Path:
    """The package and its metadata as pip lays them down.

    Parameters
    ----------
    site : folder for packages
    points : entry points by group instead of those of the distribution
    """
    described = project()
    name = described["name"].replace("-", "_")
    shutil.copytree(
        HERE / name, site / name, ignore=shutil.ignore_patterns("__pycache__"), dirs_exist_ok=True
    )
    info = site / f"{name}-{described['version']}.dist-info"
    info.mkdir(exist_ok=True)
    head = f"Metadata-Version: 2.1\nName: {described['name']}\nVersion: {described['version']}\n"
    (info / "METADATA").write_text(head, encoding="utf-8")
    lines: list[str] = []
    for group, entries in (described["entry-points"] if points is None else points).items():
        lines += [f"[{group}]", *(f"{key} = {value}" for key, value in entries.items()), ""]
    (info / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")
    return site


def run(
    site: Path, *command: str, folder: Path | None = None, given: str = ""
) -> subprocess.CompletedProcess[str]:
    """A command of Python with the distribution installed; ``given`` is its standard input."""
    path = os.pathsep.join((str(ROOT), str(site)))
    return subprocess.run(
        [sys.executable, *command], cwd=folder or site, env=os.environ | {"PYTHONPATH": path},
        capture_output=True, text=True, check=False, input=given,
    )  # fmt: skip

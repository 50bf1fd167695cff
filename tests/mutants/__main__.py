"""Runs the falsehoods: ``python -m tests.mutants [NAME …]``."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.mutants.falsehoods import MUTANTS, Mutant

ROOT = Path(__file__).parents[2]
COPIED = ("raymap", "tracer", "query", "viewer", "service", "tests", "samples", "docs")


def unnoticed(mutant: Mutant, folder: Path) -> list[str]:
    """Features whose tests pass although the formula is false."""
    for name in COPIED:
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", folder)
    place = folder / mutant.file
    text = place.read_text()
    if text.count(mutant.true) != 1:
        raise SystemExit(f"{mutant.file} has not once: {mutant.true}")
    place.write_text(text.replace(mutant.true, mutant.false))
    environment = os.environ | {
        "PYTHONPATH": str(folder),
        "NUMBA_CACHE_DIR": str(folder / "compiled"),
        "XDG_CACHE_HOME": str(folder / "cache"),
    }
    missed = []
    for feature, test in mutant.features.items():
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", test]
        ran = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
        noticed = ran.returncode == 1
        print(f"  {'red  ' if noticed else 'GREEN'} {feature}: {test}", flush=True)
        if not noticed:
            missed.append(feature)
    return missed


def main() -> int:
    """Print each mutant with its features; 1 where one of them did not notice."""
    asked = sys.argv[1:]
    missed = 0
    for mutant in MUTANTS:
        if asked and mutant.name not in asked:
            continue
        print(f"{mutant.name}: {mutant.false}", flush=True)
        with tempfile.TemporaryDirectory() as folder:
            missed += len(unnoticed(mutant, Path(folder)))
    print(f"{missed} features did not notice")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())

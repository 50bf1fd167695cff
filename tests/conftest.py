"""Shared set-up of the tests.

Compiled functions are cached on disk. Numba notices an edit of the function itself, not of a
function that it calls, so the cache directory is named by a hash of all sources.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from tests.examples import register_profiles

_ROOT = Path(__file__).resolve().parent.parent


def _source_hash() -> str:
    digest = hashlib.sha256()
    for room in ("raymap", "tracer", "query", "viewer", "service", "tests"):
        for source in sorted((_ROOT / room).rglob("*.py")):
            digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


os.environ.setdefault(
    "NUMBA_CACHE_DIR", str(Path(tempfile.gettempdir()) / f"raymap-tests-{_source_hash()}")
)
os.environ.setdefault("MPLBACKEND", "Agg")

register_profiles()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--own-engines",
        action="store_true",
        help="compile the engine that each scene needs, as users do, not one for all tests",
    )


@pytest.fixture(autouse=True, scope="session")
def one_engine(request: pytest.FixtureRequest) -> Iterator[None]:
    """Trace all scenes by one compiled engine: each variant compiles for half a minute."""
    if request.config.getoption("--own-engines") or find_spec("tracer") is None:
        yield
        return
    from tests.whole_engine import whole_engine

    with whole_engine():
        yield


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Any:
    """The command line in this process: exit code, stdout, stderr."""
    from raymap.cli import main

    def command(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["raymap", *map(str, words)])
        code = 0
        try:
            main()
        except SystemExit as end:
            code = int(end.code or 0)
        out = capsys.readouterr()
        return code, out.out, out.err

    return command

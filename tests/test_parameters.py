"""Functions take few parameters: what belongs together is handed over as one thing."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
ROOMS = ("raymap", "tracer", "query", "viewer", "service")

MOST = 12

# Options of a command are its interface, and so are the keywords of what it calls
ALLOWED = {
    "query/cli/histograms.py histogram",
    "query/cli/questions.py paths",
    "query/cli/questions.py query",
    "query/cli/rayfile.py rayfile",
    "raymap/foreign/recorder.py __init__",
    "service/cli.py serve",
    "tracer/cli.py record",
    "tracer/run/recording.py record",
    "tracer/run/sharding.py record_shards",
    "tracer/studies/cli_polarized_light.py microscope",
    "viewer/cli.py chart",
    "viewer/cli.py picture",
    "viewer/paint/rendering.py picture",
}
"""Functions that have more; but for commands the list may only become shorter."""


def functions() -> Iterator[tuple[str, int]]:
    """Every function of the product, and how many parameters it has."""
    for room in ROOMS:
        for path in sorted((ROOT / room).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                    given = node.args
                    count = len(given.posonlyargs) + len(given.args) + len(given.kwonlyargs)
                    yield f"{path.relative_to(ROOT).as_posix()} {node.name}", count


def test_functions_take_few_parameters() -> None:
    crowded = {name for name, count in functions() if count > MOST}
    assert crowded - ALLOWED == set(), "hand over what belongs together as one thing"
    assert ALLOWED - crowded == set(), "strike these off the list"

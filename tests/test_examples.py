"""Examples are the same each time by default, many others under `wide`; no test undoes it."""

from __future__ import annotations

import ast
from pathlib import Path

from hypothesis import settings

from tests.examples import DEFAULT, WIDE, examples

_TESTS = Path(__file__).resolve().parent


def test_examples_are_the_same_each_time_or_many() -> None:
    default, wide = settings.get_profile("default"), settings.get_profile("wide")
    assert default.derandomize
    assert not wide.derandomize
    assert (default.deadline, wide.deadline) == (None, None)
    assert (default.max_examples, wide.max_examples) == (DEFAULT, WIDE)


def test_shares_follow_the_profile() -> None:
    assert examples(50) == settings.default.max_examples // 2
    with_fewer = {number: examples(number) for number in (1, 8, 300)}
    assert all(with_fewer[n] * DEFAULT == n * settings.default.max_examples for n in with_fewer)


def test_no_test_undoes_the_profile() -> None:
    """Numbers of examples are shares; chance and deadlines are left to the profile."""
    seen = 0
    for path in sorted(_TESTS.rglob("*.py")):
        if path.name == "examples.py":
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not (isinstance(node, ast.Call) and getattr(node.func, "id", "") == "settings"):
                continue
            given = {word.arg: word.value for word in node.keywords}
            place = f"{path}:{node.lineno}"
            assert not given.keys() & {"derandomize", "deadline", "database"}, place
            if "max_examples" in given:
                assert ast.unparse(given["max_examples"]).startswith("examples("), place
            seen += 1
    assert seen > 15

"""Wildcards against Python's own shell patterns, and what hostile ones cost."""

from __future__ import annotations

import ast
import fnmatch
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from raymap.model.wildcards import Wildcard, characters

_ROOT = Path(__file__).resolve().parents[3]
_FROM_TABLES = (
    ("query/engine/descriptions.py", "re.fullmatch(rf"),
    ("query/engine/places.py", "re.compile(rf"),
    ("tracer/optics/glasses.py", "re.fullmatch("),
    ("tracer/scene/load.py", "re.sub(theirs, ours, message)"),
    ("viewer/panels/values.py", "re.compile(pattern, re.S).fullmatch"),
)


@given(st.text("ab*?", max_size=12), st.text("ab", max_size=14))
def test_wildcards_match_what_shell_patterns_match(pattern, name):
    assert Wildcard(pattern).matches(name) == fnmatch.fnmatchcase(name, pattern)


@given(st.text("ab*?[]!-c", max_size=10), st.text("abc-[]!", max_size=10))
def test_patterns_of_scenes_know_classes_as_the_shell_does(pattern, name):
    assert Wildcard(pattern, escapes=False).matches(name) == fnmatch.fnmatchcase(name, pattern)


def test_classes_in_scenes_and_brackets_in_criteria():
    assert Wildcard("face_[3-5]", escapes=False).matches("face_4")
    assert not Wildcard("face_[!3-5]", escapes=False).matches("face_4")
    assert Wildcard("dot[3]").matches("dot[3]")


@given(st.text(max_size=20))
def test_an_escaped_name_matches_itself_alone(name):
    pattern = "".join("\\" + character for character in name)
    assert Wildcard(pattern).matches(name)
    assert not Wildcard(pattern).matches(name + "x")
    assert "".join(character for character, _ in characters(pattern)) == name


def test_without_escapes_a_backslash_is_a_character():
    assert Wildcard("a\\*", escapes=False).matches("a\\b")
    assert not Wildcard("a\\*").matches("a\\b")


@pytest.mark.parametrize("pattern", ["*a" * 150 + "b", "*?" * 150 + "b", "*" * 10_000 + "b"])
def test_many_stars_cost_steps_in_proportion(pattern):
    """Backtracking would take more steps than the universe has had seconds."""
    steps = 0

    def count(frame, event, argument):
        nonlocal steps
        steps += 1
        return count

    wanted = Wildcard(pattern)
    sys.settrace(count)
    try:
        assert not wanted.matches("a" * 1000)
    finally:
        sys.settrace(None)
    assert steps < 100 * (len(pattern) + 1000)


def _patterns_of(path):
    """Calls of `re` whose pattern is no constant of the program."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)):
            continue
        if not (isinstance(node.func.value, ast.Name) and node.func.value.id in ("re", "regex")):
            continue
        if node.func.attr in ("escape",) or not node.args:
            continue
        if not isinstance(node.args[0], ast.Constant):
            yield f"{path.relative_to(_ROOT)}:{node.lineno}"


def test_no_text_of_a_user_becomes_a_regular_expression():
    found, matchers = [], []
    for room in ("raymap", "query", "tracer", "viewer", "service"):
        for path in sorted((_ROOT / room).rglob("*.py")):
            found += _patterns_of(path)
            text = path.read_text(encoding="utf-8")
            matchers += [str(path)] if "fnmatch" in text.replace("wildcards", "") else []
    assert found == _patterns_of_the_program()
    assert matchers == []


def _patterns_of_the_program():
    """The calls whose patterns come out of tables of constants of the program."""
    found = []
    for name, call in _FROM_TABLES:
        lines = (_ROOT / name).read_text(encoding="utf-8").splitlines()
        found.append(f"{name}:{next(n for n, line in enumerate(lines, 1) if call in line)}")
    return found

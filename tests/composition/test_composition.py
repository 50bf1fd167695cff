"""The page says what goes together, and each pair was tried."""

from __future__ import annotations

import pytest

from tests.composition.__main__ import MARKS, PAGE
from tests.composition.features import FEATURES
from tests.composition.table import MODES, filled, page, tried

_SHORT = [
    ("stack of layers", "polarised"),
    ("scatter about specular light", "polarised, splitting"),
    ("rough metal", "weighted"),
    ("coincident faces", "splitting"),
    ("camera", "polarised, weighted"),
    ("pinhole", "polarised, splitting"),
    ("metal", "crystals"),
    ("curved faces", "crystals, weighted"),
]


def _rows() -> dict[str, dict[str, str]]:
    """Signs of the page by feature and way."""
    text = PAGE.read_text(encoding="utf-8").partition(MARKS[0])[2].partition(MARKS[1])[0]
    head, _, *rows = [line for line in text.splitlines() if line.startswith("|")]
    modes = [cell.strip() for cell in head.split("|")[2:-1]]
    found = {}
    for row in rows:
        name, *signs = (cell.strip() for cell in row.split("|")[1:-1])
        found[name] = dict(zip(modes, signs, strict=True))
    return found


def test_the_page_has_every_pair() -> None:
    rows = _rows()
    assert list(rows) == list(FEATURES)
    for name, row in rows.items():
        assert list(row) == list(MODES), name
        assert set(row.values()) <= {"yes", "–"}, name


@pytest.mark.parametrize(("name", "mode"), _SHORT)
def test_a_pair_works_as_the_page_says(name: str, mode: str) -> None:
    assert tried(name, mode).state == "works"
    assert _rows()[name][mode] == "yes"


@pytest.mark.parametrize(
    ("name", "mode", "key"),
    [
        ("pinhole", "crystals", "detectors.hole"),
        ("pinhole", "crystals, weighted", "detectors.hole"),
    ],
)
def test_a_pair_is_refused_by_its_key(name: str, mode: str, key: str) -> None:
    cell = tried(name, mode)
    assert cell.state == "refused"
    assert key in cell.line
    assert _rows()[name][mode] == "–"


def test_a_feature_that_does_nothing_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same scene on both sides: a pair that works is one that makes a difference."""
    from dataclasses import replace

    same = replace(FEATURES["filter"], off=FEATURES["filter"].on)
    monkeypatch.setitem(FEATURES, "filter", same)
    assert tried("filter", "analog").state == "idle"


@pytest.mark.slow
def test_the_whole_table() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert page(filled()) == text.partition(MARKS[0])[2].partition(MARKS[1])[0]

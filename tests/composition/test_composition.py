"""The page says what goes together, and each pair was tried."""

from __future__ import annotations

import pytest

from tests.composition.__main__ import MARKS, PAGE, RUNS, part, running
from tests.composition.features import FEATURES
from tests.composition.running import RUNNING, ran
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


def _rows(mark: str = MARKS[0]) -> dict[str, dict[str, str]]:
    """Signs of a table of the page by feature, or way of running, and way of following light."""
    text = part(PAGE.read_text(encoding="utf-8"), mark)
    head, _, *rows = [line for line in text.splitlines() if line.startswith("|")]
    modes = [cell.strip() for cell in head.split("|")[2:-1]]
    found = {}
    for row in rows:
        name, *signs = (cell.strip() for cell in row.split("|")[1:-1])
        found[name] = dict(zip(modes, signs, strict=True))
    return found


def test_the_page_has_every_pair() -> None:
    rows = _rows() | _rows(RUNS)
    assert list(rows) == [*FEATURES, *RUNNING]
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


@pytest.mark.parametrize(("name", "mode"), [("metal", "weighted"), ("filter", "polarised")])
def test_a_forgotten_feature_is_seen(name: str, mode: str) -> None:
    assert tried(name, mode, forgotten=True).state in ("differs", "idle")


@pytest.mark.parametrize(
    ("name", "mode"),
    [
        ("continued map", "polarised, weighted"),
        ("folder of maps", "splitting"),
        ("time limit", "weighted"),
        ("stopped by Ctrl-C", "polarised"),
    ],
)
def test_a_way_of_running_works_as_the_page_says(name: str, mode: str) -> None:
    assert ran(name, mode).state == "works"
    assert _rows(RUNS)[name][mode] == "yes"


@pytest.mark.slow
def test_the_whole_table() -> None:
    assert page(filled()) == part(PAGE.read_text(encoding="utf-8"), MARKS[0])


@pytest.mark.slow
def test_the_whole_table_of_running() -> None:
    assert running() == part(PAGE.read_text(encoding="utf-8"), RUNS)


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
def test_each_working_pair_has_a_mutant(mode: str) -> None:
    """A way of following light that forgets the feature turns its cell red."""
    for name, row in _rows().items():
        if row[mode] == "yes":
            assert tried(name, mode, forgotten=True).state in ("differs", "idle"), (name, mode)

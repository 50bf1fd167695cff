"""Proposals for what can stand at the cursor."""

from __future__ import annotations

import pytest

from query import parse
from tests.viewer.small_map import make_directory
from viewer.panels.completion import complete

DIRECTORY = make_directory()


def proposals(text: str) -> list[str]:
    """Proposals where ``|`` stands in a text."""
    cursor = text.index("|")
    _, found = complete(text.replace("|", ""), cursor, DIRECTORY)
    return [item.text for item in found]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("|", ["hit", "detected", "source"]),
        ("de|", ["detected"]),
        ('hit("L1") & cr|', ["crossed"]),
        ('hit("|', ["L1", "tube", "sensor", "L1.front", "L1.rim", "L1.back"]),
        ('hit("L1.b|', ["L1.back"]),
        ('detected("|', ["sensor"]),
        ('source("la|', ["lamp"]),
        ('medium("|', ["air", "glass"]),
        ('hit("L1", refl|', ["reflected"]),
        ("event(|", ["reflected", "refracted"]),
        ('count(hit("L1", |', ["reflected", "refracted"]),
        ("optical|", ["optical_length"]),
        ('hit("ront|', ["L1.front", "sensor.front"]),
    ],
)
def test_proposals_begin_with(text: str, expected: list[str]) -> None:
    found = proposals(text)
    assert [name for name in found if name in expected] == expected
    assert set(found[: len(expected)]) <= set(found)


def test_nothing_is_proposed_after_a_finished_condition() -> None:
    assert proposals('hit("L1") |') == []
    assert proposals("wavelength > 500|") == []


def test_what_is_taken_reads_as_a_criterion() -> None:
    text = 'hit("L1.b'
    start, [item] = complete(text, len(text), DIRECTORY)
    taken = text[:start] + item.insert
    assert str(parse(taken + ")")) == 'hit("L1.back")'


def test_functions_leave_the_cursor_inside() -> None:
    _, [item] = complete("dete", 4, DIRECTORY)
    assert item.insert == 'detected("")'
    assert item.insert[: len(item.insert) - item.back] == 'detected("'


def test_a_closing_quotation_mark_is_not_doubled() -> None:
    text = 'source("st")'
    start, [item] = complete(text, 10, DIRECTORY)
    assert text[:start] + item.insert + text[10:] == 'source("star")'

"""Texts and JSON of criteria as they were when atoms stood in one grammar: nothing may drift."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from query import parse
from query.expression.json_form import from_json
from query.expression.registry import ATOMS

TREES = Path(__file__).parents[2] / "data" / "golden" / "criteria" / "trees.json"
ROWS: list[dict[str, Any]] = json.loads(TREES.read_text(encoding="utf-8"))


def test_every_atom_of_ours_is_among_them() -> None:
    text = TREES.read_text(encoding="utf-8")
    assert [entry.word for entry in ATOMS.entries(ours=True) if f'"{entry.word}"' not in text] == []


@pytest.mark.parametrize("row", ROWS, ids=range(len(ROWS)))
def test_text_and_json_stay_as_they_were(row: dict[str, Any]) -> None:
    tree = parse(row["text"])
    assert str(tree) == row["printed"]
    assert tree.to_json() == row["json"]
    assert from_json(row["json"]) == tree == parse(row["printed"])

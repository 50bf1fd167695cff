"""Tables of kinds on the pages are those of the registries."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from raymap.cli.kinds import markdown_table
from raymap.rooms import registries

DOCS = Path(__file__).parents[2] / "docs"
MARK = re.compile(r"<!-- raymap kinds (\w+) --markdown -->\n(.*?)\n<!-- end -->", re.S)
TABLES = [
    (page.name, name, table)
    for page in sorted(DOCS.glob("*.md"))
    for name, table in MARK.findall(page.read_text(encoding="utf-8"))
]


@pytest.mark.parametrize(("page", "name", "table"), TABLES)
def test_table(page: str, name: str, table: str) -> None:
    assert table == markdown_table(registries()[name].entries(ours=True)), (
        f"write the table of `raymap kinds {name} --markdown` into docs/{page}"
    )


def test_every_sort_of_kinds_has_a_table() -> None:
    assert {name for _, name, _ in TABLES} == set(registries())

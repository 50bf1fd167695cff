"""Rows of tables that are less sure than 30 % are marked, and only those."""

from __future__ import annotations

from typing import Any

import pytest

import query
from query.cli.terminal import print_rows
from raymap.model.doubt import FOOTNOTE


def test_rows_above_thirty_percent_carry_a_mark(capsys: pytest.CaptureFixture[str]) -> None:
    # n rays of equal flux have a relative error of 1 / sqrt(n): 11 rays 30.2 %, 12 rays 28.9 %
    rows = [{"name": f"n{n}", "flux": float(n), "flux_se": n**0.5} for n in (11, 12)]
    print_rows(rows, "rows")
    few, many = (line for line in capsys.readouterr().out.splitlines() if "│ n1" in line)
    assert "?" in few
    assert "?" not in many
    print_rows(rows[:1], "rows")
    assert "standard error" in capsys.readouterr().out
    print_rows(rows[1:], "rows")
    assert "standard error" not in capsys.readouterr().out


def test_tables_in_notebooks_carry_the_mark(maps: dict[str, Any]) -> None:
    seen = set()
    for map in maps.values():
        table = query.path_table(map)
        doubtful = [row.flux_se > 0.3 * row.flux for row in table.rows(20)]
        lines = str(table).splitlines()[1:]
        assert [" ? " in line[:50] for line in lines[: len(doubtful)]] == doubtful
        assert (lines[-1] == FOOTNOTE) == any(doubtful)
        assert table._repr_html_().count(" ?</td>") == sum(doubtful)
        seen |= set(doubtful)
    assert seen == {True, False}

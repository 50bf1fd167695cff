"""The page of the outside checks: rows as lines of a table, sections that are replaced alone."""

from __future__ import annotations

import re
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path

from tests.validation import Check, Row

__all__ = ["PAGE", "beginning", "line", "read_sections", "section_text", "write_page"]

PAGE = Path(__file__).parents[2] / "docs" / "validation.md"

_HEAD = """\
# Outside checks

What Raymap computes beside what a formula, a standard or an independent package says. `python -m
tests.validation` in a checkout with the extras `dev` and `peers` computes every value again and
writes this page; a test of the default run holds each row to its tolerance. *Error* is the value
got less the value expected, in the unit of the row; a tolerance that stands beside standard errors
(±, one sigma) covers four to five of them. New checks: see `tests/validation/__init__.py`.
"""
_COLUMNS = "| what | source | expected | got | error | tolerance |\n|---|---|---|---|---|---|\n"


def _number(value: float, error: float = 0.0, unit: str = "") -> str:
    if error:
        digits = f"{error:.1e}"
        places = max(0, 1 - int(digits.partition("e")[2]))
        text = f"{value:.{places}f} ± {error:.{places}f}"
    else:
        text = f"{value:.8g}"
    return text + unit if unit == "°" else f"{text} {unit}".rstrip()


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def beginning(check: Check, row: Row) -> str:
    """The part of a line that no change of the product may alter."""
    what = f"{check.what}: {row.of}" if row.of else check.what
    expected = _number(row.expected, row.expected_error, row.unit)
    return f"| {_cell(what)} | {_cell(check.source)}" + f" | {_cell(expected)} |"


def line(check: Check, row: Row) -> str:
    """One line of the table."""
    got = _number(row.got, row.got_error, row.unit)
    return f"{beginning(check, row)} {_cell(got)} | {row.error:+.1e} | {row.tolerance:.1e} |"


def section_text(heading: str, checks: Iterable[tuple[Check, list[Row]]]) -> str:
    """A section with its table and the versions of the packages that it asked."""
    done = list(checks)
    lines = [line(check, row) for check, rows in done for row in rows]
    packages = sorted({name for check, _ in done for name in check.packages})
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in packages)
    end = f"\n\nCompared with {versions}." if versions else ""
    return f"## {heading}\n\n{_COLUMNS}" + "\n".join(lines) + end + "\n"


def read_sections(text: str) -> dict[str, str]:
    """The sections of a page by their headings."""
    return {
        part.splitlines()[0].removeprefix("## "): part.rstrip() + "\n"
        for part in re.split(r"(?m)^(?=## )", text)[1:]
    }


def write_page(texts: Iterable[str]) -> None:
    """Write the page from the texts of its sections."""
    PAGE.write_text("\n".join([_HEAD, *texts]), encoding="utf-8")

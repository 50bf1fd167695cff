"""The makers' glasses beyond the common ones: 1,700 rows, read when one is asked for.

``maker_glasses.csv`` is made of the refractiveindex.info database (public domain, CC0 1.0; M. N.
Polyanskiy, Scientific Data 11, 94 (2024)), which follows the makers' own catalogues.
"""

from __future__ import annotations

import csv
import re
from functools import cache
from importlib import resources

__all__ = ["CATALOGUE_MAKERS", "Row", "find_row", "loose_key", "similar_rows"]

Row = dict[str, str]

CATALOGUE_MAKERS = (
    "Schott", "Ohara", "Hoya", "Hikari", "Sumita", "CDGM", "LZOS", "Barberini", "AMI", "LightPath",
    "Vitron",
)  # fmt: skip
"""In the order in which a name without a maker is looked up."""


@cache
def _rows() -> dict[str, dict[str, Row]]:
    """Rows by maker, then by loose name."""
    text = resources.files("tracer.optics").joinpath("maker_glasses.csv").read_text("utf-8")
    lines = (line for line in text.splitlines() if not line.startswith("#"))
    found: dict[str, dict[str, Row]] = {maker: {} for maker in CATALOGUE_MAKERS}
    for row in csv.DictReader(lines):
        found[row["maker"]].setdefault(loose_key(row["name"]), row)
    return found


def loose_key(name: str) -> str:
    """A glass name without what programs leave out or add: case, hyphens, spaces."""
    return re.sub(r"[\s_-]+", "", name).casefold()


def find_row(name: str, maker: str | None = None) -> Row | None:
    """The row of a glass, of the first maker that has it; None where nobody has."""
    for known, rows in _rows().items():
        if maker is None or known.casefold() == maker.casefold():
            row = rows.get(loose_key(name))
            if row is not None:
                return row
    return None


def similar_rows(name: str, count: int = 3) -> list[str]:
    """Names that look like ``name``, with their makers."""
    import difflib

    keys = {key: row for rows in reversed(_rows().values()) for key, row in rows.items()}
    near = difflib.get_close_matches(loose_key(name), list(keys), n=count, cutoff=0.6)
    return [f"{keys[key]['name']} ({keys[key]['maker']})" for key in near]

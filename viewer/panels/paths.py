"""The paths panel: the table of paths, sortable, with paths shown alone, and the ghost matrix."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from raymap.model.doubt import FOOTNOTE, MARK, is_doubtful, marked
from viewer.drawn.falsecolor import PALETTE
from viewer.drawn.itinerary import headline

__all__ = ["SORTS", "path_rows", "sort_rows"]

SORTS = ("flux", "rays", "path")


def sort_rows(rows: Sequence[dict[str, Any]], by: str) -> list[dict[str, Any]]:
    """Rows of the path table in another order; the remainder stays last."""
    body = [row for row in rows if row["path"] != "remainder"]
    last = [row for row in rows if row["path"] == "remainder"]
    if by == "path":
        return [*sorted(body, key=lambda row: str(row["path"])), *last]
    return [*sorted(body, key=lambda row: -float(row[by])), *last]


def path_rows(
    rows: Sequence[dict[str, Any]], checked: Sequence[str], unit: str
) -> list[dict[str, Any]]:
    """The path table for the page; a checked path gets the colour that its rays have."""
    shown = []
    for number, row in enumerate(rows):
        criterion = str(row.get("criterion") or "")
        flux, se = float(row["flux"]), float(row["flux_se"])
        place = list(checked).index(criterion) if criterion in checked else -1
        color = ""
        if place >= 0 and len(checked) > 1:
            color = "#" + "".join(f"{int(part):02x}" for part in PALETTE[place % len(PALETTE)])
        shown.append(
            {
                "number": number,
                "path": "everything else"
                if row["path"] == "remainder"
                else headline(str(row["path"])),
                "whole": row["path"],
                "source": row.get("source") or "",
                "criterion": criterion,
                "rays": f"{int(row['rays']):,}",
                "flux": f"{flux:.3g} {unit}",
                "flux_se": marked(f"{se:.1g}", flux, se),
                "flux_note": FOOTNOTE.removeprefix(f"{MARK} ") if is_doubtful(flux, se) else "",
                "share": f"{100 * float(row['share']):.3g} %",
                "checked": place >= 0,
                "color": color,
            }
        )
    return shown

"""Charts as PDF."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from raymap.pictures.chart_formats.format import ChartFormat

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["PDF"]


def _write(path: Path, figure: Figure) -> None:
    figure.savefig(path, format="pdf")


PDF = ChartFormat(suffixes=(".pdf",), title="a page of lines and letters", place=2.0, write=_write)

KINDS = (PDF,)

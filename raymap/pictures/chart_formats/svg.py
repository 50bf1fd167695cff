"""Charts as SVG."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from raymap.pictures.chart_formats.format import ChartFormat

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["SVG"]


def _write(path: Path, figure: Figure) -> None:
    figure.savefig(path, format="svg")


SVG = ChartFormat(
    suffixes=(".svg",), title="lines and letters for pages of the web", place=3.0, write=_write
)

KINDS = (SVG,)

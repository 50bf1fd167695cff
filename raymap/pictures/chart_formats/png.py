"""Charts as PNG."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from raymap.pictures.chart_formats.format import ChartFormat

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["PNG"]


def _write(path: Path, figure: Figure) -> None:
    figure.savefig(path, format="png", dpi=130)


PNG = ChartFormat(suffixes=(".png",), title="pixels, 130 to the inch", place=1.0, write=_write)

KINDS = (PNG,)

"""What a format of charts is, and those that there are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from raymap.model.fileformat import FileFormat, suffixes_of
from raymap.model.registry import Registry

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["CHART_FORMATS", "ChartFormat"]


@dataclass(frozen=True, kw_only=True)
class ChartFormat(FileFormat):
    """A format of charts, by the suffixes of its files.

    Attributes
    ----------
    write : writes a figure of Matplotlib to a path, which is a name beside the one that was asked
        for and need not end as that does
    """

    write: Callable[[Path, Figure], Any]


CHART_FORMATS: Registry[ChartFormat] = Registry(
    "raymap.chart_formats",
    "raymap.pictures.chart_formats",
    words=suffixes_of,
    of=ChartFormat,
    sort="formats of charts",
)

"""Files of intensities as lines ``gamma candela``, the same all around the axis (``.cdt``)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from raymap.model.errors import SceneError
from raymap.model.textfile import text_lines
from tracer.light import IntensityGrid, LightFormat

__all__ = ["FORMAT"]


def read(path: Path) -> IntensityGrid:
    """The intensities of a file."""
    rows = []
    for number, line in enumerate(text_lines(path.read_bytes()), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        try:
            gamma, candela = map(float, line.split())
        except ValueError:
            raise SceneError(
                f"{path.name}: line {number}: write gamma and candela, found {line!r:.40}"
            ) from None
        rows.append((gamma, candela))
    table = np.array(rows).reshape(-1, 2)
    return IntensityGrid(
        gamma_deg=table[:, 0], c_deg=np.zeros(1), intensity=table[:, 1], unit="lm", name=path.name
    )


FORMAT = LightFormat(
    suffixes=(".cdt",),
    title="candela by gamma, one line each",
    sniff=lambda head: head.startswith(b"# candela table"),
    read=lambda path, flux_from: read(path),
)

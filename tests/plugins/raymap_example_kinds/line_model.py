"""Rays and scene as ``.lines``: one line of text for each segment and each triangle."""

from __future__ import annotations

from pathlib import Path

from viewer.export.content import Content
from viewer.export.format import ExportFormat

__all__ = ["FORMAT"]


def write(content: Content, path: Path) -> None:
    rows = []
    for kind, corners in [
        ("ray", content.lines.segments),
        *(("body", body.corners) for body in content.bodies),
    ]:
        rows += [f"{kind} " + " ".join(f"{x:.9g}" for x in row.ravel()) for row in corners]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


FORMAT = ExportFormat(
    suffixes=(".lines",), title="segments and triangles, a line each", write=write
)

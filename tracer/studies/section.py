"""Section drawing of a scene: bodies cut by the yz plane, with the sources' chief rays, as SVG."""

from __future__ import annotations

import itertools
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import RayMapError
from raymap.model.replacing import check_place, replacing
from tracer.scene.compile import Compilation, compile_scene
from tracer.scene.model import Scene

__all__ = ["draw_section", "section_svg"]

_WIDTH = 1200.0
_MARGIN = 40.0
_RAYS = 15


def draw_section(scene: Scene, path: str | Path) -> None:
    """Write the section through x = 0, z to the right and y upward, as an SVG file.

    Raises
    ------
    RayMapError
    """
    if Path(path).suffix.lower() != ".svg":
        raise RayMapError(f"a section drawing ends in .svg, not {Path(path).name!r}")
    check_place(Path(path))
    text = section_svg(compile_scene(scene))
    with replacing(Path(path)) as beside:
        beside.write_text(text, encoding="utf-8")


def section_svg(compilation: Compilation) -> str:
    """The drawing as SVG text."""
    lines, labels = [], []
    for number, mesh in sorted(compilation.meshes.items()):
        item = compilation.directory.objects[number]
        segments = _cut(mesh.vertices.astype(float), mesh.triangles)
        if not len(segments):
            continue
        glass = item.kind not in ("ring", "disc", "cylinder", "rectangle", "detector")
        lines.append(("glass" if glass else "metal", segments))
        ends = segments.reshape(-1, 2)
        top = ends[np.argmax(ends[:, 1])]
        labels.append((item.name, float(ends[:, 0].mean()), float(top[1])))
    rays = _rays(compilation)
    everything = np.concatenate([segments.reshape(-1, 2) for _, segments in lines] or [rays[0]])
    low, high = everything.min(axis=0), everything.max(axis=0)
    span = np.maximum(high - low, 1e-9)
    low, high = low - 0.06 * span, high + 0.06 * span
    scale = (_WIDTH - 2.0 * _MARGIN) / (high[0] - low[0])
    height = (high[1] - low[1]) * scale + 2.0 * _MARGIN

    def at(point: NDArray[np.float64]) -> str:
        x = _MARGIN + (point[0] - low[0]) * scale
        y = height - _MARGIN - (point[1] - low[1]) * scale
        return f"{x:.2f} {y:.2f}"

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH:g} {height:.0f}">',
        "<style>path{fill:none;stroke-linecap:round}.glass{stroke:#1f5fa8;stroke-width:1.6}"
        ".metal{stroke:#444;stroke-width:1.6}.ray{stroke:#d9480f;stroke-width:.6;opacity:.7}"
        "text{font:12px sans-serif;fill:#333;text-anchor:middle}</style>",
        f'<clipPath id="page"><rect width="{_WIDTH:g}" height="{height:.0f}"/></clipPath>',
        '<rect width="100%" height="100%" fill="white"/><g clip-path="url(#page)">',
    ]
    for ray in rays:
        parts.append(f'<path class="ray" d="M{" L".join(at(point) for point in ray)}"/>')
    for kind, segments in lines:
        strokes = " ".join(f"M{at(a)} L{at(b)}" for a, b in segments)
        parts.append(f'<path class="{kind}" d="{strokes}"/>')
    parts.append("</g>")
    for name, z, y in labels:
        x, _, up = at(np.array([z, y])).partition(" ")
        parts.append(f'<text x="{x}" y="{float(up) - 5:.1f}">{escape(name)}</text>')
    return "\n".join([*parts, "</svg>\n"])


def _cut(vertices: NDArray[np.float64], triangles: NDArray[np.int32]) -> NDArray[np.float64]:
    """Segments (n, 2, 2) in (z, y) in which triangles meet the plane x = 0."""
    corners = vertices[triangles]
    # A hair beside the plane, so that no edge lies in it
    side = corners[:, :, 0] - 1e-7 * (np.ptp(vertices) + 1e-12)
    segments = []
    for points, values in zip(corners, side, strict=True):
        found = [
            points[k] + (points[j] - points[k]) * values[k] / (values[k] - values[j])
            for k, j in ((0, 1), (1, 2), (2, 0))
            if (values[k] > 0.0) != (values[j] > 0.0)
        ]
        if len(found) == 2:
            segments.append([[point[2], point[1]] for point in found])
    return np.array(segments, float).reshape(-1, 2, 2)


def _rays(compilation: Compilation) -> list[NDArray[np.float64]]:
    """Some transmitted rays of the collimated sources that are on, as points (z, y)."""
    from tracer.sources.model import SourceModel
    from tracer.transport.wavefront import Wavefront

    starts, along = [], []
    for model in compilation.scene.sources.values():
        if not model.on or not isinstance(model, SourceModel) or model.kind != "collimated":
            continue
        origin, frame = model.frame()
        half = (model.diameter or (model.size or (1.0, 1.0))[1]) / 2.0
        for share in np.linspace(-0.98, 0.98, _RAYS):
            starts.append(origin + share * half * frame[:, 1])
            along.append(frame[:, 2])
    if not starts:
        return [np.zeros((0, 2))]
    engine = Wavefront(compilation.arrays, 1, meshes=compilation.solids, exact=True)
    portion = engine.trace_given(np.array(starts), np.array(along), follow=1)
    offsets = np.concatenate(([0], np.cumsum(portion.records_per_ray)))
    points = np.asarray(portion.extra["exact"], float)[:, [2, 1]]
    return [points[a:b] for a, b in itertools.pairwise(offsets)]

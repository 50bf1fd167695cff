"""What a 3D file holds: bodies, frames of detectors, and rays in named groups."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from raymap.model.events import Event
from viewer.drawn.answers import draw_rays
from viewer.drawn.bodies import Body
from viewer.drawn.colors import color_lines
from viewer.drawn.lines import Lines, build_lines
from viewer.drawn.rays import DrawnRays
from viewer.drawn.scene import load_bodies

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["Content", "Grouping", "gather"]

Grouping = Literal["source", "path", "none"]
_LONGEST = 120


@dataclass(frozen=True, kw_only=True, eq=False)
class Content:
    """Everything that is written, in scene units.

    Attributes
    ----------
    title, length_unit : of the map
    bodies : the scene, empty if it was not asked for
    frames : (name, (4, 3) corners) of flat detectors
    rays, lines, rgba : rays, their segments and the colours of these
    groups : names of the groups of rays
    group : (n_rays,) group of each ray
    """

    title: str
    length_unit: str
    bodies: list[Body]
    frames: list[tuple[str, NDArray[np.float64]]]
    rays: DrawnRays
    lines: Lines
    rgba: NDArray[np.uint8]
    groups: list[str]
    group: NDArray[np.int64]

    def polylines(self, group: int) -> list[tuple[NDArray[np.float64], tuple[int, int, int]]]:
        """Corners of each ray of a group, points that coincide left out, and its colour.

        The colour is that of the ray's first segment: a polyline has one.
        """
        found = []
        first = np.searchsorted(self.lines.ray, np.arange(self.rays.n_rays))
        for ray in np.flatnonzero(self.group == group):
            low, high = self.rays.offsets[ray], self.rays.offsets[ray + 1]
            points = self.rays.position[low:high].astype(np.float64)
            steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
            points = points[np.concatenate(([True], steps > 0))]
            if len(points) > 1:
                red, green, blue = (int(value) for value in self.rgba[first[ray], :3])
                found.append((points, (red, green, blue)))
        return found

    def segment_groups(self) -> list[tuple[str, NDArray[np.bool_]]]:
        """Name and segments of each group."""
        owner = self.group[self.lines.ray]
        return [(name, owner == k) for k, name in enumerate(self.groups)]


def gather(
    ray_map: RayMap,
    criterion: Any,
    *,
    rays: int,
    color: str,
    group: Grouping,
    tail: float | None,
    scene: bool,
) -> Content:
    """Find the rays and the scene of a map; see `viewer.export.export_3d`."""
    directory = ray_map.directory
    drawing = draw_rays(ray_map, criterion, rays)
    drawn = drawing.rays if tail is None else _shortened(drawing.rays, tail)
    lines = build_lines(drawn)
    rgba, _ = color_lines(
        drawn, lines, color, directory, opacity=1.0, dark=False, path_labels=drawing.labels
    )
    names, numbers = _groups(drawn, directory, drawing.labels, group)
    return Content(
        title=directory.title or Path(str(ray_map.path)).stem,
        length_unit=directory.length_unit,
        bodies=load_bodies(directory, ray_map.meshes) if scene else [],
        frames=_frames(directory) if scene else [],
        rays=drawn,
        lines=lines,
        rgba=rgba,
        groups=names,
        group=numbers,
    )


def _groups(
    rays: DrawnRays, directory: Any, labels: dict[int, str], group: Grouping
) -> tuple[list[str], NDArray[np.int64]]:
    if group == "none":
        return ["rays"], np.zeros(rays.n_rays, np.int64)
    if group == "source":
        different, numbers = np.unique(rays.source.astype(np.int64), return_inverse=True)
        names = [f"rays {directory.sources[k].name}" for k in different]
    else:
        # Paths that the legend does not name share a group
        known = np.isin(rays.path, list(labels))
        values = np.where(known, rays.path, np.iinfo(np.int64).max)
        different, numbers = np.unique(values, return_inverse=True)
        names = [f"path {labels.get(int(path), 'others')}"[:_LONGEST] for path in different]
    return names, numbers.reshape(-1).astype(np.int64)


def _shortened(rays: DrawnRays, tail: float) -> DrawnRays:
    """Rays that leave the scene end at most so far behind their last surface."""
    last = rays.offsets[1:] - 1
    left = last[(rays.event[last] & int(Event.LEFT_SCENE)) != 0]
    left = left[~np.isin(left, rays.offsets[:-1])]
    position = rays.position.copy()
    start = position[left - 1].astype(np.float64)
    along = position[left] - start
    length = np.linalg.norm(along, axis=1, keepdims=True)
    share = np.minimum(1.0, tail / np.maximum(length, 1e-30))
    position[left] = (start + share * along).astype(np.float32)
    return replace(rays, position=position)


def _frames(directory: Any) -> list[tuple[str, NDArray[np.float64]]]:
    frames = []
    for detector in directory.detectors:
        if detector.kind != "plane":
            continue
        u = 0.5 * detector.size[0] * np.array(detector.axis_u)
        v = 0.5 * detector.size[1] * np.array(detector.axis_v)
        corners = [a * u + b * v for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        frames.append((detector.name, np.array(detector.center) + np.array(corners)))
    return frames

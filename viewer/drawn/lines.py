"""From rays to one mesh of line segments, by offsets alone.

All rays together are one array of segments, whatever their number: no object per ray, no loop in
Python. A segment remembers the record it starts at, so that a pick leads back to its ray.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from raymap.model.events import FAMILIES
from viewer.drawn.rays import DrawnRays
from viewer.drawn.state import Clip, Section, StateError

__all__ = ["Lines", "build_lines", "cut_lines", "section_plane", "visible_records"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Lines:
    """Line segments of many rays.

    Attributes
    ----------
    segments : (n, 2, 3) float32, both ends [scene units]
    record : (n,) int64, record of the drawn rays at which the segment starts
    ray : (n,) int32, index of the drawn ray
    """

    segments: NDArray[np.float32]
    record: NDArray[np.int64]
    ray: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.record)


def visible_records(rays: DrawnRays, clip: Clip) -> NDArray[np.bool_]:
    """Records whose segment belongs to the part of the ray that `clip` leaves.

    Parameters
    ----------
    rays : the rays
    clip : bounds counted in points where one of the events happened

    Returns
    -------
    (n_records,) bool; False at the last record of each ray
    """
    shown = np.ones(rays.n_records, np.bool_)
    shown[rays.offsets[1:] - 1] = False
    if not (clip.after or clip.until):
        return shown
    if clip.event not in FAMILIES:
        raise StateError(f"clip: no event is called {clip.event!r}")

    # Count the events of each ray up to and with the record
    happened = (rays.event & int(FAMILIES[clip.event])) != 0
    running = np.concatenate(([0], np.cumsum(happened)))
    before = np.repeat(running[rays.offsets[:-1]], np.diff(rays.offsets))
    count = running[1:] - before
    if clip.after:
        shown &= count >= clip.after
    if clip.until:
        shown &= count < clip.until
    return shown


def build_lines(rays: DrawnRays, clip: Clip | None = None) -> Lines:
    """Make the mesh of the visible segments of rays.

    Parameters
    ----------
    rays : rays with their records
    clip : part of each ray that is drawn; None draws all
    """
    record = np.flatnonzero(visible_records(rays, clip or Clip()))
    segments = np.empty((len(record), 2, 3), np.float32)
    np.take(rays.position, record, axis=0, out=segments[:, 0])
    np.take(rays.position, record + 1, axis=0, out=segments[:, 1])
    owner = np.repeat(np.arange(rays.n_rays, dtype=np.int32), np.diff(rays.offsets))
    return Lines(segments=segments, record=record, ray=owner[record])


def section_plane(section: Section) -> tuple[NDArray[np.float64], float]:
    """Unit normal and offset of a section; n·p <= offset is kept.

    Raises
    ------
    StateError
        The normal is zero.
    """
    normal = np.array(section.normal, np.float64)
    length = float(np.linalg.norm(normal))
    if not length > 0:
        raise StateError("section: the normal must not be zero")
    return normal / length, section.offset


def cut_lines(lines: Lines, section: Section) -> Lines:
    """Take away what lies beyond the plane; segments that cross it end there."""
    if not (section.on and section.rays):
        return lines
    normal, offset = section_plane(section)
    side = lines.segments.astype(np.float64) @ normal - offset
    kept = np.flatnonzero((side <= 0).any(axis=1))
    segments, side = lines.segments[kept].copy(), side[kept]

    # Move the end that lies beyond onto the plane
    for end in (0, 1):
        rows = np.flatnonzero(side[:, end] > 0)
        outer, inner = side[rows, end], side[rows, 1 - end]
        share = (outer / (outer - inner))[:, None]
        near, far = segments[rows, 1 - end], segments[rows, end]
        segments[rows, end] = far + share * (near - far)
    return replace(lines, segments=segments, record=lines.record[kept], ray=lines.ray[kept])

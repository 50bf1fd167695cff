"""What a scene is made of, as named parts of plain arrays that every renderer takes.

Geometry and looks are parts of their own: bodies and rays are sent once, what changes afterwards
(colours, visibility, a section) is a few bytes each. All places are relative to the centre of the
scene, so that float32 suffices for scenes far from their origin.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.directory import Directory
from viewer.drawn.bodies import Body, outline
from viewer.drawn.lines import section_plane
from viewer.drawn.rays import DrawnRays
from viewer.drawn.scene import bodies_box, opacity_of
from viewer.drawn.state import Camera, Section, ViewState

__all__ = [
    "PARTS",
    "Part",
    "body_edges",
    "body_looks",
    "body_triangles",
    "camera_part",
    "chosen_ray",
    "cut_outline",
    "cut_plane",
    "ray_colors",
    "ray_points",
    "scene_center",
    "smooth_edges",
    "style",
]

Array = NDArray[Any]

PARTS = (
    "bodies", "edges", "outlines", "rays", "looks", "colors", "section", "cut", "chosen", "style",
    "camera",
)  # fmt: skip
"""Names of all parts, in the order in which they are sent."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """One thing that a renderer holds.

    Attributes
    ----------
    header : JSON values
    arrays : by name, C-contiguous and little-endian
    """

    header: Mapping[str, Any] = field(default_factory=dict)
    arrays: Mapping[str, Array] = field(default_factory=dict)

    @property
    def size(self) -> int:
        """Bytes of all arrays."""
        return sum(array.nbytes for array in self.arrays.values())


def scene_center(bodies: Sequence[Body], directory: Directory) -> NDArray[np.float64]:
    """The place that all others are relative to [scene units]."""
    box = bodies_box(bodies)
    if box is None:
        return np.array(directory.bounding_sphere.center, np.float64)
    return 0.5 * (box[0] + box[1])


def _near(places: Array, center: NDArray[np.float64]) -> NDArray[np.float32]:
    """Places relative to the centre; the difference is taken before it is rounded."""
    return np.ascontiguousarray(places.astype(np.float64) - center, np.float32)


def _directions(vectors: Array) -> NDArray[np.int8]:
    """Unit vectors by a byte for each component, and one to spare."""
    packed = np.zeros((*vectors.shape[:-1], 4), np.int8)
    packed[..., :3] = np.rint(np.clip(vectors, -1, 1) * 127)
    return packed


def _owners(bodies: Sequence[Body], counts: Sequence[int]) -> NDArray[np.uint16]:
    """The number of the body that each of its things belongs to."""
    return np.repeat(np.arange(len(bodies), dtype=np.uint16), counts)


def body_triangles(bodies: Sequence[Body], center: NDArray[np.float64]) -> Part:
    """Triangles of all bodies, one after the other.

    Its arrays: ``position`` (3n, 3) float32, ``normal`` (3n, 4) int8, ``body`` (3n,) uint16.
    """
    counts = [3 * len(body.corners) for body in bodies]
    firsts = np.concatenate(([0], np.cumsum(counts)))[:-1]
    boxes = [bodies_box([body]) or (center, center) for body in bodies]
    lows, highs = ([(box[end] - center).tolist() for box in boxes] for end in (0, 1))
    middles = [(0.5 * (low + high) - center).tolist() for low, high in boxes]
    box = bodies_box(bodies)
    reach = float(np.linalg.norm(box[1] - box[0]) / 2) if box is not None else 0.0
    corners = [body.corners.reshape(-1, 3) for body in bodies]
    normals = [body.normals.reshape(-1, 3) for body in bodies]
    return Part(
        header={
            "names": [body.name for body in bodies],
            "first": firsts.tolist(),
            "count": counts,
            "middle": middles,
            "low": lows,
            "high": highs,
            "reach": reach,
        },
        arrays={
            "position": _near(_stack(corners, (0, 3)), center),
            "normal": _directions(_stack(normals, (0, 3))),
            "body": _owners(bodies, counts),
        },
    )


def body_edges(bodies: Sequence[Body], center: NDArray[np.float64]) -> Part:
    """Sharp edges: ``position`` (2n, 3) float32, ``body`` (2n,) uint16."""
    counts = [2 * len(body.edges) for body in bodies]
    ends = [body.edges.reshape(-1, 3) for body in bodies]
    return Part(
        arrays={"position": _near(_stack(ends, (0, 3)), center), "body": _owners(bodies, counts)}
    )


def smooth_edges(bodies: Sequence[Body], center: NDArray[np.float64]) -> Part:
    """Edges of smooth surfaces, which show where a body turns away from the eye.

    Its arrays: ``position`` (n, 2, 3) float32, ``normal`` (n, 2, 4) int8 of the triangles on both
    sides, ``body`` (n,) uint16.
    """
    counts = [len(body.smooth_edges) for body in bodies]
    ends = [body.smooth_edges for body in bodies]
    sides = [body.smooth_normals for body in bodies]
    return Part(
        arrays={
            "position": _near(_stack(ends, (0, 2, 3)), center),
            "normal": _directions(_stack(sides, (0, 2, 3))),
            "body": _owners(bodies, counts),
        }
    )


def body_looks(bodies: Sequence[Body], state: ViewState) -> Part:
    """Colour and opacity of each body: ``rgba`` (n, 4) uint8; the hidden have none."""
    rgba = np.zeros((len(bodies), 4), np.uint8)
    for row, body in zip(rgba, bodies, strict=True):
        row[:3] = np.rint(255 * body.color)
        if body.name not in state.hidden:
            row[3] = round(255 * opacity_of(body, state))
    return Part(arrays={"rgba": rgba})


def ray_points(rays: DrawnRays, center: NDArray[np.float64]) -> Part:
    """All points of all rays: ``position`` (n_records, 3) float32, 12 bytes each.

    Segment i goes from point i to point i + 1; that between two rays has no colour.
    """
    position = _near(rays.position, center)
    reach = float(np.sqrt(np.einsum("ij,ij->i", position, position).max())) if len(position) else 0
    return Part(header={"reach": reach}, arrays={"position": position})


def ray_colors(colors: NDArray[np.uint8]) -> Part:
    """Colour of the segment that starts at each point: ``rgba`` (n_records, 4) uint8."""
    return Part(arrays={"rgba": np.ascontiguousarray(colors)})


def cut_plane(section: Section, center: NDArray[np.float64]) -> Part:
    """The section: n · p <= offset is kept."""
    if not section.on:
        return Part(header={"on": False, "rays": False, "normal": [0.0, 0.0, 1.0], "offset": 0.0})
    normal, offset = section_plane(section)
    return Part(
        header={
            "on": True,
            "rays": section.rays,
            "normal": normal.tolist(),
            "offset": float(offset - normal @ center),
        }
    )


def cut_outline(bodies: Sequence[Body], section: Section, center: NDArray[np.float64]) -> Part:
    """Where the section cuts the bodies: ``position`` (2n, 3) float32, ``body`` (2n,) uint16."""
    lines = [np.empty((0, 2, 3), np.float32) for _ in bodies]
    if section.on:
        normal, offset = section_plane(section)
        lines = [outline(body.corners, normal, offset) for body in bodies]
    flat = [part.reshape(-1, 3) for part in lines]
    return Part(
        arrays={
            "position": _near(_stack(flat, (0, 3)), center),
            "body": _owners(bodies, [len(part) for part in flat]),
        }
    )


def chosen_ray(rays: DrawnRays | None, point: int | None, center: NDArray[np.float64]) -> Part:
    """The ray of the report: ``position`` (n, 3) float32, and the index of its marked point."""
    if rays is None or rays.n_records == 0:
        return Part(header={"point": None}, arrays={"position": np.empty((0, 3), np.float32)})
    marked = point if point is not None and 0 <= point < rays.n_records else None
    return Part(header={"point": marked}, arrays={"position": _near(rays.position, center)})


def style(state: ViewState, center: NDArray[np.float64], unit: str) -> Part:
    """Ground, width of lines, whether bodies have their names, and the unit of lengths."""
    return Part(
        header={
            "dark": state.dark,
            "width": state.width,
            "names": state.names,
            "unit": unit,
            "center": center.tolist(),
        }
    )


def camera_part(camera: Camera) -> Part:
    """Where the scene is seen from, in scene units."""
    return Part(
        header={
            "position": list(camera.position),
            "focal_point": list(camera.focal_point),
            "view_up": list(camera.view_up),
            "height": camera.height,
            "parallel": camera.parallel,
        }
    )


def _stack(parts: Sequence[Array], empty: tuple[int, ...]) -> Array:
    return np.concatenate(parts) if parts else np.empty(empty, np.float32)

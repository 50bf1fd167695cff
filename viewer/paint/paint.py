"""Paint one picture: background, bodies, rays, edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from viewer.drawn.bodies import Body, cut_triangles, silhouette
from viewer.drawn.camera import eye, view_axes, view_matrix
from viewer.drawn.state import Camera
from viewer.paint.fill import OPAQUE, fill_triangles
from viewer.paint.interrupt import Cancel, pieces
from viewer.paint.raster import NEAR, draw_segments
from viewer.paint.slabs import SLABS, cut_into_slabs, drawing_order

__all__ = ["Layer", "finish", "paint_bodies", "paint_edges", "paint_rays"]

Image = NDArray[np.float32]

SEGMENTS_AT_ONCE = 16_384
"""Between two looks whether the picture is still wanted: some 20 ms."""

BACKGROUND = {
    True: ((0.075, 0.090, 0.115), (0.035, 0.043, 0.058)),
    False: ((1.0, 1.0, 1.0), (0.93, 0.945, 0.96)),
}
"""Upper and lower colour of the background, by darkness."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Layer:
    """A picture in the making.

    Attributes
    ----------
    image : (height, width, 4) float32, premultiplied
    depth : (height, width) float32 of opaque bodies
    matrix : (4, 4), world to pixels
    """

    image: Image
    depth: Image
    matrix: NDArray[np.float64]

    def copy(self) -> Layer:
        return Layer(image=self.image.copy(), depth=self.depth, matrix=self.matrix)


def _reach(bodies: Sequence[Body]) -> float:
    return float(max((np.abs(body.corners).max() for body in bodies if len(body.corners)),
                     default=1.0)) or 1.0  # fmt: skip


def paint_bodies(
    bodies: Sequence[Body],
    camera: Camera,
    width: int,
    height: int,
    *,
    dark: bool,
    cancel: Cancel | None = None,
) -> Layer:
    """Background and shaded bodies.

    Parameters
    ----------
    bodies : as they are to be seen
    width, height : [pixels]
    cancel : gives the picture up

    Raises
    ------
    Interrupted
    """
    top, bottom = (np.array(color, np.float32) for color in BACKGROUND[dark])
    share = np.linspace(0, 1, height, dtype=np.float32)[:, None, None]
    image = np.ones((height, width, 4), np.float32)
    image[:, :, :3] = top + (bottom - top) * share
    depth = np.full((height, width), np.inf, np.float32)
    matrix = view_matrix(camera, width, height, _reach(bodies))
    right, up, forward = view_axes(camera)
    bounds = _slabs(bodies, forward)
    corners, normals, colors, owners = _gather(bodies, matrix, forward, bounds)
    if len(corners):
        flat = corners.reshape(-1, 3) @ matrix[:, :3].T + matrix[:, 3]
        flat[:, :3] /= flat[:, 3:]
        frame = np.stack([right, -up, forward]).astype(np.float32)
        fill_triangles(
            np.ascontiguousarray(flat[:, :3].reshape(-1, 3, 3)),
            np.ascontiguousarray(normals @ frame.T),
            colors,
            depth=depth,
            image=image,
            order=drawing_order(corners.mean(axis=1) @ forward, owners, bounds),
            cancel=cancel,
        )
    # Rays that lie in an opaque surface are not hidden by it
    return Layer(image=image, depth=depth + np.float32(1e-4), matrix=matrix)


def _slabs(bodies: Sequence[Body], forward: NDArray[np.float64]) -> NDArray[np.float64]:
    """Depths between slabs, from the nearest corner of all bodies to the farthest."""
    depths = [body.corners.astype(np.float64) @ forward for body in bodies if len(body.corners)]
    low = min((float(depth.min()) for depth in depths), default=0.0)
    high = max((float(depth.max()) for depth in depths), default=1.0)
    return np.linspace(low, max(high, low + 1e-9), SLABS + 1)


def _gather(
    bodies: Sequence[Body],
    matrix: NDArray[np.float64],
    forward: NDArray[np.float64],
    bounds: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]:
    """All triangles in front of the camera, with normals, colours and numbers of bodies."""
    parts = []
    for number, body in enumerate(bodies):
        corners, normals = body.corners, body.normals
        behind = 2 * NEAR - (corners.astype(np.float64) @ matrix[3, :3] + matrix[3, 3])
        if (behind > 0).any():
            corners, normals, _ = cut_triangles(corners, normals, behind)
        if 0.0 < body.opacity <= OPAQUE:
            corners, normals = cut_into_slabs(corners, normals, forward, bounds)
        color = np.append(body.color, body.opacity).astype(np.float32)
        owner = np.full(len(corners), number, np.int64)
        color = np.tile(color, (len(corners), 1))
        parts.append((corners.astype(np.float64), normals, color, owner))
    if not parts:
        empty = np.empty((0, 3, 3), np.float32)
        nobody = np.empty(0, np.int64)
        return empty.astype(np.float64), empty, np.empty((0, 4), np.float32), nobody
    joined = [np.concatenate(column) for column in zip(*parts, strict=True)]
    return joined[0], joined[1], joined[2], joined[3]


def paint_rays(
    layer: Layer,
    segments: NDArray[np.float32],
    rgba: NDArray[np.uint8],
    *,
    width: float,
    cancel: Cancel | None = None,
) -> None:
    """Rays over the bodies, hidden by opaque ones.

    Raises
    ------
    Interrupted
        ``cancel`` gives the picture up.
    """
    for part in pieces(len(segments), SEGMENTS_AT_ONCE, cancel):
        draw_segments(
            segments[part], rgba[part], layer.matrix,
            width=width, depth=layer.depth, image=layer.image,
        )  # fmt: skip


def paint_edges(layer: Layer, bodies: Sequence[Body], camera: Camera, *, dark: bool) -> None:
    """Sharp edges, cuts and silhouettes of the bodies as thin lines."""
    forward = view_axes(camera)[2]
    parts, tones = [], []
    for body in bodies:
        sides = silhouette(body, eye(camera), forward, camera.parallel)
        for edges, strength in ((body.edges, 0.55), (sides, 0.8)):
            tone = body.color * 0.75 + 0.25 if dark else body.color * 0.35
            alpha = strength * min(1.0, 0.35 + body.opacity)
            parts.append(edges)
            tones.append(np.tile(np.append(tone, alpha), (len(edges), 1)))
    if not parts:
        return
    rgba = np.rint(np.concatenate(tones) * 255).astype(np.uint8)
    draw_segments(
        np.ascontiguousarray(np.concatenate(parts), np.float32), rgba, layer.matrix,
        width=1.0, depth=layer.depth, image=layer.image,
    )  # fmt: skip


def finish(layer: Layer, supersampling: int = 1) -> NDArray[np.uint8]:
    """The picture as (height, width, 3) uint8; averages ``supersampling``² pixels into one."""
    color = layer.image[:, :, :3]
    if supersampling > 1:
        height, width = (side // supersampling for side in color.shape[:2])
        blocks = color[: height * supersampling, : width * supersampling]
        blocks = blocks.reshape(height, supersampling, width, supersampling, 3)
        color = blocks.mean(axis=(1, 3))
    return np.rint(np.clip(color, 0, 1) * 255).astype(np.uint8)

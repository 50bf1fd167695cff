"""The camera as plain arithmetic: fit, standard views, orbit, pan, zoom, matrices.

Frames: right-handed scene coordinates; the picture has x to the right and y upward; pixels count
from the upper left corner.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from viewer.drawn.state import Camera, Upward

__all__ = [
    "STANDARD_VIEWS",
    "UPWARD",
    "VIEW_ANGLE",
    "eye",
    "fit",
    "orbit",
    "pan",
    "screen_ray",
    "standard_view",
    "view_axes",
    "view_matrix",
    "zoom",
]

Array = NDArray[np.float64]
Box = tuple[Array, Array]

VIEW_ANGLE = 30.0
"""Vertical field of a perspective camera [degrees]."""

STANDARD_VIEWS: dict[str, tuple[tuple[float, float, float], tuple[float, float, float]]] = {
    "side": ((1, 0, 0), (0, 1, 0)),
    "top": ((0, -1, 0), (1, 0, 0)),
    "front": ((0, 0, 1), (0, 1, 0)),
    "back": ((0, 0, -1), (0, 1, 0)),
    "tilted": ((0.80, -0.35, 0.49), (0, 1, 0)),
}
"""Viewing direction and upward direction by name; "side" has z to the right and y upward."""

UPWARD: dict[Upward, int] = {"y": 0, "z": 1, "x": 2}
"""Axes that may point upward, and by how many places they turn the standard views: with z upward
x lies where z does with y upward, so that "side" has x to the right and "top" has x and y."""


def view_axes(camera: Camera) -> tuple[Array, Array, Array]:
    """Unit vectors right, up, forward."""
    forward = np.subtract(camera.focal_point, camera.position, dtype=np.float64)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, camera.view_up)
    right /= np.linalg.norm(right)
    return right, np.cross(right, forward), forward


def _vector(values: Array) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])


def _distance(height: float) -> float:
    """How far a perspective camera stands to see ``height``."""
    return 0.5 * height / math.tan(math.radians(0.5 * VIEW_ANGLE))


def eye(camera: Camera) -> Array:
    """Where a perspective camera stands to see its height; its own place may say otherwise."""
    return np.asarray(camera.focal_point) - _distance(camera.height) * view_axes(camera)[2]


def _place(center: Array, forward: Array, up: Array, height: float, parallel: bool) -> Camera:
    return Camera(
        position=_vector(center - forward * _distance(height)),
        focal_point=_vector(center),
        view_up=_vector(up),
        height=float(height),
        parallel=parallel,
    )


def standard_view(
    name: str,
    box: Box,
    *,
    aspect: float,
    parallel: bool = True,
    margin: float = 1.08,
    up: Upward = "y",
) -> Camera:
    """See the whole of ``box`` (two corners) from a side.

    Parameters
    ----------
    name : a key of `STANDARD_VIEWS`
    aspect : width / height of the picture
    up : the axis that points upward, a key of `UPWARD`
    """
    direction, upward = (np.roll(vector, UPWARD[up]) for vector in STANDARD_VIEWS[name])
    center = 0.5 * (box[0] + box[1])
    camera = _place(center, direction / np.linalg.norm(direction), upward, 1.0, parallel)
    return fit(camera, box, aspect=aspect, margin=margin)


def fit(camera: Camera, box: Box, *, aspect: float, margin: float = 1.08) -> Camera:
    """Keep the direction, show the whole of ``box``."""
    center = 0.5 * (box[0] + box[1])
    right, up, forward = view_axes(camera)
    half = np.maximum(0.5 * (box[1] - box[0]), 1e-9)

    # Corners of the box in the frame of the picture
    signs = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T
    corners = (signs * half) @ np.stack([right, up, forward]).T
    reach = np.maximum(np.abs(corners[:, 0]) / aspect, np.abs(corners[:, 1]))
    if camera.parallel:
        needed = 2 * margin * float(reach.max())
    else:
        slope = math.tan(math.radians(0.5 * VIEW_ANGLE))
        needed = 2 * slope * float((margin * reach / slope - corners[:, 2]).max())
    return _place(center, forward, np.asarray(camera.view_up), needed, camera.parallel)


def orbit(camera: Camera, right_px: float, down_px: float, picture_height: float) -> Camera:
    """Turn around the focal point as a trackball; the picture's height is half a turn."""
    right, up, forward = view_axes(camera)
    yaw, pitch = (math.pi * pixels / picture_height for pixels in (-right_px, -down_px))
    turn = _rotation(right, pitch) @ _rotation(up, yaw)
    distance = float(np.linalg.norm(np.subtract(camera.focal_point, camera.position)))
    position = np.asarray(camera.focal_point) - distance * (turn @ forward)
    return dataclasses.replace(camera, position=_vector(position), view_up=_vector(turn @ up))


def _rotation(axis: Array, angle: float) -> Array:
    """Rotation matrix around a unit vector (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn: Array = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    return turn


def pan(camera: Camera, right_px: float, down_px: float, picture_height: float) -> Camera:
    """Move the picture's content by pixels."""
    right, up, _ = view_axes(camera)
    shift = (down_px * up - right_px * right) * camera.height / picture_height
    return dataclasses.replace(
        camera,
        position=_vector(np.asarray(camera.position) + shift),
        focal_point=_vector(np.asarray(camera.focal_point) + shift),
    )


def zoom(
    camera: Camera, factor: float, x_px: float, y_px: float, width: float, height: float
) -> Camera:
    """Enlarge by ``factor``; the point of the focal plane under the pixel stays where it is."""
    new_height = float(np.clip(camera.height / factor, 1e-9, 1e12))
    factor = camera.height / new_height
    right, up, forward = view_axes(camera)
    offset = (x_px - 0.5 * width) * right - (y_px - 0.5 * height) * up
    focal = np.asarray(camera.focal_point) + offset * camera.height / height * (1 - 1 / factor)
    return _place(focal, forward, np.asarray(camera.view_up), new_height, camera.parallel)


def view_matrix(camera: Camera, width: int, height: int, reach: float) -> Array:
    """World to pixels, homogeneous: (x w, y w, depth, w) with depth growing from the camera.

    ``reach`` is the radius of the scene around the focal point; the depth of a point is its
    distance along the viewing direction from the focal plane in units of it.
    """
    right, up, forward = view_axes(camera)
    focal = np.asarray(camera.focal_point)
    scale = height / camera.height
    rows = np.zeros((4, 4))
    rows[0, :3], rows[0, 3] = scale * right, -scale * right @ focal
    rows[1, :3], rows[1, 3] = -scale * up, scale * up @ focal
    rows[2, :3], rows[2, 3] = forward / reach, -(forward @ focal) / reach
    rows[3, 3] = 1.0
    if not camera.parallel:
        distance = _distance(camera.height)
        rows[3, :3], rows[3, 3] = forward / distance, 1 - (forward @ focal) / distance
    rows[0] += 0.5 * width * rows[3]
    rows[1] += 0.5 * height * rows[3]
    return rows


def screen_ray(
    camera: Camera, x_px: float, y_px: float, width: float, height: float
) -> tuple[Array, Array]:
    """Origin and unit direction of the line of sight through a pixel."""
    right, up, forward = view_axes(camera)
    offset = ((x_px - 0.5 * width) * right - (y_px - 0.5 * height) * up) * camera.height / height
    target = np.asarray(camera.focal_point) + offset
    if camera.parallel:
        return target - _distance(camera.height) * forward, forward
    direction = target - eye(camera)
    return eye(camera), direction / np.linalg.norm(direction)

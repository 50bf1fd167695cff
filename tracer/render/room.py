"""The room around the crystals: a box of six one-sided walls that emit natural light inward."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.jit.kernels import inner_kernel
from raymap.model.errors import SceneError

__all__ = ["WALLS", "Room", "RoomArrays", "checker_board", "uniform", "wall_radiance"]

Real = NDArray[np.float64]
Array = np.ndarray[Any, np.dtype[Any]]

WALLS = ("x-", "x+", "y-", "y+", "z-", "z+")
"""Names of the walls; z- is the floor."""


class RoomArrays(NamedTuple):
    """Bounds (2, 3) [mm], texels (n, 3) linear RGB, (6, 3) first texel, width, height of walls."""

    bounds: Array
    texels: Array
    layout: Array


@dataclass(frozen=True, kw_only=True)
class Room:
    """A box whose walls are transparent from outside and emit equally in all directions inside.

    Attributes
    ----------
    low, high : (3,) corners [mm]
    walls : wall name -> (h, w, 3) linear sRGB texture; row 0 at the side of the larger second
        coordinate (y on the floor, z on upright walls); missing walls are black
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    walls: Mapping[str, Real]

    def compile(self) -> RoomArrays:
        """Arrays for the compiled renderer."""
        bounds = np.array([self.low, self.high], np.float64)
        if not np.all(bounds[1] > bounds[0]):
            raise SceneError("room: high must exceed low along every axis")
        for name in self.walls:
            if name not in WALLS:
                raise SceneError(f"room: wall {name!r} does not exist; walls: {', '.join(WALLS)}")
        texels: list[Real] = []
        layout = np.zeros((6, 3), np.int64)
        first = 0
        for number, name in enumerate(WALLS):
            texture = np.asarray(self.walls.get(name, np.zeros((1, 1, 3))), np.float64)
            if texture.ndim != 3 or texture.shape[2] != 3 or not np.all(texture >= 0.0):
                raise SceneError(f"room: wall {name!r} needs a texture (h, w, 3) of values >= 0")
            layout[number] = first, texture.shape[1], texture.shape[0]
            texels.append(texture.reshape(-1, 3))
            first += len(texels[-1])
        return RoomArrays(bounds=bounds, texels=np.concatenate(texels), layout=layout)


def uniform(rgb: ArrayLike) -> Real:
    """A wall of one colour, linear sRGB."""
    return np.asarray(rgb, np.float64).reshape(1, 1, 3)


def checker_board(
    colours: ArrayLike,
    *,
    squares: int,
    border_squares: int,
    border: ArrayLike,
    square_mm: float,
    size_mm: tuple[float, float],
    texels_per_mm: float = 8.0,
) -> Real:
    """A board of coloured squares in a border, centred on a black wall.

    Parameters
    ----------
    colours : (n, 3) linear sRGB, dealt to the squares in turn, shifted from row to row
    squares : on each side of the board
    border_squares : width of the border in squares
    size_mm : of the wall
    """
    palette = np.asarray(colours, np.float64).reshape(-1, 3)
    width, height = (round(side * texels_per_mm) for side in size_mm)
    x = ((np.arange(width) + 0.5) / texels_per_mm - size_mm[0] / 2) / square_mm + squares / 2
    y = (size_mm[1] / 2 - (np.arange(height) + 0.5) / texels_per_mm) / square_mm + squares / 2
    column, row = np.meshgrid(np.floor(x).astype(int), np.floor(y).astype(int))
    board = (column >= 0) & (column < squares) & (row >= 0) & (row < squares)
    framed = (
        (column >= -border_squares)
        & (column < squares + border_squares)
        & (row >= -border_squares)
        & (row < squares + border_squares)
    )
    texture = np.zeros((height, width, 3))
    texture[framed] = np.asarray(border, np.float64)
    number = (column + row * (squares // 2 + 1)) % len(palette)
    texture[board] = palette[number[board]]
    return texture


@inner_kernel
def wall_radiance(
    room: RoomArrays,
    px: float,
    py: float,
    pz: float,
    dx: float,
    dy: float,
    dz: float,
) -> int:
    """Texel that a ray sees from inside the room (or entering it from outside); -1 for none."""
    near = 0.0
    far = np.inf
    wall = -1
    p = (px, py, pz)
    d = (dx, dy, dz)
    for axis in range(3):
        if d[axis] == 0.0:
            if p[axis] < room.bounds[0, axis] or p[axis] > room.bounds[1, axis]:
                return -1
            continue
        t1 = (room.bounds[0, axis] - p[axis]) / d[axis]
        t2 = (room.bounds[1, axis] - p[axis]) / d[axis]
        if d[axis] > 0.0:
            near = max(near, t1)
            if t2 < far:
                far = t2
                wall = 2 * axis + 1
        else:
            near = max(near, t2)
            if t1 < far:
                far = t1
                wall = 2 * axis
    if wall < 0 or near > far:
        return -1
    axis = wall // 2
    a = 1 if axis == 0 else 0
    b = 1 if axis == 2 else 2
    u = (p[a] + far * d[a] - room.bounds[0, a]) / (room.bounds[1, a] - room.bounds[0, a])
    v = (room.bounds[1, b] - p[b] - far * d[b]) / (room.bounds[1, b] - room.bounds[0, b])
    width = room.layout[wall, 1]
    height = room.layout[wall, 2]
    column = min(max(int(u * width), 0), width - 1)
    row = min(max(int(v * height), 0), height - 1)
    texel: int = room.layout[wall, 0] + row * width + column
    return texel

"""Shapes of other distributions: faces that the engine meets by functions called by address.

The built-in shapes are parts of the loops that search for hits; these are compiled alone, so that a
new one makes nothing else compile again.
"""

from __future__ import annotations

import zlib
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from raymap.jit.compiling import Task, address_of
from raymap.jit.types import F64, I64
from raymap.model.directory import Quadric
from raymap.model.errors import SceneError
from raymap.model.registry import Registry
from tracer.geometry.doors import HIT, NORMAL
from tracer.geometry.kinds import FIRST_OTHER, HIT_ADDRESS, NORMAL_ADDRESS, ROW
from tracer.geometry.shapes import SEGMENTS, Bounds, Mesh, padded

__all__ = ["SHAPES", "OtherShape", "check_shape", "link_shapes", "shape_tasks"]

Array = NDArray[np.float64]


class OtherShape(ABC):
    """A face of a kind of its own; its functions work in a frame of the shape.

    Parameters
    ----------
    origin : (3,) of the frame
    frame : (3, 3) whose columns are its axes (as of `tracer.description.fields.Placed.frame`)

    Attributes
    ----------
    word : by which it registers under ``tracer.shapes``
    hit, normal : compiled functions (see `tracer.geometry.doors`)
    """

    word: ClassVar[str]
    hit: ClassVar[Any]
    normal: ClassVar[Any]

    def __init__(self, origin: Array, frame: Array) -> None:
        self.origin = np.asarray(origin, np.float64)
        self.frame = np.asarray(frame, np.float64)

    @abstractmethod
    def own(self) -> Sequence[float]:
        """The numbers that its functions are handed, as many as it takes."""

    @abstractmethod
    def box(self) -> tuple[Sequence[float], Sequence[float]]:
        """Corners of a box in its frame that surely holds the face."""

    @abstractmethod
    def drawn(self, segments: int) -> Mesh:
        """Vertices (n, 3) in its frame and triangles (m, 3) to draw, wound about its normals.

        ``segments`` is the number of corners that a circle is drawn with.
        """

    @property
    def kind(self) -> int:
        """Its number, which does not depend on what else is installed."""
        return _number(self.word)

    def row(self) -> Array:
        """Parameter row, without its place in the pool and the addresses."""
        s = np.zeros(ROW)
        s[0:3], s[3:6], s[6:9] = self.origin, self.frame[:, 0], self.frame[:, 1]
        return s

    def bounds(self) -> Bounds:
        """Box that surely holds the face in the scene."""
        low, high = (np.asarray(corner, float) for corner in self.box())
        center = self.origin + self.frame @ (0.5 * (low + high))
        reach = np.abs(self.frame) @ (0.5 * (high - low))
        return padded(center - reach, center + reach)

    def quadric(self) -> Quadric | None:
        """None: maps store its normals as they are."""
        return None

    def mesh(self, segments: int = SEGMENTS) -> Mesh:
        """Vertices (n, 3) and triangles (m, 3) to draw in the scene."""
        vertices, triangles = self.drawn(segments)
        placed = self.origin + np.asarray(vertices, float) @ self.frame.T
        return placed, np.asarray(triangles, np.int32)


SHAPES: Registry[type[OtherShape]] = Registry(
    "tracer.shapes",
    "",
    words=lambda kind: (kind.word,),
    of=OtherShape,
    sort="shapes of faces beside planes, spheres, cones, conics and aspheres",
)


def check_shape(shape: OtherShape, where: str) -> None:
    """Refuse a shape whose functions do not fit together: rays are sent to where it is drawn.

    Raises
    ------
    SceneError
        naming the ray and what is wrong
    """
    own = np.asarray(shape.own(), np.float64)
    low, high = (np.asarray(corner, float) for corner in shape.box())
    vertices, triangles = shape.drawn(12)
    corners = np.asarray(vertices, float)[np.asarray(triangles)]
    margin = 1e-6 * (1.0 + float(np.linalg.norm(high - low)))
    # Compiled, as rays ask them: divided by 0 is no error there
    hit, normal = type(shape).hit, type(shape).normal
    met = 0
    for a, b, c in corners[:: max(1, len(corners) // 32)]:
        across = np.cross(b - a, c - a)
        length = float(np.linalg.norm(across))
        if length == 0.0:
            continue
        d = -across / length
        start = (a + b + c) / 3.0 - d * (1.0 + float(np.linalg.norm(high - low)))
        t = float(hit(own, *start.tolist(), *d.tolist(), False))
        if not t > 0.0:
            continue
        met += 1
        point = start + t * d
        said = f"{where}: its ray from {_shown(start)} along {_shown(d)} meets {_shown(point)}, "
        if not (np.all(point >= low - margin) and np.all(point <= high + margin)):
            raise SceneError(f"{said}outside its box")
        n = np.array(normal(own, *point.tolist()), float)
        if not abs(float(n @ n) - 1.0) < 1e-6:
            raise SceneError(f"{said}where its normal is {_shown(n)}, no unit vector")
    if not met:
        raise SceneError(f"{where}: no ray meets it where it is drawn; its functions do not fit")


def _shown(vector: Array) -> str:
    return f"({', '.join(f'{value:g}' for value in vector)})"


def shape_tasks(kinds: I64) -> list[Task]:
    """What is to be compiled for the kinds of a scene's faces that are called by address."""
    return [task for _, _, task in _links(kinds)]


def link_shapes(kinds: I64, face_f: F64) -> None:
    """Fill the addresses of functions into the rows of faces of these kinds."""
    for number, column, task in _links(kinds):
        # An address has 48 bits and is exact as a float64
        face_f[kinds == number, column] = float(address_of(task))


def _number(word: str) -> int:
    return FIRST_OTHER + zlib.crc32(word.encode())


def _links(kinds: I64) -> Iterator[tuple[int, int, Task]]:
    if len(kinds) == 0 or int(kinds.max()) < FIRST_OTHER:
        return
    present = {number for number in np.unique(kinds).tolist() if number >= FIRST_OTHER}
    if not present <= {_number(word) for word in SHAPES}:
        raise SceneError(
            "the scene has faces of a shape that is not installed here; install the distribution "
            f"that adds it (there are {', '.join(SHAPES) or 'none'})"
        )
    # Only what the scene has is imported
    for word in SHAPES:
        if _number(word) in present:
            kind = SHAPES[word]
            yield _number(word), HIT_ADDRESS, HIT.task(kind.hit)
            yield _number(word), NORMAL_ADDRESS, NORMAL.task(kind.normal)

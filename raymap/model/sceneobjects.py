"""The bodies of a scene: objects, their faces, the shapes of these; one by one or as columns.

A scene may have ten thousand bodies, and opening its map must not cost ten thousand Python objects:
`SceneObjects` is a sequence over `ObjectColumns` that makes an object when it is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Literal, TypeVar, overload

import numpy as np
from numpy.typing import NDArray
from pydantic import FailFast, Field, model_validator

from raymap.model.entry import Entry, Name, Parameters, PlainText
from raymap.model.limits import MAX_INDEX, MAX_PRIMITIVES
from raymap.model.schema import NONE

__all__ = [
    "NO_QUADRIC",
    "Face",
    "Further",
    "ObjectColumns",
    "Quadric",
    "SceneObject",
    "SceneObjects",
]

_E = TypeVar("_E", bound=Entry)

NO_QUADRIC = -2
"""In `ObjectColumns.axis`: the primitive has no quadric."""


class Further:
    """Further keys of some rows; those of a file are parsed when they are first asked for."""

    def __init__(self, given: dict[int, dict[str, Any]] | Callable[[], dict[int, dict[str, Any]]]):
        self._given = given

    @cached_property
    def rows(self) -> dict[int, dict[str, Any]]:
        """The keys by row."""
        return self._given if isinstance(self._given, dict) else self._given()

    def of(self, row: int) -> dict[str, Any]:
        """The keys of one row."""
        return self.rows.get(row, {})

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Further) and self.rows == other.rows

    __hash__ = None  # type: ignore[assignment]  # parameters are dictionaries


class Quadric(Entry):
    """Implicit shape of one primitive: F(x, y, z) = 0 with the gradient pointing outward.

    Attributes
    ----------
    coefficients : c₀ … c₉ of F = c₀ x² + c₁ y² + c₂ z² + c₃ x y + c₄ x z + c₅ y z + c₆ x + c₇ y +
        c₈ z + c₉
    solve_axis : coordinate (0, 1, 2) that the encoding may rebuild from the other two; None if that
        is never worthwhile
    """

    coefficients: tuple[float, float, float, float, float, float, float, float, float, float]
    solve_axis: Literal[0, 1, 2] | None = None


class Face(Entry):
    """A named part of the boundary of an object: a run of its primitives.

    ``aliases`` are full names ("L3.front") by which criteria may also call the face: the shared
    interface of a cemented pair is one face of one object with the other element's name as alias.
    ``quadrics`` is empty or has one entry (or None) per primitive.
    """

    name: Name
    first_primitive: Annotated[int, Field(ge=0, le=MAX_PRIMITIVES)] = 0
    primitive_count: Annotated[int, Field(ge=1, le=MAX_PRIMITIVES)] = 1
    surface: Annotated[int, Field(ge=NONE, le=MAX_INDEX)] = NONE
    aliases: Annotated[tuple[str, ...], FailFast()] = ()
    quadrics: Annotated[tuple[Quadric | None, ...], FailFast()] = ()
    parameters: Parameters = Field(default_factory=dict)

    @model_validator(mode="after")
    def _check(self) -> Face:
        if self.quadrics and len(self.quadrics) != self.primitive_count:
            raise ValueError(
                f"face {self.name!r} has {self.primitive_count} primitives "
                f"but {len(self.quadrics)} quadrics"
            )
        return self


class SceneObject(Entry):
    """A body of the scene; its faces cover its primitives in order, without gaps."""

    name: Name
    kind: PlainText = ""
    faces: Annotated[tuple[Face, ...], FailFast()] = ()
    parameters: Parameters = Field(default_factory=dict)

    @model_validator(mode="after")
    def _check(self) -> SceneObject:
        expected = 0
        for face in self.faces:
            if face.first_primitive != expected:
                raise ValueError(
                    f"face {self.name}.{face.name} starts at primitive {face.first_primitive}, "
                    f"expected {expected}: faces cover the primitives in order"
                )
            expected += face.primitive_count
        if expected > MAX_PRIMITIVES:
            raise ValueError(
                f"object {self.name!r} has {expected} primitives; at most {MAX_PRIMITIVES} can be "
                "numbered: split it into several objects"
            )
        if len({face.name for face in self.faces}) != len(self.faces):
            raise ValueError(f"object {self.name!r} has two faces of one name")
        return self


@dataclass(frozen=True, kw_only=True, eq=False)
class ObjectColumns:
    """All objects of a scene as columns.

    Attributes
    ----------
    names : of the objects
    first_face : (n_objects + 1,) int32, faces of object o are rows first_face[o]:first_face[o + 1]
    face_names : of the faces, within their objects
    first_primitive, primitive_count : (n_faces,) int32
    surface : (n_faces,) int16
    first_shape : (n_faces + 1,) int64, rows of ``axis`` of each face; none of a face of no quadrics
    axis : (n_shapes,) int8, coordinate to solve for, -1 never, NO_QUADRIC the primitive has none
    coefficients : (n_quadrics, 10) float64, of the rows of ``axis`` that have a quadric
    of_objects, of_faces, of_shapes : further keys by row
    """

    names: tuple[str, ...]
    first_face: NDArray[np.int32]
    face_names: tuple[str, ...]
    first_primitive: NDArray[np.int32]
    primitive_count: NDArray[np.int32]
    surface: NDArray[np.int16]
    first_shape: NDArray[np.int64]
    axis: NDArray[np.int8]
    coefficients: NDArray[np.float64]
    of_objects: Further
    of_faces: Further
    of_shapes: Further

    @cached_property
    def quadric_row(self) -> NDArray[np.int64]:
        """(n_shapes,) row of ``coefficients``, -1 none."""
        there = self.axis != NO_QUADRIC
        return np.where(there, np.cumsum(there) - 1, -1)

    def parse_further(self) -> None:
        """Parse the further keys of all rows; those of a file may turn out not to be sound.

        Raises
        ------
        FormatError
        """
        for further in (self.of_objects, self.of_faces, self.of_shapes):
            further.rows  # noqa: B018

    @cached_property
    def _lists(self) -> dict[str, list[int]]:
        """Columns as lists, of which one number is taken faster."""
        return {
            name: getattr(self, name).tolist()
            for name in (
                "first_face", "first_primitive", "primitive_count", "surface", "first_shape",
                "axis", "quadric_row",
            )
        }  # fmt: skip

    @staticmethod
    def of(objects: Sequence[SceneObject]) -> ObjectColumns:
        """The columns of objects."""
        faces = [face for item in objects for face in item.faces]
        shapes = [quadric for face in faces for quadric in face.quadrics]
        axes = [
            NO_QUADRIC if q is None else NONE if q.solve_axis is None else q.solve_axis
            for q in shapes
        ]
        rows = [quadric.coefficients for quadric in shapes if quadric is not None]
        return ObjectColumns(
            names=tuple(item.name for item in objects),
            first_face=_starts([len(item.faces) for item in objects]).astype(np.int32),
            face_names=tuple(face.name for face in faces),
            first_primitive=np.array([face.first_primitive for face in faces], np.int32),
            primitive_count=np.array([face.primitive_count for face in faces], np.int32),
            surface=np.array([face.surface for face in faces], np.int16),
            first_shape=_starts([len(face.quadrics) for face in faces]),
            axis=np.array(axes, np.int8),
            coefficients=np.array(rows, np.float64).reshape(-1, 10),
            of_objects=_further(objects, ("kind", "parameters")),
            of_faces=_further(faces, ("aliases", "parameters")),
            of_shapes=_further(shapes, ()),
        )

    def equals(self, other: ObjectColumns) -> bool:
        """Whether the objects are the same ones."""
        return all(
            np.array_equal(mine, theirs) if isinstance(mine, np.ndarray) else mine == theirs
            for mine, theirs in zip(vars(self).values(), vars(other).values(), strict=False)
        )

    def make(self, number: int) -> SceneObject:
        """One object; the columns were checked, so that its values need not be."""
        first, end = self._lists["first_face"][number : number + 2]
        further = self.of_objects.of(number)
        values = {
            "name": self.names[number],
            "kind": further.get("kind", ""),
            "faces": tuple([self._face(row) for row in range(first, end)]),
            "parameters": further.get("parameters", {}),
        }
        return _made(SceneObject, values, further)

    def _face(self, row: int) -> Face:
        columns = self._lists
        first, end = columns["first_shape"][row : row + 2]
        further = self.of_faces.of(row)
        values = {
            "name": self.face_names[row],
            "first_primitive": columns["first_primitive"][row],
            "primitive_count": columns["primitive_count"][row],
            "surface": columns["surface"][row],
            "aliases": tuple(further.get("aliases", ())),
            "quadrics": tuple([self._quadric(shape) for shape in range(first, end)]),
            "parameters": further.get("parameters", {}),
        }
        return _made(Face, values, further)

    def _quadric(self, shape: int) -> Quadric | None:
        axis = self._lists["axis"][shape]
        if axis == NO_QUADRIC:
            return None
        values = {
            "coefficients": tuple(self.coefficients[self._lists["quadric_row"][shape]].tolist()),
            "solve_axis": None if axis == NONE else axis,
        }
        return _made(Quadric, values, self.of_shapes.of(shape))


_FIELDS: dict[type[Entry], set[str]] = {
    kind: set(kind.model_fields) for kind in (Quadric, Face, SceneObject)
}


def _made(kind: type[_E], values: dict[str, Any], further: dict[str, Any]) -> _E:
    """An entry of sound values, without the cost of checking them."""
    entry = kind.__new__(kind)
    extra = {key: value for key, value in further.items() if key not in values}
    object.__setattr__(entry, "__dict__", values)
    object.__setattr__(entry, "__pydantic_extra__", extra)
    object.__setattr__(entry, "__pydantic_fields_set__", _FIELDS[kind])
    object.__setattr__(entry, "__pydantic_private__", None)
    return entry


class SceneObjects(Sequence[SceneObject]):
    """The objects of a scene; made from columns, each comes into being when it is asked for."""

    def __init__(self, given: Iterable[SceneObject] | ObjectColumns) -> None:
        if isinstance(given, ObjectColumns):
            self.__dict__["columns"] = given
            self._made: list[SceneObject | None] = [None] * len(given.names)
        else:
            self._made = list(given)

    @staticmethod
    def of(objects: Sequence[SceneObject]) -> SceneObjects:
        """Objects as such a sequence."""
        return objects if isinstance(objects, SceneObjects) else SceneObjects(objects)

    @cached_property
    def columns(self) -> ObjectColumns:
        """All objects as columns."""
        return ObjectColumns.of([item for item in self._made if item is not None])

    def __len__(self) -> int:
        return len(self._made)

    @overload
    def __getitem__(self, index: int) -> SceneObject: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[SceneObject]: ...
    def __getitem__(self, index: int | slice) -> SceneObject | Sequence[SceneObject]:
        if isinstance(index, slice):
            return tuple(self[k] for k in range(*index.indices(len(self))))
        item = self._made[index]
        if item is None:
            item = self._made[index] = self.columns.make(index % len(self))
        return item

    def __eq__(self, other: object) -> bool:
        if isinstance(other, SceneObjects):
            return len(self) == len(other) and self.columns.equals(other.columns)
        return isinstance(other, Sequence) and tuple(self) == tuple(other)

    __hash__ = None  # type: ignore[assignment]  # parameters are dictionaries

    def __repr__(self) -> str:
        return f"<{len(self)} objects>"


def _starts(counts: list[int]) -> NDArray[np.int64]:
    starts = np.zeros(len(counts) + 1, np.int64)
    np.cumsum(np.array(counts, np.int64), out=starts[1:])
    return starts


def _further(entries: Sequence[Entry | None], known: tuple[str, ...]) -> Further:
    """Values of each entry that differ from the defaults, and keys that this version has not."""
    found: dict[int, dict[str, Any]] = {}
    for row, entry in enumerate(entries):
        if entry is None:
            continue
        values = {key: getattr(entry, key) for key in known}
        if "aliases" in values:
            # As JSON gives them back
            values["aliases"] = list(values["aliases"])
        further = {key: value for key, value in values.items() if value} | (entry.model_extra or {})
        if further:
            found[row] = further
    return Further(found)

"""Positions and normals of a portion to streams; what the shapes imply of normals is left out."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.bytes.planes import split_positions
from raymap.bytes.streams import Scope, StreamSet
from raymap.encoding.dictionary import Itineraries
from raymap.encoding.itineraries import PathRuns
from raymap.encoding.normals import end_residuals, imply_normals, normal_residuals, other_residuals
from raymap.encoding.portionmeta import Encoding
from raymap.encoding.shapes import LEFT_SCENE, RayPoints, ShapedRecords, ShapeTable, point_shapes
from raymap.jit.scratch import scratch
from raymap.model.portion import Portion

__all__ = ["PathsTaken", "add_geometry"]


class PathsTaken(NamedTuple):
    """A portion and the paths that its rays take.

    Attributes
    ----------
    offsets : (n_rays + 1,) the records of each ray
    table : the paths
    path_numbers : (n_rays,) into the table
    """

    portion: Portion
    offsets: NDArray[np.int64]
    table: Itineraries
    path_numbers: NDArray[np.uint32]


def add_geometry(
    streams: StreamSet,
    rays: PathsTaken,
    shapes: ShapeTable,
    room: NDArray[np.uint8] | None,
) -> int:
    """Store positions and normals; returns the encodings chosen
    (`raymap.encoding.portionmeta.Encoding`).

    Parameters
    ----------
    shapes : of the directory
    room : where the byte planes of positions go that are stored as they are, 12 bytes a record;
        None where they are not stored in planes
    """
    portion = rays.portion
    if room is not None:
        planes = room[: 12 * portion.n_records].reshape(12, -1)
        split_positions(portion.position, planes)
        for axis, name in enumerate("xyz"):
            own = planes[4 * axis : 4 * axis + 4]
            streams.add_split(f"position.{name}", portion.position[:, axis], own, Scope.RECORD)
        if portion.implied_normals:
            return _add_unlike_normals(streams, rays, shapes)
    if streams.raw and not portion.implied_normals:
        return _add_raw_geometry(streams, portion)
    codes = _shape_codes(rays, shapes)
    portion = with_normals(portion, codes, shapes)
    if streams.raw:
        return _add_raw_geometry(streams, portion)
    return _add_normals(streams, portion, rays.offsets, codes, shapes)


def with_normals(portion: Portion, codes: NDArray[np.int32], shapes: ShapeTable) -> Portion:
    """The portion with those normals set that its shapes imply, where it says so."""
    if not portion.implied_normals:
        return portion
    normal = portion.normal.copy()
    imply_normals(codes, shapes.gradient, portion.position, normal)
    return replace(portion, normal=normal)


def _shape_codes(rays: PathsTaken, shapes: ShapeTable) -> NDArray[np.int32]:
    """Shape code of each record."""
    portion, table = rays.portion, rays.table
    n = portion.n_records
    runs = PathRuns.check(table.offsets, rays.path_numbers, n, "records of rays")
    codes = point_shapes(table.offsets, table.object, table.face, table.event, shapes)
    room = scratch("codes", n, np.int32)
    return ShapedRecords.check(runs, codes, portion.triangle, shapes, room).codes


def _add_raw_geometry(streams: StreamSet, portion: Portion) -> int:
    for axis, name in enumerate("xyz"):
        streams.add(f"position.{name}", portion.position[:, axis], Scope.RECORD)
    for axis, name in enumerate("xyz"):
        streams.add(f"normal.{name}", portion.normal[:, axis], Scope.RECORD)
    return 0


def _add_normals(
    streams: StreamSet,
    portion: Portion,
    offsets: NDArray[np.int64],
    codes: NDArray[np.int32],
    shapes: ShapeTable,
) -> int:
    folded = scratch("normals", 3 * portion.n_records, np.uint16).reshape(3, -1)
    missed, plain = normal_residuals(
        offsets,
        codes,
        portion.triangle,
        portion.source,
        shapes.gradient,
        shapes.first_primitive,
        shapes.face_start,
        np.zeros((len(portion.emitted), 3), np.int16),
        np.zeros((shapes.n_remembered, 3), np.int16),
        portion.position,
        portion.normal,
        folded,
    )
    if missed > plain:
        for axis, name in enumerate("xyz"):
            streams.add(f"normal.{name}", portion.normal[:, axis], Scope.RECORD)
        return 0
    for axis, name in enumerate("xyz"):
        streams.add(f"normal.{name}", folded[axis], Scope.RECORD)
    return int(Encoding.NORMALS)


def _add_unlike_normals(streams: StreamSet, rays: PathsTaken, shapes: ShapeTable) -> int:
    """Store normals of which those on quadrics are implied."""
    portion = rays.portion
    most = 2 * portion.n_rays if shapes.complete else portion.n_records
    places = scratch("places", most, np.int32)
    folded = scratch("folded", 3 * most, np.uint16).reshape(3, -1)
    emission = np.zeros((len(portion.emitted), 3), np.int16)
    position, normal = portion.position, portion.normal
    if shapes.complete:
        n = end_residuals(
            rays.offsets, rays.path_numbers, *_ends(rays.table), portion.source, emission,
            position, normal, places, folded,
        )  # fmt: skip
    else:
        table = rays.table
        points = RayPoints(
            rays.path_numbers, table.offsets, rays.offsets, table.object, table.face, table.event,
            portion.triangle, portion.source,
        )  # fmt: skip
        remembered = np.zeros((shapes.n_remembered, 3), np.int16)
        n = other_residuals(points, shapes, emission, remembered, position, normal, places, folded)
    for axis, name in enumerate("xyz"):
        streams.add_sparse(
            f"normal.{name}", portion.n_records, places[:n], folded[axis, :n], Scope.RECORD
        )
    return int(Encoding.NORMALS)


def _ends(table: Itineraries) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether each path begins on no face, and whether it ends where the ray has left."""
    first, last = table.offsets[:-1], table.offsets[1:] - 1
    left = (table.object[last] < 0) & ((table.event[last] & LEFT_SCENE) != 0) & (last > first)
    return table.face[first] < 0, left & (table.face[last] < 0)

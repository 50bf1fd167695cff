"""Triangles of meshes that lie on analytic faces or on one another: found, and warned about.

Where two faces coincide light must meet one interface. That is so for analytic faces
(`tracer.scene.arrangement.coincident_faces`); the triangles of a mesh are found one by one, so
where they lie on something else light meets two faces in the order that rounding gives, or a film
of what is outside between them. The remedy is the user's.
"""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from raymap.model.directory import Quadric
from tracer.geometry.mesh import TriangleMesh
from tracer.geometry.shape_columns import ShapeColumns
from tracer.geometry.shapes import (
    Annulus,
    Conic,
    Cylinder,
    Frustum,
    Polygon,
    Rectangle,
    Shape,
    SphereCap,
)

__all__ = ["CoincidentTriangles", "find_coincident_triangles", "warn_of_coincident_triangles"]

Array = NDArray[np.float64]
Triangles = Array
"""(n, 3, 3) corners."""

_REACH = 1e-7
"""Share of the scene's radius within which planes are one: what single precision resolves."""

_INNER = np.array([[1, 1, 1], [8, 1, 1], [1, 8, 1], [1, 1, 8]]) / np.array([[3], [10], [10], [10]])
"""Places inside a triangle, as shares of its corners."""

_DEPTH = 0.12
"""Depth of a triangle below the curved face that it stands for, over its longest edge: 55 deg."""

_PAIRS, _BATCH = 1 << 20, 1 << 16


class CoincidentTriangles(UserWarning):
    """Triangles that lie on other faces: what light meets there is left to rounding."""


def warn_of_coincident_triangles(
    meshes: Mapping[str, TriangleMesh],
    faces: ShapeColumns,
    bodies: Sequence[str],
    solids: Collection[str],
    size: float,
    where: str,
) -> None:
    """Warn of every pair of bodies that coincide somewhere, with the number of triangles.

    Parameters
    ----------
    meshes : triangles of bodies by name, in the scene
    faces : analytic faces; those with aspheric coefficients are passed over
    bodies : per face the name of its body
    solids : names of the bodies with a medium; two open surfaces need no order
    size : radius of the scene
    where : names the scene
    """
    for mesh, other, count in find_coincident_triangles(meshes, faces, bodies, solids, size):
        many = "1 triangle" if count == 1 else f"{count} triangles"
        warnings.warn(
            f"{where}: bodies {mesh!r} and {other!r} coincide along {many} of {mesh!r}: light "
            "meets both faces in the order of rounding, or a film of what is outside between them; "
            "let them overlap by a micrometre (at a curved face by more than the triangles stand "
            "off it), and give one of them a higher priority",
            CoincidentTriangles,
            stacklevel=4,
        )


def find_coincident_triangles(
    meshes: Mapping[str, TriangleMesh],
    faces: ShapeColumns,
    bodies: Sequence[str],
    solids: Collection[str],
    size: float,
) -> list[tuple[str, str, int]]:
    """Mesh, other body, and triangles of the mesh that lie on it."""
    reach = _REACH * size
    corners = {name: mesh.vertices[mesh.triangles] for name, mesh in meshes.items()}
    names = list(meshes)
    low = np.array([corners[name].min(axis=(0, 1)) for name in names]).reshape(-1, 3) - reach
    high = np.array([corners[name].max(axis=(0, 1)) for name in names]).reshape(-1, 3) + reach
    found: dict[tuple[str, str], int] = {}
    for k, name in enumerate(names):
        near = (faces.high >= low[k]).all(axis=1) & (faces.low <= high[k]).all(axis=1)
        for number in np.flatnonzero(near).tolist():
            body, shape = bodies[number], faces.shapes[number]
            if name in solids or body in solids:
                count = _on_flat_face(corners[name], shape, reach)
                count += _on_curved_face(corners[name], shape, reach)
                if count:
                    found[name, body] = found.get((name, body), 0) + count
        beside = (high[k + 1 :] >= low[k]).all(axis=1) & (low[k + 1 :] <= high[k]).all(axis=1)
        for other in (names[k + 1 + number] for number in np.flatnonzero(beside).tolist()):
            if name in solids or other in solids:
                count = _on_triangles(corners[name], corners[other], reach)
                if count:
                    found[name, other] = count
    return [(*pair, count) for pair, count in found.items()]


def _near(triangles: Triangles, low: Array, high: Array, reach: float) -> NDArray[np.bool_]:
    """Triangles whose box meets a box."""
    above = (triangles.max(axis=1) >= low - reach).all(axis=1)
    return np.asarray(above & (triangles.min(axis=1) <= high + reach).all(axis=1))


def _on_flat_face(triangles: Triangles, shape: Shape, reach: float) -> int:
    """Triangles that lie on a flat face."""
    if not isinstance(shape, Annulus | Rectangle | Polygon):
        return 0
    row = shape.row()
    triangles = triangles[_near(triangles, *shape.bounds(), reach)]
    apart = np.abs((triangles - row[0:3]) @ row[3:6])
    triangles = triangles[(apart <= reach).all(axis=1)]
    if not len(triangles):
        return 0
    lies = _covered(shape, _places(triangles)).any(axis=1)
    own = shape.mesh()
    pieces = own[0][own[1]]
    lies |= _inside(_places(pieces).reshape(-1, 3), triangles).any(axis=0)
    return int(np.count_nonzero(lies))


def _on_curved_face(triangles: Triangles, shape: Shape, reach: float) -> int:
    """Triangles that stand for a curved face: their corners lie on it, and they lie along it."""
    if not isinstance(shape, SphereCap | Cylinder | Frustum | Conic):
        return 0
    quadric = shape.quadric()
    if quadric is None:
        return 0
    triangles = triangles[_near(triangles, *shape.bounds(), reach)]
    value, gradient = _quadric(quadric, triangles)
    steepness = np.linalg.norm(gradient, axis=-1)
    triangles = triangles[(np.abs(value) <= reach * steepness).all(axis=1) & (steepness > 0).all(1)]
    if not len(triangles):
        return 0
    # Their middles are near the face, too, and look as it does
    places = _places(triangles)
    value, outward = _quadric(quadric, places[:, 0])
    steepness = np.linalg.norm(outward, axis=1)
    edges = triangles - np.roll(triangles, 1, axis=1)
    lies = np.abs(value) <= _DEPTH * np.linalg.norm(edges, axis=2).max(axis=1) * steepness
    normal = np.cross(edges[:, 0], edges[:, 1])
    lengths = np.linalg.norm(normal, axis=1) * steepness
    lies &= np.abs(np.einsum("ij,ij->i", normal, outward)) > 0.7 * lengths
    return int(np.count_nonzero(lies & _along(shape, places).any(axis=1)))


def _quadric(quadric: Quadric, places: Array) -> tuple[Array, Array]:
    """Value and gradient of a quadric at places (…, 3)."""
    xx, yy, zz, xy, xz, yz, *linear, constant = quadric.coefficients
    matrix = np.array([[xx, xy / 2, xz / 2], [xy / 2, yy, yz / 2], [xz / 2, yz / 2, zz]])
    across = places @ matrix
    value = (across * places).sum(axis=-1) + places @ np.array(linear) + constant
    return value, 2.0 * across + np.array(linear)


def _along(shape: SphereCap | Cylinder | Frustum | Conic, places: Array) -> NDArray[np.bool_]:
    """Which places (…, 3) near the surface that a curved face is part of lie on the face."""
    row = shape.row()
    from_origin = places - row[0:3]
    height = from_origin @ row[3:6]
    if isinstance(shape, SphereCap):
        return np.asarray(height <= shape.sag)
    if isinstance(shape, Cylinder | Frustum):
        return np.asarray((height >= shape.low) & (height <= shape.high))
    r = np.sqrt(np.maximum(0.0, (from_origin**2).sum(axis=-1) - height**2))
    return np.asarray((r >= shape.inner) & (r <= shape.semi_diameter))


def _places(triangles: Triangles) -> Array:
    """(n, 4, 3) places inside triangles."""
    return np.asarray(np.einsum("pc,nck->npk", _INNER, triangles))


def _covered(shape: Annulus | Rectangle | Polygon, places: Array) -> NDArray[np.bool_]:
    """Which places (…, 3) in the plane of a flat face lie on it."""
    if isinstance(shape, Polygon):
        planes = shape.half_planes()
        return np.asarray((places @ planes[:, :3].T <= planes[:, 3]).all(axis=-1))
    from_origin = places - shape.origin
    if isinstance(shape, Annulus):
        r = np.linalg.norm(from_origin, axis=-1)
        return np.asarray((r >= shape.inner) & (r <= shape.outer))
    u, v = np.abs(from_origin @ shape.u), np.abs(from_origin @ shape.v)
    return np.asarray((u <= shape.size[0] / 2.0) & (v <= shape.size[1] / 2.0))


def _inside(places: Array, triangles: Triangles) -> NDArray[np.bool_]:
    """(n, m): which of n places in the plane of m triangles lie in them."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normal = np.cross(b - a, c - a)
    found = np.ones((len(places), len(triangles)), bool)
    for start, end in ((a, b), (b, c), (c, a)):
        across = np.cross(normal, end - start)
        found &= places @ across.T >= np.einsum("ij,ij->i", across, start)
    return found


def _on_triangles(one: Triangles, other: Triangles, reach: float) -> int:
    """Triangles of one mesh that lie on those of another."""
    one = one[_near(one, other.min(axis=(0, 1)), other.max(axis=(0, 1)), reach)]
    if not len(one):
        return 0
    other = other[_near(other, one.min(axis=(0, 1)), one.max(axis=(0, 1)), reach)]
    lies = np.zeros(len(one), bool)
    for a, b in _in_one_plane(one, other, reach):
        first, second = one[a], other[b]
        normal = np.cross(second[:, 1] - second[:, 0], second[:, 2] - second[:, 0])
        normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
        apart = np.einsum("nck,nk->nc", first - second[:, :1], normal)
        meets = _meet(first, second) | _meet(second, first)
        lies[a[(np.abs(apart) <= reach).all(axis=1) & meets]] = True
    return int(np.count_nonzero(lies))


def _meet(one: Triangles, other: Triangles) -> NDArray[np.bool_]:
    """Whether places in a triangle lie in the one beside it in the list, both in one plane."""
    a, b, c = other[:, 0], other[:, 1], other[:, 2]
    normal = np.cross(b - a, c - a)
    places = _places(one)
    found = np.ones(places.shape[:2], bool)
    for start, end in ((a, b), (b, c), (c, a)):
        across = np.cross(normal, end - start)
        found &= np.einsum("npk,nk->np", places - start[:, None], across) >= 0.0
    return np.asarray(found.any(axis=1))


def _in_one_plane(
    one: Triangles, other: Triangles, reach: float
) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Pairs of triangles of both that share a plane, roughly, a batch at a time."""
    keys = [_plane_keys(triangles, reach) for triangles in (one, other)]
    different, number = np.unique(np.concatenate(keys), axis=0, return_inverse=True)
    number = number.reshape(-1)
    orders = [np.argsort(part, kind="stable") for part in (number[: len(one)], number[len(one) :])]
    sizes = [
        np.bincount(part, minlength=len(different))
        for part in (number[: len(one)], number[len(one) :])
    ]
    starts = [np.cumsum(size) - size for size in sizes]
    shared = np.flatnonzero((sizes[0] > 0) & (sizes[1] > 0))
    # Where very many lie in one plane a part of them stands for all
    steps = np.maximum(1, sizes[0][shared] * sizes[1][shared] // _PAIRS)
    counts = -(-sizes[0][shared] // steps) * sizes[1][shared]
    ends = np.cumsum(counts)
    total = int(ends[-1]) if len(ends) else 0
    for begin in range(0, total, _BATCH):
        index = np.arange(begin, min(total, begin + _BATCH))
        plane = np.searchsorted(ends, index, side="right")
        index -= (ends - counts)[plane]
        row, column = np.divmod(index, sizes[1][shared][plane])
        yield (
            orders[0][starts[0][shared][plane] + row * steps[plane]],
            orders[1][starts[1][shared][plane] + column],
        )


def _plane_keys(triangles: Triangles, reach: float) -> NDArray[np.int64]:
    """Rounded plane of each triangle, in odd steps: round numbers lie within them."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    normal *= np.where(normal @ np.array([0.5773, 0.2113, 0.7886]) < 0.0, -1.0, 1.0)[:, None]
    height = (normal * triangles[:, 0]).sum(axis=1)
    plane = np.column_stack([normal / 0.00314159, height / (314.159 * reach)])
    return np.floor(plane + 0.21371).astype(np.int64)

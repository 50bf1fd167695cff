"""Display meshes as drawable bodies: normals, feature edges, cuts, silhouettes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from raymap.model.directory import DisplayMesh

__all__ = ["Body", "cut_body", "make_body", "outline", "silhouette"]

CREASE = np.cos(np.radians(35.0))
"""Faces that meet at a larger angle show an edge and do not share normals."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Body:
    """One object, ready to be drawn.

    Attributes
    ----------
    name : of the object
    index : of the object
    color : (3,) float32 sRGB 0 … 1
    opacity : 0 … 1
    corners : (n, 3, 3) float32, corners of the triangles [scene units]
    normals : (n, 3, 3) float32, unit normals at the corners
    face : (n,) int32, index of the face within the object
    edges : (k, 2, 3) float32, sharp edges [scene units]
    smooth_edges : (l, 2, 3) float32, edges between triangles of a smooth surface
    smooth_normals : (l, 2, 3) float32, normals of the two triangles there
    """

    name: str
    index: int
    color: NDArray[np.float32]
    opacity: float
    corners: NDArray[np.float32]
    normals: NDArray[np.float32]
    face: NDArray[np.int32]
    edges: NDArray[np.float32]
    smooth_edges: NDArray[np.float32]
    smooth_normals: NDArray[np.float32]


def _unit(vectors: NDArray[np.float32]) -> NDArray[np.float32]:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, 1e-30))


def _merge(vertices: NDArray[np.float32]) -> NDArray[np.int64]:
    """A number for each different position: vertices that coincide become one."""
    if len(vertices) == 0:
        return np.empty(0, np.int64)
    span = float(np.ptp(vertices, axis=0).max()) or 1.0
    grid = np.rint((vertices - vertices.min(axis=0)) / span * 1e6).astype(np.int64)
    keys = (grid[:, 0] << 42) | (grid[:, 1] << 21) | grid[:, 2]
    return np.unique(keys, return_inverse=True)[1].reshape(-1)


def make_body(
    mesh: DisplayMesh, *, name: str, index: int, color: NDArray[np.float32], opacity: float
) -> Body:
    """Prepare one display mesh; triangles without area or with bad indices are left out."""
    n = len(mesh.vertices)
    sound = ((mesh.triangles >= 0) & (mesh.triangles < n)).all(axis=1)
    triangles, face = mesh.triangles[sound], mesh.face[sound]
    corners = np.asarray(mesh.vertices, np.float32)[triangles]
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    kept = np.isfinite(corners).all(axis=(1, 2)) & (np.linalg.norm(crosses, axis=1) > 0)
    corners, crosses, face = corners[kept], crosses[kept], face[kept]
    flat = _unit(crosses)
    place = _merge(corners.reshape(-1, 3)).reshape(-1, 3)

    # Average the normals around each vertex of each face, but not across a crease
    group = np.unique(np.stack([place.ravel(), np.repeat(face, 3)], -1), axis=0,
                      return_inverse=True)[1].reshape(-1)  # fmt: skip
    sums = np.zeros((group.max() + 1 if len(group) else 0, 3), np.float64)
    np.add.at(sums, group, np.repeat(crosses, 3, axis=0))
    normals = _unit(sums[group].reshape(-1, 3, 3).astype(np.float32))
    sharp = np.einsum("ijk,ik->ij", normals, flat) < CREASE
    normals = np.where(sharp[:, :, None], flat[:, None, :], normals)
    edges, smooth_edges, smooth_normals = _edges(corners, flat, place, face)
    return Body(
        name=name,
        index=index,
        color=np.asarray(color, np.float32),
        opacity=opacity,
        corners=corners,
        normals=normals.astype(np.float32),
        face=face.astype(np.int32),
        edges=edges,
        smooth_edges=smooth_edges,
        smooth_normals=smooth_normals,
    )


def _edges(
    corners: NDArray[np.float32],
    flat: NDArray[np.float32],
    index: NDArray[np.int64],
    face: NDArray[np.int32],
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Sharp edges, and smooth edges with the normals on both sides."""
    owner = np.tile(np.arange(len(corners)), 3)
    ends = np.concatenate([index[:, [0, 1]], index[:, [1, 2]], index[:, [2, 0]]])
    spots = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    ends = np.sort(ends, axis=1)
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    ends, owner, spots = ends[order], owner[order], spots[order]
    if len(ends) == 0:
        empty = np.empty((0, 2, 3), np.float32)
        return empty, empty, empty
    new = np.concatenate(([True], (ends[1:] != ends[:-1]).any(axis=1)))
    starts = np.flatnonzero(new)
    counts = np.diff(np.append(starts, len(ends)))
    pairs = starts[counts == 2]
    first, second = owner[pairs], owner[pairs + 1]
    cosine = np.einsum("ij,ij->i", flat[first], flat[second])
    crease = (cosine < CREASE) | ((face[first] != face[second]) & (cosine < 0.996))
    lonely = starts[counts != 2]
    sharp = np.concatenate([spots[lonely], spots[pairs[crease]]])
    smooth = pairs[~crease]
    normals = np.stack([flat[owner[smooth]], flat[owner[smooth + 1]]], axis=1)
    return sharp, spots[smooth], normals


def silhouette(
    body: Body, position: NDArray[np.float64], forward: NDArray[np.float64], parallel: bool
) -> NDArray[np.float32]:
    """Edges of smooth surfaces where the front side turns into the back side.

    Returns
    -------
    (n, 2, 3) float32 [scene units]
    """
    if parallel:
        side = body.smooth_normals @ forward.astype(np.float32)
    else:
        sight = body.smooth_edges[:, 0] - position.astype(np.float32)
        side = np.einsum("nij,nj->ni", body.smooth_normals, sight)
    return body.smooth_edges[side[:, 0] * side[:, 1] < 0]


def cut_triangles(
    corners: NDArray[np.float32], normals: NDArray[np.float32], side: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]:
    """Keep the part of triangles where ``side`` (n, 3), linear on each, is not positive.

    Returns
    -------
    corners, normals, row : of the triangles that remain, and where each came from
    """
    outside = side > 0
    n_out = outside.sum(axis=1)
    whole = np.flatnonzero(n_out == 0)
    parts = [(corners[whole], normals[whole], whole)]
    for count in (1, 2):
        rows = np.flatnonzero(n_out == count)
        if len(rows) == 0:
            continue
        # Turn the lonely corner (the only one out, or the only one in) to the front
        lonely = np.argmax(outside[rows] if count == 1 else ~outside[rows], axis=1)
        turn = (lonely[:, None] + np.arange(3)) % 3
        c = np.take_along_axis(corners[rows], turn[:, :, None], axis=1)
        m = np.take_along_axis(normals[rows], turn[:, :, None], axis=1)
        s = np.take_along_axis(side[rows], turn, axis=1)
        t1 = (s[:, 0] / (s[:, 0] - s[:, 1])).astype(np.float32)[:, None]
        t2 = (s[:, 0] / (s[:, 0] - s[:, 2])).astype(np.float32)[:, None]
        c1, c2 = c[:, 0] + t1 * (c[:, 1] - c[:, 0]), c[:, 0] + t2 * (c[:, 2] - c[:, 0])
        m1, m2 = m[:, 0] + t1 * (m[:, 1] - m[:, 0]), m[:, 0] + t2 * (m[:, 2] - m[:, 0])
        if count == 2:
            parts.append((np.stack([c[:, 0], c1, c2], 1), np.stack([m[:, 0], m1, m2], 1), rows))
        else:
            parts.append((np.stack([c1, c[:, 1], c[:, 2]], 1),
                          np.stack([m1, m[:, 1], m[:, 2]], 1), rows))  # fmt: skip
            parts.append((np.stack([c1, c[:, 2], c2], 1),
                          np.stack([m1, m[:, 2], m2], 1), rows))  # fmt: skip
    joined = [np.concatenate(column) for column in zip(*parts, strict=True)]
    return joined[0], joined[1], joined[2]


def outline(
    corners: NDArray[np.float32], normal: NDArray[np.float64], offset: float
) -> NDArray[np.float32]:
    """Where a plane cuts triangles: the section drawing.

    Returns
    -------
    (n, 2, 3) float32 [scene units]
    """
    side = corners.astype(np.float64) @ normal - offset
    outside = side > 0
    rows = np.flatnonzero(outside.any(axis=1) & ~outside.all(axis=1))
    out = outside[rows]
    lonely = np.argmax(np.where(out.sum(axis=1, keepdims=True) == 1, out, ~out), axis=1)
    turn = (lonely[:, None] + np.arange(3)) % 3
    c = np.take_along_axis(corners[rows], turn[:, :, None], axis=1)
    s = np.take_along_axis(side[rows], turn, axis=1)
    t1 = (s[:, 0] / (s[:, 0] - s[:, 1])).astype(np.float32)[:, None]
    t2 = (s[:, 0] / (s[:, 0] - s[:, 2])).astype(np.float32)[:, None]
    ends = [c[:, 0] + t1 * (c[:, 1] - c[:, 0]), c[:, 0] + t2 * (c[:, 2] - c[:, 0])]
    return np.stack(ends, axis=1).astype(np.float32)


def cut_body(body: Body, normal: NDArray[np.float64], offset: float) -> Body:
    """Take away the side of the plane that ``normal`` points to and show the cut's outline."""
    side = body.corners.astype(np.float64) @ normal - offset
    corners, normals, row = cut_triangles(body.corners, body.normals, side)
    section = outline(body.corners, normal, offset)
    smooth = ((body.smooth_edges.astype(np.float64) @ normal - offset) <= 0).all(axis=1)
    return replace(
        body,
        corners=corners,
        normals=normals,
        face=body.face[row],
        edges=np.concatenate([_cut_edges(body.edges, normal, offset), section]),
        smooth_edges=body.smooth_edges[smooth],
        smooth_normals=body.smooth_normals[smooth],
    )


def _cut_edges(
    edges: NDArray[np.float32], normal: NDArray[np.float64], offset: float
) -> NDArray[np.float32]:
    """Shorten edges at the plane; those beyond it vanish."""
    side = edges.astype(np.float64) @ normal - offset
    kept = (side <= 0).any(axis=1)
    edges, side = edges[kept].copy(), side[kept]
    for end in (0, 1):
        rows = np.flatnonzero(side[:, end] > 0)
        share = side[rows, end] / (side[rows, end] - side[rows, 1 - end])
        gap = edges[rows, 1 - end] - edges[rows, end]
        edges[rows, end] += share.astype(np.float32)[:, None] * gap
    return edges

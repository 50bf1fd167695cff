"""Closed bodies of crystal: convex polyhedra and triangle meshes, and their compiled form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.model.errors import SceneError
from tracer.bodies.rhomb import cleavage_edges
from tracer.optics.crystals.media import Crystal
from tracer.render.triangle_tree import build_triangle_tree

__all__ = [
    "BodyArrays",
    "CrystalBody",
    "box",
    "calcite_rhomb",
    "compile_bodies",
    "convex_body",
    "mesh_body",
]

Real = NDArray[np.float64]
Array = np.ndarray[Any, np.dtype[Any]]


@dataclass(frozen=True, kw_only=True)
class CrystalBody:
    """One closed body of one medium.

    Attributes
    ----------
    name : for messages
    medium : the crystal
    vertices : (n, 3) corners [mm]
    planes : (m, 4) outward unit normals and offsets of a convex body (n . x = offset on the face),
        (0, 4) for a mesh
    triangles : (k, 3) corners of the triangles of a mesh, outward by the right-hand rule
    """

    name: str
    medium: Crystal
    vertices: Real
    planes: Real
    triangles: NDArray[np.int64]

    @property
    def convex(self) -> bool:
        """Whether the body is traced by its planes."""
        return len(self.planes) > 0


class BodyArrays(NamedTuple):
    """Bodies as arrays: planes of convex bodies, a tree of triangles for meshes."""

    planes: Array
    plane_start: Array
    tree_root: Array
    tree_boxes: Array
    tree_links: Array
    triangles: Array
    contacts: bool
    nudge: float


def convex_body(
    name: str, medium: Crystal, planes: ArrayLike, *, tolerance: float = 1e-9
) -> CrystalBody:
    """The bounded intersection of half spaces n . x <= offset.

    Raises
    ------
    SceneError
        if the half spaces leave nothing or an unbounded body
    """
    rows = np.array(planes, np.float64)
    if rows.ndim != 2 or rows.shape[1] != 4 or len(rows) < 4:
        raise SceneError(f"body {name!r}: planes must be four or more rows (nx, ny, nz, offset)")
    sizes = np.linalg.norm(rows[:, :3], axis=1)
    if not np.all(sizes > 0.0):
        raise SceneError(f"body {name!r}: a plane has no normal")
    rows = rows / sizes[:, None]

    # Corners are the points of three planes inside all others
    corners = []
    count = len(rows)
    for i in range(count):
        for j in range(i + 1, count):
            for k in range(j + 1, count):
                m = rows[[i, j, k], :3]
                if abs(np.linalg.det(m)) < 1e-9:
                    continue
                point = np.linalg.solve(m, rows[[i, j, k], 3])
                scale = 1.0 + np.abs(point).max()
                if np.all(rows[:, :3] @ point <= rows[:, 3] + tolerance * scale):
                    corners.append(point)
    centre_free = np.linalg.matrix_rank(rows[:, :3]) == 3
    if len(corners) < 4 or not centre_free or not _bounded(rows[:, :3]):
        raise SceneError(f"body {name!r}: its planes do not enclose a body")
    unique = np.unique(np.round(np.array(corners), 9), axis=0)
    return CrystalBody(
        name=name,
        medium=medium,
        vertices=unique,
        planes=np.ascontiguousarray(rows),
        triangles=np.zeros((0, 3), np.int64),
    )


def _bounded(normals: Real) -> bool:
    """Whether some positive combination of the normals vanishes with all of space spanned."""
    generator = np.random.default_rng(0)
    directions = np.concatenate([np.eye(3), -np.eye(3), generator.normal(size=(256, 3))])
    return bool(np.all((directions @ normals.T).max(axis=1) > 0.0))


def box(name: str, medium: Crystal, centre: ArrayLike, size: ArrayLike) -> CrystalBody:
    """A box with faces along the axes [mm]."""
    c = np.asarray(centre, np.float64)
    s = np.asarray(size, np.float64)
    if c.shape != (3,) or s.shape != (3,) or not np.all(s > 0.0):
        raise SceneError(f"body {name!r}: centre and size must be three numbers, sizes positive")
    normals = np.concatenate([np.eye(3), -np.eye(3)])
    offsets = np.concatenate([c + s / 2, -(c - s / 2)])
    return convex_body(name, medium, np.column_stack([normals, offsets]))


def calcite_rhomb(
    name: str, medium_of_axis: Any, edge_mm: float, base_centre: ArrayLike, *, turn_deg: float = 0.0
) -> CrystalBody:
    """A cleavage rhombohedron of calcite lying on a face, with its optic axis where nature has it.

    Parameters
    ----------
    medium_of_axis : function of the optic axis that gives the medium, such as `calcite`
    edge_mm : length of its edges
    base_centre : (3,) centre of the face below, whose normal is -z
    turn_deg : rotation about the vertical
    """
    if not edge_mm > 0.0:
        raise SceneError(f"body {name!r}: edge_mm is {edge_mm:g}, it must be positive")
    angle = np.radians(turn_deg)
    spin = np.array(
        [
            [np.cos(angle), -np.sin(angle), 0.0],
            [np.sin(angle), np.cos(angle), 0.0],
            [0.0, 0.0, 1.0],
        ]
    )
    edges = cleavage_edges(edge_mm) @ spin.T
    axis = edges.sum(axis=0)
    corner = np.asarray(base_centre, np.float64) - 0.5 * (edges[0] + edges[1])
    planes = []
    for i in range(3):
        normal = np.cross(edges[(i + 1) % 3], edges[(i + 2) % 3])
        normal /= np.linalg.norm(normal)
        if normal @ edges[i] < 0.0:
            normal = -normal
        planes.append([*normal, normal @ (corner + edges[i])])
        planes.append([*(-normal), -normal @ corner])
    return convex_body(name, medium_of_axis(axis / np.linalg.norm(axis)), planes)


def mesh_body(name: str, medium: Crystal, vertices: ArrayLike, triangles: ArrayLike) -> CrystalBody:
    """A closed triangle mesh, faces outward.

    Raises
    ------
    SceneError
        if the mesh is not closed and consistently oriented, or inside out
    """
    points = np.asarray(vertices, np.float64)
    faces = np.asarray(triangles, np.int64)
    if points.ndim != 2 or points.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise SceneError(f"body {name!r}: vertices and triangles must be tables of three columns")
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    forward = {(int(a), int(b)) for a, b in edges}
    if len(forward) != len(edges) or any((b, a) not in forward for a, b in forward):
        raise SceneError(
            f"body {name!r}: the mesh is not closed; a crystal needs a closed surface of "
            "consistently oriented triangles"
        )
    a, b, c = (points[faces[:, i]] for i in range(3))
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0
    if not volume > 0.0:
        raise SceneError(f"body {name!r}: the triangles face inward; reverse their corners")
    return CrystalBody(
        name=name,
        medium=medium,
        vertices=points,
        planes=np.zeros((0, 4)),
        triangles=faces,
    )


def _separation(a: CrystalBody, b: CrystalBody) -> float:
    """Largest gap over candidate axes between the convex hulls of two bodies [mm]."""
    axes = [body.planes[:, :3] for body in (a, b) if body.convex]
    edges = []
    for body in (a, b):
        centre = body.vertices.mean(axis=0)
        if not body.convex:
            axes.append(np.concatenate([np.eye(3), -np.eye(3)]))
        edges.append(body.vertices - centre)
    axes.append((b.vertices.mean(axis=0) - a.vertices.mean(axis=0))[None])
    if a.convex and b.convex:
        crossed = np.cross(a.planes[:, None, :3], b.planes[None, :, :3]).reshape(-1, 3)
        axes.append(crossed)
        axes.append(-crossed)
    best = -np.inf
    for axis in np.concatenate(axes):
        size = np.linalg.norm(axis)
        if size < 1e-9:
            continue
        unit = axis / size
        first, second = a.vertices @ unit, b.vertices @ unit
        best = max(best, second.min() - first.max(), first.min() - second.max())
    return float(best)


def compile_bodies(
    bodies: tuple[CrystalBody, ...], contacts: tuple[tuple[str, str], ...] = ()
) -> BodyArrays:
    """Arrays of all bodies; checks that they keep apart.

    Parameters
    ----------
    contacts : pairs of names of convex bodies that share an interface, light goes from one
        straight into the other there

    Raises
    ------
    SceneError
        for bodies that overlap, or touch without a stated contact
    """
    names = [body.name for body in bodies]
    for pair in contacts:
        for name in pair:
            if name not in names:
                raise SceneError(f"contact names {name!r}, the bodies are {', '.join(names)}")
        if pair[0] == pair[1]:
            raise SceneError(f"contact [{pair[0]!r}, {pair[1]!r}]: a body has none with itself")
        for name in pair:
            if not bodies[names.index(name)].convex:
                raise SceneError(
                    f"contact [{pair[0]!r}, {pair[1]!r}]: {name!r} is a mesh; contacts join boxes, "
                    "prisms and rhombs, leave a gap about a mesh"
                )
    everything = np.concatenate([body.vertices for body in bodies]) if bodies else np.zeros((1, 3))
    scale = float(np.ptp(everything, axis=0).max()) or 1.0
    for i, a in enumerate(bodies):
        for b in bodies[i + 1 :]:
            gap = _separation(a, b)
            stated = any({a.name, b.name} == set(pair) for pair in contacts)
            if gap < -1e-7 * scale:
                raise SceneError(
                    f"bodies {a.name!r} and {b.name!r} overlap by {-gap:.3g} mm; move them apart"
                )
            if gap >= 1e-7 * scale and stated:
                raise SceneError(
                    f"contact [{a.name!r}, {b.name!r}]: the bodies are {gap:.3g} mm apart; move "
                    "them together, or drop the contact"
                )
            if gap < 1e-7 * scale and not stated:
                raise SceneError(
                    f"bodies {a.name!r} and {b.name!r} touch without a stated interface; leave a "
                    f"gap or add the contact [{a.name!r}, {b.name!r}]"
                )

    planes, starts, roots = [np.zeros((0, 4))], [0], []
    boxes: list[Real] = [np.zeros((0, 6))]
    links: list[NDArray[np.int64]] = [np.zeros((0, 2), np.int64)]
    triangles: list[Real] = [np.zeros((0, 13))]
    node_count = triangle_count = 0
    for body in bodies:
        planes.append(body.planes)
        starts.append(starts[-1] + len(body.planes))
        if body.convex:
            roots.append(-1)
            continue
        tree = build_triangle_tree(body.vertices, body.triangles)
        inner = tree.links.copy()
        leaf = inner[:, 1] > 0
        inner[leaf, 0] += triangle_count
        inner[~leaf, 0] += node_count
        roots.append(node_count)
        boxes.append(tree.boxes)
        links.append(inner)
        triangles.append(tree.triangles)
        node_count += len(tree.boxes)
        triangle_count += len(tree.triangles)
    return BodyArrays(
        planes=np.concatenate(planes),
        plane_start=np.array(starts, np.int64),
        tree_root=np.array(roots, np.int64),
        tree_boxes=np.concatenate(boxes),
        tree_links=np.concatenate(links),
        triangles=np.concatenate(triangles),
        contacts=bool(contacts),
        nudge=1e-7 * scale,
    )

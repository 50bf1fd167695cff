"""The branching tree of light among lenses: points with parents, and the ends of branches.

Every hit is a node; a ray that splits has two nodes there, one for each event. A branch that
ends carries its flux; its ray is the way from the root to it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.jit.kernels import kernel
from raymap.model.events import Event
from tracer.lens.forward import trace_lens
from tracer.lens.scene_lenses import LensScene, SceneLens
from tracer.lens.shape import BACK, FRONT, RIM
from tracer.lens.tree import LensTree
from tracer.optics.polarization_rays import PolarizedRays
from tracer.rays.random import advance, stream_state, uniform

__all__ = ["Forest", "grow_forest"]

Real = NDArray[np.float64]
Integers = NDArray[np.int64]

_REFLECTED = int(Event.SPECULAR_REFLECTION)
_TIR = int(Event.TIR)
_THROUGH = int(Event.SPECULAR_REFRACTION | Event.MEDIUM_CHANGED)
_ON_RIM = int(Event.SURFACE_ABSORPTION | Event.RIM_HIT)
_ABSORBED = int(Event.SURFACE_ABSORPTION)
_IN_GLASS = int(Event.VOLUME_ABSORPTION)
_STOPPED = int(Event.DEPTH_LIMIT)
_LEFT = int(Event.LEFT_SCENE)

MAX_GENERATIONS = 1000
_SALT = 0x1E46


@dataclass
class Forest:
    """Nodes and ends, as lists of columns that grow together.

    nodes : parent, position (3), normal (3), object, triangle, event, medium
    ends : node, flux, emission
    """

    nodes: list[tuple[NDArray[np.generic], ...]] = field(default_factory=list)
    ends: list[tuple[NDArray[np.generic], ...]] = field(default_factory=list)
    count: int = 0

    def add(
        self, parent: Integers, position: Real, normal: Real, obj: ArrayLike, triangle: ArrayLike,
        event: ArrayLike, medium: ArrayLike,
    ) -> Integers:  # fmt: skip
        """Add nodes; their numbers."""
        n = len(parent)
        first = self.count
        self.count += n
        columns = (
            np.broadcast_to(np.asarray(value, np.int64), (n,)) for value in (obj, triangle, event)
        )
        self.nodes.append(
            (
                np.asarray(parent, np.int64), position, normal, *columns,
                np.broadcast_to(np.asarray(medium, np.int64), (n,)),
            )
        )  # fmt: skip
        return np.arange(first, self.count)

    def end(self, node: Integers, flux: Real, emission: Integers) -> None:
        """Let branches end at nodes."""
        self.ends.append((node, flux, emission))

    def node_columns(self) -> list[NDArray[np.generic]]:
        """Parent, position, normal, object, triangle, event, medium of all nodes."""
        return [np.concatenate(column) for column in zip(*self.nodes, strict=True)]

    def end_columns(self) -> list[NDArray[np.generic]]:
        """Node, flux, emission of all ends."""
        return [np.concatenate(column) for column in zip(*self.ends, strict=True)]


def grow_forest(
    scene: LensScene, channel: int, rays: PolarizedRays, root: Integers, emission: Integers,
    forest: Forest, seed: int, *, depth: int, min_flux: float,
) -> None:  # fmt: skip
    """Follow rays of one channel until every branch has ended.

    Parameters
    ----------
    rays : with fluxes in shares of their emission
    seed : of what is drawn: where light is absorbed in a lens
    root : node where each ray starts
    depth : of every lens tree; what a lens still holds then ends there, stopped
    min_flux : branches below this share of the emission end, stopped, at their next hit
    """
    lenses = scene.lenses[channel]
    live, node, born = rays, root, emission
    for _ in range(MAX_GENERATIONS):
        if len(live) == 0:
            return
        nearest, owner = _nearest(scene, lenses, live)
        free = owner < 0
        _leave(scene, live.where(free), node[free], born[free], forest)
        parts, nodes, emissions = [], [], []
        for number, plane in enumerate(scene.planes):
            at = owner == len(lenses) + number
            if at.any():
                hit = live.where(at)
                place = hit.origin + nearest[at, np.newaxis] * hit.direction
                looks = np.broadcast_to(plane.looks, place.shape)
                end = forest.add(node[at], place, looks, plane.object, 0, _ABSORBED, scene.outside)
                forest.end(end, hit.flux, born[at])
        for number, lens in enumerate(lenses):
            at = owner == number
            if at.any():
                tree = trace_lens(lens.lens, live.where(at), depth=depth)
                out = _split(scene, lens, tree, node[at], born[at], forest, seed, min_flux)
                parts.append(out[0])
                nodes.append(out[1])
                emissions.append(out[2])
        if not parts:
            return
        live = PolarizedRays.join(parts)
        node, born = np.concatenate(nodes), np.concatenate(emissions)
    # What mirrors itself for ever is stopped where it stands
    place, normal = live.origin, np.zeros_like(live.origin)
    forest.end(forest.add(node, place, normal, -1, -1, _STOPPED, scene.outside), live.flux, born)


def _nearest(
    scene: LensScene, lenses: tuple[SceneLens, ...], rays: PolarizedRays
) -> tuple[Real, Integers]:
    """Distance of the lens or blocking detector met first, and its number (-1 none)."""
    nearest = np.full(len(rays), np.inf)
    owner = np.full(len(rays), -1, np.int64)
    for number, lens in enumerate(lenses):
        tree = trace_lens(lens.lens, rays, depth=1, mode="scalar")
        away = np.einsum("ij,ij->i", tree.point[:, 0] - rays.origin, rays.direction)
        closer = ~tree.missed & (away < nearest)
        nearest[closer], owner[closer] = away[closer], number
    for number, plane in enumerate(scene.planes):
        if plane.object >= 0:
            away, _, _ = plane.meet(rays.origin, rays.direction)
            closer = away < nearest
            nearest[closer], owner[closer] = away[closer], len(lenses) + number
    return nearest, owner


def _leave(
    scene: LensScene, rays: PolarizedRays, node: Integers, emission: Integers, forest: Forest
) -> None:
    """End rays on the bounding sphere."""
    if len(rays) == 0:
        return
    sphere = scene.compilation.directory.bounding_sphere
    away = rays.origin - np.array(sphere.center)
    b = np.einsum("ij,ij->i", away, rays.direction)
    c = np.einsum("ij,ij->i", away, away) - sphere.radius**2
    t = np.maximum(0.0, -b + np.sqrt(np.maximum(0.0, b * b - c)))
    place = rays.origin + t[:, np.newaxis] * rays.direction
    end = forest.add(node, place, rays.direction, -1, -1, _LEFT, scene.outside)
    forest.end(end, rays.flux, emission)


def _split(
    scene: LensScene, lens: SceneLens, tree: LensTree, node: Integers, emission: Integers,
    forest: Forest, seed: int, min_flux: float,
) -> tuple[PolarizedRays, Integers, Integers]:  # fmt: skip
    """Turn a lens tree into nodes; the rays that leave it, their nodes and emissions."""
    n, depth = tree.flux.shape
    exits = tree.exits()
    exit_rays = tree.exit_rays(exits)
    exit_node = np.full((n, depth), -1, np.int64)
    inner = node
    inside = tree.rays.flux.copy()
    for level in range(depth):
        here = np.flatnonzero(tree.face[:, level] >= 0)
        if len(here) == 0:
            break
        face, place = tree.face[here, level], tree.point[here, level]
        normal = _normals(lens, place, face)
        triangle = lens.primitives[face]
        parent, arriving = inner[here], inside[here]
        if level > 0 and lens.absorption > 0.0:
            # A branch ends within the glass with what the glass took
            step = place - tree.point[here, level - 1]
            length = np.linalg.norm(step, axis=1)
            taken = -np.expm1(-lens.absorption * length)
            drawn = drawn_at(seed, emission[here], place)
            flight = -np.log1p(-drawn * taken) / lens.absorption
            ratio = np.divide(flight, length, out=np.zeros_like(length), where=length > 0.0)
            point = tree.point[here, level - 1] + ratio[:, np.newaxis] * step
            lost = forest.add(parent, point, np.zeros_like(point), -1, -1, _IN_GLASS, lens.medium)
            forest.end(lost, arriving * taken, emission[here])
            arriving = arriving * (1.0 - taken)
        rim = face == RIM
        if rim.any():
            held = lens.medium if level > 0 else scene.outside
            end = forest.add(
                parent[rim], place[rim], normal[rim], lens.object, triangle[rim], _ON_RIM, held
            )
            forest.end(end, arriving[rim], emission[here][rim])
        out = tree.flux[here, level]
        leaves, stays = (out > 0.0) & ~rim, ~rim
        # Light that meets a rarer glass may be reflected totally at once
        total = arriving[leaves] - out[leaves] <= 1e-14 * arriving[leaves]
        event = np.where(total, _TIR, _REFLECTED) if level == 0 else np.full(len(total), _THROUGH)
        exit_node[here[leaves], level] = forest.add(
            parent[leaves], place[leaves], normal[leaves], lens.object, triangle[leaves], event,
            scene.outside,
        )  # fmt: skip
        rest = np.maximum(arriving - out, 0.0)
        final = level == depth - 1
        through = _THROUGH if level == 0 else np.where(out > 0.0, _REFLECTED, _TIR)[stays]
        goes_on = forest.add(
            parent[stays], place[stays], normal[stays], lens.object, triangle[stays],
            _STOPPED if final else through, lens.medium,
        )  # fmt: skip
        if final:
            forest.end(goes_on, rest[stays], emission[here][stays])
        inner, inside = inner.copy(), inside.copy()
        inner[here[stays]] = goes_on
        inside[here] = np.where(rim, 0.0, rest)
    bright = exits.flux >= min_flux
    _stop_faint(scene, lens, tree, exits.ray[~bright], exits.level[~bright], exit_node, emission,
                exits.flux[~bright], forest)  # fmt: skip
    kept = exit_rays.where(bright)
    rows, columns = exits.ray[bright], exits.level[bright] - 1
    return kept, exit_node[rows, columns], emission[rows]


def _stop_faint(
    scene: LensScene, lens: SceneLens, tree: LensTree, row: Integers, level: Integers,
    exit_node: Integers, emission: Integers, flux: Real, forest: Forest,
) -> None:  # fmt: skip
    """End faint exits a step behind the face where they left."""
    if len(row) == 0:
        return
    at = (row, level - 1)
    place = tree.point[at] + 1e-3 * lens.lens.thickness * tree.direction[at]
    end = forest.add(exit_node[at], place, np.zeros_like(place), -1, -1, _STOPPED, scene.outside)
    forest.end(end, flux, emission[row])


def _normals(lens: SceneLens, place: Real, face: NDArray[np.int8]) -> Real:
    """(n, 3) outward unit normals of a lens."""
    frame, shape = lens.lens.frame, lens.lens.shape
    local = (place - frame[3]) @ frame[:3].T
    result = np.zeros_like(local)
    for which, curvature, vertex, sign in (
        (FRONT, shape.curvature_front, 0.0, -1.0),
        (BACK, shape.curvature_back, shape.thickness, 1.0),
    ):
        at = face == which
        x, y, z = local[at, 0], local[at, 1], local[at, 2] - vertex
        n = np.stack([-curvature * x, -curvature * y, 1.0 - curvature * z], axis=1)
        result[at] = sign * n / np.linalg.norm(n, axis=1, keepdims=True)
    at = face == RIM
    radial = local[at, :2] / np.linalg.norm(local[at, :2], axis=1, keepdims=True)
    result[at, :2] = radial
    return np.asarray(result @ frame[:3])


def drawn_at(seed: int, emission: Integers, place: Real) -> Real:
    """(n,) numbers, uniform on [0, 1), that an emission draws at each of its places (n, 3)."""
    bits = np.ascontiguousarray(place, np.float64).view(np.int64)
    drawn = np.empty(len(emission))
    _draw(seed ^ _SALT, np.asarray(emission, np.int64), bits, drawn)
    return drawn


@kernel
def _draw(seed: int, emission: Integers, bits: Integers, drawn: Real) -> None:
    """A stream of the emission, gone on by the bits of the coordinates."""
    for i in range(len(emission)):
        state = stream_state(seed, emission[i])
        for k in range(3):
            state = stream_state(state, bits[i, k])
        drawn[i] = uniform(advance(state))

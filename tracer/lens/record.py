"""Record a scene whose lenses are primitives: the branching tracer.

Every emission becomes all its branches: each is a ray of the map from the source to its end, with
its share of the flux as weight, and the column ``emission`` groups the branches of one emission.
Hits inside the lenses are recorded like any others, with the objects, faces and media of the
analog trace of the same scene, so both maps can be queried alike. Emissions draw the same numbers
as those of the analog trace, and what is drawn on the way depends on the emission alone. The column
``optical_path`` (n_records,) float32 is index times length from the emission to the record's point.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from raymap.encoding.encoder import PortionEncoder
from raymap.jit.kernels import kernel
from raymap.jit.types import F64, I64
from raymap.model.errors import SceneError
from raymap.model.events import Event
from raymap.model.portion import Descriptors, Portion
from raymap.model.schema import NORMAL_SCALE, UV_SCALE
from raymap.optics.frames import transverse_axes
from tracer.compiled import L_MEDIUM, SOURCE_ROW
from tracer.lens.branches import Forest, grow_forest
from tracer.lens.errors import LensError
from tracer.lens.scene_lenses import LensScene
from tracer.optics.polarization_rays import PolarizedRays
from tracer.rays.random import advance, stream_state, uniform
from tracer.run.recording import record
from tracer.run.trace import CompiledTrace
from tracer.scene.compilations import compilation_of
from tracer.scene.compile import Compilation
from tracer.scene.model import Scene
from tracer.scene.supported import refuse_weighting, require_plain_scene
from tracer.sources.emission import emit_ray, emitted_counts

__all__ = ["LensTracer", "LensTreeTrace", "TreeRecord", "lens_tree_trace", "record_lens_trees"]

Real = NDArray[np.float64]
Integers = NDArray[np.int64]

_EMITTED = int(Event.EMITTED)
_CROSSED = int(Event.DETECTOR_CROSSED)
_REGISTERED = int(Event.DETECTOR_REGISTERED)
_SALT = 0x1E45


@dataclass(frozen=True, kw_only=True)
class TreeRecord:
    """What a branching trace did: emissions, branches (rays of the map), records, and how the flux
    of every source ended, in emissions."""

    emissions: int
    rays: int
    records: int
    audit: dict[str, dict[str, float]]


class LensTracer:
    """Traces portions of a scene of lenses by their trees."""

    def __init__(
        self, compilation: Compilation, seed: int, *, depth: int = 8, min_flux: float = 1e-6
    ) -> None:
        if not 1 <= depth <= 1000:
            raise LensError(f"depth (dT) is {depth}: a tree has 1 to 1000 levels")
        if not 0.0 <= min_flux < 1.0:
            raise LensError(f"min_flux is {min_flux:g}: a share of the flux lies in 0 .. 1")
        self.compilation = compilation
        self.scene = LensScene.of(compilation)
        self.seed, self.depth, self.min_flux = seed, depth, min_flux

    def trace_counted(self, first_ray: int, n_rays: int) -> tuple[Portion, int]:
        """As `trace`, with the number of its records."""
        portion = self.trace(first_ray, n_rays)
        return portion, portion.n_records

    def trace(self, first_ray: int, n_rays: int, *, reuse: bool = False) -> Portion:
        """All branches of the emissions ``first_ray`` to ``first_ray + n_rays``.

        ``reuse`` changes nothing.
        """
        first, n = first_ray, n_rays
        arrays, channels = self.compilation.arrays, self.compilation.channel_set
        source = np.empty(n, np.int64)
        place, direction, normal = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
        channel, azimuth = np.empty(n, np.int64), np.empty(n)
        emit_all(
            arrays.source_i, arrays.source_f, arrays.pattern, self.seed, first, source, place,
            direction, normal, channel, azimuth,
        )  # fmt: skip
        x, y = transverse_axes(direction)
        vibration = np.cos(azimuth)[:, np.newaxis] * x + np.sin(azimuth)[:, np.newaxis] * y
        forest = Forest()
        root = forest.add(
            np.full(n, -1), place, normal, -1, -1, _EMITTED, arrays.source_i[source, L_MEDIUM]
        )
        for number, wavelength in enumerate(channels.wavelengths_nm):
            at = np.flatnonzero(channel == number)
            if len(at):
                rays = PolarizedRays.linear(
                    place[at], direction[at], vibration[at], wavelength_nm=wavelength
                )
                grow_forest(
                    self.scene, number, rays, root[at], at + first, forest, self.seed,
                    depth=self.depth, min_flux=self.min_flux,
                )  # fmt: skip
        return self._portion(forest, first, n, source, channel)

    def _portion(
        self, forest: Forest, first: int, n: int, source: Integers, channel: Integers
    ) -> Portion:  # fmt: skip
        nodes = forest.node_columns()
        leaf, flux, emission = (np.asarray(column) for column in forest.end_columns())
        order = np.lexsort((leaf, emission))
        leaf, flux, emission = leaf[order], flux[order], emission[order].astype(np.int64)
        lit = flux > 0.0
        leaf, flux, emission = leaf[lit], flux[lit], emission[lit]
        counts, rows = walk_to_roots(nodes[0].astype(np.int64), leaf.astype(np.int64))
        position, normal, obj, triangle, happened, medium = (column[rows] for column in nodes[1:])
        event: NDArray[np.int32] = happened.astype(np.int32)
        count, descriptors = self._crossings(counts, position.astype(np.float64), obj, event)
        branches = np.bincount(emission - first, minlength=n)
        if branches.max(initial=0) > LensTreeTrace.max_branches:
            raise LensError(
                f"an emission became {branches.max():,} rays; give trees a smaller depth, or stop "
                "branches earlier with min_flux"
            )
        index = np.arange(len(emission)) - np.repeat(np.cumsum(branches) - branches, branches)
        owner = source[emission - first]
        color = channel[emission - first]
        return Portion(
            emitted=emitted_counts(
                self.compilation.arrays.pattern, len(self.compilation.directory.sources), first, n
            ),
            source=owner.astype(np.int16),
            records_per_ray=counts.astype(np.int32),
            position=position.astype(np.float32),
            normal=np.round(normal.astype(np.float64) * NORMAL_SCALE).astype(np.int16),
            object=obj.astype(np.int16),
            triangle=triangle.astype(np.int32),
            event=event,
            medium=medium.astype(np.int16),
            color_code=np.repeat(color, counts).astype(np.int32),
            color_table=np.empty((0, self.compilation.channel_set.n_channels), np.uint16),
            descriptor_count=count,
            descriptors=descriptors,
            first_ray=first * LensTreeTrace.max_branches,
            ray_ids=emission * LensTreeTrace.max_branches + index,
            weight=flux.astype(np.float32),
            emission=emission * LensTreeTrace.max_branches,
            extra={"optical_path": self._paths(counts, position, medium, np.repeat(color, counts))},
        )

    def _paths(
        self, counts: Integers, position: NDArray[np.generic], medium: NDArray[np.generic],
        color: Integers,
    ) -> NDArray[np.float32]:  # fmt: skip
        """Optical path from the emission to every record."""
        index = np.array(self.compilation.channel_set.refractive_index)
        step = np.linalg.norm(np.diff(position.astype(np.float64), axis=0), axis=1)
        piece = np.concatenate([[0.0], step * index[medium[:-1].astype(np.int64), color[:-1]]])
        starts = np.cumsum(counts) - counts
        piece[starts] = 0.0
        total = np.cumsum(piece)
        return np.asarray(total - np.repeat(total[starts], counts), np.float32)

    def _crossings(
        self, counts: Integers, position: Real, obj: NDArray[np.generic], event: NDArray[np.int32]
    ) -> tuple[NDArray[np.uint16], Descriptors]:
        """Crossings of all segments and detectors; sets their bits in ``event``."""
        last = np.cumsum(counts) - 1
        segment = np.ones(len(position), np.bool_)
        segment[last] = False
        start = np.flatnonzero(segment)
        step = position[start + 1] - position[start]
        length = np.linalg.norm(step, axis=1)
        direction = step / np.where(length > 0.0, length, 1.0)[:, np.newaxis]
        found = []
        for plane in self.scene.planes:
            t, place, cosine = plane.meet(position[start], direction)
            blocked = plane.object >= 0
            ends_here = obj[start + 1] == plane.object
            met = ends_here & (t < np.inf) if blocked else (t <= length)
            registered = plane.registers(cosine)
            event[start[met]] |= _CROSSED
            event[start[met & registered]] |= _REGISTERED
            if blocked:
                event[start[met & registered] + 1] |= _REGISTERED
            rows = np.flatnonzero(met)
            found.append(
                (
                    start[rows], t[rows], np.full(len(rows), plane.number), place[rows],
                    cosine[rows], registered[rows],
                    np.minimum(place[rows] * plane.cells, plane.cells - 1).astype(np.uint16),
                )
            )  # fmt: skip
        if not found:
            found = [
                (np.empty(0, np.int64), np.empty(0), np.empty(0, np.int64), np.empty((0, 2)),
                 np.empty(0), np.empty(0, np.bool_), np.empty((0, 2), np.uint16))
            ]  # fmt: skip
        record, t, number, place, cosine, registered, cell = (
            np.concatenate(column) for column in zip(*found, strict=True)
        )
        order = np.lexsort((t, record))
        return (
            np.bincount(record.astype(np.int64), minlength=len(position)).astype(np.uint16),
            Descriptors(
                detector=number[order].astype(np.int16),
                cell=cell[order].astype(np.uint16),
                cosine=np.round(cosine[order] * NORMAL_SCALE).astype(np.int16),
                uv=np.round(place[order] * UV_SCALE).astype(np.uint16),
                registered=registered[order].astype(np.bool_),
            ),
        )


@dataclass(frozen=True, eq=False)
class LensTreeTrace(CompiledTrace):
    """A compiled scene whose lenses are primitives; attributes as of `tracer.run.trace.Trace`."""

    depth: int = 8
    min_flux: float = 1e-6

    max_branches: ClassVar[int] = 2**20
    most_rays: ClassVar[int] = 4096

    @property
    def limit(self) -> tuple[str, str]:
        return (
            f"trees of {self.depth} levels and branches below {self.min_flux:g} of their emission",
            "give trace.lens_trees more levels, or a smaller trace.min_flux",
        )

    @property
    def parameters(self) -> Mapping[str, Any]:
        return {"lens_trees": self.depth}

    def prepared(self, encoder: PortionEncoder | None, threads: int) -> LensTreeTrace:
        require_plain_scene(self.compilation, "the tracer of whole lenses")
        refuse_weighting(self.scene, "the tracer of whole lenses")
        _refuse_polarised_sources(self.compilation)
        self.engine(1)  # refuses scenes of other than lenses
        _warn_of_depth(self.compilation, self.depth)
        return self

    def engine(self, seed: int) -> LensTracer:
        return LensTracer(self.compilation, seed, depth=self.depth, min_flux=self.min_flux)

    def pinholes(self) -> None:
        return None


def lens_tree_trace(scene: Scene | Compilation) -> LensTreeTrace:
    """The trace of a scene with ``[trace] lens_trees``."""
    compilation = compilation_of(scene)
    given = compilation.scene.trace
    assert given.lens_trees is not None
    return LensTreeTrace(compilation, given.lens_trees, given.min_flux)


def record_lens_trees(
    scene: str | Path | Scene | Compilation,
    path: str | Path,
    *,
    emissions: int = 10_000,
    depth: int = 8,
    min_flux: float = 1e-6,
    **options: Any,
) -> TreeRecord:
    """Record a scene of lenses, sources and detectors, the lenses as primitives.

    Parameters
    ----------
    scene : a scene file, a `Scene`, or a compilation
    path : of the map
    emissions : how many rays the sources send
    depth : of every lens tree
    min_flux : a branch below this share of its emission is stopped
    options : as of `tracer.run.recording.record`

    Raises
    ------
    LensError, SceneError, MapExists
    """
    if emissions < 1:
        raise SceneError(f"emissions must be at least 1, not {emissions}")
    trace = LensTreeTrace(compilation_of(scene), depth, min_flux)
    done = record(trace, path, rays=emissions, **options)
    return TreeRecord(emissions=emissions, rays=done.rays, records=done.records, audit=done.audit)


def _refuse_polarised_sources(compilation: Compilation) -> None:
    """Refuse light of a given vibration: trees start from natural light.

    Raises
    ------
    SceneError
    """
    scene = compilation.scene
    for name, source in scene.sources.items():
        if source.on and source.polarisation is not None:
            raise SceneError(
                f"{scene.origin}: sources.{name}.polarisation: the tracer of whole lenses starts "
                "with natural light; leave it out, or record without lens trees"
            )


def _warn_of_depth(compilation: Compilation, depth: int) -> None:
    """Say that a limit of the scene counts something else than levels of a tree."""
    scene = compilation.scene
    if scene.limits.depth < type(scene.limits)().depth:
        warnings.warn(
            f"{scene.origin}: limits.depth = {scene.limits.depth} has no effect on lenses as "
            f"primitives: each is left after {depth} levels (depth of the trees)",
            stacklevel=3,
        )


@kernel
def emit_all(
    source_i: I64, source_f: F64, pattern: I64, seed: int, first: int, source: Integers,
    place: Real, direction: Real, normal: Real, channel: Integers, azimuth: Real,
) -> None:  # fmt: skip
    """Emit rays as the analog engine does; draw a channel and the azimuth of a linear state."""
    n_channels = source_f.shape[1] - SOURCE_ROW
    for i in range(len(source)):
        s, x, y, z, dx, dy, dz, _ = emit_ray(source_i, source_f, pattern, seed, first + i)
        source[i] = s
        place[i, 0], place[i, 1], place[i, 2] = x, y, z
        direction[i, 0], direction[i, 1], direction[i, 2] = dx, dy, dz
        normal[i, 0], normal[i, 1], normal[i, 2] = (
            source_f[s, 18],
            source_f[s, 19],
            source_f[s, 20],
        )
        state = advance(stream_state(seed ^ _SALT, first + i))
        azimuth[i] = 2.0 * np.pi * uniform(state)
        u = uniform(advance(state))
        total = 0.0
        channel[i] = n_channels - 1
        for k in range(n_channels):
            total += source_f[s, SOURCE_ROW + k]
            if u < total:
                channel[i] = k
                break


@kernel
def walk_to_roots(parent: Integers, leaf: Integers) -> tuple[Integers, Integers]:
    """Nodes from the root to each leaf: how many, and all of them one leaf after the other."""
    counts = np.zeros(len(leaf), np.int64)
    for i in range(len(leaf)):
        node = leaf[i]
        while node >= 0:
            counts[i] += 1
            node = parent[node]
    rows = np.empty(counts.sum(), np.int64)
    end = 0
    for i in range(len(leaf)):
        end += counts[i]
        node = leaf[i]
        k = end - 1
        while node >= 0:
            rows[k] = node
            k -= 1
            node = parent[node]
    return counts, rows

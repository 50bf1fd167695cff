"""The engine: portions of rays, traced block after block in step.

Compiled code does all the work per ray; Python only grows buffers and starts the next block. Every
worker thread has its own buffers, and the interpreter lock is released while rays are traced.
"""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.jit.compiling import Task, address_of, call_at, task
from raymap.jit.kernels import lean_kernel
from raymap.jit.types import I64
from raymap.laws.amplitudes import all_drawn
from raymap.laws.phase import RAYLEIGH
from raymap.model.portion import Descriptors as DescriptorColumns
from raymap.model.portion import Portion
from tracer.compiled import F_KIND, R_RAYS, R_SPLITS, CompiledScene, Faces
from tracer.detectors.linking import detector_tasks, link_detectors
from tracer.geometry.other_shapes import link_shapes, shape_tasks
from tracer.rays.colors import COLORS
from tracer.sources.emission import emitted_counts
from tracer.sources.linking import link_sources, source_tasks
from tracer.surfaces.linking import link_surfaces, surface_tasks
from tracer.transport.buffers import (
    COUNTING,
    DESCRIPTORS,
    LEFT_OUT,
    LIVE,
    RECORDS,
    Buffers,
    Workspace,
)
from tracer.transport.carried import carried_tasks, link_carried
from tracer.transport.interact import emit_block, interact, place_block
from tracer.transport.intersect import nearest_hits
from tracer.transport.splitting import SplitRays, has_room, make_split_rays, start_emissions, widen
from tracer.transport.store import Columns, store_block
from tracer.transport.store_split import order_split_block, store_split_block

if TYPE_CHECKING:
    from tracer.geometry.mesh_arrays import MeshArrays, MeshScratch
    from tracer.scene.meshes import SceneMeshes

__all__ = ["BLOCK", "Wavefront", "run_steps"]

BLOCK = 4096
"""Rays traced in step; their state fits the second-level cache."""

_SPLIT_BLOCK = 16_384
_STREAMS = 0x5851F42D4C957F2D
_WORD = 2**63 - 1

_RAYS, _RECORDS, _DESCRIPTORS, _COLORS = range(4)


class Stages(NamedTuple):
    """Where `nearest_hits`, `interact`, `nearest_on_solids` and `emit_block` are in memory.

    0 where there are no meshes, and while only given rays were traced.
    """

    hits: int
    interact: int
    solids: int
    emit: int


class Solids(NamedTuple):
    """The first arguments of `nearest_on_solids`."""

    arrays: MeshArrays
    first_face: I64
    scratch: MeshScratch


@lean_kernel
def run_steps(
    stages: Stages, scene: CompiledScene, faces: Faces, meshes: Solids | None, b: Buffers,
    split: SplitRays | None, follow: int, seed: int, first_ray: int, n_rays: int,
) -> bool:  # fmt: skip
    """Trace until no ray is alive (True) or a buffer could overflow in the next step (False).

    Begins with ``n_rays`` new ones, with 0 goes on with those that are alive.
    """
    counters = b.counters
    if n_rays > 0:
        call_at(stages.emit, (scene, seed, first_ray, n_rays, b))
        if split is not None:
            start_emissions(split, n_rays, counters)
    crossings = len(scene.detector_i) + 1
    refract = follow == 0 and meshes is None and scene.carried is None
    while counters[LIVE] > 0:
        n = counters[LIVE]
        if not has_room(split, b, n, crossings):
            return False
        call_at(stages.hits, (faces, b, n, refract))
        if meshes is not None:
            call_at(stages.solids, (meshes.arrays, meshes.first_face, meshes.scratch, b, n))
        call_at(stages.interact, (scene, b, split, follow))
    return True


class Wavefront:
    """Traces portions of one compiled scene; safe to call from many threads.

    Parameters
    ----------
    scene : the compiled scene
    seed : of all random numbers
    meshes : the scene's triangle meshes, if it has any
    block : rays traced in step
    exact : keep the positions in float64 as an extra column ``exact``
    weighted : trace as the scene's settings of variance reduction say, if it has any; otherwise
        every ray weighs the same

    Attributes
    ----------
    max_branches : rays that an emission may become; emission e has the ray numbers from
        e · max_branches on
    """

    def __init__(
        self,
        scene: CompiledScene,
        seed: int,
        *,
        meshes: SceneMeshes | None = None,
        block: int = BLOCK,
        exact: bool = False,
        weighted: bool = False,
    ) -> None:
        self.meshes = meshes
        self.scene = scene._replace(
            reduction=scene.reduction if weighted else None,
            surface_i=scene.surface_i.copy(),
            source_i=scene.source_i.copy(),
            detector_i=scene.detector_i.copy(),
            carried=scene.carried and scene.carried._replace(calls=scene.carried.calls.copy()),
        )
        self.faces = self.scene.faces
        self.weighed = self.scene.reduction is not None or _states_weigh(self.scene)
        self.exact = exact
        reduction = self.scene.reduction
        self.splits = reduction is not None and reduction.settings[R_SPLITS] > 0.0
        self.max_branches = (
            int(reduction.settings[R_RAYS]) if reduction is not None and self.splits else 1
        )
        # Emissions have numbers of their own where they split, so they take streams of their own
        self.seed, self.block = seed, block
        if self.max_branches > 1:
            self.seed = (seed + self.max_branches * _STREAMS) & _WORD
            self.block = max(16, _SPLIT_BLOCK // self.max_branches)
        self._local = threading.local()

    def trace(self, first_ray: int, n_rays: int, *, reuse: bool = False) -> Portion:
        """Trace the rays (the emissions, where they split) first_ray to first_ray + n_rays.

        With ``reuse`` the columns are views of this thread's buffers, valid until its next call.
        """
        return self._trace(first_ray, n_rays, reuse=reuse, counted=False)[0]

    def trace_counted(self, first_ray: int, n_rays: int) -> tuple[Portion, int]:
        """As `trace`, for counting only: most records are left out.

        Kept are the records at which rays end and those with descriptors. Returns the portion,
        valid until the next call, and how many records there were.
        """
        return self._trace(first_ray, n_rays, reuse=True, counted=not self.splits)

    def _trace(
        self, first_ray: int, n_rays: int, *, reuse: bool, counted: bool
    ) -> tuple[Portion, int]:
        workspace, assembly = self._buffers()
        counters = workspace.buffers.counters
        counters[COUNTING], counters[LEFT_OUT] = int(counted), 0
        records = 0
        assembly.start(n_rays)
        for start in range(0, n_rays, self.block):
            n = min(self.block, n_rays - start)
            self._run(workspace, 0, first_ray + start, n)
            records += int(counters[RECORDS])
            if self.splits:
                assembly.store_split(workspace, self._local.split_rays, n)
            else:
                assembly.store(workspace, n, counted=counted)
        emitted = emitted_counts(self.scene.pattern, len(self.scene.source_i), first_ray, n_rays)
        portion = assembly.portion(emitted, self.scene, first_ray, copy=not reuse)
        if self.weighed:
            portion = self._weighed(portion, assembly, first_ray, n_rays)
        return portion, records + int(counters[LEFT_OUT]) if counted else portion.n_records

    def _weighed(
        self, portion: Portion, assembly: _Assembly, first_ray: int, n_rays: int
    ) -> Portion:
        """The portion with weights, and with numbers and emissions of rays where they split."""
        weight = assembly.columns.weight[: portion.n_rays].astype(np.float32)
        if not self.splits:
            return replace(portion, weight=weight)
        of_ray = np.repeat(np.arange(n_rays), assembly.counts())
        index = np.arange(portion.n_rays) - np.repeat(
            np.cumsum(assembly.counts()) - assembly.counts(), assembly.counts()
        )
        emission = (first_ray + of_ray) * self.max_branches
        owners = self.scene.pattern[(first_ray + of_ray) % len(self.scene.pattern)]
        return replace(
            portion,
            source=owners.astype(np.int16),
            first_ray=first_ray * self.max_branches,
            ray_ids=emission + index,
            emission=emission,
            weight=weight,
        )

    def trace_given(
        self, origins: NDArray[np.float64], directions: NDArray[np.float64], *, follow: int = 0
    ) -> Portion:
        """Trace given rays, (n, 3) each, of the first channel, from the world medium.

        Raises
        ------
        ValueError
            to follow the transmitted ray where crystals may send on two
        """
        if follow != 0 and self.scene.carried is not None:
            raise ValueError("a crystal sends on two rays: none of them is the transmitted one")
        workspace, assembly = self._buffers()
        workspace.buffers.counters[COUNTING] = 0
        assembly.start(len(origins))
        for start in range(0, len(origins), self.block):
            n = min(self.block, len(origins) - start)
            place_block(self.scene, self.seed, start, n, origins, directions, workspace.buffers)
            self._run(workspace, follow)
            assembly.store(workspace, n)
        emitted = np.zeros(len(self.scene.source_i), np.int64)
        emitted[0] = len(origins)
        portion = assembly.portion(emitted, self.scene, 0, copy=True)
        return replace(portion, source=np.zeros(len(origins), np.int16))

    def _run(self, workspace: Workspace, follow: int, first_ray: int = 0, n_rays: int = 0) -> None:
        stages = self._stages(workspace.buffers, emits=n_rays > 0)
        while not run_steps(
            stages, self.scene, self.faces, self._solids(), workspace.buffers, self._split_rays(),
            follow, self.seed, first_ray, n_rays,
        ):  # fmt: skip
            n_rays = 0
            workspace.make_room(self.scene)
            if self.splits:
                self._local.split_rays = widen(workspace, self._local.split_rays)

    def tasks(self) -> list[Task]:
        """What is to be compiled before rays can be traced, the longest task first."""
        workspace, assembly = self._buffers()
        b, filled, few = workspace.buffers, assembly.filled, np.empty(0, np.int32)
        return [
            *self._stage_tasks(b),
            self._emission(b),
            *surface_tasks(self.scene.surface_i, weighed=self.scene.reduction is not None),
            *source_tasks(self.scene.source_i),
            *detector_tasks(self.scene.detector_i),
            *carried_tasks(self.scene.carried),
            *shape_tasks(self.scene.face_i[:, F_KIND]),
            task(store_block, 0, 0, b, assembly.columns, filled, few, few, False),
            task(
                run_steps, Stages(0, 0, 0, 0), self.scene, self.faces, self._solids(), b,
                self._split_rays(), 0, 0, 0, 0,
            ),
        ]  # fmt: skip

    def _stage_tasks(self, b: Buffers) -> list[Task]:
        """The stages of a step in the order of `Stages`."""
        tasks = [
            task(nearest_hits, self.faces, b, 0, True),
            task(interact, self.scene, b, self._split_rays(), 0),
        ]
        solids = self._solids()
        if solids is not None:
            from tracer.transport.meshes import nearest_on_solids

            tasks.append(task(nearest_on_solids, *solids, b, 0))
        return tasks

    def _solids(self) -> Solids | None:
        """What finds the nearest triangle; the scratch is this thread's own."""
        if self.meshes is None:
            return None
        if not hasattr(self._local, "solids"):
            from tracer.geometry.mesh_arrays import mesh_scratch

            arrays, first_face = self.meshes.arrays, self.meshes.first_face
            self._local.solids = Solids(arrays, first_face, mesh_scratch())
        return self._local.solids  # type: ignore[no-any-return]

    def _emission(self, b: Buffers) -> Task:
        return task(emit_block, self.scene, 0, 0, 0, b)

    def _stages(self, b: Buffers, *, emits: bool) -> Stages:
        if not hasattr(self._local, "stages"):
            link_surfaces(self.scene.surface_i, weighed=self.scene.reduction is not None)
            link_sources(self.scene.source_i)
            link_detectors(self.scene.detector_i)
            link_carried(self.scene.carried)
            link_shapes(self.scene.face_i[:, F_KIND], self.scene.face_f)
            addresses = [address_of(item) for item in self._stage_tasks(b)]
            self._local.stages = Stages(*addresses, *[0] * (4 - len(addresses)))
        if emits and not self._local.stages.emit:
            emission = address_of(self._emission(b))
            self._local.stages = self._local.stages._replace(emit=emission)
        return self._local.stages  # type: ignore[no-any-return]

    def _split_rays(self) -> SplitRays | None:
        return self._local.split_rays if self.splits else None

    def _buffers(self) -> tuple[Workspace, _Assembly]:
        if not hasattr(self._local, "workspace"):
            self._local.workspace = Workspace.create(self.scene, self.block, exact=self.exact)
            self._local.assembly = _Assembly(self.scene, exact=self.exact)
            if self.splits:
                self._local.split_rays = make_split_rays(self.block, self.block)
        return self._local.workspace, self._local.assembly


def _states_weigh(scene: CompiledScene) -> bool:
    """Whether the states that rays carry change their weights."""
    if scene.carried is None:
        return False
    phases = scene.medium_f[:, 3 * scene.n_channels]
    scatters = scene.medium_f[:, 2 * scene.n_channels : 3 * scene.n_channels].max(axis=1) > 0.0
    return not all_drawn(scene.carried.laws) or bool(np.any(scatters & (phases == RAYLEIGH)))


class _Assembly:
    """Columns of the portion under construction."""

    def __init__(self, scene: CompiledScene, *, exact: bool) -> None:
        self.n_sources, self.n_channels = len(scene.source_i), scene.n_channels
        self.exact = exact
        self.filled = np.zeros(4, np.int64)
        self._planned = 0
        self._counts: list[NDArray[np.int32]] = []
        self.columns = self._allocate(0, 0, 0, 0)

    def _allocate(self, rays: int, records: int, descriptors: int, colors: int) -> Columns:
        return Columns(
            records_per_ray=np.empty(rays, np.int32),
            weight=np.empty(rays),
            position=np.empty((records, 3), np.float32),
            normal=np.empty((records, 3), np.int16),
            object=np.empty(records, np.int16),
            triangle=np.empty(records, np.int32),
            event=np.empty(records, np.int32),
            medium=np.empty(records, np.int16),
            color_code=np.empty(records, np.int32),
            descriptor_count=np.empty(records, np.uint16),
            detector=np.empty(descriptors, np.int16),
            cell=np.empty((descriptors, 2), np.uint16),
            cosine=np.empty(descriptors, np.int16),
            uv=np.empty((descriptors, 2), np.uint16),
            registered=np.empty(descriptors, np.bool_),
            color_table=np.empty((colors, self.n_channels), np.uint16),
            exact=np.empty((records if self.exact else 0, 3)),
        )

    def start(self, n_rays: int) -> None:
        self.filled[:] = 0
        self._planned = n_rays
        self._counts.clear()
        self._reserve(n_rays, 0, 0, self.n_sources)

    def store(self, workspace: Workspace, n: int, *, counted: bool = False) -> None:
        """Append the finished block of ``n`` rays, as `store_block` does."""
        counters = workspace.buffers.counters
        self._reserve(
            int(self.filled[_RAYS]) + n,
            int(self.filled[_RECORDS] + counters[RECORDS]),
            int(self.filled[_DESCRIPTORS] + counters[DESCRIPTORS]),
            int(max(self.filled[_COLORS], self.n_sources) + counters[COLORS]),
        )
        store_block(
            n, self.n_sources, workspace.buffers, self.columns, self.filled,
            np.empty(int(counters[COLORS]), np.int32), np.empty(int(counters[RECORDS]), np.int32),
            counted,
        )  # fmt: skip

    def store_split(self, workspace: Workspace, split: SplitRays, n: int) -> None:
        """Append a finished block of ``n`` emissions that have split into rays."""
        b = workspace.buffers
        block = order_split_block(b, split, n)
        self._reserve(
            int(self.filled[_RAYS]) + len(block.ray),
            int(self.filled[_RECORDS]) + len(block.order),
            int(self.filled[_DESCRIPTORS]) + block.n_descriptors,
            int(max(self.filled[_COLORS], self.n_sources) + b.counters[COLORS]),
        )
        store_split_block(block, b, self.n_sources, self.columns, self.filled)
        self._counts.append(split.emitted[:n].copy())

    def counts(self) -> NDArray[np.int32]:
        """Rays of every emission."""
        return np.concatenate(self._counts)

    def _reserve(self, rays: int, records: int, descriptors: int, colors: int) -> None:
        old = self.columns
        have = (len(old.weight), len(old.event), len(old.detector), len(old.color_table))
        need = (rays, records, descriptors, colors)
        if all(n <= h for n, h in zip(need, have, strict=True)):
            return
        # Expect of the blocks to come what those so far have brought
        share = max(1.0, self._planned / max(rays, 1))
        sizes = [
            h if n <= h else int(1.125 * share * n) + 1 for n, h in zip(need, have, strict=True)
        ]
        grown: list[Any] = []
        pairs: Any = zip(self._allocate(*sizes), old, strict=True)
        for new, previous in pairs:
            if len(new) > len(previous):
                new[: len(previous)] = previous
            grown.append(new if len(new) > len(previous) else previous)
        self.columns = Columns(*grown)

    def portion(
        self, emitted: NDArray[np.int64], scene: CompiledScene, first_ray: int, *, copy: bool
    ) -> Portion:
        c = self.columns
        n_rays, n_records, n_descriptors, n_colors = (int(n) for n in self.filled)

        def cut(array: Any, n: int) -> Any:
            return array[:n].copy() if copy else array[:n]

        places = np.arange(first_ray, first_ray + n_rays) % len(scene.pattern)
        return Portion(
            emitted=emitted,
            source=scene.pattern[places].astype(np.int16),
            records_per_ray=cut(c.records_per_ray, n_rays),
            position=cut(c.position, n_records),
            normal=cut(c.normal, n_records),
            object=cut(c.object, n_records),
            triangle=cut(c.triangle, n_records),
            event=cut(c.event, n_records),
            medium=cut(c.medium, n_records),
            color_code=cut(c.color_code, n_records),
            color_table=cut(c.color_table, n_colors),
            descriptor_count=cut(c.descriptor_count, n_records),
            descriptors=DescriptorColumns(
                detector=cut(c.detector, n_descriptors),
                cell=cut(c.cell, n_descriptors),
                cosine=cut(c.cosine, n_descriptors),
                uv=cut(c.uv, n_descriptors),
                registered=cut(c.registered, n_descriptors),
            ),
            first_ray=first_ray,
            extra={"exact": cut(c.exact, n_records)} if self.exact else {},
        )

"""The analog engine: portions of rays, traced block after block in step.

Compiled code does all the work per ray; Python only grows buffers and starts the next block. Every
worker thread has its own buffers, and the interpreter lock is released while rays are traced.
"""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from raymap.kernels import lean_kernel
from raymap.portion import Descriptors as DescriptorColumns
from raymap.portion import Portion
from tracer.engine.buffers import COLORS, DESCRIPTORS, LIVE, RECORDS, Buffers, Workspace
from tracer.engine.interact import emit_block, interact, place_block
from tracer.engine.intersect import nearest_hits
from tracer.engine.store import Columns, store_block
from tracer.scene.arrays import CompiledScene
from tracer.sources import emitted_counts

if TYPE_CHECKING:
    from tracer.scene.meshes import SceneMeshes

__all__ = ["BLOCK", "Wavefront", "run_steps"]

BLOCK = 4096
"""Rays traced in step; their state fits the second-level cache."""

_RAYS, _RECORDS, _DESCRIPTORS, _COLORS = range(4)


@lean_kernel
def run_steps(scene: CompiledScene, b: Buffers, follow: int) -> bool:
    """Trace until no ray is alive (True) or a buffer could overflow in the next step (False)."""
    counters = b.counters
    meetings = len(scene.detector_i) + 1
    while counters[LIVE] > 0:
        n = counters[LIVE]
        if (
            counters[RECORDS] + n > len(b.words)
            or counters[DESCRIPTORS] + n * meetings > len(b.meeting_t)
            or counters[COLORS] + 4 * n > len(b.colors)
        ):
            return False
        nearest_hits(
            scene.face_i, scene.face_f, scene.pool, scene.first, scene.face, scene.distance,
            b.live_f, b.live_i, n, b.bundle_f, b.bundle_i, b.bins,
        )  # fmt: skip
        interact(scene, b, follow)
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
    """

    def __init__(
        self,
        scene: CompiledScene,
        seed: int,
        *,
        meshes: SceneMeshes | None = None,
        block: int = BLOCK,
        exact: bool = False,
    ) -> None:
        self.meshes = meshes
        self.scene = scene
        self.seed = seed
        self.block = block
        self.exact = exact
        self._local = threading.local()

    def trace(self, first_ray: int, n_rays: int, *, reuse: bool = False) -> Portion:
        """Trace the rays ``first_ray`` to ``first_ray + n_rays``.

        With ``reuse`` the columns are views of this thread's buffers, valid until its next call.
        """
        workspace, assembly = self._buffers()
        assembly.start(n_rays)
        for start in range(0, n_rays, self.block):
            n = min(self.block, n_rays - start)
            emit_block(self.scene, self.seed, first_ray + start, n, workspace.buffers)
            self._run(workspace, 0)
            assembly.store(workspace, n)
        emitted = emitted_counts(self.scene.pattern, len(self.scene.source_i), first_ray, n_rays)
        return assembly.portion(emitted, self.scene, first_ray, copy=not reuse)

    def trace_given(
        self, origins: NDArray[np.float64], directions: NDArray[np.float64], *, follow: int = 0
    ) -> Portion:
        """Trace given rays, (n, 3) each, of the first channel, from the world medium."""
        workspace, assembly = self._buffers()
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

    def _run(self, workspace: Workspace, follow: int) -> None:
        if self.meshes is None:
            while not run_steps(self.scene, workspace.buffers, follow):
                workspace.make_room(self.scene)
            return
        from tracer.engine.meshes import run_mesh_steps
        from tracer.geometry.mesh_hits import mesh_scratch

        if not hasattr(self._local, "scratch"):
            self._local.scratch = mesh_scratch()
        while not run_mesh_steps(
            self.scene, self.meshes.arrays, self.meshes.first_face, self._local.scratch,
            workspace.buffers, follow,
        ):  # fmt: skip
            workspace.make_room(self.scene)

    def _buffers(self) -> tuple[Workspace, _Assembly]:
        if not hasattr(self._local, "workspace"):
            self._local.workspace = Workspace.create(self.scene, self.block, exact=self.exact)
            self._local.assembly = _Assembly(self.scene, exact=self.exact)
        return self._local.workspace, self._local.assembly


class _Assembly:
    """Columns of the portion under construction."""

    def __init__(self, scene: CompiledScene, *, exact: bool) -> None:
        self.n_sources, self.n_channels = len(scene.source_i), scene.n_channels
        self.exact = exact
        self.filled = np.zeros(4, np.int64)
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
        self._reserve(n_rays, 0, 0, self.n_sources)

    def store(self, workspace: Workspace, n: int) -> None:
        """Append the finished block of ``n`` rays."""
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
        )  # fmt: skip

    def _reserve(self, rays: int, records: int, descriptors: int, colors: int) -> None:
        old = self.columns
        have = (len(old.weight), len(old.event), len(old.detector), len(old.color_table))
        need = (rays, records, descriptors, colors)
        if all(n <= h for n, h in zip(need, have, strict=True)):
            return
        sizes = [h if n <= h else n + n // 2 for n, h in zip(need, have, strict=True)]
        self.columns = self._allocate(*sizes)
        pairs: Any = zip(self.columns, old, strict=True)
        for new, previous in pairs:
            new[: len(previous)] = previous

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

"""Natural light, analog or weighted: the wavefront as a trace that can be recorded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from raymap.encoding.encoder import PortionEncoder
from raymap.model.portion import Portion
from raymap.model.schema import PORTION_RAYS
from raymap.optics.cells import is_pinhole
from tracer.run.results import depth_limit
from tracer.run.trace import CompiledTrace, Trace
from tracer.run.warm_up import compile_trace, order_faces
from tracer.scene.supported import warn_of_polarised_light
from tracer.transport.source_check import check_sources
from tracer.transport.wavefront import Wavefront

if TYPE_CHECKING:
    from tracer.transport.pinhole import Pinholes

__all__ = ["NaturalTrace"]


@dataclass(frozen=True, eq=False)
class NaturalTrace(CompiledTrace):
    """A compiled scene in natural light; attributes as of `tracer.run.trace.Trace`."""

    @property
    def most_rays(self) -> int:
        return PORTION_RAYS

    @property
    def limit(self) -> tuple[str, str]:
        return depth_limit(self.scene.limits.depth)

    @property
    def parameters(self) -> Mapping[str, Any]:
        return {}

    def prepared(self, encoder: PortionEncoder | None, threads: int) -> Trace:
        compile_trace(self.compilation, encoder, threads)
        check_sources(self.compilation)
        warn_of_polarised_light(self.compilation)
        return NaturalTrace(order_faces(self.compilation))

    def engine(self, seed: int) -> _NaturalEngine:
        compilation = self.compilation
        return _NaturalEngine(
            Wavefront(compilation.arrays, seed, meshes=compilation.solids, weighted=True)
        )

    def pinholes(self) -> Pinholes | None:
        if not any(is_pinhole(item) for item in self.directory.detectors):
            return None
        from tracer.transport.pinhole import Pinholes

        return Pinholes(self.compilation)


@dataclass(frozen=True, eq=False)
class _NaturalEngine:
    """A wavefront whose normals are those that the faces imply, bit for bit."""

    wavefront: Wavefront

    def trace(self, first_ray: int, n_rays: int, *, reuse: bool = False) -> Portion:
        portion = self.wavefront.trace(first_ray, n_rays, reuse=reuse)
        return replace(portion, implied_normals=True)

    def trace_counted(self, first_ray: int, n_rays: int) -> tuple[Portion, int]:
        return self.wavefront.trace_counted(first_ray, n_rays)

"""Record a scene with polarised light.

The map has what any map has, weights, and two further columns:

``stokes`` (n_records, 3) float32 : s1, s2, s3 over s0 of the segment that starts at the record. The
    axis x is the world's x axis made perpendicular to the ray (the world's y axis where the ray
    runs within 0.8 degrees of x), y = d x x; s3 > 0 is right-handed (`tracer.optics.polarization`)
``optical_path`` (n_records,) float32 : index times length from the emission to the record's point
    [scene units]; float64 together with ``phase``
``phase`` (n_records,) float32, if asked for : phase of the field along x by interfaces [rad],
    without that of the path; along y where the field has no x
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from raymap.encoding.encoder import PortionEncoder
from raymap.laws.amplitudes import Amplitudes, amplitudes_of_laws
from raymap.laws.stored import laws_of
from raymap.laws.table import TableLaw
from raymap.model.errors import SceneError
from raymap.model.portion import Portion
from raymap.model.schema import PORTION_RAYS
from raymap.optics.cells import is_pinhole
from tracer.compiled import F_KIND, F_OBJECT, F_TRIANGLE, SINGLE
from tracer.geometry.kinds import MESH
from tracer.polarized.transport import (
    FacesByNumber,
    PolarizedColumns,
    RayColumns,
    polarize_rays,
)
from tracer.run.recording import record
from tracer.run.results import RecordResult, depth_limit
from tracer.run.trace import CompiledTrace
from tracer.scene.compilations import compilation_of
from tracer.scene.compile import Compilation
from tracer.scene.model import Scene
from tracer.surfaces.surface import axis_of
from tracer.transport.source_check import check_sources
from tracer.transport.wavefront import Wavefront

if TYPE_CHECKING:
    from tracer.transport.pinhole import Pinholes

__all__ = [
    "Polarization",
    "PolarizedTrace",
    "PolarizedWavefront",
    "polarized_trace",
    "record_polarized",
]

Vector = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Polarization:
    """What is polarised in a scene.

    Attributes
    ----------
    states : of light that has no state yet (unpolarised sources, after diffuse, glossy and volume
        events): "linear" draws the azimuth of one linear wave for every ray; "natural" carries both
        halves of natural light along, so that a ray has a degree of polarisation of its own and
        fluxes have a smaller error
    sources : vibration of polarised sources by name, in place of ``polarisation`` in the scene; its
        part across the ray counts
    phases : also store the phase that interfaces give, and optical paths in float64, so that fields
        can be added
    """

    states: Literal["linear", "natural"] = "linear"
    sources: Mapping[str, Vector] = field(default_factory=dict)
    phases: bool = False

    @classmethod
    def of(cls, scene: Scene) -> Polarization:
        """What the scene's table ``[trace]`` says of polarised light."""
        given = scene.trace
        return cls(states=given.states, phases=given.phases)

    def faces_of(self, compilation: Compilation) -> FacesByNumber:
        """Look all faces, sources and laws up.

        Raises
        ------
        SceneError
            a source that the scene does not have, an axis of length zero, an unknown kind of states
        """
        if self.states not in ("linear", "natural"):
            raise SceneError(f"states is {self.states!r}: choose linear or natural")
        directory, arrays = compilation.directory, compilation.arrays
        first = np.zeros(len(directory.objects) + 1, np.int64)
        for number, item in enumerate(directory.objects):
            first[number + 1] = sum(face.primitive_count for face in item.faces)
        first = np.cumsum(first)
        face = np.full(int(first[-1]), -1, np.int64)
        for row in range(len(arrays.face_i)):
            met, triangle = arrays.face_i[row, F_OBJECT], arrays.face_i[row, F_TRIANGLE]
            if met >= 0:
                face[first[met] + triangle] = row
        if compilation.solids is not None:
            _name_triangles(face, first, compilation)

        names = [source.name for source in directory.sources]
        vibration = np.zeros((len(names), 3))
        own = {
            name: source.polarisation
            for name, source in compilation.scene.sources.items()
            if source.on and source.polarisation is not None
        }
        for name, axis in (own | dict(self.sources)).items():
            if name not in names:
                raise SceneError(
                    f"sources: the scene has no source {name!r}; sources: {', '.join(names)}"
                )
            vibration[names.index(name)] = axis_of(axis, f"sources.{name}")
        return FacesByNumber(first, face, vibration, _laws(compilation))


def _laws(compilation: Compilation) -> Amplitudes:
    """What the surfaces of a scene do to polarised light."""
    directory, channel_set = compilation.directory, compilation.channel_set
    stated = laws_of(directory, channel_set)
    surfaces = (None,) * len(directory.surfaces) if stated is None else stated.surfaces
    return amplitudes_of_laws(surfaces, channel_set)


class UnpolarisedSurface(UserWarning):
    """A surface treats polarised light by less than is known of real ones."""


def _warn_of_surfaces(compilation: Compilation) -> None:
    """Say which surfaces treat s and p alike, or depolarise, for want of a law.

    Warns
    -----
    UnpolarisedSurface
    """
    directory = compilation.directory
    stated = laws_of(directory, compilation.channel_set)
    used = {face.surface for item in directory.objects for face in item.faces}
    for k, surface in enumerate(directory.surfaces):
        if k not in used:
            continue
        where = f"{compilation.scene.origin}: surfaces.{surface.name}"
        law = None if stated is None else stated.surfaces[k]
        if law is None:
            warnings.warn(
                f"{where}: its law is not known to polarised light: what leaves it counts as "
                "unpolarised",
                UnpolarisedSurface,
                stacklevel=4,
            )
        elif isinstance(law, TableLaw) and len(law.angle_deg) > 1 and not law.reflectance_s:
            warnings.warn(
                f"{where}.coating: its table is of natural light, so s and p are treated alike; "
                "give reflectance_s, reflectance_p, transmittance_s and transmittance_p",
                UnpolarisedSurface,
                stacklevel=4,
            )


def _name_triangles(
    face: NDArray[np.int64], first: NDArray[np.int64], compilation: Compilation
) -> None:
    """Give every triangle of a mesh the row of its named face."""
    arrays, table = compilation.arrays, compilation.directory.faces
    for row in np.flatnonzero(arrays.face_i[:, F_KIND] == MESH).tolist():
        met, triangle = arrays.face_i[row, F_OBJECT], arrays.face_i[row, F_TRIANGLE]
        of_object = slice(int(table.first_face[met]), int(table.first_face[met + 1]))
        [index] = np.flatnonzero(table.first_primitive[of_object] == triangle)
        start = first[met] + triangle
        face[start : start + table.primitive_count[of_object][index]] = row


class PolarizedWavefront:
    """Traces portions of polarised light, analog or weighted; safe to call from many threads.

    Every ray carries the light of one channel, which has one state.
    """

    def __init__(self, compilation: Compilation, seed: int, polarization: Polarization) -> None:
        limits = compilation.arrays.limits.copy()
        limits[SINGLE] = 1
        self.scene = compilation.arrays._replace(limits=limits)
        self.seed = seed
        self.polarization = polarization
        self.faces = polarization.faces_of(compilation)
        self.engine = Wavefront(
            self.scene, seed, meshes=compilation.solids, exact=True, weighted=True
        )

    def trace_counted(self, first_ray: int, n_rays: int) -> tuple[Portion, int]:
        """As `trace`, with the number of its records."""
        portion = self.trace(first_ray, n_rays, reuse=True)
        return portion, portion.n_records

    def trace(self, first_ray: int, n_rays: int, *, reuse: bool = False) -> Portion:
        """Trace the rays ``first_ray`` to ``first_ray + n_rays`` with their polarisation.

        With ``reuse`` columns are views of this thread's buffers, valid until its next call.
        """
        portion = self.engine.trace(first_ray, n_rays, reuse=reuse)
        n = portion.n_records
        phases = self.polarization.phases
        out = PolarizedColumns(
            weight=np.empty(portion.n_rays),
            stokes=np.empty((n, 3), np.float32),
            path=np.empty(n),
            phase=np.empty(n if phases else 0, np.float32),
            waves=np.empty((2, 6)),
        )
        rays = RayColumns(
            source=portion.source,
            records_per_ray=portion.records_per_ray,
            exact=np.asarray(portion.extra["exact"], np.float64),
            normal=portion.normal,
            object=portion.object,
            triangle=portion.triangle,
            event=portion.event,
            medium=portion.medium,
            color_code=portion.color_code,
            ids=(
                np.arange(first_ray, first_ray + n_rays)
                if portion.ray_ids is None
                else np.asarray(portion.ray_ids, np.int64)
            ),
        )
        polarize_rays(
            self.scene, rays, self.faces, out, self.seed, self.polarization.states == "natural"
        )  # fmt: skip
        weight = out.weight if portion.weight is None else out.weight * portion.weight
        extra: dict[str, NDArray[np.generic]] = {
            "stokes": out.stokes,
            "optical_path": out.path if phases else out.path.astype(np.float32),
        }
        if phases:
            extra["phase"] = out.phase
        return replace(portion, weight=weight.astype(np.float32), extra=extra, implied_normals=True)


@dataclass(frozen=True, eq=False)
class PolarizedTrace(CompiledTrace):
    """A compiled scene in polarised light; attributes as of `tracer.run.trace.Trace`."""

    polarization: Polarization

    most_rays: ClassVar[int] = PORTION_RAYS // 4

    @property
    def limit(self) -> tuple[str, str]:
        return depth_limit(self.scene.limits.depth)

    @property
    def parameters(self) -> Mapping[str, Any]:
        return {"polarised": True, "states": self.polarization.states}

    def prepared(self, encoder: PortionEncoder | None, threads: int) -> PolarizedTrace:
        _warn_of_surfaces(self.compilation)
        check_sources(self.compilation, engine=self.engine(1).engine)
        return self

    def engine(self, seed: int) -> PolarizedWavefront:
        return PolarizedWavefront(self.compilation, seed, self.polarization)

    def pinholes(self) -> Pinholes | None:
        if not any(is_pinhole(item) for item in self.directory.detectors):
            return None
        from tracer.transport.pinhole import Pinholes

        return Pinholes(self.compilation, _laws(self.compilation))


def polarized_trace(scene: Scene | Compilation) -> PolarizedTrace:
    """The trace of a scene with ``[trace] light = "polarised"``."""
    compilation = compilation_of(scene)
    return PolarizedTrace(compilation, Polarization.of(compilation.scene))


def record_polarized(
    scene: str | Path | Scene | Compilation,
    path: str | Path | None,
    *,
    polarization: Polarization | None = None,
    rays: int = 100_000,
    **options: Any,
) -> RecordResult:
    """Record a scene with polarised light, whatever its ``[trace]`` says of it.

    Parameters
    ----------
    scene : a scene file, a `Scene`, or a compilation
    path : of the map; without one only detectors count
    polarization : what is polarised; by default what the scene says
    rays, options : as of `tracer.run.recording.record`

    Raises
    ------
    SceneError, MapExists, MapLocked, SceneMismatch
    """
    compilation = compilation_of(scene)
    trace = PolarizedTrace(compilation, polarization or Polarization.of(compilation.scene))
    return record(trace, path, rays=rays, no_rays=path is None, **options)

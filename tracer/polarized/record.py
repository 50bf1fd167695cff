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

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from raymap.encoding.encoder import PortionEncoder
from raymap.model.errors import SceneError
from raymap.model.portion import Descriptors, Portion
from raymap.model.schema import PORTION_RAYS
from tracer.compiled import F_KIND, F_OBJECT, F_TRIANGLE
from tracer.geometry.kinds import MESH
from tracer.polarized.transport import (
    PolarizedColumns,
    RayColumns,
    SpecialFaces,
    polarize_rays,
)
from tracer.run.recording import record
from tracer.run.results import RecordResult, depth_limit
from tracer.run.trace import CompiledTrace
from tracer.scene.compilations import compilation_of
from tracer.scene.compile import Compilation
from tracer.scene.model import Scene
from tracer.scene.supported import (
    refuse_pinholes,
    refuse_polarising_faces,
    refuse_weighting,
)
from tracer.transport.source_check import check_sources
from tracer.transport.wavefront import Wavefront

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
    polarisers : sheet polarisers by the full name of their face: absorption axis and extinction
        (the share of the absorbed vibration that leaks). Light that passes the face is polarised;
        a body of a medium like its surroundings makes a sheet
    phases : also store the phase that interfaces give, and optical paths in float64, so that fields
        can be added
    """

    states: Literal["linear", "natural"] = "linear"
    sources: Mapping[str, Vector] = field(default_factory=dict)
    polarisers: Mapping[str, tuple[Vector, float]] = field(default_factory=dict)
    phases: bool = False

    @classmethod
    def of(cls, scene: Scene) -> Polarization:
        """What the scene's table ``[trace]`` says of polarised light."""
        given = scene.trace
        return cls(
            states=given.states,
            polarisers={name: (axis, 0.0) for name, axis in given.polarisers.items()},
            phases=given.phases,
        )

    def special_faces(self, compilation: Compilation) -> SpecialFaces:
        """Look all names up.

        Raises
        ------
        SceneError
            a face or source that the scene does not have, an axis of length zero, an extinction
            outside 0 .. 1, an unknown kind of states
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

        table = directory.faces
        polariser = np.zeros((len(arrays.face_i), 4))
        polariser[:, 3] = -1.0
        for name, (axis, extinction) in self.polarisers.items():
            if name not in table.names:
                raise SceneError(
                    f"polarisers: the scene has no face {name!r}; faces: {', '.join(table.names)}"
                )
            if not 0.0 <= extinction <= 1.0:
                raise SceneError(f"polarisers.{name}: extinction is {extinction:g}, not in 0 .. 1")
            number = table.names.index(name)
            start = first[table.object[number]] + table.first_primitive[number]
            rows = face[start : start + table.primitive_count[number]]
            polariser[rows[rows >= 0], :3] = _direction(axis, f"polarisers.{name}")
            polariser[rows[rows >= 0], 3] = extinction

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
            vibration[names.index(name)] = _direction(axis, f"sources.{name}")
        return SpecialFaces(first, face, polariser, vibration)


def _name_triangles(
    face: NDArray[np.int64], first: NDArray[np.int64], compilation: Compilation
) -> None:
    """Give every triangle of a mesh the row of its named face."""
    arrays, table = compilation.arrays, compilation.directory.faces
    for row in np.flatnonzero(arrays.face_i[:, F_KIND] == MESH).tolist():
        met, triangle = arrays.face_i[row, F_OBJECT], arrays.face_i[row, F_TRIANGLE]
        of_object = slice(int(table.first_face[met]), int(table.first_face[met + 1]))
        [place] = np.flatnonzero(table.first_primitive[of_object] == triangle)
        start = first[met] + triangle
        face[start : start + table.primitive_count[of_object][place]] = row


class PolarizedWavefront:
    """Traces portions of polarised light; safe to call from many threads."""

    def __init__(self, compilation: Compilation, seed: int, polarization: Polarization) -> None:
        refuse_weighting(compilation.scene, "polarised light")
        refuse_polarising_faces(compilation)
        self.scene = compilation.arrays
        self.seed = seed
        self.polarization = polarization
        self.special = polarization.special_faces(compilation)
        self.engine = Wavefront(compilation.arrays, seed, meshes=compilation.solids, exact=True)

    def trace_counted(self, first_ray: int, n_rays: int) -> tuple[Portion, int]:
        """As `trace`, with the number of its records."""
        portion = self.trace(first_ray, n_rays)
        return portion, portion.n_records

    def trace(self, first_ray: int, n_rays: int, *, reuse: bool = False) -> Portion:
        """Trace the rays ``first_ray`` to ``first_ray + n_rays`` with their polarisation.

        ``reuse`` changes nothing.
        """
        portion = self.engine.trace(first_ray, n_rays)
        n = portion.n_records
        phases = self.polarization.phases
        out = PolarizedColumns(
            weight=np.empty(n_rays),
            stokes=np.empty((n, 3), np.float32),
            path=np.empty(n),
            phase=np.empty(n if phases else 0, np.float32),
            event=np.empty(n, np.int32),
            kept=np.empty(n_rays, np.int32),
            waves=np.empty((2, 6)),
        )
        exact = np.ascontiguousarray(portion.extra["exact"], np.float64)
        rays = RayColumns(
            source=portion.source,
            records_per_ray=portion.records_per_ray,
            exact=exact,
            normal=portion.normal,
            object=portion.object,
            triangle=portion.triangle,
            event=portion.event,
            medium=portion.medium,
            color_code=portion.color_code,
            color_table=portion.color_table,
        )
        polarize_rays(
            self.scene, rays, self.special, out, self.seed, first_ray,
            self.polarization.states == "natural",
        )  # fmt: skip
        extra: dict[str, NDArray[np.generic]] = {
            "stokes": out.stokes,
            "optical_path": out.path if phases else out.path.astype(np.float32),
        }
        if phases:
            extra["phase"] = out.phase
        whole = replace(portion, event=out.event, weight=out.weight.astype(np.float32), extra=extra)
        return _shortened(whole, out.kept)


@dataclass(frozen=True, eq=False)
class PolarizedTrace(CompiledTrace):
    """A compiled scene in polarised light; attributes as of `tracer.run.trace.Trace`."""

    polarization: Polarization

    fan: ClassVar[int] = 1
    most_rays: ClassVar[int] = PORTION_RAYS // 4

    @property
    def limit(self) -> tuple[str, str]:
        return depth_limit(self.scene.limits.depth)

    @property
    def parameters(self) -> Mapping[str, Any]:
        return {"polarised": True, "states": self.polarization.states}

    def prepared(self, encoder: PortionEncoder | None, threads: int) -> PolarizedTrace:
        refuse_pinholes(self.compilation, "the polarised one")
        check_sources(self.compilation, engine=self.engine(1).engine)
        return self

    def engine(self, seed: int) -> PolarizedWavefront:
        return PolarizedWavefront(self.compilation, seed, self.polarization)

    def pinholes(self) -> None:
        return None


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


def _direction(axis: Vector, name: str) -> NDArray[np.float64]:
    vector = np.asarray(axis, np.float64)
    length = float(np.linalg.norm(vector)) if vector.shape == (3,) else float("nan")
    if not (np.isfinite(length) and length > 0.0):
        raise SceneError(f"{name}: expected three numbers that are not all zero, got {axis!r}")
    return np.asarray(vector / length)


def _shortened(portion: Portion, kept: NDArray[np.int32]) -> Portion:
    """The portion with only the first ``kept`` records of every ray."""
    counts = portion.records_per_ray
    if np.array_equal(kept, counts):
        return portion
    place = np.arange(portion.n_records) - np.repeat(np.cumsum(counts) - counts, counts)
    stays = place < np.repeat(kept, counts)
    ends = place == np.repeat(kept, counts) - 1
    # The segment that would start at the last record is gone, and its meetings with it
    meetings = np.where(ends, 0, portion.descriptor_count).astype(np.uint16)
    found = np.repeat(stays & ~ends, portion.descriptor_count)
    d = portion.descriptors
    columns: dict[str, Any] = {
        name: getattr(portion, name)[stays]
        for name in (
            "position", "normal", "object", "triangle", "event", "medium", "color_code",
        )
    }  # fmt: skip
    return replace(
        portion,
        records_per_ray=kept.copy(),
        **columns,
        descriptor_count=meetings[stays],
        descriptors=Descriptors(
            detector=d.detector[found],
            cell=d.cell[found],
            cosine=d.cosine[found],
            uv=d.uv[found],
            registered=d.registered[found],
        ),
        extra={name: column[stays] for name, column in portion.extra.items()},
    )

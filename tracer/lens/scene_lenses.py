"""A scene whose lenses are primitives: what stands where, by the numbers of its directory."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracer.bodies.lens import LensBody
from tracer.compiled import DIELECTRIC, F_OBJECT, F_SURFACE, S_KIND, S_MODEL, S_SCATTER
from tracer.detectors.model import DetectorModel
from tracer.lens.errors import LensError
from tracer.lens.glass import Glass
from tracer.lens.lens import Lens
from tracer.optics.dispersion import constant
from tracer.scene.compile import Compilation

__all__ = ["LensScene", "Plane", "SceneLens"]

Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneLens:
    """One lens of a scene, for one channel.

    Attributes
    ----------
    lens : the primitive
    object : its index in the directory
    primitives : (3,) primitive of front, back and rim
    medium : index of its glass in the directory
    index, absorption : of the glass
    """

    lens: Lens
    object: int
    primitives: NDArray[np.int32]
    medium: int
    index: float
    absorption: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Plane:
    """A detector: its rectangle and what it registers.

    Attributes
    ----------
    number : index in the directory
    center, u, v, looks : (3,)
    size : (2,) full width and height
    cells : (2,)
    least_cosine, both_sides : what it accepts
    object : index of the blocking object, -1 if light passes
    """

    number: int
    center: Real
    u: Real
    v: Real
    looks: Real
    size: Real
    cells: NDArray[np.int64]
    least_cosine: float
    both_sides: bool
    object: int

    def meet(self, origin: Real, direction: Real) -> tuple[Real, Real, Real]:
        """(n,) distance (inf where missed), (n, 2) place in 0 .. 1, (n,) cosine to the look."""
        along = direction @ self.looks
        with np.errstate(divide="ignore", invalid="ignore"):
            t = ((self.center - origin) @ self.looks) / along
            at = origin + t[:, np.newaxis] * direction - self.center
            place = np.stack([at @ self.u, at @ self.v], axis=1) / self.size + 0.5
        inside = np.all((place >= 0.0) & (place <= 1.0), axis=1) & (t > 0.0)
        return np.where(inside, t, np.inf), place, -along

    def registers(self, cosine: Real) -> NDArray[np.bool_]:
        """Whether light of a cosine is counted."""
        facing = np.abs(cosine) if self.both_sides else cosine
        return np.asarray((facing > 0.0) & (facing >= self.least_cosine))


@dataclass(frozen=True, kw_only=True, eq=False)
class LensScene:
    """All lenses, for each channel, and detectors of a compiled scene.

    Attributes
    ----------
    lenses : per channel
    planes : the detectors
    outside : medium index of the world
    """

    compilation: Compilation
    lenses: tuple[tuple[SceneLens, ...], ...]
    planes: tuple[Plane, ...]
    outside: int

    @classmethod
    def of(cls, compilation: Compilation) -> LensScene:
        """Read a scene of lenses, sources and detectors.

        Raises
        ------
        LensError
            names a body that is no lens of two spherical faces, or a face that is no bare interface
        """
        scene, directory = compilation.scene, compilation.directory
        channels = compilation.channel_set
        media = [medium.name for medium in directory.media]
        objects = [item.name for item in directory.objects]
        outside = media.index(scene.world.medium)
        detectors = {
            name: model
            for name, model in scene.detectors.items()
            if isinstance(model, DetectorModel)
        }
        for name, detector in detectors.items():
            if detector.blocking and not _absorbs(compilation, detector.surface or "absorber"):
                raise LensError(
                    f"detectors.{name}.surface: {detector.surface!r} is no absorber, as every "
                    "blocking detector of whole lenses is; leave it out, or record the scene with "
                    "ordinary faces"
                )
        for name, body in scene.bodies.items():
            _check_body(compilation, name, body, objects.index(name))
        lenses = []
        for channel, wavelength in enumerate(channels.wavelengths_nm):
            row = []
            for name, body in scene.bodies.items():
                assert isinstance(body, LensBody)
                medium = media.index(body.medium)
                row.append(
                    _lens(
                        name, body, objects.index(name), medium,
                        channels.refractive_index[medium][channel],
                        channels.refractive_index[outside][channel],
                        channels.absorption[medium][channel],
                        wavelength,
                    )
                )  # fmt: skip
            lenses.append(tuple(row))
        planes = tuple(
            Plane(
                number=number,
                center=np.array(model.position),
                u=model.axes()[0],
                v=model.axes()[1],
                looks=model.axes()[2],
                size=np.array(model.size),
                cells=np.array(model.cells, np.int64),
                least_cosine=math.cos(math.radians(model.acceptance_deg)),
                both_sides=model.both_sides,
                object=objects.index(name) if model.blocking else -1,
            )
            for number, (name, model) in enumerate(detectors.items())
        )
        return cls(compilation=compilation, lenses=tuple(lenses), planes=planes, outside=outside)


def _lens(
    name: str, body: LensBody, number: int, medium: int, index: float, outside: float,
    absorption: float, wavelength: float,
) -> SceneLens:  # fmt: skip
    origin, frame = body.frame()
    through = math.exp(-10.0 * absorption)
    lens = Lens(
        radius_front=body.front.radius,
        radius_back=body.back.radius,
        thickness=body.thickness,
        semi_aperture_front=body.front.semi_diameter or 0.0,
        semi_aperture_back=body.back.semi_diameter or 0.0,
        glass=Glass(
            dispersion=constant(index, name=body.medium),
            transmittance=((wavelength, through),) if absorption > 0.0 else (),
        ),
        outside=outside,
        origin=(float(origin[0]), float(origin[1]), float(origin[2])),
        axis=(float(frame[0, 2]), float(frame[1, 2]), float(frame[2, 2])),
        name=name,
    )
    return SceneLens(
        lens=lens, object=number, primitives=np.array([0, 1, 2], np.int32), medium=medium,
        index=index, absorption=absorption,
    )  # fmt: skip


def _check_body(compilation: Compilation, name: str, body: object, number: int) -> None:
    """Refuse what a lens as a primitive cannot be."""
    remedy = "record the scene with ordinary faces instead"
    if not isinstance(body, LensBody):
        raise LensError(f"bodies.{name} is not a lens; {remedy}")
    for which, face in (("front", body.front), ("back", body.back)):
        if face.cemented is not None:
            raise LensError(
                f"bodies.{name}.{which} is cemented: a primitive stands alone; {remedy}"
            )
        if face.conic != 0.0 or any(face.aspheric):
            raise LensError(f"bodies.{name}.{which} is neither a sphere nor a plane; {remedy}")
    if body.hole is not None:
        raise LensError(f"bodies.{name}.hole: a primitive has no bore; {remedy}")
    rim = body.faces.get("rim", body.rim)
    if not _absorbs(compilation, rim):
        raise LensError(
            f"bodies.{name}.rim: {rim!r} is no absorber, as the rim of a primitive is; {remedy}"
        )
    if body.outer_radius() > max(body.front.semi_diameter or 0.0, body.back.semi_diameter or 0.0):
        raise LensError(f"bodies.{name}.diameter is larger than its faces; {remedy}")
    if body.front.semi_diameter != body.back.semi_diameter:
        raise LensError(
            f"bodies.{name}: faces of different semi_diameter have a flat land in a scene, a cone "
            f"as a primitive; {remedy}"
        )
    medium = compilation.scene.media.get(body.medium)
    if medium is not None and medium.scattering is not None:
        raise LensError(f"bodies.{name}: nothing scatters in a lens as a primitive; {remedy}")
    arrays = compilation.arrays
    rows = np.flatnonzero(arrays.face_i[:, F_OBJECT] == number)[:2]
    for row, which in zip(rows, ("front", "back"), strict=True):
        surface = arrays.surface_i[arrays.face_i[row, F_SURFACE]]
        bare = surface[S_KIND] == DIELECTRIC and surface[S_MODEL] == 0 and surface[S_SCATTER] < 0
        if not bare:
            raise LensError(f"bodies.{name}.{which} is not a bare polished interface; {remedy}")


def _absorbs(compilation: Compilation, surface: str) -> bool:
    """Whether a surface takes all light."""
    model = compilation.scene.surfaces.get(surface)
    return surface == "absorber" if model is None else model.kind == "absorber"

"""First-order numbers of an axial lens system, by tracing a paraxial ray through its vertices.

References
----------
Welford, Aberrations of Optical Systems (1986), chapter 3: n' u' = n u - y c (n' - n),
y' = y + u' d.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from raymap.model.directory import ChannelSet, Directory
from raymap.model.errors import SceneError
from tracer.bodies.body import Body
from tracer.bodies.lens import LensBody
from tracer.bodies.mesh import MeshBody
from tracer.bodies.ring import RingBody
from tracer.media.model import medium_model
from tracer.scene.media import refractive_index
from tracer.scene.model import Scene

__all__ = ["FirstOrder", "axial_surfaces", "examine", "first_order"]

D_LINE_NM = 587.5618


@dataclass(frozen=True, kw_only=True)
class FirstOrder:
    """First-order numbers [scene units]; positions along the axis from the first vertex.

    Attributes
    ----------
    efl, bfl : effective and back focal length
    f_number : focal length over the diameter of the entrance pupil, None without one
    entrance_pupil, exit_pupil : places of the pupils, None without a stop and where the pupil is at
        infinity (telecentric)
    entrance_diameter, exit_diameter : of the pupils, None without them
    wavelength_nm : for which this holds
    """

    efl: float
    bfl: float
    f_number: float | None
    entrance_pupil: float | None
    entrance_diameter: float | None
    exit_pupil: float | None
    exit_diameter: float | None
    wavelength_nm: float


@dataclass(frozen=True, kw_only=True)
class AxialSurface:
    """One refracting vertex: place, curvature, index behind it, name."""

    z: float
    curvature: float
    index: float
    name: str


def axial_surfaces(
    scene: Scene, wavelength_nm: float = D_LINE_NM
) -> tuple[list[AxialSurface], RingBody | None, float]:
    """Vertices of the lenses along z, the stop, and the index of the world.

    Raises
    ------
    SceneError
        if there is no lens, a lens is not on the z axis, or solids lie in one another there
    """
    from tracer.scene.compile import resolve_bodies

    world = _index(scene, scene.world.medium, wavelength_nm)
    bodies = resolve_bodies(scene)
    lenses = [(n, b) for n, b in bodies.items() if isinstance(b, LensBody)]
    if not lenses:
        raise SceneError(f"{scene.origin}: bodies: there is no lens, so no focal length")
    for name, lens in lenses:
        if not on_axis(lens):
            raise SceneError(f"{scene.origin}: bodies.{name}: is not on the z axis")
        for face in (lens.front, lens.back):
            surface = scene.surfaces.get(face.surface or lens.surface or "")
            if surface is not None and surface.kind in ("mirror", "rough_mirror"):
                raise SceneError(
                    f"{scene.origin}: bodies.{name}: is a mirror; these numbers are for lenses"
                )
    cemented = {lens.front.cemented for _, lens in lenses}
    surfaces = []
    for name, lens in sorted(lenses, key=lambda item: item[1].position[2]):
        z = lens.position[2]
        inside = _index(scene, lens.medium, wavelength_nm)
        surfaces.append(
            AxialSurface(z=z, curvature=lens.front.curvature, index=inside, name=f"{name}.front")
        )
        if name not in cemented:
            surfaces.append(
                AxialSurface(
                    z=z + lens.thickness,
                    curvature=lens.back.curvature,
                    index=world,
                    name=f"{name}.back",
                )
            )
    _refuse_nested(scene, bodies, surfaces)
    stops = [b for b in bodies.values() if isinstance(b, RingBody) and b.stop]
    return surfaces, (stops[0] if stops else None), world


def _refuse_nested(scene: Scene, bodies: dict[str, Body], surfaces: list[AxialSurface]) -> None:
    """Refuse lenses in one another, and other solids on the axis among them.

    Raises
    ------
    SceneError
    """
    for before, after in pairwise(surfaces):
        if after.z < before.z - 1e-9:
            raise SceneError(
                f"{scene.origin}: {after.name} lies before {before.name}: these numbers are for "
                "lenses that light meets one after the other"
            )
    low, high = surfaces[0].z, surfaces[-1].z
    for name, body in bodies.items():
        if body.medium is None or isinstance(body, LensBody | MeshBody):
            continue
        boxes = [shape.bounds() for plan in body.plan() for shape in plan.shapes]
        least = np.min([box[0] for box in boxes], axis=0)
        most = np.max([box[1] for box in boxes], axis=0)
        if np.all(least[:2] < 0.0) and np.all(most[:2] > 0.0) and least[2] < high and most[2] > low:
            raise SceneError(
                f"{scene.origin}: bodies.{name}: stands on the axis among the lenses; these "
                "numbers are for lenses alone"
            )


def on_axis(body: Body) -> bool:
    """Whether a body is turned about the z axis, unshifted."""
    origin, frame = body.frame()
    return bool(np.hypot(origin[0], origin[1]) < 1e-9 and frame[2, 2] > 1.0 - 1e-12)


def _index(scene: Scene, name: str, wavelength_nm: float) -> float:
    model = scene.media.get(name) or medium_model({"index": 1.0})
    return float(refractive_index(model, np.array([wavelength_nm]), f"media.{name}")[0])


def first_order(scene: Scene, wavelength_nm: float = D_LINE_NM) -> FirstOrder:
    """First-order numbers of the lenses of a scene on the z axis.

    Raises
    ------
    SceneError
        if there is no lens on the axis, or the system has no power
    """
    surfaces, stop, world = axial_surfaces(scene, wavelength_nm)
    start = surfaces[0].z
    y, angle = _through(surfaces, 1.0, 0.0, world, start)
    if abs(angle) < 1e-15:
        raise SceneError(f"{scene.origin}: the lenses have no power together (afocal)")
    efl = -1.0 / angle
    bfl = -y / angle
    numbers: dict[str, Any] = dict.fromkeys(
        ("f_number", "entrance_pupil", "entrance_diameter", "exit_pupil", "exit_diameter")
    )
    if stop is not None:
        # Trace from the centre of the stop to both sides
        place = stop.position[2]
        behind = [s for s in surfaces if s.z >= place]
        before = [s for s in surfaces if s.z < place]
        entrance = _image_of_stop(_mirrored(before, world), world, -place)
        if entrance is not None:
            numbers["entrance_pupil"] = -entrance[0] - start
            numbers["entrance_diameter"] = 2.0 * stop.inner * abs(entrance[1])
            numbers["f_number"] = abs(efl) / numbers["entrance_diameter"]
        leaving = _image_of_stop(behind, world, place)
        if leaving is not None:
            numbers["exit_pupil"] = leaving[0] - start
            numbers["exit_diameter"] = 2.0 * stop.inner * abs(leaving[1])
    return FirstOrder(efl=efl, bfl=bfl, wavelength_nm=wavelength_nm, **numbers)


def _through(
    surfaces: list[AxialSurface], y: float, angle: float, index: float, z: float
) -> tuple[float, float]:
    """Height at the last vertex and angle behind it of a paraxial ray."""
    for surface in surfaces:
        y += angle * (surface.z - z)
        angle = (index * angle - y * surface.curvature * (surface.index - index)) / surface.index
        index, z = surface.index, surface.z
    return y, angle


def _mirrored(surfaces: list[AxialSurface], world: float) -> list[AxialSurface]:
    """The same vertices met from behind, with z turned round."""
    indices = [world, *(surface.index for surface in surfaces)]
    return [
        AxialSurface(z=-s.z, curvature=-s.curvature, index=indices[k], name=s.name)
        for k, s in reversed(list(enumerate(surfaces)))
    ]


def _image_of_stop(
    surfaces: list[AxialSurface], world: float, place: float
) -> tuple[float, float] | None:
    """Where and how large the stop appears through ``surfaces``, None where at infinity."""
    if not surfaces:
        return place, 1.0
    y, angle = _through(surfaces, 0.0, 1.0, world, place)
    if abs(angle) < 1e-12:
        return None
    z = surfaces[-1].z - y / angle
    return z, 1.0 / angle


def _parts(scene: Scene, directory: Directory, channels: list[str]) -> dict[str, Any]:
    """What a scene holds, by name."""
    models = [scene.sources[entry.name] for entry in directory.sources]
    return {
        "scene": scene.origin,
        "title": scene.title,
        "length_unit": scene.length_unit,
        "sources": [
            f"{entry.name} ({'on' if model.on else 'off'}, {entry.flux:g} {scene.flux_unit})"
            for entry, model in zip(directory.sources, models, strict=True)
        ],
        "bodies": {
            item.name: f"{item.kind}, faces {', '.join(face.name for face in item.faces)}"
            for item in directory.objects
        },
        "media": sorted({body.medium for body in scene.bodies.values() if body.medium}),
        "detectors": [item.name for item in directory.detectors],
        "channels": channels,
    }


def _usual_nm(channels: ChannelSet) -> float:
    """The d line, for light that holds it between its channels; else the middle one of these."""
    known = sorted(channels.wavelengths_nm)
    if channels.kind == "rgb" or known[0] <= D_LINE_NM <= known[-1]:
        return D_LINE_NM
    return float(known[len(known) // 2])


def examine(scene: Scene, wavelength_nm: float | None = None) -> dict[str, Any]:
    """What `raymap check` reports: bodies, media, overlaps, first-order numbers.

    Parameters
    ----------
    wavelength_nm : of the first-order numbers; by default the d line, or the middle channel of a
        scene whose light does not reach it
    """
    from tracer.scene.compile import compile_scene
    from tracer.scene.supported import warn_of_polarised_light
    from tracer.transport.source_check import check_sources

    compilation = compile_scene(scene)
    check_sources(compilation)
    warn_of_polarised_light(compilation)
    report = _parts(scene, compilation.directory, compilation.channel_set.labels)
    report["faces"] = len(compilation.arrays.face_i)
    if any(isinstance(body, LensBody) for body in scene.bodies.values()):
        try:
            report |= asdict(
                first_order(scene, wavelength_nm or _usual_nm(compilation.channel_set))
            )
        except SceneError as error:
            report["first order"] = f"not available: {error}"
    return report

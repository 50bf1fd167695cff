"""Crystals of a scene: media by body, and what rays need that carry their polarisation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from raymap.laws.amplitudes import amplitudes_of_laws
from raymap.laws.law import InChannels, Law
from raymap.model.errors import SceneError
from raymap.model.units import length_scale
from tracer.bodies.body import Body
from tracer.compiled import Carried, CoincidentFaces
from tracer.media.keys.crystal import CrystalModel
from tracer.optics.crystals.media import Crystal, isotropic
from tracer.surfaces.surface import axis_of

if TYPE_CHECKING:
    from tracer.scene.faces import FaceTable
    from tracer.scene.media import MediumTable
    from tracer.scene.model import Scene

__all__ = ["carried_waves", "crystal_of", "refuse_beside_crystals"]

Array = NDArray[np.float64]

_MOST_KAPPA = 0.05
"""Up to here what a face reflects differs by less than 1e-3 from that of the real tensor."""


def crystal_of(scene: Scene, name: str, axis: Array | None) -> Crystal:
    """The crystal of a medium of the scene; ``axis`` where the body gives an optic axis.

    Raises
    ------
    SceneError
        so dark a crystal that its faces reflect by the complex tensor; axes that are not orthogonal
    """
    model = scene.media[name].key("crystal")
    assert isinstance(model, CrystalModel)
    try:
        crystal = model.crystal(name, axis)
        kappas = [crystal.principal_kappa(w).max() for w in scene.spectrum.channels().tolist()]
    except SceneError as error:
        raise SceneError(f"{scene.origin}: media.{name}: {error}") from None
    for wavelength, kappa in zip(scene.spectrum.channels().tolist(), kappas, strict=True):
        if kappa > _MOST_KAPPA:
            raise SceneError(
                f"{scene.origin}: media.{name}.crystal.absorption: kappa is {kappa:g} at "
                f"{wavelength:g} nm; so dark a crystal reflects by its complex tensor, scenes take "
                f"at most {_MOST_KAPPA:g}; tracer.optics.crystals.absorbing has plates and faces "
                "of dark crystals in isotropic media"
            )
    return crystal


def refuse_beside_crystals(scene: Scene) -> None:
    """Refuse what light in crystals cannot be asked for.

    Raises
    ------
    SceneError
        naming the key
    """

    def refused(key: str, message: str) -> SceneError:
        return SceneError(f"{scene.origin}: {key}: {message}")

    if scene.spectrum.kind != "spectral":
        raise refused(
            "spectrum", 'give wavelengths for crystals: kind = "spectral", wavelengths_nm'
        )
    if scene.world.medium in scene.media and scene.media[scene.world.medium].splits:
        raise refused(
            "world.medium",
            f"{scene.world.medium!r} is a crystal; light must come from an isotropic medium: put "
            "the crystal into a body",
        )
    for name, source in scene.sources.items():
        inside = [scene.bodies[body] for body in source.inside if body in scene.bodies]
        if source.on and any(_splits(scene, body) for body in inside):
            raise refused(f"sources.{name}.inside", "light must start in an isotropic medium")
    for name, detector in scene.detectors.items():
        if detector.kind == "pinhole":
            raise refused(
                f"detectors.{name}.kind",
                "a pinhole is no detector beside crystals, where light is bent on its way to it; "
                "take a camera instead",
            )
    trace = scene.trace
    if trace.light != "natural":
        raise refused(
            "trace.light",
            "beside crystals every ray carries its polarisation; leave it out, what sources and "
            "surfaces do to polarised light counts all the same",
        )
    if trace.split_depth:
        raise refused("trace.split_depth", "rays that carry their polarisation do not split")
    if trace.lens_trees is not None:
        raise refused("trace.lens_trees", "lens trees know no crystals")


def _splits(scene: Scene, body: Body) -> bool:
    return body.medium in scene.media and scene.media[body.medium].splits


def carried_waves(
    scene: Scene, faces: FaceTable, media: MediumTable, contacts: CoincidentFaces | None,
    laws: Sequence[Law | None], channels: InChannels,
) -> Carried | None:  # fmt: skip
    """What rays need that carry their state; None where no solid is a crystal.

    Parameters
    ----------
    laws : of the surfaces by number

    Raises
    ------
    SceneError
        what a scene with crystals cannot have
    """
    crystals = [name for name in faces.solids if _splits(scene, faces.bodies[name])]
    if not crystals:
        return None
    refuse_beside_crystals(scene)
    wavelengths = scene.spectrum.channels()
    world = media.number(scene.world.medium)
    rows = []
    for name in faces.solids:
        body = faces.bodies[name]
        assert body.medium is not None
        if name in crystals:
            crystal = crystal_of(scene, body.medium, body.crystal_axis())
            rows.append([crystal.row(w) for w in wavelengths.tolist()])
        else:
            rows.append(_isotropic(media.index[media.number(body.medium)]))
    rows.append(_isotropic(media.index[world]))
    _check_faces(scene, faces, contacts, crystals)
    vibration = np.zeros((len(scene.sources), 3))
    for k, (name, source) in enumerate(scene.sources.items()):
        if source.polarisation is not None:
            vibration[k] = axis_of(source.polarisation, f"sources.{name}")
    return Carried(
        rows=np.ascontiguousarray(np.swapaxes(np.array(rows), 0, 1)),
        k0=2e6 * np.pi / wavelengths * length_scale(scene.length_unit, "mm"),
        vibration=vibration,
        laws=amplitudes_of_laws(laws, channels),
        calls=np.zeros(3, np.int64),
    )


def _isotropic(indices: Array) -> list[Array]:
    return [isotropic(float(n)).row(0.0) for n in indices]


def _check_faces(
    scene: Scene, faces: FaceTable, contacts: CoincidentFaces | None, crystals: Sequence[str]
) -> None:
    """Refuse surfaces on crystals of which no law of four waves is known; and false contacts."""
    models = faces.surface_models()
    numbers = {faces.solids[name]: name for name in crystals}
    for k, face in enumerate(faces.primitives):
        name = numbers.get(face.inside) or numbers.get(face.outside)
        if name is None:
            continue
        coincident = (
            () if contacts is None else contacts.face[contacts.first[k] : contacts.first[k + 1]]
        )
        for number in (k, *coincident):
            surface, model = models[faces.primitives[number].surface]
            bare = model.kind == "dielectric" and not model.model_fields_set - {"kind"}
            if not (bare or model.kind == "absorber"):
                raise SceneError(
                    f"{scene.origin}: bodies.{name}: {surface!r} ({model.kind}) lies on a face of "
                    "a crystal, which is bare or absorbs; leave a gap to what is coated"
                )
    _check_contacts(scene, faces, contacts)


def _check_contacts(scene: Scene, faces: FaceTable, contacts: CoincidentFaces | None) -> None:
    names = list(scene.bodies)
    for a, b in scene.contacts:
        for name in (a, b):
            if name not in names:
                raise SceneError(
                    f"{scene.origin}: contact names {name!r}, the bodies are {', '.join(names)}"
                )
        if a == b:
            raise SceneError(f"{scene.origin}: contact [{a!r}, {b!r}]: a body has none with itself")
        if not _touch(faces, contacts, a, b):
            raise SceneError(
                f"{scene.origin}: contact [{a!r}, {b!r}]: the bodies have no faces on one another; "
                "move them together, or drop the contact"
            )


def _touch(faces: FaceTable, contacts: CoincidentFaces | None, a: str, b: str) -> bool:
    if contacts is None:
        return False
    owners = [faces.objects[face.object].name for face in faces.primitives]
    return any(
        owners[k] == a and owners[other] == b
        for k in range(len(owners))
        for other in contacts.face[contacts.first[k] : contacts.first[k + 1]]
    )

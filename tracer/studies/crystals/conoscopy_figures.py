"""Interference figures of crystal sections in convergent light, against closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from raymap.model.errors import SceneError
from raymap.optics.colorimetry import xyz_to_linear_srgb
from raymap.pictures.files import write_pixels
from tracer.optics.crystals.media import Crystal, biaxial, calcite, rotation_between
from tracer.optics.crystals.plates import plate_retardation
from tracer.optics.crystals.waves import waves_along
from tracer.render.images import to_bytes
from tracer.studies.crystals.crystal_statements import Check
from tracer.studies.microscopy.microscope import Microscope, conoscopy
from tracer.studies.microscopy.specimens import CrystalPlate

__all__ = ["ConoscopyScene", "biaxial_checks", "calcite_checks", "vibration_azimuths"]

Real = NDArray[np.float64]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]


class ConoscopyScene(BaseModel):
    """A section and the light; the section's normal in the crystal's own axes."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    material: Literal["calcite"] | None = None
    indices: tuple[Positive, Positive, Positive] | None = None
    normal: tuple[float, float, float]
    thickness_um: Positive
    index_outside: Positive = 1.0
    numerical_aperture: Positive = 0.65
    wavelength: Positive = 589.3
    pixels: Annotated[int, Field(ge=16)] = 241

    def crystal(self, turn_deg: float = 0.0) -> Crystal:
        """The crystal with the section's normal along z; the plane of n_x and n_z holds x."""
        if (self.material is None) == (self.indices is None):
            raise SceneError(f"{self.name}: give either material or indices")
        crystal = calcite() if self.indices is None else biaxial(*self.indices, name=self.name)
        if not np.linalg.norm(self.normal) > 0.0:
            raise SceneError(f"{self.name}: normal must not be zero")
        crystal = crystal.turned(rotation_between(self.normal, (0.0, 0.0, 1.0)))
        c, s = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
        return crystal.turned([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def plate(self, turn_deg: float = 0.0) -> CrystalPlate:
        """The section as a specimen of the microscope."""
        return CrystalPlate(
            crystal=self.crystal(turn_deg),
            thickness_mm=self.thickness_um * 1e-3,
            index_outside=self.index_outside,
        )

    def microscope(self, *, white: bool, turn_deg: float = 0.0) -> Microscope:
        """Crossed polars in light of one wavelength or white."""
        return Microscope(
            polariser_deg=turn_deg,
            analyser_deg=turn_deg + 90.0,
            numerical_aperture=self.numerical_aperture,
            wavelength_nm=None if white else self.wavelength,
            white_samples=41,
        )


def _figure(scene: ConoscopyScene, *, white: bool, turn_deg: float = 0.0) -> Real:
    """(n, n, 3) linear RGB of a figure, y upward."""
    seen = conoscopy(scene.plate(turn_deg), scene.microscope(white=white), pixels=scene.pixels)
    if white:
        image = np.maximum(xyz_to_linear_srgb(seen.xyz), 0.0)
    else:
        image = np.repeat(seen.transmission[..., None], 3, axis=2)
    return np.asarray(image[::-1])


def _crossed(scene: ConoscopyScene, s_x: Real, s_y: Real, turn_deg: float = 0.0) -> Real:
    jones = scene.plate(turn_deg).jones(s_x, s_y, scene.wavelength)
    result: Real = np.abs(jones[..., 1, 0]) ** 2
    return result


def _roots(function: Callable[[float], float], low: float, high: float) -> float:
    """Bisection."""
    sign = function(low) > 0.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        if (function(middle) > 0.0) == sign:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def calcite_checks(scene: ConoscopyScene, folder: Path | None) -> Iterator[Check]:
    """Rings and cross of a uniaxial section across its axis; writes conoscopy_calcite.png."""
    picture = ""
    if folder is not None:
        picture = "conoscopy_calcite.png"
        panels = [_figure(scene, white=white) for white in (False, True)]
        write_pixels(folder / picture, to_bytes(np.concatenate(panels, axis=1)))

    # Dark rings where the path difference is a whole number of wavelengths
    n_o, _, n_e = scene.crystal().principal_indices(scene.wavelength)
    waves = scene.thickness_um * 1e3 / scene.wavelength

    def order(s: float) -> float:
        return float(waves * (math.sqrt(n_o**2 - s * s) - n_o * math.sqrt(1.0 - (s / n_e) ** 2)))

    worst = 0.0
    last = int(order(scene.numerical_aperture))
    for k in range(1, last + 1):
        expected = _roots(lambda s, k=k: order(s) - k, 0.0, scene.numerical_aperture)  # type: ignore[misc]
        s = expected + np.linspace(-2e-3, 2e-3, 81)
        light = _crossed(scene, s / math.sqrt(2.0), s / math.sqrt(2.0))
        fit = np.polyfit(s - expected, light, 4)
        at = float(np.roots(np.polyder(fit))[np.argmin(np.abs(np.roots(np.polyder(fit))))].real)
        worst = max(worst, abs(at))
    yield Check(
        name="conoscopy_calcite.rings",
        statement=f"dark rings 1 to {last} at d [sqrt(no^2-s^2) - no sqrt(1-s^2/ne^2)] = k lambda",
        deviation=worst,
        limit=2e-5,
        picture=picture,
    )
    s = np.linspace(0.0, scene.numerical_aperture, 200)
    dark = max(
        float(_crossed(scene, x * s, y * s).max())
        for x, y in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))
    )
    yield Check(
        name="conoscopy_calcite.cross",
        statement="the arms of the dark cross lie along polariser and analyser",
        deviation=dark,
        limit=1e-20,
    )
    tilted = scene.model_copy(update={"normal": (0.3, 0.1, 1.0)})
    yield _rotation("conoscopy_calcite.rotation", tilted)


def _rotation(name: str, scene: ConoscopyScene) -> Check:
    """Turning section and polars together turns the figure."""
    generator = np.random.default_rng(5)
    radius = scene.numerical_aperture * np.sqrt(generator.uniform(size=400))
    azimuth = generator.uniform(0.0, 2.0 * np.pi, 400)
    before = _crossed(scene, radius * np.cos(azimuth), radius * np.sin(azimuth))
    later = azimuth + math.radians(30.0)
    plate = scene.plate(30.0)
    jones = plate.jones(radius * np.cos(later), radius * np.sin(later), scene.wavelength)
    c, s = math.cos(math.radians(30.0)), math.sin(math.radians(30.0))
    pass_axis, analyser = np.array([c, s]), np.array([-s, c])
    after = np.abs(np.einsum("i,nij,j->n", analyser, jones, pass_axis)) ** 2
    return Check(
        name=name,
        statement="section and polars turned by 30 deg turn the figure by 30 deg",
        deviation=float(np.abs(after - before).max()),
        limit=1e-10,
    )


def vibration_azimuths(crystal: Crystal, normal: Real, wavelength_nm: float) -> tuple[Real, Real]:
    """Vibration directions D by the rule of Biot and Fresnel, from the binormals alone.

    They bisect the angles between the planes that hold the wave normal and the two binormals.

    Parameters
    ----------
    normal : (n, 3) wave normals

    Returns
    -------
    two (n, 3) unit vectors
    """
    planes = []
    for binormal in crystal.binormals(wavelength_nm):
        across = np.cross(normal, binormal)
        planes.append(across / np.linalg.norm(across, axis=1, keepdims=True))
    bisectors = []
    for sum_ in (planes[0] + planes[1], planes[0] - planes[1]):
        bisectors.append(sum_ / np.linalg.norm(sum_, axis=1, keepdims=True))
    return bisectors[0], bisectors[1]


def biaxial_checks(scene: ConoscopyScene, folder: Path | None) -> Iterator[Check]:
    """Eyes, path differences and isogyres of a section across the acute bisectrix."""
    picture = ""
    if folder is not None:
        picture = "conoscopy_biaxial.png"
        panels = [
            _figure(scene, white=white, turn_deg=turn)
            for white, turn in ((False, 0.0), (False, 45.0), (True, 45.0))
        ]
        write_pixels(folder / picture, to_bytes(np.concatenate(panels, axis=1)))

    crystal = scene.crystal()
    n_x, n_y, n_z = np.sort(crystal.principal_indices(scene.wavelength))
    d = scene.thickness_um * 1e-3
    slow = np.asarray(crystal.orientation)[:, 2]
    s = np.linspace(0.0, 0.999 * min(scene.numerical_aperture, n_x), 300)
    in_plane = plate_retardation(crystal, slow[0] * s, slow[1] * s, d, scene.wavelength)
    across = plate_retardation(crystal, -slow[1] * s, slow[0] * s, d, scene.wavelength)
    closed_in = d * np.abs(n_z * np.sqrt(1.0 - (s / n_x) ** 2) - np.sqrt(n_y**2 - s**2))
    closed_across = d * np.abs(np.sqrt(n_z**2 - s**2) - n_y * np.sqrt(1.0 - (s / n_x) ** 2))
    deviation = max(
        float(np.abs(in_plane - closed_in).max()), float(np.abs(across - closed_across).max())
    )
    yield Check(
        name="conoscopy_biaxial.path_difference",
        statement="path difference in the optic plane and across it, over the wavelength",
        deviation=deviation / (scene.wavelength * 1e-6),
        limit=1e-9,
        picture=picture,
    )

    # The eyes: no path difference where the wave normal is a binormal
    binormal = crystal.binormals(scene.wavelength)[0]
    eye = n_y * binormal[:2] * np.sign(binormal[2])
    yield Check(
        name="conoscopy_biaxial.eyes",
        statement="path difference at s = n_y sin(V), over the wavelength",
        deviation=float(plate_retardation(crystal, eye[0], eye[1], d, scene.wavelength))
        / (scene.wavelength * 1e-6),
        limit=1e-6,
    )

    # Isogyres: vibrations by the rule of Biot and Fresnel
    generator = np.random.default_rng(2)
    normal = generator.normal(size=(500, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    waves = waves_along(crystal, normal, scene.wavelength)
    bisectors = vibration_azimuths(crystal, normal, scene.wavelength)
    displacement = waves.field @ crystal.tensor(scene.wavelength)
    displacement /= np.linalg.norm(displacement, axis=2, keepdims=True)
    aligned = np.stack(
        [np.abs(np.einsum("nki,ni->nk", displacement, b)) for b in bisectors], axis=-1
    )
    yield Check(
        name="conoscopy_biaxial.vibrations",
        statement="vibrations bisect the angles between wave normal and binormals",
        deviation=float(np.abs(1.0 - aligned.max(axis=2)).max()),
        limit=1e-9,
    )
    # ... and darkness where one of them lies along the polariser
    radius = 0.9 * min(scene.numerical_aperture, n_x) * np.sqrt(generator.uniform(size=4000))
    angle = generator.uniform(0.0, 2.0 * np.pi, 4000)
    s_x, s_y = radius * np.cos(angle), radius * np.sin(angle)
    turned = scene.crystal(45.0)
    inside = np.column_stack([s_x, s_y, np.sqrt(n_y**2 - radius**2)]) / n_y
    first, _ = vibration_azimuths(turned, inside, scene.wavelength)
    radial = np.column_stack([np.cos(angle), np.sin(angle)])
    theta = np.column_stack([radial * inside[:, 2:], -radius / n_y])
    phi = np.column_stack([-radial[:, 1], radial[:, 0], np.zeros(4000)])
    seen = np.einsum("ni,ni->n", first, theta)[:, None] * radial
    seen += np.einsum("ni,ni->n", first, phi)[:, None] * phi[:, :2]
    double = np.abs(2.0 * seen[:, 0] * seen[:, 1]) / np.einsum("ni,ni->n", seen, seen)
    light = _crossed(scene, s_x, s_y, 45.0)
    yield Check(
        name="conoscopy_biaxial.isogyres",
        statement="light where the rule puts an isogyre (|sin 2 phi| < 0.02)",
        deviation=float(light[double < 0.02].max()),
        limit=0.02,
    )
    yield _rotation("conoscopy_biaxial.rotation", scene)

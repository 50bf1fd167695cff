"""A rock's thin section under the polarising microscope: grains, a turning stage, an animation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import SceneError
from raymap.optics.colorimetry import xyz_to_linear_srgb
from tracer.optics.crystals.media import Crystal
from tracer.optics.crystals.plates import plate_retardation, plate_waves
from tracer.render.images import to_bytes, write_animation
from tracer.studies.microscopy.microscope import Microscope, orthoscopy

__all__ = ["ThinSection", "random_grains", "stage_animation"]

Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ThinSection:
    """Grains of crystals side by side, all of one thickness.

    Attributes
    ----------
    grains : (h, w) int, number of the grain at each point; row 0 at the top
    crystals : one for each grain, oriented, the normal of the section along z
    thickness_um : 30 in most laboratories
    """

    grains: NDArray[np.int64]
    crystals: Sequence[Crystal]
    thickness_um: float = 30.0

    def vibrations(self, wavelength_nm: float) -> tuple[Real, Real]:
        """Path difference [nm] and azimuth of the slow vibration [deg] of each grain."""
        if not self.thickness_um > 0.0:
            raise SceneError("thin section: thickness_um must be positive")
        difference, slow = [], []
        for crystal in self.crystals:
            waves = plate_waves(crystal, 0.0, 0.0, wavelength_nm)
            slower = int(np.argmax(waves[:2, 5].real))
            field = waves[slower, [0, 2]].real
            slow.append(float(np.degrees(np.arctan2(field[1], field[0]))))
            gamma = plate_retardation(crystal, 0.0, 0.0, self.thickness_um * 1e3, wavelength_nm)
            difference.append(float(gamma))
        return np.array(difference), np.array(slow)

    def picture(self, microscope: Microscope, *, stage_deg: float = 0.0) -> Real:
        """(h, w, 3) linear sRGB in parallel light, the stage turned counter-clockwise.

        The picture itself turns with the stage; here its points are kept in place, so that the
        colours of a grain can be followed.
        """
        wavelength = microscope.wavelength_nm or 550.0
        difference, slow = self.vibrations(wavelength)
        xyz, _ = orthoscopy(difference, slow + stage_deg, microscope)
        colours = np.maximum(xyz_to_linear_srgb(xyz), 0.0)
        return np.asarray(colours[self.grains])


def random_grains(
    crystals: Sequence[Crystal], *, count: int = 40, pixels: int = 160, seed: int = 1
) -> ThinSection:
    """A mosaic of grains of the given minerals, each turned at random."""
    rng = np.random.default_rng(seed)
    centre = rng.uniform(0.0, pixels, (count, 2))
    y, x = np.mgrid[0:pixels, 0:pixels] + 0.5
    distance = (x[..., None] - centre[:, 0]) ** 2 + (y[..., None] - centre[:, 1]) ** 2
    turned = []
    for _ in range(count):
        rotation, triangle = np.linalg.qr(rng.normal(size=(3, 3)))
        rotation = rotation * np.sign(np.diag(triangle))
        rotation[:, 0] *= np.sign(np.linalg.det(rotation))
        turned.append(crystals[int(rng.integers(len(crystals)))].turned(rotation))
    return ThinSection(grains=np.argmin(distance, axis=2), crystals=tuple(turned))


def stage_animation(
    section: ThinSection, microscope: Microscope, path: str | Path, *, frames: int = 18
) -> None:
    """Write an animated PNG of the stage turning by 90 deg (after which all repeats)."""
    if frames < 2:
        raise SceneError("thin section: an animation needs two frames or more")
    pictures = [
        to_bytes(section.picture(microscope, stage_deg=90.0 * k / frames)) for k in range(frames)
    ]
    write_animation(path, pictures, seconds_per_frame=0.15)

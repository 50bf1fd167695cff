"""A polarising microscope built of real lenses, ready to use.

Two equal plano-convex lenses face each other with their flat sides around their common focus:
condenser and objective. Parallel polarised light fills the condenser, the plate stands in the
focus, and the screen in the back focal plane of the objective, as a Bertrand lens would show it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tracer.lens import Lens
from tracer.optics.polarization_elements import Diaphragm, Polarizer, Retarder
from tracer.optics.polarization_rays import PolarizationError, PolarizedRays
from tracer.studies.interference_colors import white_weights
from tracer.studies.lenses.lens_beams import sunflower
from tracer.studies.microscopy.microscope import Microscope
from tracer.studies.microscopy.microscope_train import (
    Element,
    LensStage,
    PlateStage,
    Screen,
    run_train,
)
from tracer.studies.microscopy.specimens import CrystalPlate

__all__ = ["Bench", "bench_conoscopy"]

Real = NDArray[np.float64]

LARGEST_APERTURE = 0.3
"""Beyond it a pair of single lenses no longer makes a picture."""


class Bench:
    """Places and lenses of the microscope for one numerical aperture.

    Attributes
    ----------
    condenser, objective : the lenses
    focal_length : of either [mm], at the D line of the spectrum
    specimen_z, screen_z : where the plate and the screen stand [mm]
    """

    def __init__(self, numerical_aperture: float, *, index: float = 1.5168) -> None:
        if not 0.0 < numerical_aperture <= LARGEST_APERTURE:
            raise PolarizationError(
                f"numerical_aperture is {numerical_aperture:g}: single lenses reach at most "
                f"{LARGEST_APERTURE:g}; direction space has no such limit"
            )
        radius, thickness = 40.0, 9.0
        self.focal_length = radius / (index - 1.0)
        self.beam_radius = self.focal_length * numerical_aperture
        semi_aperture = 1.15 * self.beam_radius
        self.condenser = Lens(
            radius_front=radius, radius_back=math.inf, thickness=thickness,
            semi_aperture_front=semi_aperture, glass=index, name="condenser",
        )  # fmt: skip
        back = self.condenser.back_focal_length(589.3)
        self.specimen_z = thickness + back
        self.objective = Lens(
            radius_front=math.inf, radius_back=-radius, thickness=thickness,
            semi_aperture_front=semi_aperture, glass=index, name="objective",
            origin=(0.0, 0.0, self.specimen_z + back),
        )  # fmt: skip
        self.screen_z = self.objective.origin[2] + thickness + self.focal_length

    def train(self, plate: CrystalPlate, microscope: Microscope) -> list[Element]:
        """The elements from the polariser to the analyser."""
        elements: list[Element] = [
            Polarizer.at_angle(microscope.polariser_deg, extinction=microscope.extinction, z=-20.0),
            Diaphragm(radius=self.beam_radius, center=(0.0, 0.0, -15.0)),
            LensStage(lens=self.condenser),
            PlateStage(plate=plate, z=self.specimen_z - 0.5 * plate.thickness_mm),
            LensStage(lens=self.objective),
        ]
        given = microscope.compensator
        if given is not None:
            elements.append(
                Retarder(
                    slow_axis=given.slow_axis,
                    path_difference_nm=given.path_difference_nm,
                    center=(0.0, 0.0, self.screen_z - 2.0),
                )
            )
        if microscope.analyser_deg is not None:
            elements.append(
                Polarizer.at_angle(
                    microscope.analyser_deg,
                    extinction=microscope.extinction,
                    z=self.screen_z - 1.0,
                )
            )
        return elements

    def source(self, rays: int, polariser_deg: float, wavelength_nm: float) -> PolarizedRays:
        """Parallel light behind the polariser, even over the condenser, each ray of flux 1."""
        disc = sunflower(rays) * self.beam_radius
        start = np.column_stack([disc, np.full(rays, -30.0)])
        angle = math.radians(polariser_deg)
        return PolarizedRays.linear(
            start, (0.0, 0.0, 1.0), (math.cos(angle), math.sin(angle), 0.0),
            wavelength_nm=wavelength_nm,
        )  # fmt: skip


def bench_conoscopy(
    plate: CrystalPlate, microscope: Microscope, *, pixels: int = 201, rays_per_pixel: float = 6.0
) -> tuple[Real, float]:
    """Conoscopic picture through real lenses.

    Returns
    -------
    xyz : (pixels, pixels, 3), row i counts upward; Y = 1 where rays arrive without loss
    brightest : largest share of its rays' light that a pixel gets

    Raises
    ------
    PolarizationError
        a numerical aperture that single lenses do not reach
    """
    bench = Bench(microscope.numerical_aperture)
    screen = Screen(z=bench.screen_z, half_size=bench.beam_radius, pixels=pixels)
    wavelengths = microscope.wavelengths_nm
    if microscope.wavelength_nm is None:
        weights = white_weights(wavelengths, microscope.illuminant)
    else:
        weights = np.array([[0.95047, 1.0, 1.08883]])
    xyz = np.zeros((pixels, pixels, 3))
    count = int(rays_per_pixel * pixels * pixels * math.pi / 4.0)
    for wavelength, weight in zip(wavelengths, weights, strict=True):
        light = bench.source(count, microscope.polariser_deg, float(wavelength))
        arrived = screen(run_train(light, bench.train(plate, microscope)))
        # The mean over the rays of a pixel: their number depends on the lenses' aberrations
        mean = screen.collect(arrived) / np.maximum(screen.count(arrived), 1.0)
        xyz += mean[..., np.newaxis] * weight
    return xyz, float(xyz[..., 1].max())

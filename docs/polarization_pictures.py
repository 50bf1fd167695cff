"""Make the pictures of docs/polarization.md: python docs/polarization_pictures.py."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from raymap.optics.colorimetry import channel_display_rgb, encode_srgb
from raymap.pictures.files import write_chart, write_pixels
from tracer.lens import Glass, Lens
from tracer.optics.crystals.media import biaxial, calcite
from tracer.studies.lenses.cone import axial_cone, masked_cone
from tracer.studies.lenses.lens_beams import parallel_beam
from tracer.studies.lenses.lens_pictures import LensCamera, lens_picture
from tracer.studies.lenses.levels import level_shares, shares_by_height
from tracer.studies.lenses.newton_rings import newton_rings
from tracer.studies.microscopy.microscope import Microscope, conoscopy
from tracer.studies.microscopy.specimens import CrystalPlate
from tracer.studies.polarization_plots import (
    plot_cones,
    plot_conoscopy,
    plot_levels,
    plot_michel_levy,
    plot_rings,
)

IMAGES = Path(__file__).parent / "images"
LINE_D = 587.5618
LENS = Lens(
    radius_front=50.0,
    radius_back=-50.0,
    thickness=6.0,
    semi_aperture_front=12.5,
    glass=Glass.named("N-BK7"),
)


def level_shares_picture() -> None:
    beam = parallel_beam(LENS, 20_000, wavelength_nm=LINE_D)
    heights = np.linspace(0.0, 12.4, 600)
    by_height = shares_by_height(LENS, heights, wavelength_nm=LINE_D)
    figure = plot_levels(level_shares(LENS, beam, depth=8), heights, by_height)
    write_chart(figure, IMAGES / "level_shares.png")


def cone_picture() -> None:
    distances = np.geomspace(5.0, 150.0, 120)
    cones = {
        depth: [axial_cone(LENS, d, depth=depth, wavelength_nm=LINE_D) for d in distances]
        for depth in (1, 2, 6, 7, 9)
    }
    mask = masked_cone(LENS, (8.0, 0.0, -20.0), depth=4, wavelength_nm=LINE_D, n=301)
    write_chart(plot_cones(distances, cones, mask), IMAGES / "cone_k.png")


def newton_picture() -> None:
    r = np.linspace(0.0, 2.6, 1200)
    flux = newton_rings(1000.0, r, wavelength_nm=589.3)
    side = np.linspace(-2.6, 2.6, 401)
    away = np.hypot(*np.meshgrid(side, side))
    rings = np.interp(away, r, flux, right=0.0) / flux.max()
    yellow = channel_display_rgb([589.3], gamut=True)[0]
    picture = encode_srgb(rings[..., None] * yellow / yellow.max())
    picture[away > r[-1]] = 1.0
    write_chart(plot_rings(r, flux, picture), IMAGES / "newton_rings.png")


def conoscopy_picture() -> None:
    upright = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    turned = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, np.sqrt(2.0)]]) / np.sqrt(2.0)
    mica = biaxial(1.556, 1.587, 1.593, turned @ upright, name="muscovite")
    view = Microscope(numerical_aperture=0.85, white_samples=61)
    figures = {
        "calcite, 60 µm, across the axis": conoscopy(
            CrystalPlate(crystal=calcite(), thickness_mm=0.06), view, pixels=301
        ),
        "muscovite, 200 µm, at 45°": conoscopy(
            CrystalPlate(crystal=mica, thickness_mm=0.2), view, pixels=301
        ),
    }
    write_chart(plot_conoscopy(figures, exposure=1.2), IMAGES / "conoscopy.png")


def lens_pictures() -> None:
    lens = Lens(
        radius_front=50.0,
        radius_back=-50.0,
        thickness=9.0,
        semi_aperture_front=16.0,
        glass=Glass.named("N-SF11"),
    )
    camera = LensCamera(eye=(0.0, 0.0, -70.0), half_angle_deg=15.0, pixels=300)
    spectral = lens_picture(lens, camera=camera)
    rgb = lens_picture(lens, camera=camera, color="rgb")
    write_pixels(IMAGES / "spectral_rgb.png", encode_srgb(np.concatenate([spectral, rgb], axis=1)))
    exact = lens_picture(lens, camera=camera, color="rgb", analyser_deg=0.0)
    schlick = lens_picture(lens, camera=camera, color="rgb", rules="schlick", analyser_deg=0.0)
    difference = 0.5 + 4.0 * (exact - schlick)
    row = np.concatenate([encode_srgb(2.0 * exact), encode_srgb(2.0 * schlick), difference], axis=1)
    write_pixels(IMAGES / "fresnel_schlick.png", row)


def main() -> None:
    IMAGES.mkdir(exist_ok=True)
    level_shares_picture()
    cone_picture()
    newton_picture()
    write_chart(plot_michel_levy(), IMAGES / "michel_levy.png")
    conoscopy_picture()
    lens_pictures()


if __name__ == "__main__":
    main()

"""The compiled plate walk against the exact model, and its two estimators against each other."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest

from raymap.model.errors import SceneError
from tracer.optics.phase import sample_generalized
from tracer.scattering.plates.goniophotometer import AngularGrid, measure_plate, measure_spectrum
from tracer.scattering.plates.medium import ScatteringMedium
from tracer.scattering.plates.plate_bsdf import plate_bsdf
from tracer.scattering.plates.plate_exact import reflectance_transmittance, unscattered
from tracer.scattering.plates.plate_kernel import prepare_phase, sample_prepared
from tracer.scattering.plates.tilt import gaussian_tilt, tabulated_tilt, tilt_from_brdf

RINGS = AngularGrid(theta_edges_deg=np.linspace(0.0, 90.0, 19), n_phi=1)
OPAL = ScatteringMedium(mean_free_path_mm=0.35, absorption_per_mm=0.01, g=0.35, gamma=10.0)
with (Path(__file__).parent / "plates.csv").open() as table:
    PLATES = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(table)]


@pytest.mark.parametrize("weighted", [False, True], ids=["analog", "weighted"])
def test_reference_table_within_error(weighted: bool) -> None:
    """Each value within 4.5 standard errors + 2e-4, the whole by chi² with p > 1e-3."""
    chi2, values = 0.0, 0
    for k, row in enumerate(PLATES):
        medium = ScatteringMedium(
            mean_free_path_mm=row["m"], absorption_per_mm=row["p"], g=row["g"], gamma=row["gamma"]
        )
        angle = (0.0, 30.0, 60.0)[k % 3]
        exact = reflectance_transmittance(medium, row["thickness"], angle)
        light = measure_plate(
            medium, row["thickness"], angle, rays=8000, seed=3, grid=RINGS, weighted=weighted
        )
        pairs = (
            (light.reflectance, light.reflectance_se, exact.reflectance[0, 0]),
            (light.transmittance, light.transmittance_se, exact.transmittance[0, 0]),
        )
        for value, error, truth in pairs:
            if not weighted:
                # Rays come out on a side, or they do not: the error of a share of all
                assert error == pytest.approx(math.sqrt(value * (1.0 - value) / 8000))
            assert abs(value - truth) <= 4.5 * error + 2e-4
            chi2 += ((value - truth) / error) ** 2
            values += 1
        assert light.reflectance + light.transmittance + light.absorbed == pytest.approx(
            1.0, abs=0.0 if not weighted else 5e-3, rel=1e-9
        )
    # R and T of one plate share their noise: as many degrees of freedom as plates at least
    assert chi2 < values + 4.0 * math.sqrt(2.0 * values) + 10.0


@pytest.mark.parametrize("weighted", [False, True], ids=["analog", "weighted"])
def test_cells_agree_with_the_exact_scattering_distribution(weighted: bool) -> None:
    grid = AngularGrid(theta_edges_deg=np.linspace(0.0, 90.0, 19), n_phi=8)
    light = measure_plate(OPAL, 2.05, 30.0, rays=60_000, seed=5, grid=grid, weighted=weighted)
    # Average the exact distribution over the cells
    theta = np.linspace(0.0, 90.0, 73)[:-1] + 0.625
    phi = -22.5 + 11.25 * (np.arange(32) + 0.5)
    exact = plate_bsdf(OPAL, 2.05, 30.0, theta, phi)
    weight = np.sin(2.0 * np.radians(theta))[:, None]
    for measured, error, model, deltas in (
        (light.brdf, light.brdf_se, exact.brdf, [(6, 0)]),
        (light.btdf, light.btdf_se, exact.btdf, [(6, 0)]),
    ):
        folded = (model * weight).reshape(18, 4, 8, 4)
        mean = folded.sum(axis=(1, 3)) / weight.reshape(18, 4).sum(axis=1)[:, None] / 4
        z = (measured - mean) / np.maximum(error, 1e-3 * mean)
        for cell in deltas:
            assert z[cell] > 3.0  # the specular reflection and the direct beam stand out
            z[cell] = 0.0
        assert np.abs(z).max() < 6.0
        assert np.mean(z**2) < 2.0


def test_specular_peak_holds_the_unscattered_flux() -> None:
    grid = AngularGrid(theta_edges_deg=np.array([0.0, 29.5, 30.5, 90.0]), n_phi=360)
    thin = ScatteringMedium(mean_free_path_mm=4.0, g=0.0)
    light = measure_plate(thin, 1.0, 30.0, rays=40_000, grid=grid)
    direct = unscattered(thin, 1.0, 30.0)
    cell = grid.projected_solid_angle[1, 0]
    assert light.btdf[1, 0] * cell == pytest.approx(direct.transmittance[0, 0], abs=0.01)
    assert light.brdf[1, 0] * cell == pytest.approx(direct.reflectance[0, 0], abs=0.01)


def test_result_depends_on_the_seed_only() -> None:
    one = measure_plate(OPAL, 1.0, 10.0, rays=3000, seed=7, grid=RINGS, threads=1)
    two = measure_plate(OPAL, 1.0, 10.0, rays=3000, seed=7, grid=RINGS, threads=2)
    other = measure_plate(OPAL, 1.0, 10.0, rays=3000, seed=8, grid=RINGS)
    np.testing.assert_array_equal(one.btdf, two.btdf)
    assert one.reflectance != other.reflectance


@pytest.mark.parametrize(
    ("g", "gamma"),
    [(0.5, 1.5), (0.5, 2.5), (0.9, 10.0), (0.7, 1.0), (-0.4, 3.3), (0.001, 2.0), (0.6, 0.5)],
)
def test_prepared_sampler_is_the_phase_function(g: float, gamma: float) -> None:
    prepared = prepare_phase(g, gamma)
    for u in (0.0, 1e-9, 0.1, 0.5, 0.9, 1.0 - 1e-9):
        flipped = 1.0 - u if g < 0.0 and gamma != 1.5 else u
        assert sample_prepared(prepared, flipped) == pytest.approx(
            sample_generalized(g, gamma, u), abs=1e-9
        )


@pytest.mark.parametrize("weighted", [False, True], ids=["analog", "weighted"])
def test_rough_faces_keep_energy_and_small_tilts_change_little(weighted: bool) -> None:
    lossless = ScatteringMedium(mean_free_path_mm=0.35, g=0.35, gamma=10.0)
    face = gaussian_tilt(0.05)
    light = measure_plate(
        lossless, 2.05, 30.0, rays=20_000, grid=RINGS, weighted=weighted, front=face, back=face
    )
    exact = reflectance_transmittance(lossless, 2.05, 30.0)
    assert light.reflectance + light.transmittance == pytest.approx(1.0, abs=1e-3)
    assert abs(light.reflectance - exact.reflectance[0, 0]) < 4.5 * light.reflectance_se + 1e-3


def test_tilts_come_back_from_the_brdf_of_a_rough_face() -> None:
    black = ScatteringMedium(mean_free_path_mm=math.inf, absorption_per_mm=50.0)
    face = gaussian_tilt(0.15)
    grid = AngularGrid(theta_edges_deg=np.linspace(0.0, 90.0, 91), n_phi=72)
    light = measure_plate(black, 2.0, 10.0, rays=300_000, grid=grid, front=face, back=face)
    theta, phi = np.meshgrid(grid.theta_deg, grid.phi_deg, indexing="ij")
    found = tilt_from_brdf(10.0, theta.ravel(), phi.ravel(), light.brdf.ravel())
    assert found.rms_slope == pytest.approx(0.15, rel=0.05)
    model = np.interp(found.theta_deg, face.theta_deg, face.density)
    strong = model > 1.0
    np.testing.assert_allclose(found.density[strong], model[strong], rtol=0.3)
    again = tabulated_tilt(face.theta_deg, face.density)
    assert again.rms_slope == pytest.approx(0.15, rel=0.01)


def test_spectrum_shares_random_numbers() -> None:
    media = {
        500.0: ScatteringMedium(mean_free_path_mm=0.3, absorption_per_mm=0.0, g=0.5),
        600.0: ScatteringMedium(mean_free_path_mm=0.3, absorption_per_mm=0.001, g=0.5),
    }
    blue, red = measure_spectrum(media, 1.0, 0.0, rays=2000, grid=RINGS, weighted=True)
    assert (blue.wavelength_nm, red.wavelength_nm) == (500.0, 600.0)
    # Their difference is far below the noise of either
    assert 0.0 < blue.transmittance - red.transmittance < 0.01 < 4.0 * blue.transmittance_se


def test_impossible_measurements_are_refused() -> None:
    with pytest.raises(SceneError, match="rays"):
        measure_plate(OPAL, 1.0, 0.0, rays=10)
    with pytest.raises(SceneError, match="thickness"):
        measure_plate(OPAL, -1.0, 0.0)
    with pytest.raises(SceneError, match="angle"):
        measure_plate(OPAL, 1.0, 90.0)
    with pytest.raises(SceneError, match="grid"):
        AngularGrid(theta_edges_deg=np.array([0.0, 60.0]))
    with pytest.raises(SceneError, match="rms_slope"):
        gaussian_tilt(2.0)

"""The exact plate model against tables, limits, laws and independent solvers."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from raymap.laws.phase import generalized_row, legendre_moments, rayleigh_row
from raymap.model.errors import SceneError
from tests.examples import examples
from tests.naive.adding_doubling import doubled_plate
from tracer.scattering.plates.medium import ScatteringMedium
from tracer.scattering.plates.moments import generalized_moments
from tracer.scattering.plates.plate_bsdf import plate_bsdf
from tracer.scattering.plates.plate_exact import (
    ExactPlates,
    enough_nodes,
    reflectance_transmittance,
    unscattered,
)

ANGLES = (0, 10, 20, 30, 45, 60)
with (Path(__file__).parent / "plates.csv").open() as table:
    PLATES = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(table)]

media = st.builds(
    ScatteringMedium,
    mean_free_path_mm=st.floats(0.02, 5.0),
    absorption_per_mm=st.floats(0.0, 0.5),
    g=st.floats(-0.9, 0.97),
    gamma=st.floats(0.6, 10.0),
    index=st.floats(1.0, 2.4),
)


def medium_of(row: dict[str, float]) -> ScatteringMedium:
    return ScatteringMedium(
        mean_free_path_mm=row["m"], absorption_per_mm=row["p"], g=row["g"], gamma=row["gamma"]
    )


@pytest.mark.parametrize(
    "row", PLATES, ids=lambda r: f"g{r['g']}-gamma{r['gamma']}-d{r['thickness']}"
)
def test_reference_table_of_plates(row: dict[str, float]) -> None:
    medium = medium_of(row)
    out = reflectance_transmittance(medium, row["thickness"], ANGLES)
    assert medium.mean_cosine == pytest.approx(row["mean_cosine"], abs=5.1e-5)
    # The table has four digits and was converged to 5e-5
    np.testing.assert_allclose(out.reflectance[0], [row[f"R{a}"] for a in ANGLES], atol=1e-4)
    np.testing.assert_allclose(out.transmittance[0], [row[f"T{a}"] for a in ANGLES], atol=1e-4)


def test_no_scattering_is_the_closed_form_of_an_absorbing_sheet() -> None:
    medium = ScatteringMedium(mean_free_path_mm=math.inf, absorption_per_mm=0.2)
    out = reflectance_transmittance(medium, 2.0, [0.0, 50.0])
    assert out.reflectance[0, 0] == pytest.approx(0.0548148005, abs=1e-9)
    assert out.transmittance[0, 0] == pytest.approx(0.6198264118, abs=1e-9)
    sheet = unscattered(medium, 2.0, [0.0, 50.0])
    np.testing.assert_allclose(out.reflectance, sheet.reflectance, rtol=1e-9)
    np.testing.assert_allclose(out.transmittance, sheet.transmittance, rtol=1e-9)


def test_van_de_hulst_index_matched_slab() -> None:
    """R and T of van de Hulst (1980), table 35, as quoted by Wang et al., CMPB 47, 131 (1995)."""
    medium = ScatteringMedium(mean_free_path_mm=1 / 0.9, absorption_per_mm=0.1, g=0.75, index=1.0)
    out = reflectance_transmittance(medium, 2.0, 0.0)
    assert out.reflectance[0, 0] == pytest.approx(0.09739, abs=1e-5)
    assert out.transmittance[0, 0] == pytest.approx(0.66096, abs=1e-5)


@given(medium=media, thickness=st.floats(0.05, 10.0), angle=st.floats(0.0, 89.0))
@settings(max_examples=examples(60))
def test_energy_closes_and_nothing_is_negative(
    medium: ScatteringMedium, thickness: float, angle: float
) -> None:
    out = reflectance_transmittance(medium, thickness, angle)
    r, t = out.reflectance[0, 0], out.transmittance[0, 0]
    direct = unscattered(medium, thickness, angle)
    assert r >= direct.reflectance[0, 0] - 1e-3
    assert t >= -1e-9
    if medium.absorption_per_mm == 0.0:
        # The sharpest peaks (g = 0.97, gamma = 7) are resolved to 1.1e-6
        assert r + t == pytest.approx(1.0, abs=2e-6)
    else:
        assert r + t < 1.0 + 1e-6


@given(medium=media, angle=st.floats(0.0, 80.0))
@settings(max_examples=examples(30))
def test_thicker_plates_transmit_less(medium: ScatteringMedium, angle: float) -> None:
    out = reflectance_transmittance(medium, [0.5, 1.0, 2.0, 40.0], angle)
    assert np.all(np.diff(out.transmittance[:, 0]) < 1e-6)


@pytest.mark.parametrize(("g", "gamma"), [(0.7, 1.5), (0.5, 2.5), (-0.4, 3.3), (0.3, 0.5)])
def test_step_by_step_adding_doubling_agrees(g: float, gamma: float) -> None:
    medium = ScatteringMedium(mean_free_path_mm=0.2, absorption_per_mm=0.05, g=g, gamma=gamma)
    nodes = 12
    moments = generalized_moments(g, gamma, 2 * nodes)
    forward = moments[-1]
    scattering = 1 / medium.mean_free_path_mm * (1 - forward)
    cosines, reflection, transmission = doubled_plate(
        scattering=scattering,
        absorption=medium.absorption_per_mm,
        moments=(moments[:-1] - forward) / (1 - forward),
        thickness=1.5,
        index=medium.index,
        nodes=nodes,
        doublings=22,
    )
    angles = np.degrees(np.arccos(cosines[::4]))
    out = reflectance_transmittance(medium, 1.5, angles, nodes=nodes)
    np.testing.assert_allclose(out.reflectance[0], reflection.sum(axis=0)[::4], atol=2e-5)
    np.testing.assert_allclose(out.transmittance[0], transmission.sum(axis=0)[::4], atol=2e-5)


def test_more_nodes_change_nothing() -> None:
    for g, gamma in [(0.95, 1.5), (0.8, 10.0), (0.2, 1.0)]:
        medium = ScatteringMedium(mean_free_path_mm=0.05, absorption_per_mm=0.01, g=g, gamma=gamma)
        coarse = reflectance_transmittance(medium, [0.5, 3.0], [0, 45, 75])
        fine = reflectance_transmittance(medium, [0.5, 3.0], [0, 45, 75], nodes=96)
        np.testing.assert_allclose(coarse.reflectance, fine.reflectance, atol=2e-4)
        np.testing.assert_allclose(coarse.transmittance, fine.transmittance, atol=2e-4)


@pytest.mark.parametrize(
    ("g", "gamma"), [(0.5, 1.5), (0.99, 1.5), (0.35, 10.0), (-0.4, 3.3), (0.7, 1.0), (1e-7, 2.0)]
)
def test_moments_by_recurrence_equal_quadrature(g: float, gamma: float) -> None:
    np.testing.assert_allclose(
        generalized_moments(g, gamma, 40),
        legendre_moments(generalized_row(g, gamma), order=40),
        atol=1e-11,
    )


def test_any_phase_function_by_its_moments() -> None:
    """Rayleigh scattering has two moments; its plates reflect alike whoever names them."""
    moments = legendre_moments(rayleigh_row(), order=64)
    assert moments[2] == pytest.approx(0.1)
    medium = ScatteringMedium(mean_free_path_mm=0.5, absorption_per_mm=0.0, moments=moments)
    out = reflectance_transmittance(medium, 1.0, [0.0, 60.0])
    np.testing.assert_allclose(out.reflectance + out.transmittance, 1.0, atol=1e-7)
    isotropic = reflectance_transmittance(ScatteringMedium(mean_free_path_mm=0.5), 1.0, [0.0, 60.0])
    assert np.all(np.abs(out.reflectance - isotropic.reflectance) > 1e-4)
    assert enough_nodes(medium) == 32


BTDF_ANGLES = (5.88, 10.76, 20.36, 29.83, 39.13, 48.24, 61.50, 70.10, 78.53, 86.82)
BTDF = {
    (0.35, 0.01, 0.35, 10.0): (
        0.26130, 0.25712, 0.24386, 0.22780, 0.21207, 0.19767, 0.17616, 0.15658, 0.12233, 0.04975,
    ),
    (0.0956, 0.01002, 0.8588, 2.5): (
        0.25372, 0.25088, 0.24127, 0.22837, 0.21433, 0.20038, 0.17844, 0.15835, 0.12354, 0.05021,
    ),
}  # fmt: skip


@pytest.mark.parametrize("parameters", BTDF)
def test_reference_btdf_at_normal_incidence(parameters: tuple[float, ...]) -> None:
    m, p, g, gamma = parameters
    medium = ScatteringMedium(mean_free_path_mm=m, absorption_per_mm=p, g=g, gamma=gamma)
    light = plate_bsdf(medium, 2.05, 0.0, BTDF_ANGLES)
    np.testing.assert_allclose(light.btdf[:, 0], BTDF[parameters], atol=5e-5)


def test_section_of_the_flux_solver_is_the_full_one() -> None:
    medium = ScatteringMedium(mean_free_path_mm=0.3, absorption_per_mm=0.01, g=0.7)
    solver = ExactPlates(
        index=1.49, incidence_deg=[0.0, 40.0], section_deg=[0.0, 10.0, 70.0], nodes=24
    )
    out = solver.solve(medium, [1.0, 2.0])
    plain = reflectance_transmittance(medium, [1.0, 2.0], [0.0, 40.0], nodes=24)
    np.testing.assert_allclose(out.reflectance, plain.reflectance, atol=1e-6)
    np.testing.assert_allclose(out.transmittance, plain.transmittance, atol=1e-6)
    light = plate_bsdf(medium, 2.0, 0.0, [0.0, 10.0, 70.0], nodes=24)
    np.testing.assert_allclose(out.btdf[1], light.btdf[:, 0], rtol=1e-5)


@pytest.mark.parametrize(("g", "gamma", "angle"), [(0.8, 1.5, 30.0), (0.35, 10.0, 60.0)])
def test_scattered_light_integrates_to_the_fluxes(g: float, gamma: float, angle: float) -> None:
    medium = ScatteringMedium(mean_free_path_mm=0.35, absorption_per_mm=0.01, g=g, gamma=gamma)
    x, w = np.polynomial.legendre.leggauss(40)
    cosines = (x + 1) / 2
    azimuths = np.arange(72) * 5.0
    light = plate_bsdf(medium, 2.05, angle, np.degrees(np.arccos(cosines)), azimuths)
    measure = np.pi * w * cosines
    total = reflectance_transmittance(medium, 2.05, angle)
    direct = unscattered(medium, 2.05, angle)
    assert measure @ light.brdf.mean(axis=1) == pytest.approx(
        (total.reflectance - direct.reflectance)[0, 0], abs=1e-4
    )
    assert measure @ light.btdf.mean(axis=1) == pytest.approx(
        (total.transmittance - direct.transmittance)[0, 0], abs=1e-4
    )
    assert light.brdf.min() > 0.0
    assert light.btdf.min() > 0.0


@given(medium=media, first=st.floats(1.0, 80.0), second=st.floats(1.0, 80.0))
@settings(max_examples=examples(8))
def test_scattering_is_reciprocal(medium: ScatteringMedium, first: float, second: float) -> None:
    there = plate_bsdf(medium, 1.0, first, second, 37.0, nodes=24)
    back = plate_bsdf(medium, 1.0, second, first, 37.0, nodes=24)
    scale = max(1e-3, abs(there.btdf[0, 0]))
    assert there.brdf[0, 0] == pytest.approx(back.brdf[0, 0], abs=1e-5 * scale + 1e-6)
    assert there.btdf[0, 0] == pytest.approx(back.btdf[0, 0], abs=1e-5 * scale + 1e-6)


@pytest.mark.peers
@pytest.mark.filterwarnings("ignore")
def test_iadpython_on_random_henyey_greenstein_plates() -> None:
    iad = pytest.importorskip("iadpython")
    random = np.random.default_rng(20)
    for _ in range(25):
        g, albedo = random.uniform(-0.5, 0.92), random.uniform(0.3, 1.0)
        depth, index = 10 ** random.uniform(-1, 1.5), random.uniform(1.3, 1.7)
        sample = iad.Sample(a=albedo, b=depth, g=g, n=index, quad_pts=48)
        r, t, _, _ = sample.rt()
        medium = ScatteringMedium(
            mean_free_path_mm=1 / albedo, absorption_per_mm=1 - albedo, g=g, index=index
        )
        out = reflectance_transmittance(medium, depth, 0.0)
        assert out.reflectance[0, 0] == pytest.approx(float(r), abs=2e-4)
        assert out.transmittance[0, 0] == pytest.approx(float(t), abs=2e-4)


def test_what_the_model_cannot_mean_is_refused() -> None:
    medium = ScatteringMedium(mean_free_path_mm=0.1)
    with pytest.raises(SceneError, match="angles of incidence"):
        reflectance_transmittance(medium, 1.0, 95.0)
    with pytest.raises(SceneError, match="thicknesses"):
        reflectance_transmittance(medium, [1.0, 0.0], 0.0)
    with pytest.raises(SceneError, match="index"):
        ExactPlates(index=1.5, incidence_deg=0.0).solve(medium, 1.0)
    with pytest.raises(SceneError, match="mean_free_path_mm"):
        ScatteringMedium(mean_free_path_mm=-0.1)
    short = ScatteringMedium(mean_free_path_mm=0.1, moments=np.array([1.0, 0.5]))
    with pytest.raises(SceneError, match="Legendre moments"):
        ExactPlates(index=1.49, incidence_deg=0.0).solve(short, 1.0)

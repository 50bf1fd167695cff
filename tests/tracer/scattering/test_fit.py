"""The fit: recovery from clean and noisy data, coverage, identifiability, bounds, Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tracer.scattering.synthetic import (
    CLEAR,
    CLEAR_PLATES,
    DENSE,
    DENSE_PLATES,
    flux_table,
    problem_of,
)
from tracer.scattering.fits.fit_exact import fit_wavelength, published_objective
from tracer.scattering.fits.fit_mc import fit_monte_carlo, traced_fluxes
from tracer.scattering.fits.identifiability import profile_along_g, sensitivity
from tracer.scattering.fits.problem import medium_of, parameters_of
from tracer.scattering.measured.measurement import MeasurementError
from tracer.scattering.plates.medium import ScatteringMedium

CASES = [(DENSE, DENSE_PLATES), (CLEAR, CLEAR_PLATES)]


@pytest.mark.parametrize(("medium", "plates"), CASES, ids=["dense", "clear"])
def test_clean_data_give_back_the_medium(
    medium: ScatteringMedium, plates: tuple[float, ...]
) -> None:
    fit = fit_wavelength(problem_of(flux_table(medium, plates)), medium.gamma)
    found = fit.medium
    assert found.reduced_scattering_per_mm == pytest.approx(
        medium.reduced_scattering_per_mm, rel=0.005
    )
    assert found.absorption_per_mm == pytest.approx(medium.absorption_per_mm, rel=0.01)
    assert found.g == pytest.approx(medium.g, abs=0.02)
    assert fit.rms < 1e-4
    assert fit.bounds == ()


@pytest.mark.parametrize("gamma", [1.5, 10.0])
def test_dense_plates_fit_any_exponent_and_still_tell_the_similarity_parameter(
    gamma: float,
) -> None:
    fit = fit_wavelength(problem_of(flux_table(DENSE, DENSE_PLATES)), gamma)
    assert fit.rms < 1e-3
    assert fit.medium.reduced_scattering_per_mm == pytest.approx(
        DENSE.reduced_scattering_per_mm, rel=0.02
    )
    assert fit.medium.absorption_per_mm == pytest.approx(DENSE.absorption_per_mm, rel=0.05)


def test_a_wrong_exponent_runs_into_a_bound_and_says_so() -> None:
    fit = fit_wavelength(problem_of(flux_table(CLEAR, CLEAR_PLATES)), 1.5)
    assert fit.rms == pytest.approx(0.021, abs=0.005)
    assert any("bound" in text for text in fit.bounds)


def test_singular_values_of_both_materials() -> None:
    """Reference: 13.19, 0.49, 0.0042 and 8.0, 0.64, 0.050 for three plates and five angles."""
    for medium, plates, expected in (
        (DENSE, DENSE_PLATES, (13.19, 0.49, 0.0042)),
        (CLEAR, CLEAR_PLATES, (8.04, 0.64, 0.050)),
    ):
        flux = flux_table(medium, plates, angles=(0.0, 10.0, 20.0, 30.0, 45.0))
        found = sensitivity(problem_of(flux, equal_weights=True), medium)
        np.testing.assert_allclose(found.singular_values, expected, rtol=0.02)
        # The weakest direction trades m against g at constant mu_s'
        assert abs(found.directions[2] @ [0.0, 1.0, 0.0]) < 0.05


def coverage(
    medium: ScatteringMedium, plates: tuple[float, ...], repetitions: int, seed: int
) -> dict[str, int]:
    random = np.random.default_rng(seed)
    names = ("reduced_scattering_per_mm", "absorption_per_mm")
    inside = dict.fromkeys(names, 0)
    for _ in range(repetitions):
        problem = problem_of(flux_table(medium, plates, noise=0.05, random=random))
        fit = fit_wavelength(problem, medium.gamma)
        intervals = profile_along_g(fit).intervals
        for name in names:
            inside[name] += getattr(medium, name) in intervals[name]
    return inside


@pytest.mark.parametrize(("medium", "plates"), CASES, ids=["dense", "clear"])
def test_intervals_cover_the_truth_as_often_as_they_say(
    medium: ScatteringMedium, plates: tuple[float, ...]
) -> None:
    """68 % intervals; 12 repetitions fall outside 4 .. 12 once in a thousand times."""
    for count in coverage(medium, plates, 12, seed=11).values():
        assert 4 <= count <= 12


@pytest.mark.slow
@pytest.mark.parametrize(("medium", "plates"), CASES, ids=["dense", "clear"])
def test_coverage_of_a_hundred_repetitions(
    medium: ScatteringMedium, plates: tuple[float, ...]
) -> None:
    """68 % intervals within binomial error."""
    for name, count in coverage(medium, plates, 100, seed=2018).items():
        assert 58 <= count <= 78, f"{name}: {count} of 100"


def test_parameters_come_back() -> None:
    again = medium_of(parameters_of(CLEAR), CLEAR.gamma, CLEAR.index)
    assert again.mean_free_path_mm == pytest.approx(CLEAR.mean_free_path_mm)
    assert again.g == pytest.approx(CLEAR.g)


def test_section_of_the_thinnest_plate_tells_more_about_g() -> None:
    from tracer.scattering.fits.problem import WavelengthProblem
    from tracer.scattering.plates.plate_bsdf import plate_bsdf

    theta = np.array([0.0, 5.0, 10.0, 20.0, 30.0, 45.0, 60.0])
    thin = ScatteringMedium(mean_free_path_mm=0.5, absorption_per_mm=0.01, g=0.35, gamma=10.0)
    flux = flux_table(thin, (0.5, 1.0))
    light = plate_bsdf(thin, 0.5, 0.0, theta).btdf[:, 0]
    plain = problem_of(flux)
    shaped = WavelengthProblem(
        flux=flux, index=1.49, weights=plain.weights,
        section=(theta, 1.7 * light, np.full(theta.size, 0.1)),
    )  # fmt: skip
    alone, together = (fit_wavelength(p, 10.0) for p in (plain, shaped))
    widths = [
        i.high - i.low for i in (profile_along_g(f).intervals["g"] for f in (alone, together))
    ]
    assert widths[1] < 0.8 * widths[0]
    assert together.medium.g == pytest.approx(0.35, abs=0.02)  # its level does not matter


def test_monte_carlo_fit_improves_its_objective_and_reports_its_noise() -> None:
    flux = flux_table(CLEAR, CLEAR_PLATES[:2], angles=(0.0, 30.0))
    problem = problem_of(flux)
    start = ScatteringMedium(mean_free_path_mm=0.30, absorption_per_mm=0.013, g=0.35, gamma=10.0)
    fit = fit_monte_carlo(problem, start, rays=600, evaluations=20, seed=4)
    assert len(fit.log) <= 20
    assert fit.objective == min(entry.objective for entry in fit.log)
    assert fit.objective < fit.log[0].objective
    assert 0.0 < fit.noise < 0.05
    assert fit.medium.reduced_scattering_per_mm == pytest.approx(
        CLEAR.reduced_scattering_per_mm, rel=0.25
    )
    # Common random numbers: the same medium gives the same objective
    values = [traced_fluxes(problem, start, rays=500, seed=1, threads=k) for k in (1, 2)]
    np.testing.assert_array_equal(*values)
    assert published_objective(problem, values[0]) > 0.0


def test_fewer_values_than_parameters_are_refused() -> None:
    flux = flux_table(CLEAR, (1.0,), angles=(0.0,))
    with pytest.raises(MeasurementError, match="2 measured values"):
        problem_of(flux)

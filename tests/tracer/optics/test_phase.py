"""Phase functions: normalised, sampled as evaluated, with known moments."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from raymap.laws import phase
from raymap.model.errors import SceneError
from tests.examples import examples
from tests.tracer.chi2 import chi2_line
from tracer.optics import phase as draws

EMPTY = np.zeros(0)

# Values with 10 digits from an evaluation in extended precision
SPOT = [
    # g, gamma, A, mean cosine, mu(.1), mu(.5), mu(.9)
    (0.5, 1.5, 0.05968310366, 0.5, -0.3125, 0.6875, 0.9630102041),
    (0.8, 1.5, 0.02864788976, 0.8, 0.4, 0.944, 0.9948839976),
    (0.7, 1.0, 0.06422713731, 0.4877842779, -0.3948788481, 0.7, 0.9733404672),
    (0.3, 2.0, 0.06589810419, 0.3927045320, -0.4459016393, 0.5504587156, 0.9375796178),
    (0.5, 2.5, 0.03098930382, 0.7307692308, 0.2921132095, 0.8626557075, 0.9825417694),
    (0.8, 2.5, 0.0030599724, 0.9582417582, 0.9099056195, 0.9853512240, 0.9981835752),
    (0.35, 10.0, 0.0004301321853, 0.9245579227, 0.8240304597, 0.9516783691, 0.9928926497),
    (0.6, 10.0, 1.181200796e-07, 0.9833333334, 0.9611267113, 0.9893253681, 0.9984299312),
    (-0.4, 3.3, 0.02851259057, -0.7271326972, -0.9793675837, -0.8470212266, -0.3115257201),
]


@pytest.mark.parametrize("spot", SPOT)
def test_generalized_spot_values(spot: tuple[float, ...]) -> None:
    g, gamma, amplitude, mean, low, middle, high = spot
    row = phase.generalized_row(g, gamma)
    for mu in (-1.0, -0.2, 0.9):
        expected = amplitude / (1 + g * g - 2 * g * mu) ** gamma
        assert phase.eval_phase(row, EMPTY, mu) == pytest.approx(expected, rel=1e-8)
    assert phase.mean_cosine(row) == pytest.approx(mean, abs=2e-10)
    for u, expected in ((0.1, low), (0.5, middle), (0.9, high)):
        assert draws.sample_phase(row, EMPTY, u) == pytest.approx(expected, abs=1e-9)


@settings(max_examples=examples(60))
@given(st.floats(-0.99, 0.99), st.floats(-3.0, 200.0), st.floats(0.0, 0.9999))
def test_generalized_distribution_is_inverted(g: float, gamma: float, u: float) -> None:
    """The probability up to the drawn cosine is the uniform number (by quadrature in log space)."""
    mu = draws.sample_generalized(g, gamma, u)
    assert -1.0 <= mu <= 1.0
    nodes, weights = np.polynomial.legendre.leggauss(60)
    # Substitute x = log(1 + g² - 2 g mu), in which the density is an exponential
    if abs(g) < 1e-3:
        edges = np.linspace(-1.0, mu, 9)
        half = np.diff(edges) / 2
        points = edges[:-1, None] + half[:, None] * (1 + nodes)
        density = np.vectorize(lambda m: phase.eval_generalized(g, gamma, m))(points)
        mass = 2 * np.pi * (density * half[:, None] * weights).sum()
    else:
        edges = np.linspace(2 * np.log1p(g), np.log(1 + g * g - 2 * g * mu), 65)
        half = np.diff(edges) / 2
        x = edges[:-1, None] + half[:, None] * (1 + nodes)
        cosine = np.clip((1 + g * g - np.exp(x)) / (2 * g), -1, 1)
        density = np.vectorize(lambda m: phase.eval_generalized(g, gamma, m))(cosine)
        jacobian = -np.exp(x) / (2 * g)
        mass = 2 * np.pi * (density * jacobian * half[:, None] * weights).sum()
    assert mass == pytest.approx(u, abs=2e-6)


@given(st.floats(-0.999, 0.999), st.floats(0.0, 1.0, exclude_max=True))
def test_henyey_greenstein_is_the_general_form(g: float, u: float) -> None:
    assert draws.sample_henyey_greenstein(g, u) == pytest.approx(
        draws.sample_generalized(g, 1.5, u), abs=1e-9
    )
    mu = 2 * u - 1
    assert phase.eval_henyey_greenstein(g, mu) == pytest.approx(
        phase.eval_generalized(g, 1.5, mu), rel=1e-9
    )


def test_moments_of_henyey_greenstein_are_powers_of_g() -> None:
    for g in (-0.7, 0.0, 0.3, 0.9, 0.99):
        moments = phase.legendre_moments(phase.henyey_greenstein_row(g), order=40)
        np.testing.assert_allclose(moments, g ** np.arange(41.0), atol=1e-11)


def test_moments_of_rayleigh() -> None:
    moments = phase.legendre_moments(phase.rayleigh_row(), order=4)
    np.testing.assert_allclose(moments, [1.0, 0.0, 0.1, 0.0, 0.0], atol=1e-14)


def _rows() -> list[tuple[str, np.ndarray, np.ndarray]]:
    angles = [0.0, 2.0, 5.0, 20.0, 60.0, 110.0, 150.0, 180.0]
    values = [300.0, 120.0, 20.0, 4.0, 0.5, 0.0, 0.7, 1.1]
    row, table = phase.tabulated_phase(angles, values, first=3)
    return [
        ("isotropic", phase.isotropic_row(), EMPTY),
        ("hg", phase.henyey_greenstein_row(0.85), EMPTY),
        ("backward", phase.generalized_row(-0.4, 3.3), EMPTY),
        ("log", phase.generalized_row(0.7, 1.0), EMPTY),
        ("below", phase.generalized_row(0.7, -0.5), EMPTY),
        ("rayleigh", phase.rayleigh_row(), EMPTY),
        ("tabulated", row, np.concatenate((np.zeros(3), table))),
    ]


@pytest.mark.parametrize("case", _rows(), ids=lambda case: case[0])
def test_samples_follow_the_density(case: tuple[str, np.ndarray, np.ndarray]) -> None:
    _, row, tables = case
    uniform = np.random.default_rng(5).random(200_000)
    drawn = np.array([draws.sample_phase(row, tables, u) for u in uniform])
    assert np.all(np.diff(drawn[np.argsort(uniform)]) >= -1e-12)
    chi2_line(
        drawn,
        lambda mu: 2 * np.pi * draws.pdf_phase(row, tables, mu),
        np.concatenate((np.linspace(-1, 0.9, 20), 1 - np.geomspace(0.08, 1e-3, 10), [1.0])),
    )


@pytest.mark.parametrize("case", _rows(), ids=lambda case: case[0])
def test_densities_integrate_to_one(case: tuple[str, np.ndarray, np.ndarray]) -> None:
    _, row, tables = case
    assert phase.legendre_moments(row, tables, order=0)[0] == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: phase.henyey_greenstein_row(1.0), "between -1 and 1"),
        (lambda: phase.generalized_row(0.5, float("inf")), "finite"),
        (lambda: phase.tabulated_phase([0, 90], [1, 1]), "0 to 180"),
        (lambda: phase.tabulated_phase([0, 180], [1, -1]), "not negative"),
        (lambda: phase.tabulated_phase([0], [1]), "two or more"),
    ],
)
def test_bad_input_is_refused(build: object, words: str) -> None:
    with pytest.raises(SceneError, match=words):
        build()  # type: ignore[operator]

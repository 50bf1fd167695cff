"""Scattering of polished surfaces: closed forms, sampling, energy, wavelength."""

from __future__ import annotations

import math

import numpy as np
import pytest

from raymap.laws import radial as scatter
from raymap.model.errors import SceneError
from tests.tracer.chi2 import chi2_sphere
from tracer.optics import radial


def test_abg_of_power_two_has_a_closed_total() -> None:
    """TIS at normal incidence = 2 pi A integral of r / (B + r²) = pi A ln(1 + 1 / B)."""
    a, b = 1e-3, 1e-4
    table = scatter.radial_table(scatter.abg(a, b, 2.0))
    assert scatter.scatter_share(table, 0, 0.0) == pytest.approx(
        math.pi * a * math.log(1 + 1 / b), rel=2e-4
    )
    for rho in (1e-6, 1e-3, 0.03, 0.5, 1.9):
        assert scatter.eval_radial(table, 0, rho) == pytest.approx(a / (b + rho**2), rel=3e-4)


def test_harvey_shack_has_a_closed_total() -> None:
    b, width, s = 5.0, 0.01, -1.5
    table = scatter.radial_table(scatter.harvey_shack(b, width, s))
    total = 2 * math.pi * b * width**2 / (s + 2) * ((1 + width**-2) ** (s / 2 + 1) - 1)
    assert scatter.scatter_share(table, 0, 0.0) == pytest.approx(total, rel=2e-4)


def test_a_constant_law_is_lambertian_at_every_angle() -> None:
    table = scatter.radial_table(scatter.abg(0.5, 0.9, 0.0))
    expected = math.pi * 0.5 / 1.9
    for beta in np.linspace(0, 1, 33):
        assert scatter.scatter_share(table, 0, beta) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(
    ("law", "angle"),
    [
        (scatter.abg(0.02, 1e-2, 1.8), 0.0),
        (scatter.abg(0.02, 1e-2, 1.8), 60.0),
        (scatter.abg(0.1, 0.5, 0.5), 80.0),
        (scatter.harvey_shack(0.5, 0.1, -1.5), 45.0),
        (scatter.tabulated_radial([0.01, 0.1, 1.0], [1.0, 0.3, 0.1]), 75.0),
    ],
)
def test_samples_follow_the_bsdf(law, angle: float) -> None:  # type: ignore[no-untyped-def]
    table = np.concatenate((np.zeros(3), scatter.radial_table(law)))
    beta = math.sin(math.radians(angle))
    beta_x, beta_y = beta * math.cos(0.4), beta * math.sin(0.4)
    u = np.random.default_rng(7).random((60_000, 2))
    out = np.array([radial.sample_radial(table, 3, beta_x, beta_y, a, b) for a, b in u])
    np.testing.assert_allclose(np.linalg.norm(out, axis=1), 1.0)
    chi2_sphere(
        out,
        lambda x, y, z: radial.pdf_radial(table, 3, beta_x, beta_y, x, y, z),
        cells=(24, 24),
        gauss=14,
        significance=1e-5,
    )


def test_reciprocity() -> None:
    """f depends on |beta + beta'| of both directions alike."""
    table = scatter.radial_table(scatter.abg(0.02, 1e-2, 1.8))
    rng = np.random.default_rng(3)
    for _ in range(20):
        a, b = rng.uniform(-0.6, 0.6, (2, 2))
        there = scatter.eval_radial(table, 0, math.hypot(*(b - -a)))
        back = scatter.eval_radial(table, 0, math.hypot(*(a - -b)))
        assert there == back


def test_the_roughness_is_the_same_at_all_wavelengths() -> None:
    """The total scatter of a fine roughness falls as 1 / λ², BSDF / cosines as PSD / λ⁴."""
    totals = []
    for wavelength in (400.0, 800.0):
        law = scatter.abg(1e-4, 1e-8, 3.0, wavelength_nm=wavelength, reference_nm=632.8)
        totals.append(scatter.scatter_share(scatter.radial_table(law), 0, 0.0))
    assert totals[0] / totals[1] == pytest.approx(4.0, rel=0.02)
    law_1 = scatter.harvey_shack(1.0, 0.01, -1.6, wavelength_nm=1000.0, reference_nm=500.0)
    law_0 = scatter.harvey_shack(1.0, 0.01, -1.6)
    # The same spatial frequency rho / λ
    assert law_1(np.array([0.2]))[0] == pytest.approx(law_0(np.array([0.1]))[0] / 16)


def test_more_scatter_than_light_is_refused() -> None:
    with pytest.raises(SceneError, match=r"scatters .* degrees.*must not exceed 1"):
        scatter.radial_table(scatter.abg(1.0, 0.1, 1.0), name="bad")
    with pytest.raises(SceneError, match="A must be positive"):
        scatter.abg(0.0, 1.0, 1.0)
    with pytest.raises(SceneError, match="g must not be negative"):
        scatter.abg(1.0, 1.0, -1.0)
    with pytest.raises(SceneError, match="s must not be positive"):
        scatter.harvey_shack(1.0, 1.0, 1.0)
    with pytest.raises(SceneError, match="distances must rise"):
        scatter.tabulated_radial([1, 0.5], [1, 1])

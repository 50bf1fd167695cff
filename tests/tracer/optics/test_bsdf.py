"""Diffuse, tabulated and retroreflecting surfaces."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from raymap.laws import lambertian, sheet, tabulated
from raymap.laws.retroreflector import pdf_retro
from raymap.model.errors import SceneError
from tests.tracer.chi2 import chi2_line, chi2_sphere
from tracer.optics import bsdf


def incident(angle_deg: float, azimuth_deg: float) -> tuple[float, float, float]:
    theta, phi = math.radians(angle_deg), math.radians(azimuth_deg)
    return math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)


def uniforms(n: int, columns: int, seed: int = 3) -> NDArray[np.float64]:
    return np.random.default_rng(seed).random((n, columns))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_lambert(side: float) -> None:
    out = np.array([bsdf.sample_lambert(a, b, side) for a, b in uniforms(60_000, 2)])
    chi2_sphere(out, lambda _x, _y, z: bsdf.pdf_lambert(z, side))
    assert lambertian.eval_lambert(0.6) * math.pi == pytest.approx(0.6)


@pytest.mark.parametrize(("angle", "spread"), [(0.0, 20.0), (50.0, 10.0), (85.0, 30.0)])
def test_retro(angle: float, spread: float) -> None:
    wi = incident(angle, 130.0)
    cosine = math.cos(math.radians(spread))
    out = np.array([bsdf.sample_retro(*wi, cosine, a, b) for a, b in uniforms(60_000, 2)])
    assert np.all(out[:, 2] >= 0)
    # Uniform over the cone about wi, unless part of it is mirrored to the front
    if angle + spread < 90.0:
        chi2_line(out @ wi, lambda _c: 1 / (1 - cosine), np.linspace(cosine, 1, 20))
    else:
        chi2_sphere(
            out, lambda x, y, z: pdf_retro(*wi, x, y, z, cosine), gauss=40, cells=(16, 16),
            significance=1e-6,
        )  # fmt: skip
    # The density counts how often a direction is reached
    once = 1 / (2 * math.pi * (1 - cosine))
    norm = math.hypot(wi[0], wi[1]) or 1.0
    assert pdf_retro(*wi, *wi, cosine) == pytest.approx(once * (2 if angle == 85 else 1))
    grazing = pdf_retro(*wi, wi[0] / norm, wi[1] / norm, 1e-9, cosine)
    assert grazing == pytest.approx(2 * once if angle == 85 else 0.0)
    assert bsdf.sample_retro(*wi, 1.0, 0.3, 0.4) == wi


def lobe_table(full: bool) -> NDArray[np.float64]:
    """A lobe about the specular direction, different to the left and to the right if ``full``."""
    theta_i = np.array([0.0, 30.0, 60.0])
    theta_o = np.arange(0.0, 90.0, 6.0)
    phi = np.arange(0.0, 360.0, 20.0) if full else np.arange(0.0, 181.0, 15.0)
    i, o, p = np.meshgrid(*(np.radians(a) for a in (theta_i, theta_o, phi)), indexing="ij")
    cosine = np.sin(i) * np.sin(o) * np.cos(p) + np.cos(i) * np.cos(o)
    values = 0.05 + 0.4 * np.maximum(cosine, 0) ** 8 * (1 + 0.5 * np.sin(p) * full)
    return np.concatenate((np.zeros(5), tabulated.tabulated_bsdf(theta_i, theta_o, phi, values)))


@pytest.mark.parametrize(
    ("full", "angle", "side"),
    [(False, 0.0, 1.0), (True, 17.0, 1.0), (False, 45.0, -1.0), (True, 75.0, -1.0)],
)
def test_tables_are_sampled_as_evaluated(full: bool, angle: float, side: float) -> None:
    table = lobe_table(full)
    wi = incident(angle, 200.0)
    out = np.array([bsdf.sample_tabulated(table, 5, *wi, *u, side) for u in uniforms(60_000, 3)])
    np.testing.assert_allclose(np.linalg.norm(out, axis=1), 1.0)
    chi2_sphere(
        out,
        lambda x, y, z: bsdf.pdf_tabulated(table, 5, *wi, x, y, z, side),
        cells=(16, 16),
        gauss=32,
        significance=1e-6,
    )


def test_a_constant_table_is_lambertian() -> None:
    table = tabulated.tabulated_bsdf(
        [0.0, 80.0], np.arange(0, 91, 10.0), np.arange(0, 181, 30.0), np.full((2, 10, 7), 0.2)
    )
    for angle in (0.0, 33.0, 89.0):
        assert tabulated.tabulated_share(table, 0, math.cos(math.radians(angle))) == pytest.approx(
            0.2 * math.pi
        )
    assert tabulated.eval_tabulated(table, 0, *incident(20, 0), *incident(50, 77), 1.0) == 0.2
    assert tabulated.eval_tabulated(table, 0, *incident(20, 0), 0.0, 0.0, -1.0, 1.0) == 0.0


def test_the_lobe_points_to_the_specular_ray() -> None:
    table = lobe_table(False)
    wi = incident(60.0, 30.0)
    ahead = tabulated.eval_tabulated(table, 5, *wi, -wi[0], -wi[1], wi[2], 1.0)
    back = tabulated.eval_tabulated(table, 5, *wi, *wi, 1.0)
    assert ahead > 5 * back


def test_filter_follows_the_longer_path() -> None:
    assert sheet.filter_transmittance(0.5, 1.0, 1.0, 1.5) == 0.5
    cosine = math.sqrt(1 - 0.75 / 1.5**2)
    assert sheet.filter_transmittance(0.5, 0.5, 1.0, 1.5) == pytest.approx(0.5 ** (1 / cosine))
    assert sheet.filter_transmittance(0.0, 0.5, 1.0, 1.5) == 0.0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([0], [0, 45], [0, 180], np.full((1, 2, 2), 0.4)), r"creates energy: at 0 degrees"),
        (([0], [0, 45], [0, 180], np.full((1, 2, 2), -1)), "not negative"),
        (([0], [45, 0], [0, 180], np.zeros((1, 2, 2))), "angles of scattering must rise"),
        (([95], [0, 45], [0, 180], np.zeros((1, 2, 2))), "within 0 and 90"),
        (([0], [0, 45], [0, 90], np.zeros((1, 2, 2))), "they end at 90"),
        (([0], [0, 45], [0, 10, 180], np.zeros((1, 2, 3))), "equal steps"),
        (([0], [0, 45], [0, 180], np.zeros((2, 2, 2))), "needs 1 x 2 x 2"),
    ],
)
def test_bad_tables_are_refused(arguments, words: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(SceneError, match=words):
        tabulated.tabulated_bsdf(*arguments, name="bad")


def test_energy_check_names_the_angle() -> None:
    tabulated.check_energy(lambda _cosine: 1.0)
    with pytest.raises(SceneError, match=r"'paint' creates energy.* at 89\.9 degrees"):
        tabulated.check_energy(lambda cosine: 1.2 - cosine, name="paint")
    with pytest.raises(SceneError, match="not a number"):
        tabulated.check_energy(lambda _cosine: math.nan)

"""Rough surfaces: sampled as evaluated, reciprocal, and nothing is lost."""

from __future__ import annotations

import math
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from raymap.jit.kernels import kernel
from raymap.laws import microfacet as laws
from raymap.laws import microfacet_losses as losses
from raymap.model.errors import SceneError
from raymap.optics.ggx import ggx_distribution
from tests.tracer.chi2 import chi2_sphere
from tracer.optics import microfacet as mf


@cache
def dielectric(alpha: float) -> NDArray[np.float64]:
    return np.concatenate((np.zeros(7), losses.dielectric_table(alpha)))


@cache
def conductor(alpha: float) -> NDArray[np.float64]:
    return np.concatenate((np.zeros(5), losses.conductor_table(alpha)))


def incident(angle_deg: float, azimuth_deg: float = 0.0) -> tuple[float, float, float]:
    theta, phi = math.radians(angle_deg), math.radians(azimuth_deg)
    return math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)


@kernel
def _draw_dielectric(table, wi, alpha, n_i, n_o, u):  # type: ignore[no-untyped-def]
    out = np.empty((len(u), 3))
    for k in range(len(u)):
        out[k, 0], out[k, 1], out[k, 2], _ = mf.sample_rough_dielectric(
            table, 7, wi[0], wi[1], wi[2], alpha, n_i, n_o,
            (u[k, 0], u[k, 1], u[k, 2], u[k, 3], u[k, 4])
        )  # fmt: skip
    return out


@kernel
def _draw_conductor(table, wi, alpha, u):  # type: ignore[no-untyped-def]
    out = np.empty((len(u), 4))
    for k in range(len(u)):
        out[k] = mf.sample_rough_conductor(
            table, 5, wi[0], wi[1], wi[2], alpha, (u[k, 0], u[k, 1], u[k, 2], u[k, 3], u[k, 4])
        )
    return out


@pytest.mark.parametrize(
    ("alpha", "n_i", "n_o", "angle"),
    [
        (0.3, 1.0, 1.5, 30.0), (0.3, 1.5, 1.0, 30.0), (0.5, 1.0, 1.5, 70.0),
        (0.5, 1.5, 1.0, 60.0), (1.0, 1.0, 1.5, 45.0), (1.0, 1.52, 1.0, 10.0),
        (0.4, 1.33, 1.7, 80.0), (0.7, 1.0, 2.2, 0.0),
    ],
)  # fmt: skip
def test_rough_glass_is_sampled_as_evaluated(
    alpha: float, n_i: float, n_o: float, angle: float
) -> None:
    wi = incident(angle, 20.0)
    table = dielectric(alpha)
    u = np.random.default_rng(4).random((60_000, 5))
    out = _draw_dielectric(table, wi, alpha, n_i, n_o, u)
    np.testing.assert_allclose(np.linalg.norm(out, axis=1), 1.0, atol=1e-9)
    chi2_sphere(
        out,
        lambda x, y, z: mf.pdf_rough_dielectric(table, 7, *wi, x, y, z, alpha, n_i, n_o),
        cells=(16, 16),
        gauss=12,
        significance=1e-5,
    )


@pytest.mark.parametrize(("alpha", "angle"), [(0.3, 20.0), (0.6, 65.0), (1.0, 85.0)])
def test_rough_metal_is_sampled_as_evaluated(alpha: float, angle: float) -> None:
    wi = incident(angle, -70.0)
    table = conductor(alpha)
    u = np.random.default_rng(9).random((60_000, 5))
    out = _draw_conductor(table, wi, alpha, u)
    assert np.all(out[:, 2] > 0)
    chi2_sphere(
        out[:, :3],
        lambda x, y, z: mf.pdf_rough_conductor(table, 5, *wi, x, y, z, alpha),
        cells=(16, 16),
        gauss=12,
        significance=1e-5,
    )


def _integral(function, upper: bool) -> float:  # type: ignore[no-untyped-def]
    """Integral of f over a hemisphere by Gauss points."""
    nodes, weights = np.polynomial.legendre.leggauss(96)
    theta, w_theta = (nodes + 1) * math.pi / 4, weights * math.pi / 4
    phi = (np.arange(128) + 0.5) * 2 * math.pi / 128
    total = 0.0
    for t, w in zip(theta, w_theta, strict=True):
        z = math.cos(t) if upper else -math.cos(t)
        ring = sum(function(math.sin(t) * math.cos(p), math.sin(t) * math.sin(p), z) for p in phi)
        total += w * math.sin(t) * ring * 2 * math.pi / 128
    return float(total)


@pytest.mark.parametrize(
    ("alpha", "n_i", "n_o"), [(0.3, 1.0, 1.5), (0.8, 1.0, 1.5), (0.8, 1.5, 1.0)]
)
def test_white_furnace_of_rough_glass(alpha: float, n_i: float, n_o: float) -> None:
    """All flux arrives on one of the sides."""
    table = dielectric(alpha)
    for angle in (5.0, 40.0, 65.0):
        wi = incident(angle)

        def pdf(x: float, y: float, z: float, wi: tuple[float, float, float] = wi) -> float:
            return mf.pdf_rough_dielectric(table, 7, *wi, x, y, z, alpha, n_i, n_o)

        total = _integral(pdf, True) + _integral(pdf, False)
        assert total == pytest.approx(1.0, abs=4e-3)


def _metal_pdf(  # type: ignore[no-untyped-def]
    table, wi, alpha: float, x: float, y: float, z: float
) -> float:
    return mf.pdf_rough_conductor(table, 5, *wi, x, y, z, alpha)


def test_white_furnace_of_a_rough_metal() -> None:
    for alpha in (0.3, 0.9):
        table = conductor(alpha)
        for angle in (5.0, 60.0):
            wi = incident(angle)

            pdf = partial(_metal_pdf, table, wi, alpha)
            assert _integral(pdf, True) == pytest.approx(1.0, abs=2e-3)


def test_reciprocity() -> None:
    rng = np.random.default_rng(1)
    glass, metal = dielectric(0.5), conductor(0.5)
    for _ in range(50):
        a = incident(rng.uniform(2, 85), rng.uniform(0, 360))
        b = incident(rng.uniform(2, 85), rng.uniform(0, 360))
        n1, n2 = rng.uniform(1, 1.8, 2)
        # Reflection
        there = laws.eval_rough_dielectric(glass, 7, *a, *b, 0.5, n1, n2)
        back = laws.eval_rough_dielectric(glass, 7, *b, *a, 0.5, n1, n2)
        assert there == pytest.approx(back, rel=1e-9)
        assert sum(laws.eval_rough_conductor(metal, 5, *a, *b, 0.5)) == pytest.approx(
            sum(laws.eval_rough_conductor(metal, 5, *b, *a, 0.5)), rel=1e-9
        )
        # Transmission: on the way back the frame is turned over
        c = (b[0], b[1], -b[2])
        there = laws.eval_rough_dielectric(glass, 7, *a, *c, 0.5, n1, n2) / n2**2
        back = laws.eval_rough_dielectric(glass, 7, *b, a[0], a[1], -a[2], 0.5, n2, n1) / n1**2
        assert there == pytest.approx(back, rel=1e-9)


def test_little_roughness_is_nearly_specular() -> None:
    u = np.random.default_rng(2).random((4000, 5))
    wi = incident(35.0)
    out = _draw_dielectric(dielectric(0.005), wi, 0.005, 1.0, 1.5, u)
    reflected = out[out[:, 2] > 0]
    transmitted = out[out[:, 2] < 0]
    assert np.median(np.abs(reflected - np.array([-wi[0], 0, wi[2]])).max(axis=1)) < 0.02
    sine = wi[0] / 1.5
    expected = np.array([-sine, 0, -math.sqrt(1 - sine**2)])
    assert np.median(np.abs(transmitted - expected).max(axis=1)) < 0.02
    assert len(reflected) / 4000 == pytest.approx(0.0424, abs=0.012)


def test_distribution_is_normalised() -> None:
    for alpha in (0.1, 0.5, 1.0):
        found = _integral(lambda _x, _y, z, a=alpha: ggx_distribution(a, z) * z, True)
        assert found == pytest.approx(1.0, abs=2e-3)


def test_average_reflectances() -> None:
    assert losses.average_conductor_reflectance(1.0, 1e-9, 1e9) == pytest.approx(1.0)
    # Hemispherical reflectance of glass 1.5: 0.0918 (closed form of Walsh, 1926)
    assert losses.average_conductor_reflectance(1.0, 1.5, 0.0) == pytest.approx(0.09178, abs=2e-4)
    table = losses.conductor_table(0.6)
    assert losses.multiple_reflectance(1.0, table) == pytest.approx(1.0)
    assert 0 < losses.multiple_reflectance(0.5, table) < 0.25


@pytest.mark.parametrize("alpha", [0.0, 1.2, math.nan])
def test_roughness_out_of_range(alpha: float) -> None:
    with pytest.raises(SceneError, match="roughness must lie between"):
        losses.dielectric_table(alpha)


def _mitsuba_rows() -> NDArray[np.float64]:
    return np.loadtxt(Path(__file__).parent / "mitsuba_rough.csv", delimiter=",", skiprows=3)


def test_single_facets_agree_with_mitsuba() -> None:
    """120 pairs of directions on both sides of glass and metal; Mitsuba computes in float32."""
    no_loss = np.zeros(len(losses.dielectric_table(0.5)))
    for alpha, *wi, wo_x, wo_y, wo_z, glass, metal in _mitsuba_rows():
        side = math.copysign(1.0, wi[2])
        n_i, n_o = (1.0, 1.5) if side > 0 else (1.5, 1.0)
        own = laws.eval_rough_dielectric(
            no_loss, 0, wi[0], wi[1], side * wi[2], wo_x, wo_y, side * wo_z, alpha, n_i, n_o
        )
        assert own * abs(wo_z) == pytest.approx(glass, rel=2e-5, abs=1e-7)
        single, _, _ = laws.eval_rough_conductor(no_loss, 0, *wi, wo_x, wo_y, wo_z, alpha)
        assert single * max(wo_z, 0.0) == pytest.approx(metal, rel=2e-5, abs=1e-7)


@pytest.mark.peers
def test_mitsuba_still_says_so() -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    context = mi.BSDFContext(mi.TransportMode.Importance)
    for alpha, *rest, glass, metal in _mitsuba_rows():
        surfaces = [
            {"type": "roughdielectric", "int_ior": 1.5, "ext_ior": 1.0},
            {"type": "roughconductor", "material": "none"},
        ]
        point = mi.SurfaceInteraction3f()
        point.wi = mi.Vector3f(rest[:3])
        for surface, value in zip(surfaces, (glass, metal), strict=True):
            model = mi.load_dict({**surface, "distribution": "ggx", "alpha": alpha})
            found = model.eval(context, point, mi.Vector3f(rest[3:]))[0]
            assert found == pytest.approx(value, rel=1e-4, abs=1e-7)

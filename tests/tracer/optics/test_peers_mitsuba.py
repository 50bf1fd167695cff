"""Rough glass and rough metal drawn from, against what Mitsuba 3 evaluates."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from raymap.jit.kernels import kernel
from raymap.laws import microfacet as laws
from raymap.laws import microfacet_losses as losses
from tests.naive.fresnel import fresnel_conductor
from tests.tracer.chi2 import chi2_counts
from tracer.optics import microfacet as mf

pytestmark = pytest.mark.peers

RAYS = 200_000
CASES = [
    (alpha, angle, inside)
    for alpha in (0.1, 0.3, 0.6, 1.0)
    for angle in (0.0, 35.0, 65.0)
    for inside in (False, True)
]


@cache
def mitsuba() -> Any:
    package = pytest.importorskip("mitsuba")
    package.set_variant("scalar_rgb")
    return package


@cache
def surface(kind: str, alpha: float) -> Any:
    given = {
        "roughdielectric": {"int_ior": 1.5, "ext_ior": 1.0},
        "roughconductor": {"material": "none"},
        "metal": {"eta": 0.2, "k": 3.4},
    }[kind]
    plugin = "roughconductor" if kind == "metal" else kind
    return mitsuba().load_dict({"type": plugin, "distribution": "ggx", "alpha": alpha, **given})


def lobe(model: Any, wi: tuple[float, float, float]) -> Any:
    """Flux per solid angle that Mitsuba sends into a direction (eval holds the cosine)."""
    mi = mitsuba()
    context = mi.BSDFContext(mi.TransportMode.Importance)
    point = mi.SurfaceInteraction3f()
    point.wi = mi.Vector3f(*wi)

    def value(x: float, y: float, z: float) -> float:
        return float(model.eval(context, point, mi.Vector3f(x, y, z))[0])

    return value


def incident(angle_deg: float) -> tuple[float, float, float]:
    theta, phi = math.radians(angle_deg), math.radians(25.0)
    return math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)


@kernel
def _glass(table, wi, alpha, n_i, n_o, u):  # type: ignore[no-untyped-def]
    out = np.empty((len(u), 4))
    for k in range(len(u)):
        out[k] = mf.sample_rough_dielectric(
            table, 0, wi[0], wi[1], wi[2], alpha, n_i, n_o,
            (u[k, 0], u[k, 1], u[k, 2], u[k, 3], u[k, 4]),
        )  # fmt: skip
    return out


@kernel
def _metal(table, wi, alpha, u):  # type: ignore[no-untyped-def]
    out = np.empty((len(u), 4))
    for k in range(len(u)):
        out[k] = mf.sample_rough_conductor(
            table, 0, wi[0], wi[1], wi[2], alpha, (u[k, 0], u[k, 1], u[k, 2], u[k, 3], u[k, 4])
        )
    return out


def _numbers(seed: int) -> NDArray[np.float64]:
    return np.random.default_rng(seed).random((RAYS, 5))


def agreement(out: NDArray[np.float64], value: Any, sides: tuple[float, ...]) -> float:
    """p-value of samples (n, 3) against flux per solid angle, on cells across the lobes.

    Cells are squares of the direction's x and y, in the box that holds 99 % of a lobe and up to
    grazing directions; all else is a class of its own.
    """
    observed, expected = [], []
    nodes, weights = np.polynomial.legendre.leggauss(6)
    for side in sides:
        lobes = out[out[:, 2] * side > 0.0, :2]
        low, high = np.percentile(lobes, 0.5, axis=0), np.percentile(lobes, 99.5, axis=0)
        edges = [np.linspace(a, b, 19) for a, b in zip(low, high, strict=True)]
        counts = np.histogram2d(lobes[:, 0], lobes[:, 1], edges)[0]
        for i in range(18):
            for j in range(18):
                corners = [
                    math.hypot(edges[0][i + a], edges[1][j + b]) for a in (0, 1) for b in (0, 1)
                ]
                if max(corners) > 0.97:
                    continue
                half = np.diff(edges[0])[i] / 2.0, np.diff(edges[1])[j] / 2.0
                total = 0.0
                for u, wu in zip(nodes, weights, strict=True):
                    for v, wv in zip(nodes, weights, strict=True):
                        x = edges[0][i] + half[0] * (1.0 + u)
                        y = edges[1][j] + half[1] * (1.0 + v)
                        z = math.sqrt(1.0 - x * x - y * y)
                        total += wu * wv * value(x, y, side * z) / z
                observed.append(counts[i, j])
                expected.append(total * half[0] * half[1] * RAYS)
    seen, wanted = np.array(observed), np.array(expected)
    assert len(seen) > 100
    assert wanted.sum() > 0.6 * len(out)
    rest = RAYS - seen.sum(), RAYS - wanted.sum()
    return chi2_counts(np.append(seen, rest[0]), np.append(wanted, rest[1]))


@pytest.mark.parametrize(("alpha", "angle", "inside"), CASES)
def test_lobes_of_rough_glass_are_mitsubas(alpha: float, angle: float, inside: bool) -> None:
    wi = incident(angle)
    n_i, n_o = (1.5, 1.0) if inside else (1.0, 1.5)
    out = _glass(
        losses.dielectric_table(alpha),
        wi,
        alpha,
        n_i,
        n_o,
        _numbers(100 + CASES.index((alpha, angle, inside))),
    )
    # What met one facet only: several facets are Mitsuba's loss and our compensating lobe
    single = out[out[:, 3] >= 0.0, :3]
    turned = (wi[0], wi[1], -wi[2]) if inside else wi
    value = lobe(surface("roughdielectric", alpha), turned)
    frame = -1.0 if inside else 1.0
    sides = (1.0, -1.0) if np.count_nonzero(single[:, 2] < 0.0) > 2_000 else (1.0,)
    p = agreement(single, lambda x, y, z: value(x, y, frame * z), sides)
    print(f"alpha {alpha}, {angle} deg: {len(single) / RAYS:.4f} by one facet, p = {p:.3f}")
    assert p > 1e-4


@pytest.mark.parametrize(("alpha", "angle"), [(a, t) for a, t, inside in CASES if not inside])
def test_lobes_of_rough_metal_are_mitsubas(alpha: float, angle: float) -> None:
    wi = incident(angle)
    out = _metal(
        losses.conductor_table(alpha), wi, alpha, _numbers(200 + CASES.index((alpha, angle, False)))
    )
    single = out[out[:, 3] >= 0.0, :3]
    value = lobe(surface("roughconductor", alpha), wi)
    assert agreement(single, value, (1.0,)) > 1e-4


def test_reflectance_at_the_facets_is_mitsubas() -> None:
    rng = np.random.default_rng(5)
    table = np.zeros_like(losses.conductor_table(0.5))
    for alpha in (0.15, 0.5, 1.0):
        for _ in range(40):
            wi, wo = incident(rng.uniform(0, 85)), incident(rng.uniform(0, 85))
            wo = (wo[0] * math.cos(2.0), wo[1] - wo[0], wo[2])
            length = math.sqrt(sum(v * v for v in wo))
            wo = (wo[0] / length, wo[1] / length, wo[2] / length)
            single, _, cosine = laws.eval_rough_conductor(table, 0, *wi, *wo, alpha)
            own = single * fresnel_conductor(1.0, 0.2, 3.4, cosine) * wo[2]
            expected = lobe(surface("metal", alpha), wi)(*wo)
            assert own == pytest.approx(expected, rel=1e-4, abs=1e-6)

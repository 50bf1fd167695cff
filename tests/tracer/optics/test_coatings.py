"""Coatings: textbook stacks, energy, and an independent package."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from raymap.laws.stack import layer_coating
from raymap.laws.table import coating_share, constant_coating, tabulated_coating
from raymap.model.errors import SceneError
from raymap.optics.stacks import Layer, stack_shares
from tests.examples import examples
from tests.naive.fresnel import fresnel_reflectance


def layer(index: complex, thickness: float) -> Layer:
    return Layer(index=np.array([index], complex), thickness_nm=thickness)


def test_a_bare_interface_is_fresnel() -> None:
    table = layer_coating([1.0], [1.5], [], [550.0])[0]
    for n_i, n_o in ((1.0, 1.5), (1.5, 1.0)):
        for angle in (0, 20, 40, 41.5, 60, 85):
            cos_i = math.cos(math.radians(angle))
            r, t = coating_share(table, 0, n_i, n_o, cos_i)
            exact = fresnel_reflectance(n_i, n_o, cos_i)
            assert r == pytest.approx(exact, abs=2e-4)
            assert r + t == pytest.approx(1.0, abs=1e-12)


def test_quarter_wave_layers() -> None:
    """R = ((n0 ns - n²) / (n0 ns + n²))², and a high reflector of N pairs (Macleod, ch. 5, 6)."""
    r, _ = stack_shares([1.0], [1.52], [layer(1.38, 550 / 4 / 1.38)], [550.0], [0.0])
    assert r[0, 0] == pytest.approx(((1.52 - 1.38**2) / (1.52 + 1.38**2)) ** 2)
    pair = [layer(2.35, 550 / 4 / 2.35), layer(1.45, 550 / 4 / 1.45)]
    r, t = stack_shares([1.0], [1.52], [*(pair * 5), pair[0]], [550.0], [0.0])
    y = (2.35 / 1.45) ** 10 * 2.35**2 / 1.52
    assert r[0, 0] == pytest.approx(((1 - y) / (1 + y)) ** 2)
    assert r[0, 0] + t[0, 0] == pytest.approx(1.0)


def test_a_half_wave_layer_is_absent() -> None:
    r, _ = stack_shares([1.0], [1.5], [layer(2.0, 550 / 2 / 2.0)], [550.0], [0.0])
    assert r[0, 0] == pytest.approx(0.04)


INDEX = st.builds(complex, st.floats(1.2, 2.6), st.sampled_from([0.0, 0.0, 0.02, 0.5, 3.0]))


@settings(max_examples=examples(60))
@given(
    st.lists(st.tuples(INDEX, st.floats(0, 800)), max_size=6),
    st.floats(1.0, 2.0),
    st.floats(1.0, 2.0),
    st.floats(0, 0.999),
)
def test_energy_and_reciprocity(
    stack: list[tuple[complex, float]], n_i: float, n_o: float, sine: float
) -> None:
    layers = [layer(index, thickness) for index, thickness in stack]
    r, t = stack_shares([n_i], [n_o], layers, [600.0], [sine])
    assert t[0, 0] >= -1e-12
    assert r[0, 0] + t[0, 0] <= 1 + 1e-9
    if all(index.imag == 0 for index, _ in stack):
        assert r[0, 0] + t[0, 0] == pytest.approx(1.0, abs=1e-9)
    if n_i * sine < n_o:
        _, back = stack_shares([n_o], [n_i], layers[::-1], [600.0], [n_i * sine / n_o])
        assert back[0, 0] == pytest.approx(t[0, 0], abs=1e-9)


def test_total_reflection_stays_total_but_for_absorbing_layers() -> None:
    clear = layer_coating([1.5], [1.0], [layer(2.1, 90.0)], [500.0])[0]
    metal = layer_coating([1.5], [1.0], [layer(0.8 + 3.0j, 10.0)], [500.0])[0]
    for angle in (42.5, 60.0, 89.0):
        cosine = math.cos(math.radians(angle))
        assert coating_share(clear, 0, 1.5, 1.0, cosine) == (pytest.approx(1.0), 0.0)
        assert coating_share(metal, 0, 1.5, 1.0, cosine)[0] < 0.99
    constant = constant_coating([0.002])[0]
    assert coating_share(constant, 0, 1.5, 1.0, 0.5) == (1.0, 0.0)
    assert coating_share(constant, 0, 1.5, 1.0, 0.9) == pytest.approx((0.002, 0.998))


def test_the_table_follows_the_stack() -> None:
    layers = [layer(1.38, 100.0), layer(2.05, 130.0), layer(1.62 + 0.01j, 80.0)]
    table = layer_coating([1.0], [1.52], layers, [532.0])[0]
    for angle in np.linspace(0, 88, 23):
        sine = math.sin(math.radians(angle))
        cosine = math.cos(math.radians(angle))
        r, t = stack_shares([1.0], [1.52], layers, [532.0], [sine])
        assert coating_share(table, 0, 1.0, 1.52, cosine) == pytest.approx(
            (r[0, 0], t[0, 0]), abs=2e-4
        )
        if sine < 1 / 1.52:
            r, t = stack_shares([1.52], [1.0], layers[::-1], [532.0], [sine])
            assert coating_share(table, 0, 1.52, 1.0, cosine) == pytest.approx(
                (r[0, 0], t[0, 0]), abs=3e-4
            )


def test_measured_tables() -> None:
    table = tabulated_coating(
        [550.0], [500, 600], [0, 60, 90], [[0.1, 0.2, 1.0], [0.3, 0.4, 1.0]],
        [[0.8, 0.7, 0.0], [0.6, 0.5, 0.0]],
    )[0]  # fmt: skip
    assert coating_share(table, 0, 1.0, 1.5, 1.0) == pytest.approx((0.2, 0.7))
    assert coating_share(table, 0, 1.0, 1.5, 0.5) == pytest.approx((0.3, 0.6), abs=1e-9)
    # From inside glass at the angle that Snell's law joins to 60 degrees
    inside = math.sqrt(1 - 0.75 / 1.5**2)
    assert coating_share(table, 0, 1.5, 1.0, inside) == pytest.approx((0.3, 0.6), abs=1e-9)
    assert coating_share(table, 0, 1.5, 1.0, 0.1) == (1.0, 0.0)


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: constant_coating([1.2]), "between 0 and 1"),
        (
            lambda: tabulated_coating([550], [500, 600], [0], [[0.5], [0.6]], [[0.3], [0.6]]),
            r"creates energy: R \+ T = 1.2 at 600 nm and 0 degrees",
        ),
        (
            lambda: tabulated_coating([650], [500, 600], [0], [[0], [0]], [[1], [1]]),
            "trace needs it at 650 nm",
        ),
        (lambda: tabulated_coating([550], [500, 600], [0], [[0]], [[1]]), "of that shape"),
        (lambda: layer_coating([1], [1.5], [layer(1.5 - 0.1j, 10)], [500]), "positive k"),
        (lambda: layer_coating([1], [1.5], [layer(1.5, -1)], [500]), "no sound thickness"),
        (lambda: layer_coating([1, 1], [1.5, 1.5], [layer(1.5, 1)], [500, 600]), "2 wavelengths"),
    ],
)
def test_bad_input_is_refused(build, words: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(SceneError, match=words):
        build()


@pytest.mark.peers
def test_tmm_agrees() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        tmm = pytest.importorskip("tmm")
    rng = np.random.default_rng(0)
    for _ in range(30):
        n = rng.uniform(1.3, 2.5, 4) + 1j * rng.choice([0, 0.3], 4)
        d = rng.uniform(20, 300, 4)
        angle = rng.uniform(0, 1.4)
        n_o = rng.uniform(1.0, 2.0)
        r, t = stack_shares(
            [1.0], [n_o], [layer(*x) for x in zip(n, d, strict=True)], [550.0], [math.sin(angle)]
        )
        other = tmm.unpolarized_RT([1.0, *n, n_o], [np.inf, *d, np.inf], angle, 550.0)
        assert r[0, 0] == pytest.approx(other["R"], abs=1e-10)
        assert t[0, 0] == pytest.approx(other["T"], abs=1e-10)

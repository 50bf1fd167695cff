"""Coherent sums of lens exits against closed forms and independent packages.

Airy: Born & Wolf, Principles of Optics, 7th ed., 7.6.1 eqs (9), (15). Newton's rings: 7.5.2.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.examples import examples
from tests.tracer.lens.lenses import N_D, plate
from tracer.lens import Lens, LensTree, trace_lens
from tracer.optics.polarization_elements import to_plane
from tracer.optics.polarization_interference import interfere
from tracer.optics.polarization_rays import PolarizationError, PolarizedRays

SODIUM = 589.3


def slanted(degrees: float, state: str, wavelength_nm: float = SODIUM) -> PolarizedRays:
    theta = math.radians(degrees)
    d = np.array([math.sin(theta), 0.0, math.cos(theta)])
    v = [0.0, 1.0, 0.0] if state == "s" else [math.cos(theta), 0.0, -math.sin(theta)]
    return PolarizedRays.linear([-d], [d], [v], wavelength_nm=wavelength_nm)


def plane_wave_sums(tree: LensTree) -> tuple[float, float]:
    """Reflected and transmitted flux of a plate in a plane wave.

    All exits on one side are parallel; their phases are compared on one wave front.
    """
    exits = tree.exits()
    rays = tree.exit_rays(exits)
    sums = []
    for side in (-1.0, 1.0):
        on_side = rays.where(exits.direction[:, 2] * side > 0.0)
        if len(on_side) == 0:
            sums.append(0.0)
            continue
        front = to_plane(on_side, 50.0 * on_side.direction[0], on_side.direction[0])
        sums.append(float(interfere(front)[0]))
    return sums[0], sums[1]


def airy(degrees: float, state: str, n: float, d_nm: float, wavelength: float = SODIUM) -> float:
    ci = math.cos(math.radians(degrees))
    ct = math.sqrt(1.0 - (1.0 - ci * ci) / n**2)
    r = (ci - n * ct) / (ci + n * ct) if state == "s" else (n * ci - ct) / (n * ci + ct)
    finesse = 4.0 * r * r / (1.0 - r * r) ** 2
    delta = 4.0 * math.pi * n * d_nm * ct / wavelength
    return 1.0 / (1.0 + finesse * math.sin(delta / 2.0) ** 2)


@pytest.mark.parametrize(
    ("degrees", "state", "transmitted"),
    [
        (0.0, "s", 0.964442895),
        (30.0, "s", 0.952558039),
        (30.0, "p", 0.979925883),
        (60.0, "s", 0.682879656),
        (60.0, "p", 0.997325562),
    ],
)
def test_plane_plate_is_airy(degrees: float, state: str, transmitted: float) -> None:
    tree = trace_lens(plate(1e-3), slanted(degrees, state), depth=40)
    reflected, through = plane_wave_sums(tree)
    assert through == pytest.approx(transmitted, abs=1e-9)
    assert through == pytest.approx(airy(degrees, state, N_D, 1000.0), abs=1e-9)
    assert reflected + through == pytest.approx(1.0, abs=1e-9)


def test_truncation_leaves_what_the_remainder_says() -> None:
    exact = airy(30.0, "s", N_D, 1000.0)
    for depth in (2, 4, 6, 8):
        tree = trace_lens(plate(1e-3), slanted(30.0, "s"), depth=depth)
        _, through = plane_wave_sums(tree)
        assert abs(through - exact) <= 4.0 * math.sqrt(tree.remainder[0])


def test_incoherent_slab() -> None:
    tree = trace_lens(plate(5.0, semi_aperture=1e3, glass=1.5), slanted(30.0, "s"), depth=60)
    backward = tree.direction[0, :, 2] < 0.0
    r = 0.240408206**2
    assert tree.flux[0][backward].sum() == pytest.approx(2 * r / (1 + r), abs=1e-8)
    assert tree.flux[0][backward].sum() == pytest.approx(0.109276457, abs=5e-10)


@settings(max_examples=examples(60))
@given(st.floats(0.0, 80.0), st.floats(1.1, 2.5), st.floats(0.0, math.pi), st.floats(1e-9, 1e-7))
def test_a_vanishing_film_reflects_nothing(
    degrees: float, n: float, azimuth: float, thickness: float
) -> None:
    theta = math.radians(degrees)
    d = np.array([math.sin(theta), 0.0, math.cos(theta)])
    s, p = np.array([0.0, 1.0, 0.0]), np.array([math.cos(theta), 0.0, -math.sin(theta)])
    v = math.cos(azimuth) * s + math.sin(azimuth) * p
    rays = PolarizedRays.linear([-d], [d], [v], wavelength_nm=500.0)
    film = plate(thickness, glass=n)
    tree = trace_lens(film, rays, depth=300)
    reflected, through = plane_wave_sums(tree)
    lost = 4.0 * math.sqrt(tree.remainder[0]) + 1e-3
    assert reflected < lost
    assert abs(through - 1.0) < lost


def test_the_published_rules_fail_the_vanishing_film() -> None:
    right = plane_wave_sums(trace_lens(plate(1e-8), slanted(20.0, "s"), depth=60))
    wrong = plane_wave_sums(trace_lens(plate(1e-8), slanted(20.0, "s"), depth=60, mode="published"))
    assert right[0] < 1e-6
    assert wrong[0] > 0.1


def newton(radius_mm: float, m: float) -> tuple[float, float]:
    """Flux of the two rays that meet in the air gap, and the radius, for r = sqrt(m lambda R)."""
    r = math.sqrt(m * SODIUM * 1e-6 * radius_mm)
    lens = Lens(
        radius_front=math.inf, radius_back=-radius_mm, thickness=2.0, semi_aperture_front=5.0,
        glass=1.5,
    )  # fmt: skip
    flat = Lens(
        radius_front=math.inf, radius_back=math.inf, thickness=2.0, semi_aperture_front=5.0,
        glass=1.5, origin=(0.0, 0.0, 2.0),
    )  # fmt: skip
    down = PolarizedRays.linear(
        [[r, 0.0, -1.0]], [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]], wavelength_nm=SODIUM
    )
    # First wave: reflected inside the lens at its curved back
    upper = trace_lens(lens, down, depth=3)
    # Second wave: out of the lens, reflected at the flat, back through the lens
    gap = upper.exits()
    through = upper.exit_rays(gap).where(gap.level == 2)
    mirror = trace_lens(flat, through, depth=1)
    back = trace_lens(lens, mirror.exit_rays(), depth=2)
    up, again = upper.exits(), back.exits()
    both = PolarizedRays.join(
        [
            upper.exit_rays(up).where(up.level == 3),
            back.exit_rays(again).where(again.level == 2),
        ]
    )
    # The rings lie in the gap: compare phases at its image, 2 mm / 1.5 behind the flat front
    way = (2.0 / 1.5 - both.origin[:, 2]) / both.direction[:, 2]
    seen = replace(both, optical_path=both.optical_path + way)
    return float(interfere(seen)[0]), r


@pytest.mark.parametrize(
    ("m", "radius"), [(1, 0.767659), (2, 1.085633), (3, 1.329624), (10, 2.427550)]
)
def test_newtons_rings(m: int, radius: float) -> None:
    dark, r = newton(1000.0, m)
    bright, _ = newton(1000.0, m - 0.5)
    assert r == pytest.approx(radius, abs=5e-7)
    assert dark < 0.01 * bright


def test_newtons_rings_have_a_dark_centre() -> None:
    dark, _ = newton(1000.0, 0.0)
    bright, _ = newton(1000.0, 0.5)
    assert dark < 0.01 * bright


def test_young() -> None:
    a, far, wavelength = 0.2, 1000.0, 500.0
    x = np.linspace(-6.0, 6.0, 1201)
    parts = []
    for side in (-0.5, 0.5):
        start = np.array([side * a, 0.0, 0.0])
        target = np.stack([x, np.zeros_like(x), np.full_like(x, far)], axis=1)
        way = np.linalg.norm(target - start, axis=1)
        parts.append(
            PolarizedRays.linear(
                target,
                (target - start) / way[:, None],
                [0.0, 1.0, 0.0],
                wavelength_nm=wavelength,
                optical_path=way,
            )
        )
    rays = PolarizedRays.join(parts)
    flux = interfere(rays, np.tile(np.arange(len(x)), 2))
    np.testing.assert_allclose(flux, 4.0 * np.cos(np.pi * a * x / (500e-6 * far)) ** 2, atol=1e-3)
    # Fringes are lambda D / a = 2.5 mm apart; without coherence there are none
    other = PolarizedRays(**{**vars(rays), "coherence": np.repeat([0, 1], len(x))})
    np.testing.assert_allclose(interfere(other, np.tile(np.arange(len(x)), 2)), 2.0, rtol=1e-12)


def test_coherence_length_and_wavelengths() -> None:
    rays = PolarizedRays.linear(
        np.zeros(3), [0.0, 0.0, 1.0], [[1.0, 0, 0]] * 3, wavelength_nm=[500.0, 500.0, 600.0],
        optical_path=[0.0, 0.01, 0.0],
    )  # fmt: skip
    assert interfere(rays)[0] == pytest.approx(4.0 + 1.0)
    partly = interfere(rays, coherence_length=0.01)[0]
    assert partly == pytest.approx(2.0 + 2.0 * math.exp(-1.0) + 1.0)
    assert interfere(rays, coherence_length=1e9)[0] == pytest.approx(5.0)
    assert interfere(rays, coherence_length=1e-9)[0] == pytest.approx(3.0)
    np.testing.assert_allclose(interfere(rays, [2, 0, 2], n_points=4), [1.0, 0.0, 2.0, 0.0])
    with pytest.raises(PolarizationError, match="coherence_length"):
        interfere(rays, coherence_length=0.0)
    with pytest.raises(PolarizationError, match="point"):
        interfere(rays, [2, 0, 9], n_points=4)


@pytest.mark.peers
@pytest.mark.parametrize("degrees", [0.0, 15.0, 40.0, 75.0])
@pytest.mark.parametrize("state", ["s", "p"])
def test_plates_against_tmm(degrees: float, state: str) -> None:
    tmm = pytest.importorskip("tmm")
    for n, d_nm, wavelength in ((1.5, 350.0, 450.0), (2.2, 1234.0, 633.0)):
        tree = trace_lens(
            plate(d_nm * 1e-6, glass=n), slanted(degrees, state, wavelength), depth=80
        )
        reflected, through = plane_wave_sums(tree)
        peer = tmm.coh_tmm(
            state, [1.0, n, 1.0], [math.inf, d_nm, math.inf], math.radians(degrees), wavelength
        )
        assert reflected == pytest.approx(peer["R"], abs=1e-9)
        assert through == pytest.approx(peer["T"], abs=1e-9)


@pytest.mark.peers
def test_plates_against_pyelli() -> None:
    elli = pytest.importorskip("elli")
    glass = elli.IsotropicMaterial(elli.ConstantRefractiveIndex(N_D))
    air = elli.IsotropicMaterial(elli.ConstantRefractiveIndex(1.0))
    structure = elli.Structure(air, [elli.Layer(glass, 1000.0)], air)
    for degrees in (10.0, 50.0):
        peer = structure.evaluate(np.array([SODIUM]), degrees)
        for state, transmitted in (("s", peer.T_ss), ("p", peer.T_pp)):
            tree = trace_lens(plate(1e-3), slanted(degrees, state), depth=60)
            _, through = plane_wave_sums(tree)
            assert through == pytest.approx(float(transmitted[0]), abs=1e-9)

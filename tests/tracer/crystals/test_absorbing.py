"""Absorbing crystals: closed forms, limits, singular axes, and another program."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tracer.optics.crystals.absorbing import absorbing_interface, absorbing_plate, berreman_matrices
from tracer.optics.crystals.media import Crystal, biaxial, isotropic, uniaxial
from tracer.optics.crystals.plates import plate_jones


def random_crystal(rng: np.random.Generator, dark: float) -> Crystal:
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    n, kappa = rng.uniform(1.3, 2.2, 3), dark * rng.uniform(0.0, 1.0, 3)
    return Crystal(indices=tuple(n), orientation=turn, absorption=tuple(kappa))


def test_without_absorption_it_is_the_lossless_plate() -> None:
    rng = np.random.default_rng(1)
    sx, sy = rng.uniform(-0.6, 0.6, (2, 50))
    for thickness in (1e-5, 3e-4, 0.02):
        crystal = random_crystal(rng, 0.0)
        options = {"n_before": 1.0, "n_after": 1.4}
        exact = absorbing_plate(crystal, sx, sy, thickness, 550.0, **options)
        lossless = plate_jones(crystal, sx, sy, thickness, 550.0, **options)
        for ours, theirs in zip(exact, lossless, strict=True):
            np.testing.assert_allclose(ours, theirs, atol=1e-10)


def test_an_isotropic_absorber_is_the_film_of_the_textbook() -> None:
    """Airy's sums with a complex index (Born & Wolf, 7th ed., 14.4)."""
    index, d, wavelength = 1.6 + 0.05j, 800.0, 500.0
    theta = math.radians(40.0)
    t, r = absorbing_plate(
        isotropic(index.real, kappa=index.imag), math.sin(theta), 0.0, d * 1e-6, wavelength
    )
    c1 = math.cos(theta)
    c2 = np.sqrt(1.0 - (math.sin(theta) / index) ** 2)
    phase = np.exp(2j * np.pi * d / wavelength * index * c2)
    for k, r12 in enumerate(
        ((c1 - index * c2) / (c1 + index * c2), (index * c1 - c2) / (index * c1 + c2))
    ):
        through = (1 - r12**2) * phase / (1 - r12**2 * phase**2)
        back = r12 * (1 - phase**2) / (1 - r12**2 * phase**2)
        assert t[k, k] == pytest.approx(through, abs=1e-12)
        assert r[k, k] == pytest.approx(back, abs=1e-12)


def test_weak_absorption_is_the_decay_along_the_ray() -> None:
    # Along a principal axis each wave loses exp(-2 k0 kappa d)
    crystal = uniaxial(1.6, 1.5, (1.0, 0.0, 0.0), kappa_o=2e-6, kappa_e=5e-6)
    clear = uniaxial(1.6, 1.5, (1.0, 0.0, 0.0))
    d = 1.0
    dark, bright = (
        np.abs(np.diagonal(absorbing_plate(c, 0.0, 0.0, d, 500.0, n_before=1.55, n_after=1.55)[0]))
        for c in (crystal, clear)
    )
    k0 = 2e6 * math.pi / 500.0
    # s light vibrates along y, where it is ordinary
    np.testing.assert_allclose(
        (dark / bright) ** 2, np.exp(-2.0 * k0 * d * np.array([2e-6, 5e-6])), rtol=2e-3
    )


def test_energy_at_the_face() -> None:
    rng = np.random.default_rng(2)
    for dark in (0.0, 1e-6, 0.02, 1.5):
        crystal = random_crystal(rng, dark)
        sx, sy = rng.uniform(-0.65, 0.65, (2, 200))
        reflection, entering = absorbing_interface(crystal, sx, sy, 600.0)
        reflected = (np.abs(reflection) ** 2).sum(axis=-2)
        np.testing.assert_allclose(reflected + entering, 1.0, atol=1e-12)
        assert entering.min() > 0.0


def test_a_thick_dark_plate_is_a_half_space() -> None:
    rng = np.random.default_rng(3)
    crystal = random_crystal(rng, 0.1)
    sx, sy = rng.uniform(-0.6, 0.6, (2, 30))
    t, r = absorbing_plate(crystal, sx, sy, 1.0, 500.0)
    half, _ = absorbing_interface(crystal, sx, sy, 500.0)
    np.testing.assert_allclose(r, half, atol=1e-10)
    assert np.abs(t).max() < 1e-100


def test_singular_axes_are_no_special_case() -> None:
    """On a singular axis of an absorbing biaxial crystal both waves and their fields coincide."""
    angles = np.linspace(0.0, 1.5, 3001)
    kappa = (0.0, 0.01, 0.03)
    worst, place = np.inf, 0.0
    # Look for the direction in which the two forward waves are most alike
    for angle in angles:
        turn = np.array(
            [
                [math.cos(angle), 0.0, math.sin(angle)],
                [0.0, 1.0, 0.0],
                [-math.sin(angle), 0.0, math.cos(angle)],
            ]
        )
        crystal = Crystal(indices=(1.5, 1.55, 1.65), orientation=turn, absorption=kappa)
        d = berreman_matrices(crystal, np.zeros(1), np.zeros(1), 500.0)[0]
        q, fields = np.linalg.eig(d)
        forward = fields[:, q.imag > 0.0]
        alike = np.linalg.svd(forward)[1][-1]
        if alike < worst:
            worst, place = float(alike), float(angle)
    turn = np.array(
        [
            [math.cos(place), 0.0, math.sin(place)],
            [0.0, 1.0, 0.0],
            [-math.sin(place), 0.0, math.cos(place)],
        ]
    )
    crystal = Crystal(indices=(1.5, 1.55, 1.65), orientation=turn, absorption=kappa)
    beside = np.array([0.0, 1e-9, 1e-6])
    t, r = absorbing_plate(crystal, beside, 0.0 * beside, 2e-3, 500.0)
    np.testing.assert_allclose(t[1], t[0], atol=1e-7)
    np.testing.assert_allclose(r[2], r[0], atol=1e-4)
    assert np.all((np.abs(t) ** 2).sum(axis=-2) + (np.abs(r) ** 2).sum(axis=-2) < 1.0)
    _, entering = absorbing_interface(crystal, beside, 0.0 * beside, 500.0)
    assert np.all((entering > 0.9) & (entering < 1.0))


@pytest.mark.peers
def test_random_absorbing_plates_agree_with_pyelli() -> None:
    elli = pytest.importorskip("elli")
    rng = np.random.default_rng(7)
    worst = 0.0
    for k in range(40):
        crystal = random_crystal(rng, (1e-3, 0.03, 0.3)[k % 3])
        theta, phi = rng.uniform(0.0, 85.0), rng.uniform(0.0, 2.0 * np.pi)
        thickness, wavelength = rng.uniform(50.0, 1500.0), rng.uniform(400.0, 700.0)
        before, after = rng.uniform(1.0, 1.3), rng.uniform(1.3, 1.6)
        s = before * math.sin(math.radians(theta))
        place = s * math.cos(phi), s * math.sin(phi)
        t, r = absorbing_plate(
            crystal, *place, thickness * 1e-6, wavelength, n_before=before, n_after=after
        )
        c, sn = math.cos(phi), math.sin(phi)
        n = crystal.principal_indices(wavelength) + 1j * crystal.principal_kappa(wavelength)
        medium = elli.BiaxialMaterial(*[elli.ConstantRefractiveIndex(x) for x in n])
        medium.set_rotation(np.array([[c, sn, 0], [-sn, c, 0], [0, 0, 1]]) @ crystal.orientation)
        outer = [elli.IsotropicMaterial(elli.ConstantRefractiveIndex(x)) for x in (before, after)]
        stack = elli.Structure(outer[0], [elli.Layer(medium, thickness)], outer[1])
        data = stack.evaluate([wavelength], theta, solver=elli.Solver4x4)
        for ours, theirs in ((t, data.jones_matrix_t[0]), (r, data.jones_matrix_r[0])):
            flipped = ours[::-1, ::-1] * np.array([[1, -1], [-1, 1]])
            worst = max(worst, float(np.abs(flipped - np.asarray(theirs)).max()))
    assert worst < 1e-10


def test_a_binormal_is_no_special_case_either() -> None:
    crystal = biaxial(1.3, 1.4, 1.5, np.eye(3))
    axis, _ = crystal.binormals(500.0)
    sx = 1.4 * axis[0] + np.array([0.0, 1e-12, 1e-7])
    lossless = plate_jones(crystal, sx, 0.0 * sx, 0.01, 500.0, n_before=1.9, n_after=1.9)
    exact = absorbing_plate(crystal, sx, 0.0 * sx, 0.01, 500.0, n_before=1.9, n_after=1.9)
    np.testing.assert_allclose(exact[0], lossless[0], atol=1e-9)

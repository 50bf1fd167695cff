"""Plates against Airy, path differences in closed form, and an independent 4 x 4 method."""

from __future__ import annotations

import math

import numpy as np
import pytest

from raymap.model.errors import SceneError
from tracer.optics.crystals.media import (
    Crystal,
    biaxial,
    calcite,
    isotropic,
    rotation_between,
    uniaxial,
)
from tracer.optics.crystals.plates import plate_jones, plate_retardation


@pytest.mark.parametrize(
    ("degrees", "pol", "expected"),
    [(0, 0, 0.964442895), (30, 0, 0.952558039), (30, 1, 0.979925883), (60, 0, 0.682879656),
     (60, 1, 0.997325562)],
)  # fmt: skip
def test_glass_plate_follows_airy(degrees, pol, expected):
    glass = isotropic(1.5168000345)
    s = math.sin(math.radians(degrees))
    t, r = plate_jones(glass, s, 0.0, 1e-3, 589.3)
    assert abs(t[pol, pol]) ** 2 == pytest.approx(expected, abs=1e-9)
    assert abs(t[pol, pol]) ** 2 + abs(r[pol, pol]) ** 2 == pytest.approx(1.0, abs=1e-14)


def test_vanishing_plate_does_nothing():
    t, r = plate_jones(biaxial(1.3, 1.4, 1.5), 0.3, 0.4, 1e-13, 500.0)
    np.testing.assert_allclose(t, np.eye(2), atol=1e-6)
    np.testing.assert_allclose(r, 0.0, atol=1e-6)


@pytest.mark.parametrize(("degrees", "expected"), [(15, 0.249794), (45, 0.999177)])
def test_quartz_plate_between_crossed_polars(degrees, expected):
    angle = math.radians(degrees)
    quartz = uniaxial(1.544, 1.553, (math.cos(angle), math.sin(angle), 0.0))
    t, _ = plate_jones(quartz, 0.0, 0.0, 0.03, 550.0, n_before=1.5485, n_after=1.5485)
    assert abs(t[0, 1]) ** 2 == pytest.approx(expected, abs=1e-6)


def test_calcite_section_in_convergent_light():
    s = np.array([0.25, 0.65, 0.8]) / math.sqrt(2.0)
    t, _ = plate_jones(calcite(), s, s, 0.06, 589.3, n_before=1.54, n_after=1.54, basis="pupil")
    np.testing.assert_allclose(np.abs(t[:, 0, 1]) ** 2, [0.993067, 0.993754, 0.909465], atol=5e-6)
    rings = np.array([0.359918, 0.502138, 0.606707, 0.878121, 0.969529])
    waves = plate_retardation(calcite(), rings, 0.0, 0.06, 589.3) / 589.3e-6
    np.testing.assert_allclose(waves, [1, 2, 3, 7, 9], atol=2e-5)


def test_biaxial_section_in_convergent_light():
    # Acute bisectrix (n_x) along z, n_z along x
    crystal = biaxial(1.3, 1.4, 1.5, [[0, 0, 1], [0, -1, 0], [1, 0, 0]])
    s = np.array([0.2, 0.4, 0.6, 0.8, 0.9, 0.95])
    along = plate_retardation(crystal, s, 0.0, 0.06, 589.3) / 589.3e-6
    across = plate_retardation(crystal, 0.0, s, 0.06, 589.3) / 589.3e-6
    np.testing.assert_allclose(
        along, [9.825377, 8.714212, 6.696342, 3.403490, 1.020510, 0.449140], atol=1e-6
    )
    np.testing.assert_allclose(
        across, [10.514930, 11.566565, 13.521578, 16.834208, 19.320204, 20.886908], atol=1e-6
    )


def test_levels_of_the_tree_converge_to_the_whole():
    crystal = biaxial(1.3, 1.4, 1.5, rotation_between((0, 0, 1), (1, 2, 3)))
    whole, _ = plate_jones(crystal, [0.3, -0.5], [0.1, 0.7], 0.01, 500.0)
    errors = []
    for levels in (1, 3, 6, 30):
        part, _ = plate_jones(crystal, [0.3, -0.5], [0.1, 0.7], 0.01, 500.0, levels=levels)
        errors.append(float(np.abs(part - whole).max()))
    assert errors[0] > errors[1] > errors[2] > errors[3]
    assert errors[3] < 1e-14


def test_plates_refuse_what_cannot_be():
    with pytest.raises(SceneError, match="thickness_mm"):
        plate_jones(calcite(), 0.0, 0.0, 0.0, 500.0)
    with pytest.raises(SceneError, match="shorter than n_before"):
        plate_jones(calcite(), 1.0, 0.2, 0.1, 500.0)


@pytest.mark.peers
def test_random_plates_agree_with_pyelli():
    elli = pytest.importorskip("elli")
    rng = np.random.default_rng(5)
    worst = 0.0
    for k in range(40):
        n = np.sort(rng.uniform(1.3, 2.2, 3))
        if k % 2:
            n[1] = n[0]
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        turn *= np.sign(np.linalg.det(turn))
        theta, phi = rng.uniform(0.0, 85.0), rng.uniform(0.0, 2.0 * np.pi)
        thickness, wavelength = rng.uniform(100.0, 3000.0), rng.uniform(400.0, 700.0)
        before, after = rng.uniform(1.0, 1.3), rng.uniform(1.3, 1.6)
        s = before * math.sin(math.radians(theta))
        t, r = plate_jones(
            Crystal(indices=tuple(n), orientation=turn), s * math.cos(phi), s * math.sin(phi),
            thickness * 1e-6, wavelength, n_before=before, n_after=after,
        )  # fmt: skip
        c, sn = math.cos(phi), math.sin(phi)
        medium = elli.BiaxialMaterial(*[elli.ConstantRefractiveIndex(x) for x in n])
        medium.set_rotation(np.array([[c, sn, 0], [-sn, c, 0], [0, 0, 1]]) @ turn)
        stack = elli.Structure(
            elli.IsotropicMaterial(elli.ConstantRefractiveIndex(before)),
            [elli.Layer(medium, thickness)],
            elli.IsotropicMaterial(elli.ConstantRefractiveIndex(after)),
        )
        data = stack.evaluate([wavelength], theta, solver=elli.Solver4x4)
        # Its order is p, s, and its s points the other way
        for ours, theirs in ((t, data.jones_matrix_t[0]), (r, data.jones_matrix_r[0])):
            flipped = ours[::-1, ::-1] * np.array([[1, -1], [-1, 1]])
            worst = max(worst, float(np.abs(flipped - np.asarray(theirs)).max()))
    assert worst < 1e-10

"""Descriptions of crystals, their waves by direction, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from raymap.model.errors import SceneError
from tracer.optics.crystals.conical import cone_opening, conical_rays, ring_of_plate
from tracer.optics.crystals.media import (
    Crystal,
    biaxial,
    calcite,
    isotropic,
    rotation_between,
    uniaxial,
)
from tracer.optics.crystals.rows import BIAXIAL, ISOTROPIC, KIND, UNIAXIAL
from tracer.optics.crystals.waves import absorption_coefficient, waves_along


@pytest.mark.parametrize(
    ("wavelength", "n_o", "n_e"),
    [(589.3, 1.6583574, 1.4864161), (400.0, 1.6822815, 1.4974196), (780.0, 1.6493536, 1.4823932)],
)
def test_calcite_has_the_indices_of_its_formula(wavelength, n_o, n_e):
    indices = calcite().principal_indices(wavelength)
    np.testing.assert_allclose(indices, [n_o, n_o, n_e], atol=5e-8)


def test_equal_indices_decide_the_kind():
    assert isotropic(1.5).row(500.0)[KIND] == ISOTROPIC
    assert uniaxial(1.5, 1.6, (1, 2, 3)).row(500.0)[KIND] == UNIAXIAL
    assert biaxial(1.5, 1.6, 1.7).row(500.0)[KIND] == BIAXIAL
    # The axis is the one whose index differs, wherever it stands in the list
    axis = Crystal(indices=(1.7, 1.5, 1.5)).optic_axis(500.0)
    np.testing.assert_allclose(np.abs(axis), [1, 0, 0])


def test_binormals_stand_where_the_closed_form_puts_them():
    first, second = biaxial(1.3, 1.4, 1.5).binormals(500.0)
    assert np.degrees(np.arccos(first[2])) == pytest.approx(48.0700696465, abs=1e-9)
    assert np.degrees(np.arccos(second[2])) == pytest.approx(48.0700696465, abs=1e-9)
    # Both waves have the index n_y there
    waves = waves_along(biaxial(1.3, 1.4, 1.5), [first, second], 500.0)
    np.testing.assert_allclose(waves.index, 1.4, atol=1e-14)


def test_waves_found_by_ray_are_those_found_by_normal():
    rng = np.random.default_rng(0)
    crystal = biaxial(1.3, 1.45, 1.7, rotation_between((0, 0, 1), (1, 2, 2)))
    k = rng.normal(size=(300, 3))
    k /= np.linalg.norm(k, axis=1, keepdims=True)
    waves = waves_along(crystal, k, 500.0)
    for j in range(2):
        back = waves_along(crystal, waves.direction[:, j], 500.0, ray=True)
        gap = np.abs(back.refraction_vector - waves.refraction_vector[:, j][:, None]).max(axis=2)
        assert gap.min(axis=1).max() < 1e-12


def test_absorption_of_principal_waves():
    # 4 pi kappa / lambda for light polarised along a principal axis
    kappas = (1e-5, 3e-5, 8e-5)
    crystal = Crystal(indices=(1.5, 1.6, 1.7), absorption=kappas)
    for j in range(3):
        along = np.eye(3)[(j + 1) % 3] * (1.5, 1.6, 1.7)[j]
        value = absorption_coefficient(crystal, along, np.eye(3)[j], 500.0)
        assert value == pytest.approx(4 * np.pi * kappas[j] / 500e-6, rel=1e-12)


def test_cone_of_internal_conical_refraction():
    crystal = biaxial(1.3, 1.4, 1.5)
    assert np.tan(cone_opening(crystal, 500.0)) == pytest.approx(0.1434981393, abs=1e-10)
    assert np.degrees(cone_opening(crystal, 500.0)) == pytest.approx(8.166090982, abs=1e-8)
    binormal = crystal.binormals(500.0)[0]
    cone = conical_rays(crystal, binormal, 500.0, count=128, polarisation=(1, 2, 3))
    assert cone.weight.sum() == pytest.approx(1.0, abs=1e-12)
    centre, radius = ring_of_plate(crystal, binormal, 10.0, 500.0)
    assert radius == pytest.approx(0.717490696, abs=1e-9)
    along = cone.direction @ binormal
    ring = cone.direction * (10.0 / along)[:, None] - centre
    np.testing.assert_allclose(np.linalg.norm(ring, axis=1), radius, rtol=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: biaxial(1.3, -1.4, 1.5), r"indices\[1\] is -1.4; .* positive"),
        (lambda: isotropic(0.0), r"indices\[0\] is 0"),
        (lambda: isotropic(1.5, kappa=-1e-3), r"absorption\[0\] .* would amplify"),
        (lambda: biaxial(1.3, 1.4, 1.5, [[1, 1, 0], [0, 1, 0], [0, 0, 1]]), "not orthogonal"),
        (lambda: biaxial(1.3, 1.4, 1.5, np.eye(2)), "3 x 3"),
        (lambda: uniaxial(1.5, 1.6, (0, 0, 0)), "axis must be three numbers, not all zero"),
        (lambda: Crystal(indices=(lambda w: -1.0, 1.5, 1.5)).row(500.0), "at 500 nm"),
        (lambda: uniaxial(1.5, 1.6).binormals(500.0), "not biaxial"),
        (lambda: conical_rays(biaxial(1.3, 1.4, 1.5), (0, 0, 1), 500.0), "not a binormal"),
    ],
)
def test_impossible_crystals_are_refused(make, message):
    with pytest.raises(SceneError, match=message):
        make()

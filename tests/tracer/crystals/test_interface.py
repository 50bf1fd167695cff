"""The local model against tables, laws and random media."""

from __future__ import annotations

import math

import numpy as np
import pytest

from raymap.model.errors import SceneError
from tracer.optics.crystals.interface import WAVE, interface_batch
from tracer.optics.crystals.local import s_and_p, solve_interface
from tracer.optics.crystals.media import Crystal, biaxial, isotropic, rotation_between, uniaxial

AIR = isotropic(1.0, name="air")
UP = np.array([0.0, 0.0, 1.0])


def turn(axis, angle):
    a = np.asarray(axis, float) / np.linalg.norm(axis)
    k = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    return np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k


def shine(first, second, degrees, n=1.0):
    """Waves for s and for p input at an angle of incidence in the xz plane."""
    angle = math.radians(degrees)
    d = np.array([[math.sin(angle), 0.0, math.cos(angle)]])
    s, p = s_and_p(d, UP)
    return [solve_interface(first, second, n * d, e, UP) for e in (s, p)]


def split(waves):
    """Reflected shares along s (y) and across it, and the refracted shares."""
    along = abs(waves.field[0, 0, 1]) ** 2 / np.vdot(waves.field[0, 0], waves.field[0, 0]).real
    r = waves.reflected[0]
    return r * along, r * (1.0 - along), waves.share[0, 2], waves.share[0, 3]


C1 = (math.sin(math.radians(44.61)), 0.0, math.cos(math.radians(44.61)))


def test_calcite_at_normal_incidence():
    # Along and across the main plane (xz): n_e and n_o
    crystal = uniaxial(1.6584, 1.4864, C1)
    d = UP[None]
    o = solve_interface(AIR, crystal, d, [0.0, 1.0, 0.0], UP)
    e = solve_interface(AIR, crystal, d, [1.0, 0.0, 0.0], UP)
    assert o.reflected[0] == pytest.approx(0.0613393243, abs=1e-10)
    assert e.reflected[0] == pytest.approx(0.0487238217, abs=1e-10)
    assert e.index[0, 3] == pytest.approx(1.5665201322, abs=1e-10)
    np.testing.assert_allclose(e.direction[0, 3], [-0.10856718, 0.0, 0.99408911], atol=1e-8)


def test_calcite_at_45_degrees():
    s, p = shine(AIR, uniaxial(1.6584, 1.4864, C1), 45.0)
    np.testing.assert_allclose(
        [s.reflected[0], s.share[0, 2], p.reflected[0], p.share[0, 3]],
        [0.1290775439, 0.8709224561, 0.0114741504, 0.9885258496],
        atol=1e-10,
    )
    np.testing.assert_allclose(s.refraction_vector[0, 2], [0.70710678, 0, 1.50009685], atol=1e-8)
    np.testing.assert_allclose(s.direction[0, 2], [0.42637891, 0, 0.90454465], atol=1e-8)
    np.testing.assert_allclose(p.refraction_vector[0, 3], [0.70710678, 0, 1.47667572], atol=1e-8)
    np.testing.assert_allclose(p.direction[0, 3], [0.36458781, 0, 0.93116901], atol=1e-8)


def test_calcite_with_a_skew_axis():
    s, p = shine(AIR, uniaxial(1.6584, 1.4864, (1, 2, 3)), 40.0)
    np.testing.assert_allclose(
        split(s), [0.0988192860, 0.0003862017, 0.0136222293, 0.8871722831], atol=1e-10
    )
    along, across, t_o, t_e = split(p)
    np.testing.assert_allclose(
        [across, along, t_o, t_e],
        [0.0260771219, 0.0000051598, 0.9598073577, 0.0141103606],
        atol=1e-10,
    )
    np.testing.assert_allclose(s.direction[0, 3], [0.41251417, -0.10225137, 0.90519430], atol=1e-8)
    assert s.index[0, 3] == pytest.approx(1.60219144, abs=1e-8)


def test_biaxial_crystal():
    crystal = biaxial(1.3, 1.4, 1.5, turn((1, 1, 1), math.radians(50)))
    s, p = shine(AIR, crystal, 35.0)
    along, across, fast, slow = split(s)
    np.testing.assert_allclose(
        [along, across, fast, slow],
        [0.0437236176, 0.0005926169, 0.2928704664, 0.6628132991],
        atol=1e-10,
    )
    along, across, fast, slow = split(p)
    np.testing.assert_allclose(
        [across, along, fast, slow],
        [0.0097437953, 0.0005166604, 0.6931262741, 0.2966132702],
        atol=1e-10,
    )
    np.testing.assert_allclose(s.refraction_vector[0, 2], [0.57357644, 0, 1.16696849], atol=1e-8)
    np.testing.assert_allclose(s.refraction_vector[0, 3], [0.57357644, 0, 1.29173041], atol=1e-8)
    np.testing.assert_allclose(s.direction[0, 2], [0.43334348, -0.00571731, 0.90121071], atol=1e-8)
    np.testing.assert_allclose(s.direction[0, 3], [0.42903703, -0.03842606, 0.90246921], atol=1e-8)


@pytest.mark.parametrize(
    ("radians", "r_s", "r_p"),
    [(0.90, 0.3428837083, 0.0032437418), (0.97, 1.0, 0.0587688463), (1.03, 1.0, 1.0)],
)
def test_one_wave_travels_and_one_decays(radians, r_s, r_p):
    s, p = shine(isotropic(2.0), biaxial(1.4, 1.6, 1.7), math.degrees(radians), 2.0)
    assert s.reflected[0] == pytest.approx(r_s, abs=1e-10)
    assert p.reflected[0] == pytest.approx(r_p, abs=1e-10)


@pytest.mark.parametrize(("radians", "r_s"), [(0.90, 0.8815191649), (0.97, 0.9170423342)])
def test_mixed_regime_with_turned_axes(radians, r_s):
    crystal = biaxial(1.4, 1.6, 1.7, turn((1, 2, 3), 0.7))
    s, _ = shine(isotropic(2.0), crystal, math.degrees(radians), 2.0)
    assert s.reflected[0] == pytest.approx(r_s, abs=1e-10)


def random_crystal(rng, kind):
    n = rng.uniform(1.3, 2.5, 3)
    if kind == "uniaxial":
        return uniaxial(n[0], n[1], rng.normal(size=3))
    if kind == "nearly isotropic":
        return biaxial(*(1.5 + 1e-9 * n), turn(rng.normal(size=3), 1.0))
    return biaxial(*n, turn(rng.normal(size=3), rng.uniform(0, 3)))


@pytest.mark.parametrize("kind", ["uniaxial", "biaxial", "nearly isotropic"])
def test_fluxes_add_up_into_through_and_out_of_random_crystals(kind):
    rng = np.random.default_rng(11)
    count, kinds = 6000, 24
    media = np.array(
        [AIR.row(500.0)] + [random_crystal(rng, kind).row(500.0) for _ in range(kinds)]
    )
    d = rng.normal(size=(count, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    normal = rng.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal *= np.sign(np.einsum("ij,ij->i", d, normal))[:, None]
    field = np.cross(d, rng.normal(size=(count, 3))) + 1j * np.cross(d, rng.normal(size=(count, 3)))
    first, second = np.zeros(count, int), rng.integers(1, kinds + 1, count)
    out, flux = np.zeros((count, 4, WAVE)), np.zeros(count)
    interface_batch(media, first, second, d, field, normal, out, flux)
    assert np.abs(out[:, :, 12].sum(axis=1) - 1.0).max() < 1e-12

    # The waves inside meet further boundaries, to air and to other crystals
    for slot in (2, 3):
        ray = out[:, slot, 3:6]
        inner = out[:, slot, 6:9] + 1j * out[:, slot, 9:12]
        good = out[:, slot, 12] > 1e-9
        again = rng.normal(size=(count, 3))
        again /= np.linalg.norm(again, axis=1, keepdims=True)
        again *= np.sign(np.einsum("ij,ij->i", ray, again))[:, None]
        for target in (first, rng.integers(1, kinds + 1, count)):
            later, flux = np.zeros((count, 4, WAVE)), np.zeros(count)
            interface_batch(
                media, second, target, out[:, slot, :3].copy(), inner, again, later, flux
            )
            assert np.abs(later[good][:, :, 12].sum(axis=1) - 1.0).max() < 1e-12


def test_equal_media_let_everything_through():
    crystal = biaxial(1.3, 1.4, 1.5, turn((1, 2, 0), 0.6))
    s, p = shine(AIR, crystal, 50.0)
    for waves in (s, p):
        for slot in (2, 3):
            again = solve_interface(
                crystal, crystal, waves.refraction_vector[:, slot], waves.field[:, slot], UP
            )
            assert again.reflected[0] < 1e-28
            assert again.share[0, slot] == pytest.approx(1.0, abs=1e-13)


def test_isotropic_media_follow_fresnel():
    from tests.naive.fresnel import fresnel_reflectance

    for n1, n2, degrees in ((1.0, 1.5, 60.0), (1.5, 1.0, 30.0), (1.5, 1.0, 50.0)):
        s, p = shine(isotropic(n1), isotropic(n2), degrees, n1)
        natural = 0.5 * (s.reflected[0] + p.reflected[0])
        assert natural == pytest.approx(
            fresnel_reflectance(n1, n2, math.cos(math.radians(degrees))), abs=1e-14
        )


def test_waves_near_a_binormal_stay_power_orthogonal():
    crystal = biaxial(1.3, 1.4, 1.5)
    cut = crystal.turned(rotation_between(crystal.binormals(589.3)[0], UP))
    for offset in [0.0] + [10.0**-k for k in range(1, 17)]:
        for azimuth in (0.0, 1.0, 2.5, 4.0):
            d = np.array([[offset * math.cos(azimuth), offset * math.sin(azimuth), 1.0]])
            d /= np.linalg.norm(d)
            s, p = s_and_p(d, UP)
            both = [solve_interface(AIR, cut, d, e, UP) for e in (s, p)]
            for waves in both:
                assert abs(waves.share.sum() - 1.0) < 3e-15
            # Natural light feeds both rays alike, near the binormal
            if offset < 1e-4:
                natural = 0.5 * (both[0].share[0] + both[1].share[0])
                np.testing.assert_allclose(natural[2:], 0.5 * (1 - (0.4 / 2.4) ** 2), atol=1e-6)


def test_a_wave_that_goes_away_from_the_boundary_is_refused():
    with pytest.raises(SceneError, match="carries no energy towards"):
        solve_interface(AIR, isotropic(1.5), [0.0, 0.0, -1.0], [1.0, 0.0, 0.0], UP)


def test_reflection_inside_is_symmetric_between_the_two_waves():
    # In total reflection the exchange o -> e equals the exchange e -> o
    crystal = Crystal(indices=(1.6584, 1.6584, 1.4864), orientation=turn((1, 2, 0.5), 1.1))
    dense = isotropic(1.7)
    xi = 1.2
    d = np.array([[xi / 1.7, 0.0, math.sqrt(1 - (xi / 1.7) ** 2)]])
    s, _ = s_and_p(d, UP)
    inside = solve_interface(dense, crystal, 1.7 * d, s + 0.3, UP)
    shares = []
    for slot in (2, 3):
        out = solve_interface(
            crystal, AIR, inside.refraction_vector[:, slot], inside.field[:, slot], UP
        )
        assert out.refracted[0] == 0.0
        shares.append(out.share[0, :2])
    assert shares[0][1] == pytest.approx(shares[1][0], abs=1e-12)

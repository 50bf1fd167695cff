"""Branching trees: energy, coherent sums, meshes, contacts, absorption."""

from __future__ import annotations

import math

import numpy as np
import pytest

from raymap.model.errors import SceneError
from tracer.optics.crystals.local import s_and_p
from tracer.optics.crystals.media import (
    Crystal,
    biaxial,
    calcite,
    isotropic,
    rotation_between,
    uniaxial,
)
from tracer.optics.crystals.plates import plate_jones
from tracer.render.bodies import box, calcite_rhomb, compile_bodies, convex_body, mesh_body
from tracer.render.branching import coherent_sum, trace_tree

AIR = isotropic(1.0, name="air")
TURNED = biaxial(1.3, 1.4, 1.5, rotation_between((0, 0, 1), (1, 2, 3)))


def unit(*v):
    return np.array(v, float) / np.linalg.norm(v)


@pytest.mark.parametrize("tolerance", [0.0, 1e-4])
def test_nothing_is_lost(tolerance):
    rhomb = calcite_rhomb("rhomb", calcite, 30.0, (0.0, 0.0, 0.0), turn_deg=20.0)
    exits = trace_tree(
        (rhomb,), AIR, (4.0, -3.0, 60.0), unit(0.1, 0.05, -1.0), wavelength_nm=500.0,
        max_events=9, tolerance=tolerance,
    )  # fmt: skip
    total = exits.share.sum() + exits.pruned + exits.truncated + exits.absorbed
    assert total == pytest.approx(1.0, abs=1e-13)
    assert exits.pruned <= max(tolerance, 1e-15)


def tree_of_a_plate(crystal, thickness, wavelength, d, field):
    """Fields behind and before a plate that light meets at the origin from above, summed."""
    slab = box("slab", crystal, (0.0, 0.0, -thickness / 2), (1e3, 1e3, thickness))
    exits = trace_tree(
        (slab,), AIR, -d, d, wavelength_nm=wavelength, field=field, max_events=80, tolerance=1e-24
    )
    found = []
    for place, way in ((-thickness, d), (0.0, d * [1, 1, -1])):
        directions, fields = coherent_sum(exits, (0.0, 0.0, place))
        found.append(fields[int(np.argmin(np.linalg.norm(directions - way, axis=1)))])
    return found


# The plate's own frame looks along +z: turn the world about x by 180 degrees
FLIP = np.diag([1.0, -1.0, -1.0])


@pytest.mark.parametrize("seed", [0, 1])
def test_coherent_sum_of_the_tree_of_a_plate_is_its_jones_matrix(seed):
    crystal, d, thickness, wavelength = random_plate(np.random.default_rng(seed), seed)
    there = FLIP @ d
    t, r = plate_jones(crystal.turned(FLIP), there[0], there[1], thickness, wavelength)
    assert_fields(crystal, d, thickness, wavelength, t, r)


@pytest.mark.peers
def test_coherent_sums_of_trees_agree_with_pyelli():
    elli = pytest.importorskip("elli")
    for seed in range(10, 14):
        crystal, d, thickness, wavelength = random_plate(np.random.default_rng(seed), seed)
        there = FLIP @ d
        size = math.hypot(there[0], there[1])
        c, s = there[0] / size, there[1] / size
        medium = elli.BiaxialMaterial(
            *[elli.ConstantRefractiveIndex(n) for n in crystal.principal_indices(wavelength)]
        )
        medium.set_rotation(
            np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ FLIP @ np.asarray(crystal.orientation)
        )
        air = elli.IsotropicMaterial(elli.ConstantRefractiveIndex(1.0))
        stack = elli.Structure(air, [elli.Layer(medium, thickness * 1e6)], air)
        data = stack.evaluate([wavelength], math.degrees(math.asin(size)), solver=elli.Solver4x4)
        # Its order is p, s, and its s points the other way
        t, r = (
            np.asarray(matrix[0])[::-1, ::-1] * np.array([[1, -1], [-1, 1]])
            for matrix in (data.jones_matrix_t, data.jones_matrix_r)
        )
        assert_fields(crystal, d, thickness, wavelength, t, r)


def random_plate(rng, number):
    n = rng.uniform(1.25, 1.55, 3)
    if number % 2:
        n[1] = n[0]
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    theta, phi = rng.uniform(0.1, 0.7), rng.uniform(0.0, 2.0 * np.pi)
    d = np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), -np.cos(theta)])
    return Crystal(indices=tuple(n), orientation=turn), d, rng.uniform(5e-4, 4e-3), 600.0


def assert_fields(crystal, d, thickness, wavelength, t, r):
    """The tree's sums against Jones matrices, for s, p and an elliptical state."""
    s, p = (v[0] for v in s_and_p(d, (0.0, 0.0, 1.0)))
    there = FLIP @ d
    ps, pp = (v[0] for v in s_and_p(there, (0.0, 0.0, 1.0)))
    k0 = 2e6 * np.pi / wavelength
    for field in (s, p, 0.6 * s + 0.8j * p):
        behind, before = tree_of_a_plate(crystal, thickness, wavelength, d, field)
        # The ray starts at -d and meets the upper face at the origin
        inside = FLIP @ np.asarray(field) * np.exp(1j * k0 * 1.0)
        amplitudes = np.array([inside @ ps, inside @ pp])
        seen = FLIP @ behind
        np.testing.assert_allclose([seen @ ps, seen @ pp], t @ amplitudes, atol=1e-10)
        back = np.linalg.norm(r @ amplitudes)
        assert np.linalg.norm(before) == pytest.approx(back, abs=1e-10)


def test_a_mesh_is_traced_like_the_same_convex_body():
    solid = box("solid", TURNED, (0.0, 0.0, 0.0), (2.0, 2.0, 2.0))
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    mesh = mesh_body("mesh", TURNED, corners, triangles)
    results = []
    for body in (solid, mesh):
        exits = trace_tree(
            (body,), AIR, (0.3, 0.2, 5.0), unit(0.05, -0.1, -1.0), wavelength_nm=500.0,
            max_events=7,
        )  # fmt: skip
        order = np.lexsort(np.round(exits.point, 6).T)
        results.append((exits.share[order], exits.point[order]))
    np.testing.assert_allclose(results[0][0], results[1][0], atol=1e-12)
    np.testing.assert_allclose(results[0][1], results[1][1], atol=1e-9)


def test_a_stated_contact_joins_two_crystals():
    glass = isotropic(1.5, name="glass")
    lower = box("lower", glass, (0.0, 0.0, -1.0), (4.0, 4.0, 2.0))
    upper = box("upper", glass, (0.0, 0.0, 1.0), (4.0, 4.0, 2.0))
    exits = trace_tree(
        (lower, upper), AIR, (0.1, 0.2, 9.0), (0.0, 0.0, -1.0), wavelength_nm=500.0,
        max_events=4, contacts=(("upper", "lower"),),
    )  # fmt: skip
    straight = exits.share[(exits.direction[:, 2] < 0.0) & (exits.events == 3)]
    # Two faces only: the inner boundary of equal media does nothing
    assert straight.sum() == pytest.approx(0.96**2, abs=1e-12)


def test_absorption_takes_its_share():
    dark = Crystal(name="dark", indices=(1.5, 1.5, 1.6), absorption=(1e-5, 1e-5, 4e-5))
    slab = box("slab", dark, (0.0, 0.0, 0.0), (50.0, 50.0, 2.0))
    exits = trace_tree(
        (slab,), AIR, (0.0, 0.0, 5.0), (0.0, 0.0, -1.0), wavelength_nm=500.0,
        field=(1.0, 0.0, 0.0), max_events=2,
    )  # fmt: skip
    through = exits.share[exits.direction[:, 2] < 0.0].sum()
    kept = math.exp(-4.0 * math.pi * 1e-5 / 500e-6 * 2.0)
    assert through == pytest.approx(0.96**2 * kept, rel=1e-9)
    assert exits.absorbed == pytest.approx(0.96 * (1.0 - kept), rel=1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: convex_body("b", AIR, [[1, 0, 0, 1], [-1, 0, 0, 1], [0, 1, 0, 1], [0, -1, 0, 1]]),
         "do not enclose"),
        (lambda: box("b", AIR, (0, 0, 0), (1, -1, 1)), "sizes positive"),
        (lambda: mesh_body("m", AIR, np.eye(3), [[0, 1, 2]]), "not closed"),
        (lambda: calcite_rhomb("r", calcite, -3.0, (0, 0, 0)), "edge_mm"),
        (lambda: compile_bodies((box("a", AIR, (0, 0, 0), (2, 2, 2)),
                                 box("b", AIR, (0, 0, 2), (2, 2, 2)))),
         "touch without a stated interface"),
        (lambda: compile_bodies((box("a", AIR, (0, 0, 0), (2, 2, 2)),
                                 box("b", AIR, (0, 0, 1), (2, 2, 2)))), "overlap by 1 mm"),
        (lambda: compile_bodies((box("a", AIR, (0, 0, 0), (2, 2, 2)),), (("a", "c"),)),
         "contact names 'c'"),
        (lambda: trace_tree((), uniaxial(1.5, 1.6), (0, 0, 0), (0, 0, 1), wavelength_nm=500.0),
         "must be isotropic"),
    ],
)  # fmt: skip
def test_impossible_bodies_are_refused(make, message):
    with pytest.raises(SceneError, match=message):
        make()

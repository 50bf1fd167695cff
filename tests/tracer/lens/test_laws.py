"""Laws over random lenses and rays: energy, reciprocity, transversality, turned lenses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.examples import examples
from tests.tracer.lens.lenses import lenses, random_rays, rays_at
from tracer.lens import Arriving, Glass, Lens, answer, trace_backward, trace_lens
from tracer.optics.dispersion import constant
from tracer.optics.polarization_rays import PolarizedRays

RUNS = settings(max_examples=examples(60))


@RUNS
@given(st.data(), lenses(), st.integers(1, 12), st.sampled_from([1.0, 0.9, 0.2, 0.0]))
def test_energy_is_booked_to_rounding(
    data: st.DataObject, lens: Lens, depth: int, transmittance: float
) -> None:
    clear = lens.glass
    assert isinstance(clear, Glass)
    absorbing = replace(lens, glass=replace(clear, transmittance=((550.0, transmittance),)))
    rays = data.draw(rays_at(absorbing))
    for mode in ("polarized", "scalar", "schlick", "published", "unpolarized"):
        tree = trace_lens(absorbing, rays, depth=depth, mode=mode)  # type: ignore[arg-type]
        np.testing.assert_allclose(tree.energy_error(), 0.0, atol=1e-12)


@RUNS
@given(st.data(), lenses())
def test_fields_stand_across_their_rays_and_square_to_the_flux(
    data: st.DataObject, lens: Lens
) -> None:
    tree = trace_lens(lens, data.draw(rays_at(lens)), depth=8)
    exits = tree.exits()
    assert exits.field is not None
    np.testing.assert_allclose(np.linalg.norm(exits.direction, axis=1), 1.0, rtol=1e-12)
    scale = np.sqrt(exits.flux)
    along = np.abs(np.sum(exits.field * exits.direction, axis=1)) / scale
    np.testing.assert_allclose(along, 0.0, atol=1e-11)
    np.testing.assert_allclose(np.sum(np.abs(exits.field) ** 2, axis=1), exits.flux, rtol=1e-12)


@RUNS
@given(st.data(), lenses())
def test_reciprocity_between_states(data: st.DataObject, lens: Lens) -> None:
    """Flux from state a to state b forward = from b to a backward (Helmholtz), in both uses."""
    rays = data.draw(rays_at(lens, 10))
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    vibration = rng.normal(size=(len(rays), 3))
    vibration -= np.sum(vibration * rays.direction, axis=1, keepdims=True) * rays.direction
    linear = PolarizedRays.linear(rays.origin, rays.direction, vibration, wavelength_nm=550.0)
    there = trace_lens(lens, linear, depth=7).exits()
    if len(there) == 0:
        return
    assert there.field is not None
    analyser = rng.normal(size=(len(there), 3))
    analyser -= np.sum(analyser * there.direction, axis=1, keepdims=True) * there.direction
    analyser /= np.linalg.norm(analyser, axis=1, keepdims=True)
    forward = np.abs(np.sum(analyser * there.field, axis=1)) ** 2

    # The backward tree from the same root: its answer travels against the ray
    tree = trace_backward(lens, rays.origin, rays.direction, wavelength_nm=550.0, depth=7)
    exits = tree.exits()
    np.testing.assert_array_equal(exits.level, there.level)
    bundle = answer(tree, exits, Arriving.at(np.arange(len(exits)), analyser))
    unit = linear.field[bundle.ray].real
    backward = np.sum(bundle.light.field * unit, axis=1)
    np.testing.assert_allclose(np.abs(backward) ** 2, forward, atol=1e-12)
    np.testing.assert_allclose(bundle.light.optical_path, there.optical_path, rtol=1e-12)


@RUNS
@given(lenses(), st.integers(0, 2**32 - 1))
def test_a_forward_tree_from_the_other_end_agrees(lens: Lens, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rays = random_rays(rng, lens, 5)
    out = trace_lens(lens, rays, depth=5, mode="unpolarized").exits()
    back = PolarizedRays.from_field(
        out.point + 0.01 * out.direction,
        -out.direction,
        np.cross(out.direction, rng.normal(size=(len(out), 3))),
        wavelength_nm=550.0,
    )
    if len(out) == 0:
        return
    tree = trace_lens(lens, back, depth=5, mode="unpolarized")
    # Unpolarised transport is symmetric: share of level k either way
    for row, level in enumerate(out.level):
        share = out.flux[row] / rays.flux[out.ray[row]]
        again = tree.flux[row, level - 1] / back.flux[row]
        if tree.status[row] == out.face[row]:  # the same lens may stand in its own way
            np.testing.assert_allclose(again, share, atol=1e-9)


@RUNS
@given(st.data(), lenses(), st.floats(0.0, 6.28))
def test_turning_lens_and_light_together_changes_nothing(
    data: st.DataObject, lens: Lens, angle: float
) -> None:
    rays = data.draw(rays_at(lens, 10))
    axis = np.array([0.48, 0.6, 0.64])
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
    other = replace(
        lens, origin=tuple(turn @ np.array(lens.origin)), axis=tuple(turn @ np.array(lens.axis))
    )
    turned = PolarizedRays.from_field(
        rays.origin @ turn.T, rays.direction @ turn.T, rays.field @ turn.T, wavelength_nm=550.0
    )
    first, second = trace_lens(lens, rays, depth=4), trace_lens(other, turned, depth=4)
    same = (first.face == second.face).all(axis=1)  # a ray on an edge may fall either way
    assert same.mean() > 0.7
    np.testing.assert_allclose(second.flux[same], first.flux[same], atol=1e-7)
    assert first.field is not None
    assert second.field is not None
    np.testing.assert_allclose(second.field[same], (first.field @ turn.T)[same], atol=1e-6)


@RUNS
@given(st.data(), lenses())
def test_batches_threads_and_single_rays_agree(data: st.DataObject, lens: Lens) -> None:
    rays = data.draw(rays_at(lens, 12))
    together = trace_lens(lens, rays, depth=5)
    alone = [trace_lens(lens, rays.where([row]), depth=5).flux[0] for row in range(len(rays))]
    np.testing.assert_array_equal(together.flux, alone)


def test_a_pool_gives_the_same_trees() -> None:
    lens = Lens(
        radius_front=50.0, radius_back=-50.0, thickness=6.0, semi_aperture_front=12.5,
        glass=Glass(dispersion=constant(1.5)),
    )  # fmt: skip
    rays = random_rays(np.random.default_rng(5), lens, 20_000)
    one, two = trace_lens(lens, rays), trace_lens(lens, rays, threads=2)
    np.testing.assert_array_equal(one.flux, two.flux)
    np.testing.assert_array_equal(one.field, two.field)

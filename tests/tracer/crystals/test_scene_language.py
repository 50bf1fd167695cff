"""Crystals in scenes of the common language."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import raymap
from query import detected, event, hit, select
from raymap.model.errors import SceneError, SceneMismatch
from tracer.render.scenes import bodies_of
from tracer.run.recording import record
from tracer.run.traces import trace_of
from tracer.scene.compile import compile_scene
from tracer.scene.load import load_scene, parse_scene

SAMPLE = Path(__file__).parents[3] / "samples" / "crystals" / "calcite_paths.toml"

PLATE = """
length_unit = "mm"
[spectrum]
kind = "spectral"
wavelengths_nm = [589.3]
[media.crystal]
crystal = {{ indices = [{o}, {o}, {e}], optic_axis = {axis} }}
[media.glass]
index = 1.5
[bodies.plate]
kind = "box"
size = [20, 20, 5]
medium = "{medium}"
[sources.pencil]
kind = "collimated"
position = [0, 0, -20]
direction = [0, 0, 1]
diameter = 0.2
{light}
[detectors.screen]
position = [0, 0, 20]
looks = [0, 0, -1]
size = [10, 10]
cells = [50, 50]
blocking = true
"""


def plate(light: str = "", medium: str = "crystal", axis: str = "[1, 0, 0]") -> str:
    return PLATE.format(o=1.6584, e=1.4864, light=light, medium=medium, axis=axis)


def test_record_takes_a_scene_with_crystals(tmp_path: Path) -> None:
    path = tmp_path / "calcite.raymap"
    first = record(SAMPLE, path, rays=4_000, seed=5, threads=1)
    assert first.rays == 4_000
    assert first.audit["pencil"]["emitted"] == 4_000
    assert sum(n for key, n in first.audit["pencil"].items() if key != "emitted") == 4_000
    more = record(SAMPLE, path, rays=1_000, append=True, threads=2)
    assert more.seed == 5
    with raymap.open(path) as map:
        assert map.rays == 5_000
        assert "rhomb.top" in map.directory.faces.names
        both = [
            select(map, hit("rhomb", word) & detected("screen")).matched
            for word in ("ordinary", "extraordinary")
        ]
        assert min(both) > 1_500
        whole = map.portions[0].read()
    again = tmp_path / "one.raymap"
    record(SAMPLE, again, rays=5_000, seed=5, threads=2)
    with raymap.open(again) as map:
        np.testing.assert_array_equal(
            map.portions[0].read().position[: whole.n_records], whole.position
        )
    with pytest.raises(SceneMismatch):
        record(parse_scene(plate()), path, rays=10, append=True)


def test_shares_of_a_plate_with_its_axis_in_the_face(tmp_path: Path) -> None:
    # Normal incidence: s and p see glass of n_o and n_e; light that vibrates along the axis is e
    for light, n in (("polarisation = [1, 0, 0]", 1.4864), ("polarisation = [0, 1, 0]", 1.6584)):
        path = tmp_path / f"{n}.raymap"
        record(parse_scene(plate(light)), path, rays=20_000, force=True)
        r = ((n - 1.0) / (n + 1.0)) ** 2
        expected = (1.0 - r) / (1.0 + r)
        with raymap.open(path) as map:
            found = select(map, detected("screen"))
            assert found.matched / 20_000 == pytest.approx(expected, abs=0.006)
            other = "extraordinary" if n > 1.6 else "ordinary"
            assert select(map, event(other)).matched == 0


def test_an_isotropic_body_is_traced_like_glass(tmp_path: Path) -> None:
    text = plate(medium="glass")
    portion = trace_of(parse_scene(text)).engine(1).trace(0, 20_000)
    last = np.cumsum(portion.records_per_ray) - 1
    on_screen = np.mean(portion.object[last] == 1)
    r = 0.04
    assert on_screen == pytest.approx((1 - r) / (1 + r), abs=0.006)


def test_bodies_stand_where_the_scene_puts_them() -> None:
    text = plate().replace(
        "size = [20, 20, 5]", "size = [2, 4, 6]\nposition = [1, 2, 3]\nrotation = [0, 0, 90]"
    )
    [body] = bodies_of(parse_scene(text))
    np.testing.assert_allclose(body.vertices.min(axis=0), [-1, 1, 0], atol=1e-12)
    np.testing.assert_allclose(body.vertices.max(axis=0), [3, 3, 6], atol=1e-12)
    rhomb = bodies_of(load_scene(SAMPLE))[0]
    assert rhomb.vertices[:, 2].min() == pytest.approx(0.01)
    axis = rhomb.medium.orientation[:, 2]
    # The optic axis makes 44.61 degrees with every face of the cleavage
    np.testing.assert_allclose(
        np.abs(rhomb.planes[:, :3] @ axis), np.cos(np.radians(44.6095)), atol=1e-5
    )


@pytest.mark.parametrize(
    ("change", "to", "named"),
    [
        ('kind = "spectral"\nwavelengths_nm = [589.3]', 'kind = "rgb"', "spectrum"),
        ("optic_axis", "optical_axis", "media.crystal.crystal.optical_axis"),
        ("[1.6584, 1.6584, 1.4864]", "[1.6584, 1.6584, -1]", "media|index"),
        ("blocking = true", 'blocking = true\n[trace]\nlight = "polarised"', "trace.light"),
        (
            "blocking = true",
            'blocking = true\n[trace]\nmode = "weighted"\nsplit_depth = 1',
            "trace.split_depth",
        ),
        (
            "[0, 0, 1]\ndiameter",
            '[0, 0, 1]\ninside = "plate"\ndiameter',
            "sources.pencil.inside: light must start in an isotropic medium",
        ),
        (
            'medium = "crystal"',
            'medium = "crystal"\nsurface = "film"\n'
            '[surfaces.film]\nkind = "mirror"\nreflectance = 0.9',
            "bodies.plate: 'film' .mirror. lies on a face of a crystal",
        ),
        (
            'length_unit = "mm"',
            'length_unit = "mm"\ncontacts = [["plate", "plate"]]',
            "contact .*: a body has none with itself",
        ),
        (
            'length_unit = "mm"',
            'length_unit = "mm"\ncontacts = [["plate", "lens"]]',
            "contact names 'lens', the bodies are plate",
        ),
        (
            'length_unit = "mm"',
            'length_unit = "mm"\nworld = { medium = "crystal" }',
            "world.medium: 'crystal' is a crystal; light must come from an isotropic medium",
        ),
        (
            "[1.6584, 1.6584, 1.4864]",
            "[1.6584, 1.6584, 1.4864], absorption = [0.01, 0.01, 0.3]",
            "media.crystal.crystal.absorption: kappa is 0.3 at 589.3 nm",
        ),
    ],
)
def test_what_crystals_cannot_have_is_refused_by_name(change: str, to: str, named: str) -> None:
    text = plate().replace(change, to)
    with pytest.raises(SceneError, match=named):
        compile_scene(parse_scene(text))


def test_other_tracers_refuse_crystals() -> None:
    text = plate() + '[trace]\nlens_trees = "lens"\n'
    with pytest.raises(SceneError, match="lens_trees"):
        trace_of(parse_scene(text))


def test_contacts_that_cannot_be_are_refused() -> None:
    second = """
[bodies.second]
kind = "box"
size = [20, 20, 5]
position = [0, 0, {z}]
medium = "glass"
"""
    head = 'contacts = [["plate", "second"]]\n'
    compile_scene(parse_scene(head + plate() + second.format(z=5)))
    with pytest.raises(SceneError, match="no faces on one another; move them together"):
        compile_scene(parse_scene(head + plate() + second.format(z=6)))


def test_dark_crystals_need_a_clear_isotropic_medium_outside() -> None:
    from tracer.optics.crystals.absorbing import absorbing_interface, absorbing_plate
    from tracer.optics.crystals.media import calcite, uniaxial

    dark = uniaxial(1.6, 1.5, [0, 0, 1], kappa_o=0.4)
    for outside in (calcite([0, 0, 1]), 1.5 + 0.2j, -1.0):
        with pytest.raises(SceneError, match=r"n_before is .* a clear isotropic medium"):
            absorbing_interface(dark, 0.0, 0.0, 550.0, n_before=outside)  # type: ignore[arg-type]
    with pytest.raises(SceneError, match="n_after is crystal 'calcite'"):
        absorbing_plate(dark, 0.0, 0.0, 0.1, 550.0, n_after=calcite([0, 0, 1]))  # type: ignore[arg-type]

"""Lists of rays as sources: drawn by their flux, in order, in their colours."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from raymap.model.errors import SceneError
from tests.tracer.chi2 import SIGNIFICANCE, chi2_counts
from tests.tracer.sources.emission import directions, emitted, starts, with_source
from tracer.light import RayList
from tracer.scene.compile import compile_scene
from tracer.scene.load import parse_scene
from tracer.sources.rays import RaySource


def listed(n: int, flux: NDArray[np.float64], **rest: object) -> RayList:
    angle = np.linspace(0.0, 1.0, n)
    return RayList(
        positions=np.column_stack([np.arange(n), np.zeros(n), np.zeros(n)]),
        directions=np.column_stack([np.sin(angle), np.zeros(n), np.cos(angle)]),
        flux=flux,
        **rest,  # type: ignore[arg-type]
    )


def test_rays_are_drawn_by_their_flux() -> None:
    flux = np.arange(1.0, 41.0)
    model = RaySource(light=listed(40, flux, unit="W"))
    scene = with_source(model)
    compilation = compile_scene(scene)
    assert compilation.directory.sources[0].flux == pytest.approx(flux.sum())
    found = emitted(scene, 50_000)
    drawn = np.round(found.position[starts(found), 0]).astype(int)
    counts = np.bincount(drawn, minlength=40).astype(float)
    assert chi2_counts(counts, flux / flux.sum() * 50_000) > SIGNIFICANCE
    along = directions(found)
    assert np.allclose(np.arctan2(along[:, 0], along[:, 2]), drawn / 39.0, atol=1e-4)


def test_equal_rays_come_one_by_one_in_order() -> None:
    scene = with_source(RaySource(light=listed(37, np.ones(37)), draw="in_order"))
    found = emitted(scene, 100)
    drawn = np.round(found.position[starts(found), 0]).astype(int)
    assert drawn.tolist() == [k % 37 for k in range(100)]
    later = emitted(scene, 10, first=50)
    again = np.round(later.position[starts(later), 0]).astype(int)
    assert again.tolist() == [k % 37 for k in range(50, 60)]


def test_unequal_rays_in_order_come_as_often_as_their_flux_says() -> None:
    flux = np.array([0.2, 1.0, 3.0, 0.7, 0.0, 2.1])
    scene = with_source(RaySource(light=listed(6, flux), draw="in_order"))
    found = emitted(scene, 6_000)
    drawn = np.round(found.position[starts(found), 0]).astype(int)
    share = np.bincount(drawn, minlength=6) / 6_000
    # Far closer than independent draws: each round of six differs by less than one
    assert np.abs(share - flux / flux.sum()).max() < 0.01


def test_two_sources_share_the_numbers_of_a_list_in_order() -> None:
    scene = parse_scene('length_unit = "mm"\n[sources.x]\nkind = "point"\nflux = 2\n')
    rays = RaySource(light=listed(11, np.ones(11)), draw="in_order")
    scene = scene.model_copy(update={"sources": {**scene.sources, "rays": rays}})
    found = emitted(scene, 9_000)
    mine = found.source == 1
    drawn = np.round(found.position[starts(found)][mine, 0]).astype(int)
    assert drawn.tolist() == [k % 11 for k in range(int(mine.sum()))]


def test_wavelengths_of_rays_choose_their_channels() -> None:
    light = listed(4, np.ones(4), wavelength_nm=np.array([450.0, 548.0, 552.0, 690.0]))
    text = """
[spectrum]
kind = "spectral"
wavelengths_nm = [450, 550, 650]
"""
    scene = with_source(RaySource(light=light, draw="in_order"), text)
    wide = listed(4, np.ones(4), unit="W", wavelength_nm=np.array([450.0, 548.0, 552.0, 900.0]))
    with pytest.warns(UserWarning, match="25.0% of the light"):
        found = compile_scene(with_source(RaySource(light=wide), text))
    assert found.directory.sources[0].flux == pytest.approx(3.0)
    seen = emitted(scene, 8)
    assert seen.color_code[starts(seen)].tolist() == [0, 1, 1, 2] * 2
    # In an RGB trace they have the colours of their wavelengths
    seen = emitted(with_source(RaySource(light=light, draw="in_order")), 4)
    codes = seen.color_code[starts(seen)]
    colors = np.concatenate([np.eye(3) * 65535, seen.color_table])[codes]
    assert colors[0].argmax() == 2
    assert colors[1].argmax() == 1
    assert colors[3].argmax() == 0


def test_lengths_and_place_of_a_list() -> None:
    light = RayList(positions=[[1, 2, 3]], directions=[[0, 0, 2]], flux=[1.0], length_unit="cm")
    model = RaySource(light=light, position=(100, 0, 0), axis=(1, 0, 0))
    found = emitted(with_source(model), 3)
    assert np.allclose(found.position[0], [130.0, 20.0, -10.0], atol=1e-4)
    assert np.allclose(directions(found)[0], [1, 0, 0], atol=1e-4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"flux": [-1.0, 1.0]}, "ray 0"),
        ({"directions": [[0, 0, 1], [0, 0, 0]]}, "ray 1"),
        ({"flux": [0.0, 0.0]}, "flux 0"),
        ({"positions": [[0, 0, 0]]}, "needs positions"),
    ],
)
def test_lists_that_make_no_light_are_refused(change: dict[str, object], message: str) -> None:
    given = {"positions": np.zeros((2, 3)), "directions": [[0, 0, 1]] * 2, "flux": [1.0, 1.0]}
    with pytest.raises(SceneError, match=message):
        RayList(**(given | change))  # type: ignore[arg-type]

"""The laws that a scene's map states are those that its light obeyed."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import raymap
import tracer
from raymap.laws.stored import Laws, laws_of
from raymap.model.events import Event
from tests.oracle.scenes import MEDIA, SURFACES
from tracer.compiled import S_SCATTER
from tracer.scene.compile import Compilation, compile_scene
from tracer.surfaces.interaction import Interface, optics_of
from tracer.surfaces.specular import specular_share

COSINES = np.cos(np.radians([0.0, 20.0, 41.0, 60.0, 85.0]))
SMOOTH = ["clear", "half", "coated", "measured_coating", "hazy", "mirror", "silver", "dusty"]


@pytest.fixture(scope="module")
def all_kinds() -> tuple[Compilation, Laws]:
    """A ball of every surface and a ball of every medium, as a map would state them."""
    tree: dict[str, Any] = {"media": MEDIA, "surfaces": SURFACES, "bodies": {}}
    for k, surface in enumerate(SURFACES):
        tree["bodies"][surface] = {
            "kind": "sphere", "radius": 1, "position": [3 * k, 0, 0], "medium": "glass",
            "surface": surface,
        }  # fmt: skip
    text = ['length_unit = "mm"\n']
    for part, tables in tree.items():
        text += [f"[{part}.{name}]\n" + _keys(table) for name, table in tables.items()]
    text.append('[sources.lamp]\nkind = "point"\nposition = [0, 0, 9]\naxis = [0, 0, -1]\n')
    compilation = compile_scene(tracer.parse_scene("\n".join(text)))
    laws = laws_of(compilation.directory, compilation.channel_set)
    assert laws is not None
    return compilation, laws


def _keys(table: dict[str, Any]) -> str:
    return "".join(f"{key} = {_inline(value)}\n" for key, value in table.items())


def _inline(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{k} = {_inline(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_inline, value)) + "]"
    return f'"{value}"' if isinstance(value, str) else str(value)


def law_of(all_kinds: tuple[Compilation, Laws], name: str) -> tuple[int, Any]:
    compilation, laws = all_kinds
    names = [surface.name for surface in compilation.directory.surfaces]
    return names.index(name), laws.surfaces[names.index(name)]


def test_every_surface_and_medium_states_its_law(all_kinds: tuple[Compilation, Laws]) -> None:
    compilation, laws = all_kinds
    assert {surface.name for surface in compilation.directory.surfaces} >= set(SURFACES)
    assert None not in laws.surfaces
    assert None not in laws.media


@pytest.mark.parametrize("name", SMOOTH)
@pytest.mark.parametrize("inside", [False, True])
def test_smooth_laws_are_those_of_the_compiled_scene(
    all_kinds: tuple[Compilation, Laws], name: str, inside: bool
) -> None:
    compilation, _ = all_kinds
    number, law = law_of(all_kinds, name)
    optics = optics_of.py_func(compilation.arrays)
    media = [medium.name for medium in compilation.directory.media]
    here, beyond = media.index("air"), media.index("glass")
    if inside:
        here, beyond = beyond, here
    index = np.array(compilation.channel_set.refractive_index)
    found = law.shares(compilation.channel_set, index[here], index[beyond], COSINES)
    for crosses, shares in enumerate(found):
        if crosses and law.law == "mirror":
            assert not shares.any()
            continue
        traced = [
            [
                specular_share(optics, Interface(number, here, beyond, float(c)), bool(crosses), k)
                for c in COSINES
            ]
            for k in range(3)
        ]
        np.testing.assert_allclose(shares, traced, rtol=1e-12, atol=1e-15)


def test_scatter_about_the_specular_light(all_kinds: tuple[Compilation, Laws]) -> None:
    compilation, _ = all_kinds
    for name in ("hazy", "dusty"):
        number, law = law_of(all_kinds, name)
        table = law.scatter.tables(compilation.channel_set.wavelengths_nm)[0]
        first = compilation.arrays.surface_i[number, S_SCATTER]
        assert compilation.arrays.tables is not None
        np.testing.assert_array_equal(table, compilation.arrays.tables[first : first + len(table)])
    _, dusty = law_of(all_kinds, "dusty")
    assert dusty.scatter.bsdf(550.0)(np.array([0.05]))[0] == pytest.approx(0.2 * 2.0**-0.75)


def test_rough_and_measured_laws(all_kinds: tuple[Compilation, Laws]) -> None:
    compilation, _ = all_kinds
    one = np.ones(3)
    _, gold = law_of(all_kinds, "gold")
    assert gold.roughness == 0.4
    found, _ = gold.shares(compilation.channel_set, one, one, np.array([1.0]))
    assert found[0, 0] == pytest.approx((0.7**2 + 2.9**2) / (1.3**2 + 2.9**2))
    assert law_of(all_kinds, "ground")[1].roughness == 0.3
    _, sampled = law_of(all_kinds, "sampled")
    back, through = sampled.shares(compilation.channel_set, one, one, np.array([1.0]))
    # Cells about 0, 45, 90 degrees end at 22.5 and 67.5: half the projected solid angle counts
    s1, s2 = math.sin(math.radians(22.5)) ** 2, math.sin(math.radians(67.5)) ** 2
    expected = math.pi * (0.2 * s1 + 0.09 * (s2 - s1))
    assert back[0, 0] == pytest.approx(expected)
    assert through[0, 0] == pytest.approx(math.pi * 0.1 * 0.5)


def test_media(all_kinds: tuple[Compilation, Laws]) -> None:
    compilation, laws = all_kinds
    media = dict(zip([m.name for m in compilation.directory.media], laws.media, strict=True))
    assert media["glass"].scattering == ()
    assert media["milk"].scattering == pytest.approx((0.98 / 8.0,) * 3)
    assert media["milk"].phase.g == 0.7
    assert media["mist"].phase.kind == "isotropic"
    assert media["paint"].phase.value == (9, 3, 1, 0.5)


PLATE = """
length_unit = "mm"
[media.glass]
index = 1.5
[surfaces.front]
kind = "dielectric"
coating = { wavelength_nm = [400, 700], angle_deg = [0, 30, 60, 90], \
reflectance = [[0.2, 0.3, 0.5, 0.9], [0.2, 0.3, 0.5, 0.9]], \
transmittance = [[0.7, 0.6, 0.3, 0.05], [0.7, 0.6, 0.3, 0.05]] }
[bodies.plate]
kind = "box"
size = [400, 400, 5]
medium = "glass"
surface = "front"
[sources.lamp]
kind = "point"
position = [0, 0, -20]
axis = [0, 0, 1]
cone_deg = 75
"""


def test_recorded_hits_follow_the_stated_law(tmp_path: Path) -> None:
    """What a map records at first hits, against the law that it states, angle by angle."""
    path = tmp_path / "plate.raymap"
    tracer.record(tracer.parse_scene(PLATE), path, rays=20_000, seed=3)
    with raymap.open(path) as ray_map:
        laws = ray_map.laws()
        assert laws is not None
        portion = ray_map.portions[0].read()
        starts = np.concatenate(([0], np.cumsum(portion.records_per_ray)[:-1]))
        met = portion.records_per_ray > 1
        first = starts[met] + 1
        way = portion.position[first].astype(float) - portion.position[first - 1]
        cosine = way[:, 2] / np.linalg.norm(way, axis=1)
        on_front = portion.position[first][:, 2] < -2.0
        event = portion.event[first]
        names = [surface.name for surface in ray_map.directory.surfaces]
        channel_set = ray_map.channel_sets[0]
    law = laws.surfaces[names.index("front")]
    assert law is not None
    r, t = law.shares(channel_set, np.ones(3), np.full(3, 1.5), cosine)
    for band in (cosine > 0.9, (cosine <= 0.9) & (cosine > 0.5), cosine <= 0.5):
        chosen = band & on_front
        for expected, kind in (
            (r[0], Event.SPECULAR_REFLECTION),
            (t[0], Event.SPECULAR_REFRACTION),
        ):
            happened = (event & int(kind)) != 0
            mean = expected[chosen].sum()
            spread = math.sqrt((expected * (1.0 - expected))[chosen].sum())
            assert abs(happened[chosen].sum() - mean) < 4.5 * spread

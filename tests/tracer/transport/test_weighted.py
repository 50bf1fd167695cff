"""The weighted mode: other rays, the same light."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import raymap
from query import path_table, select
from query.answers.paths.ghosts import ghost_matrix
from raymap.model.events import Event
from raymap.model.portion import Portion
from tests.tracer.transport.tracing import compiled
from tracer.run.pieces import split_portion
from tracer.run.recording import record
from tracer.scene.compile import Compilation, compile_scene
from tracer.scene.load import parse_scene
from tracer.transport.wavefront import Wavefront

SAMPLES = Path(__file__).parents[3] / "samples"
LENS = (SAMPLES / "double_gauss.toml").read_text()

MODES = {
    "likelier": "min_reflection = 0.3",
    "split": "split_depth = 2",
    "split and likelier": "split_depth = 1\nmin_reflection = 0.2\nroulette_weight = 0.01",
    "roulette": "min_reflection = 0.2\nroulette_weight = 0.5",
}


def traced(scene: Compilation, emissions: int, *, seed: int = 5, weighted: bool = True) -> Portion:
    engine = Wavefront(scene.arrays, seed, meshes=scene.solids, weighted=weighted)
    return engine.trace(0, emissions)


def moments(portion: Portion, values: NDArray[np.float64]) -> tuple[float, float]:
    """Mean per emission of what rays bring, and its variance; rays of an emission add up."""
    n = int(portion.emitted.sum())
    weight = np.ones(portion.n_rays) if portion.weight is None else portion.weight.astype(float)
    brought = weight * values
    if portion.emission is not None:
        brought = np.add.reduceat(brought, np.unique(portion.emission, return_index=True)[1])
    mean = brought.sum() / n
    return mean, ((brought**2).sum() / n - mean**2) / n


def endings(portion: Portion, scene: Compilation) -> dict[str, NDArray[np.float64]]:
    """Indicators: rays by what they ended on, and how."""
    last = np.cumsum(portion.records_per_ray) - 1
    names = [item.name for item in scene.directory.objects] + ["nothing"]
    found = {}
    for number, name in enumerate(names):
        here = portion.object[last] == (number if name != "nothing" else -1)
        found[name] = here.astype(float)
    return found


def color_at_end(portion: Portion, channel: int) -> NDArray[np.float64]:
    codes = portion.color_code[np.cumsum(portion.records_per_ray) - 1]
    n = portion.color_table.shape[1]
    table = np.concatenate((np.eye(n), portion.color_table / 65535.0))
    return table[codes, channel]


def assert_same_light(text: str, mode: str, *, rays: int, emissions: int) -> None:
    """Everything that ends somewhere does so with the same flux and colour, by a z-test each."""
    plain = compiled(text)
    scene = compiled(f'{text}\n[trace]\nmode = "weighted"\n{mode}')
    analog, weighted = traced(plain, rays, weighted=False), traced(scene, emissions)
    assert analog.weight is None
    tests = []
    ended = (endings(analog, plain), endings(weighted, scene))
    for name in ended[0]:
        for channel in range(analog.color_table.shape[1]):
            found = [
                moments(p, e[name] * color_at_end(p, channel))
                for p, e in zip((analog, weighted), ended, strict=True)
            ]
            spread = found[0][1] + found[1][1]
            if spread > 0.0 and min(e[name].sum() for e in ended) > 20:
                tests.append((found[0][0] - found[1][0]) / np.sqrt(spread))
            else:
                assert abs(found[0][0] - found[1][0]) <= 20.0 / min(rays, emissions)
    assert tests
    z = np.array(tests)
    assert np.abs(z).max() < 4.5, z
    assert (z**2).mean() < 1.0 + 4.0 * np.sqrt(2.0 / len(z)) + 1.0, z


PLATES = """
[media.glass]
index = { rgb = [1.5, 1.6, 1.7] }
[media.flint]
index = 1.8
[surfaces.half]
kind = "dielectric"
reflectance = { rgb = [0.3, 0.5, 0.1] }
[surfaces.black]
kind = "lambertian"
reflectance = { rgb = [0.1, 0.2, 0.3] }
[surfaces.opal]
kind = "lambertian"
reflectance = 0.3
transmittance = { rgb = [0.5, 0.3, 0.4] }
[bodies.first]
kind = "box"
size = [9, 9, 1]
position = [0, 0, 3]
medium = "glass"
[bodies.second]
kind = "sphere"
radius = 1.5
position = [0, 0.3, 6]
medium = "flint"
surface = "half"
[bodies.sheet]
kind = "rectangle"
size = [6, 6]
position = [0, 0, 9.5]
axis = [0.2, 0, 1]
surface = "opal"
[bodies.tube]
kind = "cylinder"
radius = 5
length = 14
open = true
surface = "black"
[sources.lamp]
kind = "lambertian"
diameter = 2
cone_deg = 30
[detectors.sensor]
position = [0, 0, 12]
looks = [0, 0, -1]
size = [5, 5]
cells = [1, 1]
blocking = true
"""


@pytest.mark.parametrize("mode", MODES)
def test_interfaces_pass_the_same_light(mode: str) -> None:
    assert_same_light(PLATES, MODES[mode], rays=60_000, emissions=15_000)


SCATTERERS = {
    "lambertian": 'kind = "lambertian"\nreflectance = 0.2\ntransmittance = 0.3',
    "colored sheet": 'kind = "lambertian"\nreflectance = { rgb = [0.3, 0.1, 0.05] }\n'
    "transmittance = { rgb = [0.05, 0.4, 0.6] }",
    "beads": 'kind = "retroreflector"\nreflectance = { rgb = [0.3, 0.6, 0.9] }\nspread_deg = 30',
    "rough glass": 'kind = "rough_dielectric"\nroughness = 0.4',
    "rough metal": 'kind = "rough_mirror"\nroughness = 0.3\nmetal = { n = 0.2, k = 3.4 }',
    "mirror with scatter": 'kind = "mirror"\nreflectance = 0.9\n'
    "scatter = { abg = [0.01, 0.01, 2] }",
    "polish": 'kind = "dielectric"\n'
    "scatter = { harvey_shack = [0.1, 0.1, -1.8], reference_nm = 600 }",
    "measured": """kind = "tabulated"
reflected = { theta_i_deg = [0, 90], theta_o_deg = [0, 45, 90], phi_deg = [0, 180], values = [
[[0.1, 0.1], [0.15, 0.05], [0.0, 0.0]], [[0.1, 0.1], [0.15, 0.05], [0.0, 0.0]]] }
transmitted = { theta_i_deg = [0, 90], theta_o_deg = [0, 90], phi_deg = [0, 180], values = [
[[0.1, 0.1], [0.1, 0.1]], [[0.1, 0.1], [0.1, 0.1]]] }""",
}

ROOM = """
[media.glass]
index = {{ rgb = [1.5, 1.52, 1.55] }}
[surfaces.tested]
{surface}
[surfaces.wall]
kind = "lambertian"
reflectance = 0.5
[bodies.walls]
kind = "box"
size = [6, 6, 6]
surface = "wall"
[bodies.block]
kind = "box"
size = [3, 3, 0.5]
position = [0, 0, 1.5]
medium = "glass"
surface = "tested"
[bodies.ball]
kind = "sphere"
radius = 0.3
position = [2, 2, -2]
surface = "wall"
[sources.lamp]
kind = "point"
position = [-1, 0, -2]
[detectors.eye]
position = [2, -1.5, -2.9]
looks = [0, 0, 1]
size = [0.5, 0.8]
cells = [1, 1]
blocking = true
"""


# What needs tables compiles for a minute
@pytest.mark.parametrize(
    "surface",
    [
        pytest.param(
            name, marks=[] if name in ("lambertian", "colored sheet") else [pytest.mark.slow]
        )
        for name in SCATTERERS
    ],
)
def test_aimed_scatter_brings_the_same_light(surface: str) -> None:
    text = ROOM.format(surface=SCATTERERS[surface])
    mode = 'aim = ["eye", "ball"]\naim_share = 0.4\nmin_reflection = 0.1'
    assert_same_light(text, mode, rays=60_000, emissions=60_000)


FOG = """
[media.fog]
index = 1.0
absorption = {{ rgb = [0.02, 0.05, 0.1] }}
scattering = {{ mean_free_path = 3.0, phase = {{ kind = "{phase}", g = {g} }} }}
[bodies.cloud]
kind = "sphere"
radius = 5
medium = "fog"
[bodies.disc]
kind = "disc"
inner = 0.2
outer = 0.6
position = [0, 4, 3]
axis = [0, 1, 1]
surface = "absorber"
[sources.lamp]
kind = "collimated"
position = [0, 0, -6]
direction = [0, 0, 1]
diameter = 1
"""


@pytest.mark.slow
@pytest.mark.parametrize(("phase", "g"), [("isotropic", 0.0), ("henyey_greenstein", 0.7)])
def test_aiming_in_a_cloud_brings_the_same_light(phase: str, g: float) -> None:
    text = FOG.format(phase=phase, g=g)
    assert_same_light(text, 'aim = ["disc.face"]', rays=60_000, emissions=60_000)


def test_a_white_furnace_stays_white() -> None:
    # All light that enters glass in a white room comes back; whatever the mode, it all leaves
    text = """
[media.glass]
index = 1.5
[surfaces.white]
kind = "lambertian"
reflectance = 0.9
[bodies.room]
kind = "sphere"
radius = 3
surface = "white"
[bodies.ball]
kind = "sphere"
radius = 1
medium = "glass"
[sources.lamp]
kind = "point"
position = [2, 0, 0]
"""
    for mode in (*MODES.values(), 'aim = ["ball"]'):
        scene = compiled(f'{text}\n[trace]\nmode = "weighted"\n{mode}')
        portion = traced(scene, 10_000)
        mean, variance = moments(portion, np.ones(portion.n_rays))
        assert abs(mean - 1.0) < 4.5 * np.sqrt(variance) + 1e-6, mode


def test_splitting_alone_keeps_all_light_of_every_emission() -> None:
    scene = compiled(f'{PLATES}\n[trace]\nmode = "weighted"\nsplit_depth = 3')
    portion = traced(scene, 2_000)
    assert portion.emission is not None
    assert portion.weight is not None
    starts = np.unique(portion.emission, return_index=True)[1]
    assert len(starts) == 2_000
    total = np.add.reduceat(portion.weight.astype(float), starts)
    assert np.allclose(total, 1.0, atol=1e-5)


@pytest.mark.parametrize("color", ["[1, 1, 1]", "[0.1, 0.1, 0.6]", "[0.1, 0.2, 0.3]"])
def test_total_reflection_in_all_channels_does_not_split(color: str) -> None:
    """Whatever the shares of the channels sum up to in floating point."""
    scene = compiled(
        f"""
[media.flint]
glass = "SF11"
absorption = 0
[bodies.block]
kind = "box"
size = [40, 40, 10]
medium = "flint"
surface = "absorber"
faces = {{ z_max = "bare" }}
[sources.lamp]
kind = "collimated"
position = [-10, 0, 0]
direction = [1.5, 0, 1]
diameter = 1
inside = "block"
spectrum = {{ rgb = {color} }}
[trace]
mode = "weighted"
split_depth = 2
"""
    )
    portion = traced(scene, 500)
    assert portion.n_rays == 500
    assert not np.any(portion.event & int(Event.SPECULAR_REFLECTION))
    assert np.count_nonzero(portion.event & int(Event.TIR)) == 500


def test_splitting_does_not_depend_on_blocks_and_portions() -> None:
    scene = compiled(f'{PLATES}\n[trace]\nmode = "weighted"\nsplit_depth = 2')
    whole = Wavefront(scene.arrays, 3, weighted=True).trace(0, 400)
    pieces = [
        Wavefront(scene.arrays, 3, weighted=True).trace(first, n)
        for first, n in ((0, 1), (1, 150), (151, 249))
    ]
    for name in ("ray_ids", "emission", "weight", "position", "event", "medium", "source"):
        joined = np.concatenate([getattr(p, name) for p in pieces])
        assert np.array_equal(joined, getattr(whole, name)), name
    cut = split_portion(replace(whole))
    assert sum(p.n_rays for p in cut) == whole.n_rays
    assert sum(p.emitted.sum() for p in cut) == 400


def test_every_ray_is_whole() -> None:
    scene = compiled(f'{PLATES}\n[trace]\nmode = "weighted"\nsplit_depth = 2')
    portion = traced(scene, 1_000)
    last = np.cumsum(portion.records_per_ray) - 1
    first = last + 1 - portion.records_per_ray
    assert np.all(portion.event[first] & int(Event.EMITTED))
    assert np.count_nonzero(portion.event & int(Event.EMITTED)) == portion.n_rays
    ending = int(
        Event.SURFACE_ABSORPTION | Event.LEFT_SCENE | Event.DEPTH_LIMIT | Event.ROULETTE_KILL
    )
    assert np.all(portion.event[last] & ending)
    # Two rays of an emission differ somewhere: no itinerary is there twice
    assert portion.ray_ids is not None
    assert np.all(np.diff(portion.ray_ids) > 0)


def lens(reflectance: float, mode: str) -> Compilation:
    text = LENS.replace("reflectance = 0.005", f"reflectance = {reflectance}")
    text += f'\n[trace]\nmode = "weighted"\n{mode}'
    return compile_scene(parse_scene(text, variants=("coated",), folder=SAMPLES))


@pytest.mark.parametrize("emissions", [600, pytest.param(30_000, marks=pytest.mark.slow)])
def test_all_pairs_of_a_coated_lens_are_known(tmp_path: Path, emissions: int) -> None:
    result = record(lens(0.002, "split_depth = 2"), tmp_path / "g.raymap", rays=emissions)
    audit = result.audit["beam"]
    ended = sum(audit[name] for name in ("absorbed", "detected", "left", "stopped", "errors"))
    assert ended == pytest.approx(emissions, rel=1e-6)
    with raymap.open(tmp_path / "g.raymap") as found:
        matrix = ghost_matrix(found, "sensor")
    known = matrix.flux_se[matrix.flux > 0.0] / matrix.flux[matrix.flux > 0.0]
    if emissions > 10_000:
        assert len(known) == 45
        assert known.max() < 0.06
    # The strongest ghost reflects twice with 0.2 %: its flux is R² times what stays in the way
    strongest = matrix.flux.max()
    assert 0.8 * 0.002**2 < strongest < 0.002**2


def test_map_answers_as_the_analog_one(tmp_path: Path) -> None:
    plain = compiled(PLATES)
    split = compiled(f'{PLATES}\n[trace]\nmode = "weighted"\nsplit_depth = 1')
    record(plain, tmp_path / "a.raymap", rays=40_000)
    record(split, tmp_path / "w.raymap", rays=8_000, threads=1)
    record(split, tmp_path / "w.raymap", rays=8_000, append=True)
    with raymap.open(tmp_path / "a.raymap") as a, raymap.open(tmp_path / "w.raymap") as w:
        assert w.emitted.sum() == 16_000
        assert np.all(np.diff(np.concatenate([p.ray_ids() for p in w.portions])) > 0)
        for criterion in ('detected("sensor")', 'hit("second", reflected)', 'last(hit("tube"))'):
            one, two = select(a, criterion), select(w, criterion)
            spread = np.hypot(one.flux_se, two.flux_se)
            assert abs(one.flux - two.flux) < 4.5 * spread, criterion
        assert len(path_table(w, 'detected("sensor")')) > 3

"""Polarised recording: weights and states against closed forms and the lens as a primitive."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

import raymap
from raymap.model.errors import MapExists, SceneError
from raymap.model.events import Event
from raymap.model.portion import Portion
from tracer import compile_scene, parse_scene
from tracer.lens import Lens
from tracer.polarized.record import Polarization, PolarizedWavefront, record_polarized
from tracer.run.results import UnevenWeights
from tracer.scene.load import load_scene
from tracer.studies.lenses.lens_beams import parallel_beam
from tracer.studies.lenses.levels import level_shares

HEAD = """
length_unit = "mm"
[spectrum]
kind = "spectral"
wavelengths_nm = [587.5618]
[surfaces.clear]
kind = "dielectric"
[surfaces.metal]
kind = "mirror"
reflectance = 1.0
[surfaces.white]
kind = "lambertian"
reflectance = 1.0
[media.glass]
index = 1.5
[media.fog]
index = 1.0
scattering = { mean_free_path = 3.0, phase = { kind = "rayleigh" } }
"""


def traced(text: str, n: int = 20_000, **options: object) -> Portion:
    compilation = compile_scene(parse_scene(HEAD + text))
    return PolarizedWavefront(compilation, 1, Polarization(**options)).trace(0, n)  # type: ignore[arg-type]


def ends(portion: Portion) -> tuple[np.ndarray, np.ndarray]:
    """First and last record of every ray."""
    last = np.cumsum(portion.records_per_ray) - 1
    return last - portion.records_per_ray + 1, last


def beam(direction: str, position: str, extra: str = "") -> str:
    return f"""
[sources.lamp]
kind = "collimated"
position = {position}
direction = {direction}
diameter = 1.0
{extra}
"""


BLOCK = """
[bodies.block]
kind = "box"
medium = "glass"
size = [200.0, 200.0, 100.0]
position = [0.0, 0.0, 50.0]
surface = "clear"
"""


@pytest.mark.parametrize("states", ["linear", "natural"])
def test_light_reflected_at_the_brewster_angle_is_linear(states: str) -> None:
    theta = math.atan(1.5)
    d = f"[{math.sin(theta)}, 0.0, {math.cos(theta)}]"
    start = f"[{-20 * math.sin(theta)}, 0.0, {-20 * math.cos(theta)}]"
    portion = traced(BLOCK + beam(d, start), 100_000, states=states)
    first, _ = ends(portion)
    reflected = portion.event[first + 1] & int(Event.SPECULAR_REFLECTION) != 0
    assert portion.weight is not None
    weight = portion.weight.astype(float)
    n = len(weight)
    # Unbiased: the unpolarised reflectance, within four standard errors
    share = weight[reflected].sum() / n
    error = math.sqrt((weight[reflected] ** 2).sum()) / n
    assert abs(share - 0.073964497) < 4.0 * error
    stokes = portion.extra["stokes"][first[reflected] + 1].astype(float)
    if states == "natural":
        np.testing.assert_allclose(np.linalg.norm(stokes, axis=1), 1.0, atol=1e-6)
    lit = weight[reflected] > 1e-12
    # s light vibrates along y: across the axis x of the ray
    np.testing.assert_allclose(stokes[lit], [[-1.0, 0.0, 0.0]] * int(lit.sum()), atol=1e-5)
    # The refracted rest is partly polarised, and knows it where natural light is carried
    inside = first[~reflected] + 1
    if states == "natural":
        r_s = 0.384615385**2
        degree = r_s / (2.0 - r_s)
        np.testing.assert_allclose(portion.extra["stokes"][inside, 0], degree, atol=1e-6)


def test_two_mirrors_of_glass_at_the_brewster_angle_crossed() -> None:
    """Reflect twice, the second time in the plane across: all light is gone."""
    theta = math.atan(1.5)
    turn = math.pi - 2.0 * theta
    second = np.array([math.sin(theta), 0.0, -math.cos(theta)])
    # A block whose face is met by the reflected ray with a plane of incidence through y
    normal = -math.cos(theta) * second + math.sin(theta) * np.array([0.0, 1.0, 0.0])
    center = 20.0 * second - 5.0 * normal
    text = (
        BLOCK
        + f"""
[bodies.second]
kind = "cylinder"
medium = "glass"
radius = 15.0
length = 5.0
position = {center.tolist()}
axis = {normal.tolist()}
surface = "clear"
"""
        + beam(
            f"[{math.sin(theta)}, 0.0, {math.cos(theta)}]",
            f"[{-20 * math.sin(theta)}, 0.0, {-20 * math.cos(theta)}]",
        )
    )
    portion = traced(text, 40_000, states="natural")
    assert turn > 0.0
    first, _ = ends(portion)
    bits = int(Event.SPECULAR_REFLECTION)
    long = portion.records_per_ray > 3
    both = np.zeros(len(first), np.bool_)
    both[long] = (
        (portion.event[first[long] + 1] & bits != 0)
        & (portion.event[first[long] + 2] & bits != 0)
        & (portion.object[first[long] + 2] == 1)
    )
    assert both.sum() > 50
    assert portion.weight is not None
    assert portion.weight[both].max() < 1e-9


def test_total_reflection_makes_elliptical_light() -> None:
    theta = math.radians(50.0)
    text = """
[bodies.prism]
kind = "box"
medium = "glass"
size = [400.0, 400.0, 100.0]
position = [0.0, 0.0, -50.0]
surface = "clear"
""" + beam(
        f"[{math.sin(theta)}, 0.0, {math.cos(theta)}]",
        f"[{-20 * math.sin(theta)}, 0.0, {-20 * math.cos(theta)}]",
        'inside = "prism"',
    )
    # The source vibrates at 45° to the plane of incidence
    p = np.array([math.cos(theta), 0.0, -math.sin(theta)])
    vibration = tuple(p + np.array([0.0, 1.0, 0.0]))
    portion = traced(text, 100, sources={"lamp": vibration})
    first, _ = ends(portion)
    assert np.all(portion.event[first + 1] & int(Event.TIR) != 0)
    s1, s2, s3 = portion.extra["stokes"][first[0] + 1].astype(float)
    # Phase between p and s: -44.912302°; equal powers give s1 = 0, |s3| = sin, |s2| = cos of it
    assert s1 == pytest.approx(0.0, abs=1e-6)
    assert abs(s3) == pytest.approx(math.sin(math.radians(44.912302)), abs=1e-6)
    assert abs(s2) == pytest.approx(math.cos(math.radians(44.912302)), abs=1e-6)
    assert portion.weight is not None
    np.testing.assert_allclose(portion.weight[portion.records_per_ray == 2], 1.0)


SHEETS = """
[surfaces.upright]
kind = "polariser"
absorbs = [0.0, 1.0, 0.0]
[surfaces.turned]
kind = "polariser"
absorbs = [AXIS]
[bodies.first]
kind = "rectangle"
size = [10.0, 10.0]
position = [0.0, 0.0, 1.0]
surface = "upright"
[bodies.second]
kind = "rectangle"
size = [10.0, 10.0]
position = [0.0, 0.0, 2.0]
surface = "turned"
[detectors.eye]
position = [0.0, 0.0, 3.0]
looks = [0.0, 0.0, -1.0]
size = [10.0, 10.0]
cells = [2, 2]
""" + beam("[0.0, 0.0, 1.0]", "[0.0, 0.0, 0.0]")


def sheets(degrees: float) -> str:
    """Two polarisers, the second turned by an angle."""
    angle = math.radians(degrees)
    return SHEETS.replace("AXIS", f"{-math.sin(angle)}, {math.cos(angle)}, 0.0")


@pytest.mark.parametrize("degrees", [0.0, 30.0, 90.0])
def test_malus_in_a_recorded_scene(degrees: float) -> None:
    angle = math.radians(degrees)
    n = 40_000
    portion = traced(sheets(degrees), n)
    assert portion.weight is not None
    weight = portion.weight.astype(float)
    _, last = ends(portion)
    through = portion.event[last] & int(Event.LEFT_SCENE) != 0
    # A quarter of the rays gets through, as natural light would at each sheet
    assert through.mean() == pytest.approx(0.25, abs=4.0 * math.sqrt(0.25 / n))
    share, error = weight[through].sum() / n, math.sqrt((weight[through] ** 2).sum()) / n
    assert abs(share - 0.5 * math.cos(angle) ** 2) < 4.0 * error + 1e-9
    whole = math.sqrt((weight**2).sum()) / n
    assert weight.sum() / n == pytest.approx(1.0, abs=4.0 * whole)
    ended = portion.event[last[~through]]
    assert np.all(ended & int(Event.SURFACE_ABSORPTION) != 0)
    crossed = portion.event[last[through] - 1]
    assert np.all(crossed & int(Event.POLARISER) != 0)
    assert len(portion.descriptors.detector) == through.sum()
    if degrees == 30.0:
        stokes = portion.extra["stokes"][last[through] - 1]
        np.testing.assert_allclose(
            stokes, [[math.cos(2 * angle), math.sin(2 * angle), 0.0]] * len(stokes), atol=1e-5
        )


STRAINED = """
[surfaces.first]
kind = "polariser"
absorbs = [0, 1, 0]
[surfaces.half_wave]
kind = "retarder"
slow = [1, 1, 0]
retardance_nm = 275
[surfaces.second]
kind = "polariser"
absorbs = [1, 0, 0]
[bodies.first]
kind = "disc"
outer = 9
position = [0, 0, 1]
surface = "first"
[bodies.spot]
kind = "disc"
outer = 0.2
position = [0, 0, 2]
surface = "half_wave"
[bodies.second]
kind = "disc"
outer = 9
position = [0, 0, 3]
surface = "second"
[spectrum]
kind = "spectral"
wavelengths_nm = [550]
[sources.lamp]
kind = "collimated"
direction = [0, 0, 1]
diameter = 2
flux = 5
[detectors.between]
position = [0, 0, 1.5]
looks = [0, 0, -1]
size = [9, 9]
cells = [1, 1]
[detectors.behind]
position = [0, 0, 4]
looks = [0, 0, -1]
size = [9, 9]
cells = [1, 1]
"""


@pytest.mark.parametrize("states", ["linear", "natural"])
def test_effective_rays_are_those_that_carry_the_light(
    states: Literal["linear", "natural"],
) -> None:
    """Crossed polarisers with a half-wave spot: 4 % of the rays that arrive carry all light.

    Weights behind one polariser are 2, or 2 · 2 cos² of a random azimuth: (Σw)² / Σw² is all or 2/3
    of the rays. Between the two each ray counts by its weight in the end: half have none.
    """
    n = 40_000
    scene = parse_scene('length_unit = "mm"\n' + STRAINED)
    with pytest.warns(UnevenWeights, match=r"detectors\.behind: .* trace more rays"):
        result = record_polarized(
            scene, None, rays=n, threads=1, polarization=Polarization(states=states)
        )
    between, behind = (result.fluxes["detectors"][name] for name in ("between", "behind"))
    even = 1.0 if states == "natural" else 2.0 / 3.0
    assert between["rays"] == pytest.approx(n / 2, abs=4.5 * math.sqrt(n / 4))
    assert between["effective_rays"] == pytest.approx(0.5 * even * between["rays"], rel=0.04)
    assert behind["flux"] == pytest.approx(0.5 * 5 * 0.04, abs=4.5 * behind["flux_se"])
    assert behind["rays"] == pytest.approx(n / 4, abs=4.5 * math.sqrt(n / 4))
    assert behind["effective_rays"] == pytest.approx(even * 0.04 * behind["rays"], rel=0.25)
    # The error that is printed is that of so many equal rays
    assert behind["flux_se"] / behind["flux"] == pytest.approx(
        behind["effective_rays"] ** -0.5, rel=0.02
    )
    assert result.warnings
    assert "detectors.between" not in " ".join(result.warnings)


def test_rayleigh_scattering_polarises() -> None:
    """Degree of polarisation after one scattering of natural light: sin² / (1 + cos²)."""
    text = """
[bodies.cloud]
kind = "sphere"
medium = "fog"
radius = 1.0
surface = "clear"
""" + beam("[0.0, 0.0, 1.0]", "[0.0, 0.0, -5.0]")
    portion = traced(text, 20_000, states="natural")
    first, _ = ends(portion)
    once = portion.event[first + 2] & int(Event.VOLUME_SCATTER) != 0
    k = first[once] + 2
    position = portion.position.astype(float)
    d = position[k + 1] - position[k]
    mu = d[:, 2] / np.linalg.norm(d, axis=1)
    degree = np.linalg.norm(portion.extra["stokes"][k], axis=1)
    np.testing.assert_allclose(degree, (1.0 - mu**2) / (1.0 + mu**2), atol=1e-3)
    assert portion.weight is not None
    single = once & (portion.records_per_ray == 5)
    np.testing.assert_allclose(portion.weight[single], 1.0, atol=1e-5)


def test_diffuse_light_forgets_its_state() -> None:
    text = """
[bodies.screen]
kind = "rectangle"
size = [50.0, 50.0]
position = [0.0, 0.0, 1.0]
surface = "white"
""" + beam("[0.0, 0.0, 1.0]", "[0.0, 0.0, 0.0]")
    portion = traced(text, 4000, sources={"lamp": (1.0, 0.0, 0.0)})
    first, _ = ends(portion)
    np.testing.assert_allclose(portion.extra["stokes"][first, 0], 1.0, atol=1e-6)
    after = portion.extra["stokes"][first + 1].astype(float)
    np.testing.assert_allclose(np.linalg.norm(after, axis=1), 1.0, atol=1e-5)
    assert np.abs(after.mean(axis=0)).max() < 0.06


LENS = """
[bodies.L]
kind = "lens"
medium = "glass"
position = [0.0, 0.0, 0.0]
thickness = 6.0
surface = "clear"
rim = "black"
front = { radius = 50.0, semi_diameter = 12.5 }
back = { radius = -50.0, semi_diameter = 12.5 }
[surfaces.black]
kind = "absorber"
[sources.lamp]
kind = "collimated"
position = [0.0, 0.0, -20.0]
direction = [0.0, 0.0, 1.0]
diameter = 24.0
"""


@pytest.mark.parametrize("states", ["linear", "natural"])
def test_a_lens_of_ordinary_faces_has_the_fluxes_of_the_primitive(states: str) -> None:
    n = 200_000
    portion = traced(LENS, n, states=states)
    lens = Lens(
        radius_front=50.0, radius_back=-50.0, thickness=6.0, semi_aperture_front=12.5, glass=1.5
    )
    beam_rays = parallel_beam(lens, 50_000, wavelength_nm=587.5618)
    inner = np.hypot(beam_rays.origin[:, 0], beam_rays.origin[:, 1]) < 12.0
    shares = level_shares(lens, beam_rays.where(inner), depth=8).share
    first, last = ends(portion)
    # Rays that left after k hits, all of them with the lens
    hits = portion.records_per_ray - 2
    left = portion.event[last] & int(Event.LEFT_SCENE) != 0
    assert portion.weight is not None
    weight = portion.weight.astype(float)
    for level in (1, 2, 3, 4):
        at = left & (hits == level)
        found = weight[at].sum() / n
        error = math.sqrt((weight[at] ** 2).sum()) / n
        assert abs(found - shares[level - 1]) < 4.5 * error + 1e-4
    assert weight.mean() == pytest.approx(1.0, abs=0.01)
    assert first[0] == 0


def test_optical_paths_and_phases() -> None:
    portion = traced(LENS, 2000, phases=True)
    path = portion.extra["optical_path"]
    assert path.dtype == np.float64
    assert portion.extra["phase"].dtype == np.float32
    first, _ = ends(portion)
    np.testing.assert_array_equal(path[first], 0.0)
    position = portion.position.astype(float)
    step = np.linalg.norm(np.diff(position, axis=0), axis=1)
    for ray in range(50):
        a, n = first[ray], portion.records_per_ray[ray]
        index = np.where(portion.medium[a : a + n - 1] == portion.medium[a], 1.0, 1.5)
        expected = np.concatenate([[0.0], np.cumsum(index * step[a : a + n - 1])])
        np.testing.assert_allclose(path[a : a + n], expected, atol=1e-3)


def test_a_map_of_polarised_light(tmp_path: Path) -> None:
    scene = parse_scene(HEAD + sheets(0.0))
    path = tmp_path / "polarised.raymap"
    options = Polarization(phases=True)
    result = record_polarized(
        scene, path, polarization=options, rays=3000, portion_rays=700, threads=2
    )
    again = record_polarized(scene, None, polarization=options, rays=3000, threads=1)
    assert result.audit == again.audit
    assert result.audit["lamp"]["emitted"] == 3000
    with raymap.open(path) as ray_map:
        assert ray_map.rays == 3000
        portions = [p.read() for p in ray_map.portions]
        names = ray_map.portions[0].column_names
        assert {"stokes", "optical_path", "phase"} <= set(names)
        assert sum(p.n_rays for p in portions) == 3000
        stokes = np.concatenate([p.extra["stokes"] for p in portions])
        assert stokes.shape[1] == 3
        sums, _ = ray_map.detector_result("eye")  # type: ignore[misc]
        assert sums.sum() == pytest.approx(1500.0, abs=150.0)
    with pytest.raises(MapExists):
        record_polarized(scene, path, rays=10)
    more = record_polarized(scene, path, polarization=options, rays=1000, append=True)
    assert more.rays == 1000
    with raymap.open(path) as ray_map:
        assert ray_map.rays == 4000


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"sources": {"sun": (1.0, 0.0, 0.0)}}, "sun"),
        ({"sources": {"lamp": (0.0, 0.0, 0.0)}}, "sources.lamp"),
        ({"states": "circular"}, "states"),
    ],
)
def test_bad_options_are_refused_by_name(options: dict[str, object], named: str) -> None:
    with pytest.raises(SceneError, match=named):
        traced(sheets(0.0), 10, **options)


def test_bad_sheets_are_refused_by_name() -> None:
    with pytest.raises(SceneError, match=r"surfaces\.upright\.absorbs: an axis"):
        traced(sheets(0.0).replace("absorbs = [0.0, 1.0, 0.0]", "absorbs = [0, 0, 0]"), 10)
    with pytest.raises(SceneError, match="extinction"):
        traced(sheets(0.0).replace('"polariser"', '"polariser"\nextinction = 2'), 10)
    with pytest.raises(SceneError, match="polarisers are surfaces now"):
        parse_scene(
            HEAD + sheets(0.0) + "[trace]\nlight = 'polarised'\n"
            "polarisers = {'first.face' = [0, 1, 0]}\n"
        )


def test_meshes_polarise_like_other_bodies(tmp_path: Path) -> None:
    import trimesh

    # Brewster's angle at a tilted glass block: reflected light is linear across the plane
    trimesh.creation.box((20.0, 20.0, 6.0)).export(tmp_path / "block.stl")
    tilt = math.degrees(math.atan(1.5))
    axis = [math.sin(math.radians(tilt)), 0.0, -math.cos(math.radians(tilt))]
    lamp = beam("[0, 0, 1]", "[0, 0, -20]")
    place = f"position = [0, 0, 0]\naxis = {axis}\nmedium = 'glass'\nsurface = 'clear'\n"
    results = []
    for body in (
        "[bodies.block]\nkind = 'mesh'\nfile = 'block.stl'\nscale = 1.0\n",
        "[bodies.block]\nkind = 'box'\nsize = [20, 20, 6]\n",
    ):
        (tmp_path / "scene.toml").write_text(HEAD + lamp + body + place)
        engine = PolarizedWavefront(
            compile_scene(load_scene(tmp_path / "scene.toml")), 1, Polarization(states="natural")
        )
        portion = engine.trace(0, 20_000)
        start, end = ends(portion)
        direct = (portion.records_per_ray == 3) & (
            portion.event[start + 1] & int(Event.SPECULAR_REFLECTION) != 0
        )
        assert direct.sum() > 1_000
        state = portion.extra["stokes"][start[direct] + 1]
        np.testing.assert_allclose(np.linalg.norm(state, axis=1), 1.0, atol=1e-6)
        results.append((portion.weight[direct].sum(), portion.weight.sum()))
        through = (portion.records_per_ray == 4) & ~direct
        results[-1] += (portion.weight[through].sum(),)
        results[-1] += (float(portion.extra["stokes"][end[through] - 1, 0].mean()),)
    mesh, box = results
    # Fresnel: half of 1 - (2 n / (1 + n²))² comes back
    for reflected, *_ in results:
        assert reflected / 20_000 == pytest.approx(0.5 * (1 - (3 / 3.25) ** 2), abs=4e-3)
    np.testing.assert_allclose(mesh, box, rtol=0.05)
    assert mesh[3] == pytest.approx(box[3], abs=1e-4)


def test_a_source_may_be_polarised_in_the_scene() -> None:
    lamp = beam("[0, 0, 1]", "[0, 0, -20]", "polarisation = [1, 1, 0]")
    portion = traced(lamp, 50)
    np.testing.assert_allclose(portion.extra["stokes"][0], [0.0, 1.0, 0.0], atol=1e-6)
    # What the call says goes before what the scene says
    portion = traced(lamp, 50, sources={"lamp": (1.0, 0.0, 0.0)})
    np.testing.assert_allclose(portion.extra["stokes"][0], [1.0, 0.0, 0.0], atol=1e-6)


TOUCHING = """
[bodies.lower]
kind = "box"
medium = "glass"
size = [4.0, 4.0, 1.0]
position = [0.0, 0.0, -0.5]
surface = "clear"
[bodies.upper]
kind = "box"
medium = "glass"
size = [2.0, 2.0, 1.0]
position = [0.3, 0.2, 0.5]
surface = "clear"
[sources.lamp]
kind = "lambertian"
position = [0.0, 0.0, -2.0]
diameter = 4.0
"""


def test_no_light_is_lost_where_solids_touch() -> None:
    portion = traced(TOUCHING, 40_000, states="natural")
    weight = portion.weight.astype(float)
    spread = weight.std() / math.sqrt(len(weight))
    assert abs(weight.mean() - 1.0) < 4.5 * spread + 1e-9, (weight.mean(), spread)

"""Polarised light at coatings, metals, sheets, rough and scattering surfaces: recorded fluxes and
states against tmm, pyElli and closed forms; weighted and split light against analog light."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest

from raymap.model.events import Event
from raymap.model.portion import Portion
from tracer import compile_scene, parse_scene
from tracer.polarized.record import Polarization, PolarizedWavefront, UnpolarisedSurface

HEAD = """
length_unit = "mm"
[media.glass]
index = 1.52
[media.dense]
index = 1.7
[surfaces.black]
kind = "absorber"
[surfaces.clear]
kind = "dielectric"
"""
BACK = int(Event.SPECULAR_REFLECTION | Event.TIR | Event.GLOSSY_REFLECTION)
THROUGH = int(Event.SPECULAR_REFRACTION | Event.GLOSSY_TRANSMISSION)
ABSORBED = int(Event.SURFACE_ABSORPTION)


def traced(text: str, n: int, **options: object) -> Portion:
    compilation = compile_scene(parse_scene(HEAD + text))
    return PolarizedWavefront(compilation, 1, Polarization(**options)).trace(0, n)  # type: ignore[arg-type]


def lamp(angle_deg: float, vibration: str, wavelengths: str = "550") -> str:
    """A thin beam that meets the plane z = 0 at the origin; s is y, p lies in the xz plane."""
    angle = math.radians(angle_deg)
    sine, cosine = math.sin(angle), math.cos(angle)
    p, y = (cosine, 0.0, -sine), (0.0, 1.0, 0.0)
    both = tuple(a + b for a, b in zip(p, y, strict=True))
    axis = {"s": y, "p": p, "both": both}[vibration]
    return f"""
[spectrum]
kind = "spectral"
wavelengths_nm = [{wavelengths}]
[sources.lamp]
kind = "collimated"
diameter = 0.01
aim = [0, 0, 0]
distance = 5
direction = [{sine}, 0, {cosine}]
polarisation = {list(axis)}
"""


def half_space(surface: str, medium: str = "glass") -> str:
    return f"""
[bodies.block]
kind = "box"
size = [400, 400, 100]
position = [0, 0, 50]
medium = "{medium}"
surface = "black"
faces = {{ z_min = "{surface}" }}
"""


def first_hit(portion: Portion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Second record of every ray, its events, and the weights."""
    first = np.cumsum(portion.records_per_ray) - portion.records_per_ray
    assert portion.weight is not None
    return first + 1, portion.event[first + 1], portion.weight.astype(float)


def shares(portion: Portion, *events: int) -> list[tuple[float, float]]:
    """Flux of the rays whose first hit has one of the events, with its standard error."""
    _, met, weight = first_hit(portion)
    found = []
    for bits in events:
        one = np.where(met & bits != 0, weight, 0.0)
        found.append((float(one.mean()), float(one.std() / math.sqrt(len(one)))))
    return found


STACK = """
[surfaces.stack]
kind = "dielectric"
[surfaces.stack.coating]
between = ["air", "glass"]
layers = [{ index = 2.3, thickness_nm = 70 }, { index = 0.9, extinction = 2.1, thickness_nm = 12 },
    { index = 1.38, thickness_nm = 150 }]
"""
LAYERS = [(2.3, 70.0), (0.9 + 2.1j, 12.0), (1.38, 150.0)]
WORST = 4.5
"""Standard errors that the worst of a hundred tests may be off."""
ANGLES = (0.0, 20.0, 40.0, 55.0, 65.0, 75.0)


@pytest.mark.parametrize("nm", [450.0, 550.0, 650.0])
def test_a_stack_has_the_amplitudes_of_tmm(nm: float) -> None:
    tmm = pytest.importorskip("tmm")
    n = 4000
    for angle in ANGLES:
        theta = math.radians(angle)
        peer = {
            part: tmm.coh_tmm(
                part,
                [1.0, *(a for a, _ in LAYERS), 1.52],
                [math.inf, *(b for _, b in LAYERS), math.inf],
                theta,
                nm,
            )
            for part in "sp"
        }
        for part in "sp":
            portion = traced(STACK + half_space("stack") + lamp(angle, part, f"{nm}"), n)
            expected = peer[part]["R"], peer[part]["T"], 1.0 - peer[part]["R"] - peer[part]["T"]
            found = shares(portion, BACK, THROUGH, ABSORBED)
            for (share, error), right in zip(found, expected, strict=True):
                assert abs(share - right) < WORST * error + 1e-6, (angle, part)
        # The state of what is reflected
        if angle > 0.0:
            portion = traced(STACK + half_space("stack") + lamp(angle, "both", f"{nm}"), 200)
            at, met, _ = first_hit(portion)
            stokes = portion.extra["stokes"][at[met & BACK != 0]].astype(float)
            r_s, r_p = peer["s"]["r"], peer["p"]["r"]
            np.testing.assert_allclose(
                stokes, [reflected_stokes(theta, r_s, r_p)] * len(stokes), atol=2e-6
            )


def reflected_stokes(theta: float, r_s: complex, r_p: complex) -> list[float]:
    """Of light that vibrates along p + s before, about the axes of stored states.

    d = (sin, 0, cos), n = (0, 0, -1): s = d x n = (0, sin, 0) / sin, p = d x s = (-cos, 0, sin).
    """
    e_s, e_p = 1.0 * r_s, -1.0 * r_p
    o = np.array([math.sin(theta), 0.0, -math.cos(theta)])
    s = np.array([0.0, 1.0, 0.0])
    field = e_s * s + e_p * np.cross(o, s)
    x = np.array([1.0, 0.0, 0.0]) - o[0] * o
    x /= np.linalg.norm(x)
    a, b = field @ x, field @ np.cross(o, x)
    power = abs(a) ** 2 + abs(b) ** 2
    turned = a * b.conjugate()
    return [
        (abs(a) ** 2 - abs(b) ** 2) / power,
        2.0 * turned.real / power,
        2.0 * turned.imag / power,
    ]


def test_a_stack_of_a_crystal_package() -> None:
    """The same numbers from pyElli's 4x4 matrices, at one angle."""
    elli = pytest.importorskip("elli")
    air, glass = (elli.IsotropicMaterial(elli.ConstantRefractiveIndex(n)) for n in (1.0, 1.52))
    film = elli.IsotropicMaterial(elli.ConstantRefractiveIndex(2.3))
    structure = elli.Structure(air, [elli.Layer(film, 70.0)], glass)
    data = structure.evaluate(np.array([550.0]), 60.0)
    text = STACK.replace(
        "{ index = 2.3, thickness_nm = 70 }, { index = 0.9, extinction = 2.1, thickness_nm = 12 },"
        "\n    { index = 1.38, thickness_nm = 150 }",
        "{ index = 2.3, thickness_nm = 70 }",
    )
    assert "1.38" not in text
    for part, right in (("s", float(data.R_ss[0])), ("p", float(data.R_pp[0]))):
        [(share, error)] = shares(
            traced(text + half_space("stack") + lamp(60.0, part), 20_000), BACK
        )
        assert abs(share - right) < 4.0 * error


METAL = """
[surfaces.metal]
kind = "mirror"
metal = { n = 2.9, k = 3.1 }
[bodies.plate]
kind = "rectangle"
size = [100, 100]
surface = "metal"
"""


@pytest.mark.parametrize(("part", "right"), [("s", 0.851), ("p", 0.177)])
def test_a_metal_at_75_degrees(part: str, right: float) -> None:
    found = shares(traced(METAL + lamp(75.0, part), 40_000), BACK, ABSORBED)
    assert abs(found[0][0] - right) < 4.0 * found[0][1] + 5e-4
    assert abs(found[1][0] - (1.0 - right)) < 4.0 * found[1][1] + 5e-4


def test_a_metal_makes_elliptical_light() -> None:
    theta = math.radians(70.0)
    portion = traced(METAL + lamp(70.0, "both"), 500)
    at, met, _ = first_hit(portion)
    stokes = portion.extra["stokes"][at[met & BACK != 0]].astype(float)
    # Fresnel with n + i k, from the equations
    m, c = 2.9 + 3.1j, math.cos(theta)
    root = cmath.sqrt(1.0 - (math.sin(theta) / m) ** 2)
    r_s, r_p = (c - m * root) / (c + m * root), (m * c - root) / (m * c + root)
    np.testing.assert_allclose(stokes, [reflected_stokes(theta, r_s, r_p)] * len(stokes), atol=2e-6)
    assert abs(stokes[0, 2]) > 0.5


def test_a_macneille_cube_splits_s_from_p() -> None:
    """Quarter-wave pairs between prisms: at 45 degrees p goes through, s comes back.

    The prisms have the index for which light meets H and L at Brewster's angle (MacNeille 1946).
    """
    high, low = 2.35, 1.38
    glass = math.sqrt(2.0) * high * low / math.hypot(high, low)
    sine = glass * math.sin(math.radians(45.0))
    quarter = {n: 550.0 / (4.0 * math.sqrt(n * n - sine * sine)) for n in (high, low)}
    layers = ", ".join(f"{{ index = {n}, thickness_nm = {quarter[n]} }}" for n in [high, low] * 8)
    text = f"""
[media.prism]
index = {glass}
[media.other]
index = {glass}
[surfaces.cube]
kind = "dielectric"
coating = {{ between = ["prism", "other"], layers = [{layers}] }}
[bodies.before]
kind = "box"
size = [400, 400, 100]
position = [0, 0, -50]
medium = "prism"
surface = "black"
faces = {{ z_max = "cube" }}
[bodies.after]
kind = "box"
size = [400, 400, 100]
position = [0, 0, 50]
medium = "other"
surface = "black"
faces = {{ z_min = "cube" }}
"""
    found = {}
    for part in "sp":
        light = lamp(45.0, part).replace("[sources.lamp]", '[sources.lamp]\ninside = "before"')
        found[part] = shares(traced(text + light, 20_000), BACK, THROUGH)
    assert found["s"][0][0] == pytest.approx(1.0, abs=1e-3 + 4.0 * found["s"][0][1])
    assert found["p"][1][0] > 0.98 - 4.0 * found["p"][1][1]


def test_a_fresnel_rhomb_makes_circular_light() -> None:
    """Two total reflections at 54.62 degrees in n = 1.51 delay s and p by 45 degrees each."""
    angle = 54.6224
    text = """
[media.crown]
index = 1.51
[bodies.rhomb]
kind = "box"
size = [400, 40, 10]
medium = "crown"
surface = "clear"
""" + lamp(angle, "both").replace("[sources.lamp]", '[sources.lamp]\ninside = "rhomb"').replace(
        "distance = 5", "distance = 1"
    )
    portion = traced(text, 50)
    at, met, _ = first_hit(portion)
    assert np.all(met & int(Event.TIR) != 0)
    assert np.all(portion.event[at + 1] & int(Event.TIR) != 0)
    after_one, after_two = portion.extra["stokes"][at], portion.extra["stokes"][at + 1]
    np.testing.assert_allclose(np.abs(after_one[:, 2]), math.sqrt(0.5), atol=2e-4)
    np.testing.assert_allclose(np.abs(after_two[:, 2]), 1.0, atol=2e-4)


def test_a_pile_of_plates_polarises() -> None:
    """m plates at Brewster's angle, seen through: T_s from Stokes' sum of all reflections.

    A pile of m faces-pairs passes s with 1 / (1 + 2 m q), q = R_s / (1 - R_s) per face, p whole.
    """
    m, n = 4, 1.5
    theta = math.atan(n)
    plates = "".join(
        f"""
[bodies.plate{k}]
kind = "box"
size = [4000, 4000, 1]
position = [0, 0, {1.0 + 2.0 * k}]
medium = "crown"
surface = "clear"
"""
        for k in range(m)
    )
    text = f"[media.crown]\nindex = {n}\n" + plates + "[limits]\ndepth = 400\n"
    r_s = math.sin(theta - math.asin(math.sin(theta) / n)) ** 2
    right = {"s": 1.0 / (1.0 + 2.0 * m * r_s / (1.0 - r_s)), "p": 1.0}
    for part in "sp":
        portion = traced(text + lamp(math.degrees(theta), part), 60_000)
        last = np.cumsum(portion.records_per_ray) - 1
        assert portion.weight is not None
        up = portion.position[last, 2] > portion.position[last - 1, 2]
        weight = np.where(up, portion.weight.astype(float), 0.0)
        error = weight.std() / math.sqrt(len(weight))
        assert abs(weight.mean() - right[part]) < 4.5 * error, part


def test_measured_shares_of_s_and_p() -> None:
    text = """
[surfaces.splitter]
kind = "dielectric"
[surfaces.splitter.coating]
wavelength_nm = [400, 700]
angle_deg = [0, 30, 90]
reflectance_s = [[0.5, 0.7, 0.9], [0.5, 0.7, 0.9]]
reflectance_p = [[0.5, 0.2, 0.9], [0.5, 0.2, 0.9]]
transmittance_s = [[0.4, 0.2, 0.05], [0.4, 0.2, 0.05]]
transmittance_p = [[0.4, 0.6, 0.05], [0.4, 0.6, 0.05]]
"""
    for part, right in (("s", (0.7, 0.2, 0.1)), ("p", (0.2, 0.6, 0.2))):
        portion = traced(text + half_space("splitter") + lamp(30.0, part), 40_000)
        for (share, error), value in zip(
            shares(portion, BACK, THROUGH, ABSORBED), right, strict=True
        ):
            assert abs(share - value) < 4.0 * error + 2e-3, part


def test_tables_of_natural_light_are_warned_of() -> None:
    from tracer.polarized.record import polarized_trace

    text = """
[surfaces.splitter]
kind = "dielectric"
[surfaces.splitter.coating]
wavelength_nm = [400, 700]
angle_deg = [0, 90]
reflectance = [[0.5, 0.5], [0.5, 0.5]]
transmittance = [[0.4, 0.4], [0.4, 0.4]]
[trace]
light = "polarised"
"""
    trace = polarized_trace(parse_scene(HEAD + text + half_space("splitter") + lamp(30.0, "s")))
    with pytest.warns(UnpolarisedSurface, match=r"splitter\.coating.*reflectance_s"):
        trace.prepared(None, 1)


def sheet(kind: str, keys: str, z: float, name: str) -> str:
    return f"""
[surfaces.{name}]
kind = "{kind}"
{keys}
[bodies.{name}]
kind = "rectangle"
size = [10, 10]
position = [0, 0, {z}]
surface = "{name}"
"""


@pytest.mark.parametrize("retardance", [0.0, 100.0, 137.5, 275.0])
def test_a_retarder_between_crossed_polarisers(retardance: float) -> None:
    """I = ½ sin²(2 φ) sin²(δ / 2) of natural light (Born & Wolf, 15.4, eq. 9)."""
    text = (
        sheet("polariser", "absorbs = [0, 1, 0]", 1.0, "first")
        + sheet("retarder", f"slow = [1, 0.4, 0]\nretardance_nm = {retardance}", 2.0, "wave")
        + sheet("polariser", "absorbs = [1, 0, 0]", 3.0, "second")
        + lamp(0.0, "s").partition("polarisation")[0]
    )
    n = 40_000
    portion = traced(text, n, states="natural")
    last = np.cumsum(portion.records_per_ray) - 1
    assert portion.weight is not None
    out = portion.event[last] & int(Event.LEFT_SCENE) != 0
    weight = np.where(out, portion.weight.astype(float), 0.0)
    phi, delta = math.atan(0.4), 2.0 * math.pi * retardance / 550.0
    right = 0.5 * math.sin(2.0 * phi) ** 2 * math.sin(0.5 * delta) ** 2
    assert abs(weight.mean() - right) < 4.0 * weight.std() / math.sqrt(n) + 1e-9


def test_a_quarter_wave_plate_makes_circular_light() -> None:
    text = sheet("retarder", "slow = [1, 1, 0]\nretardance_nm = 137.5", 1.0, "wave")
    portion = traced(text + lamp(0.0, "s"), 20)
    at, _, weight = first_hit(portion)
    np.testing.assert_allclose(np.abs(portion.extra["stokes"][at, 2]), 1.0, atol=1e-6)
    np.testing.assert_allclose(weight, 1.0)


def test_a_leaking_polariser_of_some_transmittance() -> None:
    keys = "absorbs = [0, 1, 0]\nextinction = 0.1\ntransmittance = 0.8"
    for part, right in (("p", 0.8), ("s", 0.08)):
        portion = traced(sheet("polariser", keys, 1.0, "sheet") + lamp(0.0, part), 20_000)
        for (share, error), value in zip(
            shares(portion, THROUGH, ABSORBED), (right, 1.0 - right), strict=True
        ):
            assert abs(share - value) < 4.0 * error


ROUGH_METAL = """
[surfaces.metal]
kind = "rough_mirror"
roughness = ALPHA
metal = { n = 2.9, k = 3.1 }
[bodies.plate]
kind = "rectangle"
size = [100, 100]
surface = "metal"
"""
ROUGH_GLASS = """
[surfaces.ground]
kind = "rough_dielectric"
roughness = ALPHA
"""


@pytest.mark.parametrize("part", ["s", "p"])
def test_nearly_smooth_facets_are_the_smooth_surface(part: str) -> None:
    portion = traced(ROUGH_METAL.replace("ALPHA", "0.002") + lamp(75.0, part), 40_000)
    right = {"s": 0.851, "p": 0.177}[part]
    [(share, error)] = shares(portion, BACK)
    assert abs(share - right) < 4.0 * error + 2e-3
    text = ROUGH_GLASS.replace("ALPHA", "0.002") + half_space("ground") + lamp(60.0, part)
    [(share, error), (through, other)] = shares(traced(text, 40_000), BACK, THROUGH)
    c, t = 0.5, math.sqrt(1.0 - 0.75 / 1.52**2)
    r = {"s": (c - 1.52 * t) / (c + 1.52 * t), "p": (1.52 * c - t) / (1.52 * c + t)}[part] ** 2
    assert abs(share - r) < 4.0 * error + 2e-3
    assert abs(through - (1.0 - r)) < 4.0 * other + 2e-3


@pytest.mark.parametrize("part", ["s", "p"])
def test_rough_glass_keeps_the_light(part: str) -> None:
    text = ROUGH_GLASS.replace("ALPHA", "0.4") + half_space("ground") + lamp(60.0, part)
    _, _, weight = first_hit(traced(text, 60_000))
    assert abs(weight.mean() - 1.0) < 4.0 * weight.std() / math.sqrt(len(weight))


def test_scatter_takes_its_share_of_what_is_reflected() -> None:
    """The specular light of s is R_s - TIS, whatever natural light would reflect."""
    from raymap.laws.radial import RadialScatter, scatter_share

    text = METAL.replace("metal = {", "scatter = { abg = [2e-3, 0.01, 2.0] }\nmetal = {")
    table = RadialScatter(abg=(2e-3, 0.01, 2.0)).tables([550.0])[0]
    tis = scatter_share(table, 0, math.sin(math.radians(75.0)))
    assert 0.005 < tis < 0.1
    for part, right in (("s", 0.851), ("p", 0.177)):
        portion = traced(text + lamp(75.0, part), 60_000)
        found = shares(portion, int(Event.SPECULAR_REFLECTION), int(Event.GLOSSY_REFLECTION))
        for (share, error), value in zip(found, (right - tis, tis), strict=True):
            assert abs(share - value) < 4.0 * error + 5e-4, part


MODES = {
    "analog": "",
    "weighted": "mode = 'weighted'\nmin_reflection = 0.3\n",
    "split": "mode = 'weighted'\nsplit_depth = 2\nroulette_weight = 0.01\n",
}


@pytest.mark.parametrize("mode", ["weighted", "split"])
def test_weighted_and_split_light_agree_with_analog_light(mode: str) -> None:
    """A coated plate on a metal: every class of path by z-test."""
    text = (
        STACK
        + half_space("stack").replace('"black"', '"clear"')
        + METAL.replace('surface = "metal"', 'surface = "metal"\nposition = [0, 0, 110]')
    )
    scene = text + lamp(60.0, "both") + "[trace]\nlight = 'polarised'\n"
    found = []
    for name in ("analog", mode):
        compilation = compile_scene(parse_scene(HEAD + scene + MODES[name]))
        portion = PolarizedWavefront(compilation, 3, Polarization(states="natural")).trace(
            0, 20_000
        )
        assert portion.weight is not None
        emission = portion.emission if portion.emission is not None else np.arange(portion.n_rays)
        _, place = np.unique(emission, return_inverse=True)
        last = np.cumsum(portion.records_per_ray) - 1
        kinds = np.minimum(portion.records_per_ray, 7) * 2 + (
            portion.event[last] & int(Event.LEFT_SCENE) != 0
        )
        rows = []
        for kind in range(16):
            each = np.bincount(
                place, np.where(kinds == kind, portion.weight.astype(float), 0.0), minlength=20_000
            )
            rows.append((each.mean(), each.std() / math.sqrt(20_000)))
        found.append(rows)
    tests = 0
    for (a, error_a), (b, error_b) in zip(*found, strict=True):
        if error_a > 0.0 and error_b > 0.0:
            tests += 1
            assert abs(a - b) < 4.5 * math.hypot(error_a, error_b)
    assert tests > 5
    assert sum(row[0] for row in found[1]) == pytest.approx(1.0, abs=0.02)


def test_rays_of_mixed_colour_go_on_in_one_channel() -> None:
    """A metal whose index depends on the wavelength: each channel by its own amplitudes."""
    text = METAL.replace(
        "{ n = 2.9, k = 3.1 }",
        "{ n = { wavelength_nm = [450, 650], value = [1.2, 0.15] }, "
        "k = { wavelength_nm = [450, 650], value = [1.8, 3.5] } }",
    )
    light = lamp(70.0, "p", "450, 650")
    portion = traced(text + light, 40_000)
    first = np.cumsum(portion.records_per_ray) - portion.records_per_ray
    channel = portion.color_code[first]
    assert set(channel.tolist()) == {0, 1}
    _, met, weight = first_hit(portion)
    c = math.cos(math.radians(70.0))
    for k, m in enumerate((1.2 + 1.8j, 0.15 + 3.5j)):
        root = cmath.sqrt(1.0 - (math.sin(math.radians(70.0)) / m) ** 2)
        right = abs((m * c - root) / (m * c + root)) ** 2
        own = weight[channel == k] * (met[channel == k] & BACK != 0)
        assert abs(own.mean() - right) < 4.0 * own.std() / math.sqrt(len(own))

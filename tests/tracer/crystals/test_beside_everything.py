"""Crystals beside mirrors, films, polarisers, curved bodies and in the weighted mode."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import raymap
from query import detected, hit, select, sensitivity, what_if
from raymap.model.errors import RayMapError
from tracer.run.recording import record
from tracer.run.results import StoppedLight
from tracer.scene.load import parse_scene

HEAD = """
length_unit = "mm"
spectrum = {{ kind = "spectral", wavelengths_nm = [589.3] }}
[media.crystal]
crystal = {{ indices = [{o}, {o}, {e}], optic_axis = {axis} }}
[media.glass]
index = 1.5
[sources.lamp]
kind = "collimated"
position = [0, 0, -20]
direction = [0, 0, 1]
diameter = 0.2
"""
N_O, N_E = 1.6584, 1.4864


def head(axis: str = "[1, 0, 0]", light: str = "") -> str:
    return HEAD.format(o=N_O, e=N_E, axis=axis) + light


def slab(name: str, z: float, medium: str = "crystal", more: str = "") -> str:
    return f"""
[bodies.{name}]
kind = "box"
size = [30, 30, 5]
position = [0, 0, {z}]
medium = "{medium}"
{more}
"""


SCREEN = """
[detectors.screen]
position = [0, 0, 40]
looks = [0, 0, -1]
size = [60, 60]
cells = [2, 2]
"""

BACK = """
[detectors.back]
position = [0, 0, -19]
looks = [0, 0, 1]
size = [20, 20]
cells = [4, 4]
"""


def flux(text: str, detector: str = "screen", rays: int = 20_000) -> tuple[float, float]:
    row = record(parse_scene(text), None, no_rays=True, rays=rays, threads=1).fluxes["detectors"]
    return row[detector]["flux"], row[detector]["flux_se"]


def through(n: float) -> float:
    """Share that a slab lets through at right angles, with all inner reflections."""
    return 2.0 * n / (n * n + 1.0)


@pytest.mark.parametrize("degrees", [0.0, 30.0, 90.0])
def test_a_polariser_behind_a_crystal_passes_each_wave_by_malus(degrees: float) -> None:
    # The axis lies along x: e vibrates along it, o across; the sheet absorbs along its axis
    a = math.radians(degrees)
    sheet = f"""
[surfaces.sheet]
kind = "polariser"
absorbs = [{math.cos(a)}, {math.sin(a)}, 0]
[bodies.film]
kind = "rectangle"
size = [30, 30]
position = [0, 0, 20]
surface = "sheet"
"""
    found, error = flux(head() + slab("plate", 0) + sheet + SCREEN)
    e, o = through(N_E) / 2.0, through(N_O) / 2.0
    expected = e * math.sin(a) ** 2 + o * math.cos(a) ** 2
    assert abs(found - expected) < 4.0 * error + 1e-9


def test_glass_at_brewsters_angle_sends_the_waves_of_a_crystal_unequal_light() -> None:
    # p goes through the tilted glass whole, of s (1 - R) / (1 + R) by the sum over reflections
    tilt = math.degrees(math.atan(1.5))
    glass = slab("glass", -8, "glass", f"rotation = [0, {tilt}, 0]")
    glass = glass.replace("30, 30, 5", "40, 40, 2")
    text = head() + glass + slab("plate", 10) + SCREEN
    single = ((1.5**2 - 1.0) / (1.5**2 + 1.0)) ** 2
    p = through(N_E) / 2.0
    s = (1.0 - single) / (1.0 + single) * through(N_O) / 2.0
    found, error = flux(text, rays=40_000)
    assert abs(found - (p + s)) < 4.0 * error
    # Seen apart: a sheet that absorbs what vibrates along x leaves s alone
    sheet = '[surfaces.sheet]\nkind = "polariser"\nabsorbs = [1, 0, 0]\n'
    sheet += '[bodies.film]\nkind = "rectangle"\nsize = [30, 30]\nposition = [0, 0, 20]\n'
    found, error = flux(text + sheet + 'surface = "sheet"\n', rays=40_000)
    assert abs(found - s) < 4.0 * error


def test_a_mirror_sends_both_waves_back_onto_their_way(tmp_path: Path) -> None:
    # With the axis at 45 degrees e walks off; reversed, it walks back to where it came from
    mirror = """
[surfaces.silver]
kind = "mirror"
reflectance = 0.9
[bodies.silver]
kind = "rectangle"
size = [30, 30]
position = [0, 0, 20]
surface = "silver"
[detectors.back]
position = [0, 0, -10]
looks = [0, 0, 1]
size = [20, 20]
cells = [4, 4]
"""
    text = head("[1, 0, 1]") + slab("plate", 0) + mirror
    path = tmp_path / "back.raymap"
    record(parse_scene(text), path, rays=4_000, threads=1)
    with raymap.open(path) as ray_map:
        for wave in ("ordinary", "extraordinary"):
            asked = detected("back") & hit("silver") & hit("plate.z_min", wave)
            found = select(ray_map, asked)
            assert found.matched > 1_000
        whole = raymap.join_portions([portion.read() for portion in ray_map.portions])
    ends = np.cumsum(whole.records_per_ray) - 1
    starts = ends - whole.records_per_ray + 1
    silver = [o.name for o in ray_map.directory.objects].index("silver")
    for first, last in zip(starts.tolist(), ends.tolist(), strict=True):
        # lamp, in, out, mirror, in, out, left: no other reflections
        if last - first != 6 or whole.object[first + 3] != silver:
            continue
        offset = whole.position[first + 5, :2] - whole.position[first, :2]
        assert np.abs(offset).max() < 1e-4


def test_a_sphere_of_hardly_split_waves_bends_as_glass_does() -> None:
    # Indices apart by 1e-7: all laws of crystals run, what they do is that of glass
    ball = '[bodies.ball]\nkind = "sphere"\nradius = 5\nmedium = "{}"\n'
    far = '[detectors.far]\nkind = "far_field"\naxis = [0, 0, 1]\n'
    far += "gamma_deg = [0, 90]\ncells = [1, 9]\n"
    wide = head().replace("diameter = 0.2", "diameter = 9")
    weak = wide.replace(f"[{N_O}, {N_O}, {N_E}]", "[1.5, 1.5, 1.5000001]")
    texts = (weak + ball.format("crystal") + far, wide + ball.format("glass") + far)
    found = [
        record(parse_scene(text), None, no_rays=True, rays=30_000, seed=seed, threads=1)
        for seed, text in enumerate(texts)
    ]
    a, b = (result.detectors["far"].by_channel.sum(axis=0).ravel() for result in found)
    assert a.sum() > 20_000
    chi2 = float(np.sum((a - b) ** 2 / np.maximum(a + b, 1.0)))
    assert chi2 < 9 + 4.0 * math.sqrt(18.0)


def test_the_weighted_mode_says_what_the_analog_says() -> None:
    # What left after two inner reflections is rare; the weighted mode draws it more often
    text = head("[1, 0, 1]") + slab("plate", 0) + SCREEN + BACK
    weighted = text + '[trace]\nmode = "weighted"\nmin_reflection = 0.3\n'
    for detector in ("screen", "back"):
        analog, error = flux(text, detector, rays=40_000)
        found, own = flux(weighted, detector, rays=40_000)
        assert abs(found - analog) < 4.0 * math.hypot(error, own)


def test_fog_before_a_crystal_leaves_light_unpolarised() -> None:
    # Half of the light vibrates along either axis, whatever the lamp's vibration was
    fog = """
[media.fog]
index = 1.0
scattering = { mean_free_path = 1e-3, phase = { kind = "henyey_greenstein", g = 0.9999 } }
[bodies.fog]
kind = "box"
size = [30, 30, 0.02]
position = [0, 0, -10]
medium = "fog"
"""
    sheet = """
[surfaces.sheet]
kind = "polariser"
absorbs = [{x}, {y}, 0]
[bodies.film]
kind = "rectangle"
size = [60, 60]
position = [0, 0, 20]
surface = "sheet"
"""
    text = head(light="polarisation = [1, 0, 0]\n") + fog + slab("plate", 0) + SCREEN
    for x, y, n in ((0, 1, N_E), (1, 0, N_O)):
        found, error = flux(text + sheet.format(x=x, y=y), rays=20_000)
        assert abs(found - through(n) / 2.0) < 4.0 * error + 2e-3


def test_maps_of_crystals_say_why_nothing_can_be_changed(tmp_path: Path) -> None:
    path = tmp_path / "plate.raymap"
    record(parse_scene(head() + slab("plate", 0) + SCREEN), path, rays=200)
    with raymap.open(path) as ray_map:
        for ask in (
            lambda: what_if(ray_map, {"plate.z_min.reflectance": 0.1}),
            lambda: sensitivity(ray_map, detected("screen")),
        ):
            with pytest.raises(RayMapError, match="beside crystals, whose polarisation chose"):
                ask()


def test_a_sheet_that_no_law_knows_inside_of_a_crystal_is_an_error() -> None:
    sheet = '[surfaces.half]\nkind = "mirror"\nreflectance = 0.5\n'
    sheet += '[bodies.half]\nkind = "rectangle"\nsize = [4, 4]\nsurface = "half"\n'
    with pytest.warns(StoppedLight, match="geometry errors"):
        result = record(
            parse_scene(head() + slab("plate", 0) + sheet), None, no_rays=True, rays=500
        )
    assert result.audit["lamp"]["errors"] > 300

"""Measured light: intensity grids, pictures and rings as sources."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from raymap.model.errors import SceneError
from tests.tracer.chi2 import SIGNIFICANCE, chi2_counts, chi2_sphere
from tests.tracer.sources.emission import directions, emitted, starts, with_source
from tests.tracer.transport.tracing import compiled, trace
from tracer.light import IntensityGrid
from tracer.scene.compile import compile_scene
from tracer.scene.load import parse_scene
from tracer.sources.intensity import IntensitySource

GAMMA = [0.0, 20.0, 45.0, 70.0, 90.0]
HALF_TABLE = """
gamma_deg = [0, 20, 45, 70, 90]
c_deg = [0, 60, 120, 180]
value = [[5, 5, 5, 5], [6, 4, 3, 2], [2, 3, 4, 5], [1, 0.5, 0, 0.5], [0, 0, 0, 0]]
"""


# -- intensity grids -----------------------------------------------------------------------------


def test_flux_of_a_grid_is_the_integral_over_its_directions() -> None:
    grid = IntensityGrid(gamma_deg=np.linspace(0, 180, 7), c_deg=[0], intensity=np.full(7, 3.0))
    assert grid.flux == pytest.approx(12.0 * math.pi)
    # Linear in gamma: I = 1 - gamma / (pi / 2) over a hemisphere
    cone = IntensityGrid(gamma_deg=[0, 90], c_deg=[0], intensity=[[1], [0]])
    assert cone.flux == pytest.approx(2 * math.pi * (1 - 2 / math.pi))


@pytest.mark.parametrize(
    "planes",
    [[0, 30, 90], [0, 90, 180], [90, 180, 270], [-90, 0, 90], range(0, 360, 15), range(0, 361, 15)],
)
def test_symmetric_tables_say_the_same_all_around(planes: list[float]) -> None:
    angles = np.array(list(planes), float)
    if angles[0] in (90.0, -90.0):
        values = 2.0 + np.sin(np.radians(angles))
        around = 2.0 + np.sin(np.radians(np.array([0.0, 90, 180, 270])))
    else:
        values = 2.0 + np.cos(np.radians(2 * angles))
        around = 2.0 + np.cos(np.radians(2 * np.array([0.0, 90, 180, 270])))
    grid = IntensityGrid(gamma_deg=[0, 180], c_deg=angles, intensity=np.tile(values, (2, 1)))
    assert grid.at(90.0, [0, 90, 180, 270]) == pytest.approx(around)
    assert grid.full()[0][-1] - grid.full()[0][0] == pytest.approx(360.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"intensity": [[1], [-1]]}, "negative"),
        ({"intensity": [[1], [math.nan]]}, "gap"),
        ({"gamma_deg": [30, 10]}, "rise"),
        ({"c_deg": [0, 70], "intensity": [[1, 1], [1, 1]]}, "0 .. 90"),
        ({"intensity": [[0], [0]]}, "not 0 everywhere"),
    ],
)
def test_grids_that_make_no_light_are_refused(change: dict[str, object], message: str) -> None:
    given = {"gamma_deg": [0, 90], "c_deg": [0], "intensity": [[1], [1]]} | change
    with pytest.raises(SceneError, match=message):
        IntensityGrid(**given)  # type: ignore[arg-type]


def test_rays_follow_the_intensity_table() -> None:
    scene = parse_scene(
        f"""
length_unit = "mm"
[sources.lamp]
kind = "intensity"
[sources.lamp.intensity]
{HALF_TABLE}
"""
    )
    table = scene.sources["lamp"].intensity
    assert table is not None
    grid = table.build("lamp")

    def pdf(x: float, y: float, z: float) -> float:
        gamma = math.degrees(math.acos(max(-1.0, min(1.0, z))))
        return float(grid.at(gamma, -math.degrees(math.atan2(y, x)))) / grid.flux

    chi2_sphere(directions(emitted(scene, 200_000)), pdf, cells=(20, 24), gauss=10)


def test_c_planes_turn_as_on_a_luminaire_that_shines_down() -> None:
    table = "gamma_deg = [0, 60, 90]\nc_deg = [0, 80, 90, 100, 180, 270]\n"
    table += "value = [[0,0,0,0,0,0], [0,0,1,0,0,0], [0,0,0,0,0,0]]"
    scene = parse_scene(
        'length_unit = "mm"\n[sources.lamp]\nkind = "intensity"\naxis = [0, 0, -1]\n'
        f"[sources.lamp.intensity]\n{table}\n"
    )
    mean = directions(emitted(scene, 4_000)).mean(axis=0)
    assert mean[1] > 0.7
    assert abs(mean[0]) < 0.02
    assert mean[2] < 0.0


def test_theta_and_phi_turn_right_handed_about_the_axis() -> None:
    grid = IntensityGrid.from_theta_phi(
        [0, 60, 90], np.arange(0, 360, 30), np.outer([0, 1, 0], np.arange(12) == 3)
    )
    model = IntensitySource(light=grid)
    mean = directions(emitted(with_source(model), 4_000)).mean(axis=0)
    assert mean[1] > 0.6
    assert abs(mean[0]) < 0.05


def test_flux_comes_from_the_table_unless_given() -> None:
    grid = IntensityGrid(gamma_deg=[0, 180], c_deg=[0], intensity=[[10], [10]], unit="lm")
    lumen = {"flux_unit": "lm"}
    scene = with_source(IntensitySource(light=grid), **lumen)
    assert compile_scene(scene).directory.sources[0].flux == pytest.approx(40 * math.pi)
    scene = with_source(IntensitySource(light=grid, flux=7.0), **lumen)
    assert compile_scene(scene).directory.sources[0].flux == 7.0
    with pytest.raises(SceneError, match="cannot become W without a spectrum"):
        compile_scene(with_source(IntensitySource(light=grid)))
    watt = with_source(
        IntensitySource.model_validate({"kind": "intensity", "light": grid, "spectrum": "D65"})
    )
    # Channels R, G, B: 179 lm are one watt of white, whatever the spectrum that it stands for
    assert compile_scene(watt).directory.sources[0].flux == pytest.approx(
        40 * math.pi / 179, rel=1e-4
    )


def test_light_starts_evenly_from_the_opening() -> None:
    grid = IntensityGrid(
        gamma_deg=[0, 90], c_deg=[0], intensity=[[1], [1]], opening=(0.02, 0.01), length_unit="m"
    )
    found = emitted(with_source(IntensitySource(light=grid)), 20_000)
    places = found.position[starts(found)]
    assert np.allclose(np.abs(places).max(axis=0), [10.0, 5.0, 0.0], atol=0.01)
    counts = np.histogram2d(places[:, 0], places[:, 1], bins=(8, 4))[0]
    assert chi2_counts(counts, np.full(counts.shape, 20_000 / 32)) > SIGNIFICANCE


# -- pictures and rings --------------------------------------------------------------------------


def test_a_picture_emits_what_it_shows(tmp_path: Path) -> None:
    picture = np.random.default_rng(3).random((6, 8, 3))
    picture[0, :, :] = [1.0, 0.0, 0.0]
    picture[2, 3] = 0.0
    np.save(tmp_path / "flag.npy", picture)
    scene = parse_scene(
        """
length_unit = "mm"
[sources.screen]
kind = "picture"
file = "flag.npy"
size = [8, 6]
""",
        folder=tmp_path,
    )
    n = 60_000
    found = emitted(scene, n)
    at = starts(found)
    places, codes = found.position[at], found.color_code[at]
    colors = np.concatenate([np.eye(3) * 65535, found.color_table])[codes] / 65535.0
    column = np.clip((places[:, 0] + 4.0).astype(int), 0, 7)
    row = np.clip((3.0 - places[:, 1]).astype(int), 0, 5)
    light = picture.sum(axis=2) / picture.sum()
    counts = np.zeros((6, 8))
    np.add.at(counts, (row, column), 1.0)
    assert chi2_counts(counts, light * n) > SIGNIFICANCE
    # Each pixel has its colour
    wanted = picture[row, column] / picture[row, column].sum(axis=1, keepdims=True)
    assert np.abs(colors - wanted).max() < 2e-5
    # A one-coloured pixel needs no mixture
    assert set(codes[row == 0].tolist()) == {0}


def test_a_picture_in_srgb_is_linearised(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    image.fromarray(np.array([[[255, 188, 0]]], np.uint8)).save(tmp_path / "orange.png")
    text = 'length_unit = "mm"\n[sources.s]\nkind = "picture"\nfile = "orange.png"\nsize = [1, 1]\n'
    found = emitted(parse_scene(text, folder=tmp_path), 100)
    color = found.color_table[found.color_code[0] - 3] / 65535.0
    assert color == pytest.approx([1 / 1.5029, 0.5029 / 1.5029, 0.0], abs=2e-4)
    with pytest.raises(SceneError, match=r"sources\.s\.file: there is no picture"):
        compile_scene(parse_scene(text.replace("orange", "pear"), folder=tmp_path))


def test_a_tilted_ring_shines_towards_its_axis() -> None:
    found = trace(
        """
[sources.ring]
kind = "ring"
diameter = 20
inner_diameter = 10
tilt_deg = 30
""",
        40_000,
    )
    at = starts(found.portion)
    places = found.portion.position[at].astype(np.float64)
    radius = np.hypot(places[:, 0], places[:, 1])
    counts = np.histogram(radius**2, bins=np.linspace(25.0, 100.0, 16))[0]
    assert chi2_counts(counts.astype(float), np.full(15, 40_000 / 15)) > SIGNIFICANCE
    along = directions(found.portion)
    normal = np.column_stack(
        [-0.5 * places[:, :2] / radius[:, None], np.full(40_000, math.sqrt(0.75))]
    )
    cosine = (along * normal).sum(axis=1)
    assert cosine.min() > -1e-4
    # Lambertian: cos² is uniform
    counts = np.histogram(cosine**2, bins=np.linspace(0, 1, 21))[0]
    assert chi2_counts(counts.astype(float), np.full(20, 2_000.0)) > SIGNIFICANCE
    recorded = found.portion.normal[at] / 32767.0
    assert np.allclose(recorded, normal, atol=1e-4)


# -- in the scene file ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('kind = "intensity"', r"sources\.s: give one of intensity"),
        ('kind = "rays"', "give a file of rays"),
        ('kind = "rays"\nfile = "a.xyz"', "no reader for 'a.xyz'"),
        ('kind = "rays"\nfile = "a.dis"', r"no reader for 'a\.dis' \(its name .* rays of ASAP"),
        ('kind = "intensity"\nfile = "a.ies"', "there is no file"),
        ('kind = "point"\ntilt_deg = 3', "a point source has no tilt_deg"),
        ('kind = "ring"', "needs a diameter"),
        ('kind = "picture"\nsize = [1, 1]', "picture file"),
        ('kind = "point"\nspectrum = "D66"', "no illuminant 'D66'"),
        (
            'kind = "point"\nspectrum = { wavelength_nm = [400, 500, 700], value = [1, 1, 1] }',
            "gap",
        ),
        ('kind = "point"\nspectrum = { wavelength_nm = [400, 410], value = [1, nan] }', "gap"),
        ('kind = "point"\nflux = 3\nflux_unit = "lm"', "cannot become W without a spectrum"),
        ('kind = "point"\nspectrum = { led = { peak_nm = 525 }, blackbody = 3000 }', "exactly one"),
    ],
)
def test_bad_sources_are_refused_in_one_line(text: str, message: str) -> None:
    with pytest.raises(SceneError, match=message) as caught:
        compiled(f"[sources.s]\n{text}\n")
    assert "\n" not in str(caught.value)


def test_flux_in_lumen_becomes_watts_through_the_spectrum() -> None:
    found = compiled(
        """
[spectrum]
kind = "spectral"
wavelengths_nm = [535, 545, 555, 565, 575]
[sources.green]
kind = "point"
flux = 683
flux_unit = "lm"
spectrum = { lines = { wavelength_nm = [555], power = [1] } }
[sources.warm]
kind = "point"
spectrum = { blackbody = 3000 }
"""
    )
    assert found.directory.sources[0].flux == pytest.approx(1.0, rel=1e-4)
    colors = np.array(found.channel_set.source_colors)
    assert colors[0] == pytest.approx([0, 0, 1, 0, 0])
    assert np.all(np.diff(colors[1]) > 0.0)


def test_scene_hash_follows_the_files_of_light(tmp_path: Path) -> None:
    text = 'length_unit = "mm"\n[sources.s]\nkind = "picture"\nfile = "a.npy"\nsize = [1, 1]\n'
    hashes = []
    for value in (1.0, 2.0):
        np.save(tmp_path / "a.npy", np.array([[value, 1.0]]))
        scene = parse_scene(text, folder=tmp_path)
        hashes.append(compile_scene(scene).directory.scene_hash)
    assert hashes[0] != hashes[1]

"""Far fields, cameras and maps of faces: closed formulas within their own error."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2 as chi2_distribution
from typer.testing import CliRunner

import query
import raymap
from raymap.cli import application
from raymap.model.errors import RayMapError, SceneError
from raymap.optics.cells import cell_measure
from tests.tracer.chi2 import SIGNIFICANCE, chi2_counts
from tests.tracer.transport.tracing import compiled, trace
from tracer.detectors.plane import Plane
from tracer.run.recording import record
from tracer.scene.load import parse_scene

UNITS = 'length_unit = "mm"\nflux_unit = "lm"\n'


def pictures(text: str, path: Path, rays: int, *names: str) -> list[Any]:
    """Record a scene and read its detectors."""
    record(parse_scene(UNITS + text), path, rays=rays, threads=1)
    with raymap.open(path) as ray_map:
        return [query.detector_image(ray_map, name) for name in names]


def agree(values: NDArray[Any], errors: NDArray[Any], expected: NDArray[Any]) -> None:
    """Values equal what is expected, by chi² of their own errors."""
    known = errors > 0.0
    statistic = (((values - expected) / np.where(known, errors, 1.0))[known] ** 2).sum()
    p = chi2_distribution.sf(statistic, int(known.sum()))
    assert p > SIGNIFICANCE, f"chi² rejects, p = {p:.1e}"


FACE = """
[sources.wall]
kind = "lambertian"
size = [0.02, 0.02]
flux = 10
[detectors.far]
kind = "far_field"
cells = [12, 18]
"""


def test_far_field_of_a_lambertian_face_is_the_cosine_law(tmp_path: Path) -> None:
    (far,) = pictures(FACE, tmp_path / "a.raymap", 200_000, "far")
    edges = np.radians(np.linspace(0.0, 180.0, 19))
    # I = flux cos / pi, averaged over the solid angle of each band
    squares = np.sin(np.minimum(edges, math.pi / 2)) ** 2 / 2
    mean = 10.0 / math.pi * np.diff(squares) / (np.cos(edges[:-1]) - np.cos(edges[1:]))
    agree(far.candela, far.density_se, np.repeat(mean[:, None], 12, axis=1))
    assert far.total == pytest.approx(10.0)
    assert far.density_unit == "cd"
    assert not far.candela[9:].any()
    assert (far.candela * cell_measure(far.detector, "mm").values).sum() == pytest.approx(10.0)
    with pytest.raises(RayMapError, match="it has no irradiance; ask for its intensity"):
        _ = far.irradiance


TABLE = """
[sources.lamp]
kind = "intensity"
axis = [0, 0, -1]
flux = 100
[sources.lamp.intensity]
gamma_deg = [0, 40, 80]
c_deg = [0, 90, 180, 270]
value = [[9, 9, 9, 9], [8, 4, 2, 6], [0, 0, 0, 0]]
"""


def test_far_field_returns_the_table_that_a_source_emits(tmp_path: Path) -> None:
    (far,) = pictures(
        TABLE
        + """
[detectors.far]
kind = "far_field"
axis = [0, 0, -1]
c0 = [1, 0, 0]
cells = [8, 20]
gamma_deg = [0, 100]
""",
        tmp_path / "a.raymap",
        300_000,
        "far",
    )
    table = parse_scene(UNITS + TABLE).sources["lamp"].intensity
    assert table is not None
    grid = table.build("lamp")
    # Average the table over each cell
    fine_c, fine_g = (np.arange(160) + 0.5) * 360 / 160, (np.arange(400) + 0.5) * 100 / 400
    values = grid.at(fine_g[:, None], fine_c[None, :]) * np.sin(np.radians(fine_g))[:, None]
    weight = np.sin(np.radians(fine_g)).reshape(20, 20).sum(axis=1)[:, None] * 20
    expected = values.reshape(20, 20, 8, 20).sum(axis=(1, 3)) / weight * 100 / grid.flux
    agree(far.candela, far.density_se, expected)


WALL = """
[sources.wall]
kind = "lambertian"
position = [0, 0, 30]
axis = [0, 0, -1]
size = [60, 60]
flux = 7
[detectors.cam]
kind = "camera"
position = [0, 0, 0]
looks = [0, 0, 1]
cells = [3, 2]
field_deg = 50
aperture = {aperture}
{focus}
"""


@pytest.mark.parametrize(
    ("aperture", "focus"),
    [(4.0, "focus = 30"), (16.0, "focus = 30"), (4.0, "focus = 60"), (16.0, "")],
)
def test_luminance_of_a_lambertian_wall(tmp_path: Path, aperture: float, focus: str) -> None:
    text = WALL.format(aperture=aperture, focus=focus)
    (cam,) = pictures(text, tmp_path / "a.raymap", 400_000, "cam")
    expected = 7.0 / (math.pi * 3600e-6)
    agree(cam.luminance, cam.density_se, np.full((2, 3), expected))
    assert cam.density_unit == "cd/m²"
    assert cam.rays.min() > 15


def test_camera_takes_in_as_much_as_the_form_factor_says() -> None:
    """Pixels together are the whole field: discs on a common axis, and the limit of far focus."""
    found = compiled(WALL.format(aperture=20, focus="focus = 30"))
    cam = found.directory.detectors[0]
    measure = cell_measure(cam, "m")
    assert measure is not None
    rng = np.random.default_rng(5)
    # Étendue by drawing places on the lens and in the plane of focus
    half_u, half_v = cam.parameters["half_field"]
    n = 400_000
    radius, angle = 10 * np.sqrt(rng.random(n)), 2 * np.pi * rng.random(n)
    x = (2 * rng.random(n) - 1) * half_u * 30 - radius * np.cos(angle)
    y = (2 * rng.random(n) - 1) * half_v * 30 - radius * np.sin(angle)
    integrand = (30 / (x * x + y * y + 900)) ** 2 * (100 * np.pi) * (4 * half_u * half_v * 900)
    spread = integrand.std() / math.sqrt(n)
    assert abs(integrand.mean() - measure.values.sum()) < 4.5 * spread
    # A distant focus leaves area times projected solid angle
    far = cam.model_copy(update={"parameters": cam.parameters | {"focus_distance": 1e7}})
    near = cam.model_copy(
        update={"parameters": {k: v for k, v in cam.parameters.items() if k != "focus_distance"}}
    )
    assert np.allclose(cell_measure(far, "m").values, cell_measure(near, "m").values, rtol=1e-9)


def test_camera_shows_the_scene_upright_and_unmirrored(tmp_path: Path) -> None:
    (cam,) = pictures(
        """
[sources.lamp]
kind = "lambertian"
position = [6.2, 3, 30]
axis = [0, 0, -1]
size = [0.1, 0.1]
[detectors.cam]
kind = "camera"
position = [0, 0, 0]
looks = [0, 0, 1]
up = [0, 1, 0]
cells = [40, 20]
field_deg = 40
aperture = 6
focus = 30
""",
        tmp_path / "a.raymap",
        100_000,
        "cam",
    )
    rows, columns = np.nonzero(cam.rays)
    half = math.tan(math.radians(20))
    # Looking along +z with y up, +x is to the left
    assert set(columns) == {int((0.5 - 6.2 / 30 / half / 2) * 40)}
    assert set(rows) == {int((0.5 + 3 / 30 / half) * 20)}


@pytest.mark.parametrize(
    ("body", "face", "cells", "area"),
    [
        ('kind = "sphere"\nradius = 3', "b.surface", [6, 5], 36 * math.pi),
        ('kind = "cylinder"\nradius = 2\nlength = 6', "b.side", [6, 5], 24 * math.pi),
        ('kind = "cylinder"\nradius = 2\nlength = 6', "b.end", [7, 7], 4 * math.pi),
        (
            'kind = "cone"\nradius = 3\nend_radius = 1\nlength = 4',
            "b.side",
            [5, 6],
            4 * math.pi * math.sqrt(20),
        ),
        ('kind = "box"\nsize = [4, 5, 6]', "b.z_max", [4, 5], 20.0),
        ('kind = "prism"\noutline = [[0, 0], [4, 0], [0, 3]]\nlength = 2', "b.z_min", [9, 7], 6.0),
        ('kind = "ring"\ninner = 1\nouter = 3', "b.face", [12, 12], 8 * math.pi),
    ],
)
def test_maps_of_faces_cover_them_evenly(
    body: str, face: str, cells: list[int], area: float
) -> None:
    """In an isotropic field every face is lit alike: the counts follow the cells' areas."""
    found = trace(
        f"""
[surfaces.white]
kind = "lambertian"
reflectance = 0.98
[surfaces.clear]
kind = "filter"
transmittance = 1
index = 1
[bodies.room]
kind = "sphere"
radius = 10
surface = "white"
[bodies.b]
{body}
position = [0.5, -1, 1]
surface = "clear"
[sources.lamp]
kind = "lambertian"
position = [0, 0, -9.9]
diameter = 0.1
[detectors.map]
kind = "surface"
face = "{face}"
side = "both"
cells = {cells}
""",
        6_000,
    )
    entry = found.compilation.directory.detectors[0]
    measure = cell_measure(entry, "m")
    assert measure is not None
    assert measure.values.sum() == pytest.approx(area, rel=2e-3)
    crossings = found.portion.descriptors
    counts = np.zeros((cells[1], cells[0]))
    np.add.at(counts, (crossings.cell[:, 1], crossings.cell[:, 0]), 1.0)
    # A ray meets a face several times: the counts spread a little more than independent ones
    shares = measure.values / measure.values.sum()
    excess = ((counts - counts.sum() * shares) ** 2)[shares > 0] / (
        counts.sum() * shares[shares > 0]
    )
    assert excess.mean() < 2.0
    assert counts[shares == 0].sum() == 0
    assert counts.sum() > 1_000


def test_irradiance_of_a_lens_face_under_a_beam(tmp_path: Path) -> None:
    (seen,) = pictures(
        """
[media.glass]
index = 1.5
[surfaces.black]
kind = "absorber"
[bodies.L]
kind = "lens"
medium = "glass"
thickness = 4
front = { radius = 12, semi_diameter = 5 }
back = { radius = inf, semi_diameter = 5 }
[sources.beam]
kind = "collimated"
position = [0, 0, -10]
diameter = 12
flux = 36
[detectors.front]
kind = "surface"
face = "L.front"
cells = [16, 16]
""",
        tmp_path / "a.raymap",
        300_000,
        "front",
    )
    # Irradiance on a slope is that of the beam times the cosine
    fine = (np.arange(16 * 24) + 0.5) / 24 / 16 * 10 - 5
    x, y = np.meshgrid(fine, fine)
    inside = x * x + y * y <= 25.0
    flux = inside.reshape(16, 24, 16, 24).sum(axis=(1, 3)) / 24**2 * (10 / 16) ** 2
    flux *= 36.0 / (math.pi * 36.0)
    counts = seen.rays[flux > 0.0]
    assert chi2_counts(counts.astype(float), flux[flux > 0] / 36 * 300_000) > SIGNIFICANCE
    middle = seen.illuminance[7:9, 7:9].mean()
    assert middle == pytest.approx(1e6 / math.pi, rel=0.03)
    cosine = math.sqrt(1 - (4.7**2) / 144)
    edge = seen.illuminance[7:9, 0].mean() / cosine
    assert edge == pytest.approx(1e6 / math.pi, rel=0.1)


def test_maps_of_mesh_faces_have_a_cell_per_triangle(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box(extents=[2, 2, 2]).export(tmp_path / "box.stl")
    text = """
[bodies.box]
kind = "mesh"
file = "box.stl"
scale = 1
name_by = "angle"
surface = "absorber"
[sources.beam]
kind = "collimated"
position = [0, 0, -10]
diameter = 1
flux = 3
[detectors.box]
kind = "surface"
face = "box"
"""
    scene = parse_scene(UNITS + text, folder=tmp_path)
    record(scene, tmp_path / "a.raymap", rays=10_000, threads=1)
    with raymap.open(tmp_path / "a.raymap") as ray_map:
        seen = query.detector_image(ray_map, "box")
    assert seen.detector.cells == (4, 3)
    assert seen.rays.sum() == 10_000
    assert np.count_nonzero(seen.rays) == 2
    assert np.allclose(seen.measure.values, 2e-6)
    assert seen.illuminance.sum() == pytest.approx(3 / 2e-6)


def test_results_are_stored_and_add_up(tmp_path: Path) -> None:
    scene = parse_scene(UNITS + FACE)
    target = tmp_path / "a.raymap"
    record(scene, target, rays=3_000, threads=1)
    record(scene, target, rays=2_000, threads=1, append=True)
    record(scene, tmp_path / "b.raymap", rays=5_000, threads=2)
    with raymap.open(target) as grown, raymap.open(tmp_path / "b.raymap") as whole:
        first, second = grown.detector_result("far"), whole.detector_result("far")
        assert first is not None
        assert second is not None
        assert np.allclose(first[0], second[0])
        image = query.detector_image(whole, "far")
        assert first[0].sum(axis=2) == pytest.approx(image.rays)
        some = query.detector_image(whole, "far", 'detected("far", rect(0, 0, 12, 4))')
        assert some.rays[:4].sum() == image.rays[:4].sum()
        assert not some.rays[4:].any()
    result = CliRunner().invoke(application(), ["info", str(target), "--json"])
    assert json.loads(result.stdout)["detectors"] == ["far"]


def test_every_file_format_holds_the_same_picture(tmp_path: Path) -> None:
    record(parse_scene(UNITS + FACE), tmp_path / "a.raymap", rays=5_000, threads=1)
    run = CliRunner()
    for name in ("a.png", "a.tiff", "a.exr", "a.csv", "a.npy"):
        asked = ["image", str(tmp_path / "a.raymap"), "far", "-o", str(tmp_path / name)]
        result = run.invoke(application(), [*asked, "--kind", "candela", "--json"])
        assert result.exit_code == 0, result.stderr
    answer = json.loads(result.stdout)
    assert answer["quantity"] == "candela"
    assert answer["peak_unit"] == "cd"
    values = np.load(tmp_path / "a.npy")
    tifffile = pytest.importorskip("tifffile")
    assert np.allclose(tifffile.imread(tmp_path / "a.tiff")[::-1], values, rtol=1e-6)
    table = np.genfromtxt(tmp_path / "a.csv", delimiter=",", names=True, deletechars="")
    assert len(table) == 216
    assert np.allclose(table["candela_[cd]"].reshape(18, 12), values, rtol=1e-6)
    assert table["gamma_[deg]"][12] == 15.0
    assert (tmp_path / "a.exr").read_bytes()[:4] == b"v/1\x01"
    result = run.invoke(application(), [*asked, "--kind", "luminance"])
    assert result.exit_code == 1
    assert "far_field: it has no luminance; ask for its candela" in str(result.exception)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('kind = "far_field"', "cells is missing"),
        ('kind = "far_field"\ncells = [4, 4]\nsize = [1, 1]', "a far_field detector has no size"),
        ('kind = "camera"\ncells = [4, 4]', "position is missing"),
        (
            'kind = "surface"\nface = "ball.front"\ncells = [2, 2]',
            "there is no face 'ball.front'; known are ball.surface",
        ),
        ('kind = "surface"\nface = "ball"', "cells: is missing"),
        ("cells = [4, 4]\nsize = [1, 1]\nlooks = [0, 0, 1]", "position is missing"),
        (
            'kind = "plane"\nposition = [0, 0, 0]\nlooks = [0, 0, 1]\nsize = [1, 1]',
            "cells is missing",
        ),
    ],
)
def test_bad_detectors_are_refused_in_one_line(text: str, message: str) -> None:
    ball = (
        '[bodies.ball]\nkind = "sphere"\nradius = 1\nposition = [0, 0, 5]\nsurface = "absorber"\n'
    )
    with pytest.raises(SceneError, match=message) as caught:
        compiled(f'[sources.s]\nkind = "point"\n{ball}[detectors.d]\n{text}\n')
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("reflectance", [0.5, 0.9])
def test_an_integrating_sphere_multiplies_the_light_on_its_wall(
    tmp_path: Path, reflectance: float
) -> None:
    (wall,) = pictures(
        f"""
[surfaces.white]
kind = "lambertian"
reflectance = {reflectance}
[bodies.wall]
kind = "sphere"
radius = 50
surface = "white"
[sources.lamp]
kind = "point"
flux = 20
[detectors.wall]
kind = "surface"
face = "wall"
side = "inside"
cells = [10, 8]
""",
        tmp_path / "a.raymap",
        40_000,
        "wall",
    )
    # The wall gets the flux 1 / (1 - rho) times; each ray meets it a geometric number of times
    multiplier = 1.0 / (1.0 - reflectance)
    spread = math.sqrt(reflectance) * multiplier / math.sqrt(40_000)
    assert abs(wall.total / 20.0 - multiplier) < 4.5 * spread
    lux = 20.0 * multiplier / (4.0 * math.pi * 0.05**2)
    excess = ((wall.illuminance - lux) / wall.density_se) ** 2
    assert excess.mean() < 1.6


@pytest.mark.parametrize(
    ("looks", "upward"),
    [((0, 0, 1), (0, 1, 0)), ((0, 1, 0), (0, 0, 1)), ((0, -2, 0), (0, 0, 1)), ((1, 1, 0), None)],
)
def test_a_detector_without_up_stands_upright(
    looks: tuple[float, float, float], upward: tuple[float, float, float] | None
) -> None:
    model = Plane(looks=looks, position=(0, 0, 0), size=(1, 1), cells=(1, 1))
    u, v, n = model.axes()
    assert np.allclose(np.cross(u, v), n)
    assert v @ (upward or (0, 1, 0)) > 0.0
    if upward is not None:
        assert np.allclose(v, upward)
        said = Plane(looks=looks, position=(0, 0, 0), size=(1, 1), cells=(1, 1), up=upward)
        assert said.model_dump() == model.model_dump()  # one fingerprint of the scene


@pytest.mark.parametrize(
    ("body", "face"),
    [
        ('kind = "disc"\nouter = 2', "b.face"),
        ('kind = "cone"\nradius = 2\nend_radius = 1\nlength = 3', "b.side"),
        (
            'kind = "lens"\nmedium = "glass"\nthickness = 1\ndiameter = 3\n'
            "front = { radius = 5 }\nback = {}",
            "b.front",
        ),
    ],
)
def test_the_directory_does_not_grow_with_the_cells_of_a_face(body: str, face: str) -> None:
    """Nor does the time: 16 million areas would take minutes and 130 MB."""
    found = compiled(
        f"""
[media.glass]
index = 1.5
[surfaces.s]
kind = "absorber"
[bodies.b]
{body}
surface = "s"
[sources.lamp]
kind = "point"
position = [0, 0, 9]
[detectors.map]
kind = "surface"
face = "{face}"
cells = [4000, 4000]
"""
    )
    (entry,) = found.directory.detectors
    assert len(entry.model_dump_json()) < 60_000
    measure = cell_measure(entry, "mm")
    assert measure is not None
    assert measure.sizes.at(np.array([2000]), np.array([2000])).item() > 0.0

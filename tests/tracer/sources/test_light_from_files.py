"""Files of light in scenes: photometric files and ray files as sources, and light handed on from
one scene to the next."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import query
import raymap
import tracer
from query.answers.reports.rays_at_place import write_ray_file
from raymap.model.errors import SceneError

FILES = Path(__file__).parents[2] / "data" / "photometry"

UPSTREAM = """
length_unit = "mm"
flux_unit = "{unit}"

[media.glass]
index = 1.5

[bodies.lens]
kind = "lens"
position = [0, 0, 10]
thickness = 4
front = {{ radius = 30, semi_diameter = 10 }}
back = {{ radius = -30, semi_diameter = 10 }}
rim = "absorber"
medium = "glass"

[sources.lamp]
kind = "lambertian"
axis = [0, 0, 1]
size = [2, 1]
cone_deg = 35
flux = 3

[detectors.plane]
position = [0, 0, 20]
looks = [0, 0, -1]
size = [60, 60]
cells = [10, 10]
"""

DOWNSTREAM = """
[bodies.edge]
kind = "rectangle"
position = [6, 0, 30]
size = [10, 40]
surface = "absorber"

[detectors.screen]
position = [0, 0, 50]
looks = [0, 0, -1]
size = [40, 40]
cells = [8, 8]
blocking = true
"""

HANDED_ON = """
length_unit = "{length}"
flux_unit = "{unit}"

[sources.handed_on]
kind = "rays"
file = "{file}"
"""


def trace(folder: Path, name: str, text: str, rays: int) -> Path:
    scene = folder / f"{name}.toml"
    scene.write_text(text)
    path = folder / f"{name}.raymap"
    tracer.record(tracer.load_scene(scene), path, rays=rays, seed=len(name))
    return path


@pytest.mark.parametrize(("suffix", "unit"), [("tm25ray", "W"), ("sdf", "lm"), ("dat", "W")])
def test_light_handed_on_makes_the_same_image(tmp_path: Path, suffix: str, unit: str) -> None:
    whole = trace(tmp_path, "whole", UPSTREAM.format(unit=unit) + DOWNSTREAM, 60_000)
    first = trace(tmp_path, "first", UPSTREAM.format(unit=unit), 60_000)
    with raymap.open(first) as ray_map:
        file = tmp_path / f"light.{suffix}"
        written = write_ray_file(query.select(ray_map), file, "plane")
        image = query.detector_image(ray_map, "plane")
    text = HANDED_ON.format(length="mm", unit=unit, file=file.name) + DOWNSTREAM
    second = trace(tmp_path, "second", text, 60_000)
    with raymap.open(whole) as a, raymap.open(second) as b:
        assert b.directory.sources[0].flux == pytest.approx(written["flux"], rel=1e-5)
        assert b.directory.sources[0].flux == pytest.approx(image.total, rel=1e-5)
        wanted, found = (query.detector_image(each, "screen") for each in (a, b))
        blocked = [query.select(each, 'last(hit("edge"))') for each in (a, b)]
    # The second scene adds its own noise to that of the file, which is that of a first scene
    spread = np.hypot(np.hypot(wanted.flux_se, found.flux_se), wanted.flux_se)
    z = (found.flux - wanted.flux) / np.maximum(spread, spread[spread > 0].min())
    assert np.abs(z).max() < 5
    assert np.sqrt(np.mean(z**2)) < 1.5
    error = np.hypot(2 * blocked[0].flux_se, blocked[1].flux_se)
    assert abs(blocked[0].flux - blocked[1].flux) < 4 * error


def test_light_that_reaches_a_face_shines_on_it_again(tmp_path: Path) -> None:
    whole = trace(tmp_path, "whole", UPSTREAM.format(unit="W") + DOWNSTREAM, 20_000)
    with raymap.open(whole) as ray_map:
        on_edge = query.select(ray_map, 'last(hit("edge"))').flux
        written = write_ray_file(
            query.select(ray_map), tmp_path / "edge.tm25ray", "edge.face", before=0.01
        )
    assert written["flux"] == pytest.approx(on_edge, rel=1e-5)
    text = HANDED_ON.format(length="mm", unit="W", file="edge.tm25ray") + DOWNSTREAM
    again = trace(tmp_path, "again", text, 5_000)
    with raymap.open(again) as ray_map:
        assert query.select(ray_map, 'last(hit("edge"))').flux == pytest.approx(on_edge, rel=1e-5)


def test_other_units_and_a_turned_source(tmp_path: Path) -> None:
    first = trace(tmp_path, "first", UPSTREAM.format(unit="W"), 5_000)
    with raymap.open(first) as ray_map:
        write_ray_file(query.select(ray_map), tmp_path / "light.tm25ray", "plane")
    text = HANDED_ON.format(length="cm", unit="W", file="light.tm25ray")
    text += "position = [1, 2, 3]\naxis = [0, 0, -1]\n"
    second = trace(tmp_path, "second", text, 5_000)
    with raymap.open(second) as ray_map:
        stored = ray_map.portions[0]
        start = stored.record_offsets()[:-1]
        position = stored.column("position")[start]
    np.testing.assert_allclose(position[:, 2], 3 - 2.0, atol=1e-5)


LUMINAIRE = """
length_unit = "m"
flux_unit = "lm"

[sources.luminaire]
kind = "intensity"
file = "{file}"
position = [0, 0, 8]
axis = [0, 0, -1]

[detectors.street]
position = [0, 0, 0]
looks = [0, 0, 1]
up = [0, 1, 0]
size = [400, 400]
cells = [50, 50]
blocking = true
"""


@pytest.mark.parametrize(
    ("name", "flux"),
    [("road_luminaire.ldt", None), ("maxwell_measured.ies", 1000), ("italo.ies", None)],
)
def test_a_luminaire_shines_down(tmp_path: Path, name: str, flux: float | None) -> None:
    from tracer.light import read_light

    (tmp_path / name).write_bytes((FILES / name).read_bytes())
    path = trace(tmp_path, "street", LUMINAIRE.format(file=name), 40_000)
    grid = read_light(FILES / name)
    with raymap.open(path) as ray_map:
        source = ray_map.directory.sources[0]
        assert source.flux == pytest.approx(grid.flux)  # type: ignore[union-attr]
        if flux is not None:
            assert source.flux == pytest.approx(flux, rel=2e-4)
        image = query.detector_image(ray_map, "street")
        stored = ray_map.portions[0]
        start = stored.record_offsets()[:-1]
        along = (stored.column("position")[start + 1] - stored.column("position")[start]).astype(
            float
        )
    # Nadir is -z; C0 is +x, C90 is +y: compare with the intensities integrated over quadrants
    gamma = np.degrees(np.arctan2(np.hypot(along[:, 0], along[:, 1]), -along[:, 2]))
    c = np.degrees(np.arctan2(along[:, 1], along[:, 0])) % 360
    g_low, c_low = np.meshgrid(np.arange(0, 90, 10), np.arange(0, 360, 90), indexing="ij")
    fine_g = (np.arange(0, 90, 0.25) + 0.125)[:, None]
    fine_c = (np.arange(0, 360, 1) + 0.5)[None, :]
    power = grid.at(fine_g, fine_c) * np.sin(np.radians(fine_g))  # type: ignore[union-attr]
    wanted = power.reshape(9, 40, 4, 90).sum(axis=(1, 3))
    wanted /= power.sum()
    found, _, _ = np.histogram2d(gamma, c, bins=(np.arange(0, 91, 10), np.arange(0, 361, 90)))
    n = found.sum()
    z = (found - n * wanted) / np.sqrt(np.maximum(n * wanted, 1))
    assert np.abs(z).max() < 5, (g_low[np.abs(z) > 5], c_low[np.abs(z) > 5])
    assert image.total < source.flux


def test_refusals_name_scene_and_file(tmp_path: Path) -> None:
    (tmp_path / "bad.tm25ray").write_bytes(b"TM25" + bytes(100))
    (tmp_path / "bad.ies").write_text("hello")
    for kind, name in (("rays", "bad.tm25ray"), ("intensity", "bad.ies"), ("rays", "none.sdf")):
        scene = tmp_path / "bad.toml"
        scene.write_text(f'length_unit = "mm"\n[sources.a]\nkind = "{kind}"\nfile = "{name}"\n')
        with pytest.raises(SceneError, match=name) as error:
            tracer.record(tracer.load_scene(scene), tmp_path / "x.raymap", rays=10)
        assert "sources.a" in str(error.value)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("spectral", [False, True])
def test_colors_are_handed_on(tmp_path: Path, spectral: bool) -> None:
    color = "spectrum = { rgb = [1.0, 0.5, 0.1] }\n"
    upstream = UPSTREAM.format(unit="lm").replace("flux = 3", "flux = 3\n" + color)
    first = trace(tmp_path, "first", upstream, 20_000)
    with raymap.open(first) as ray_map:
        write_ray_file(query.select(ray_map), tmp_path / "light.tm25ray", "plane")
        before = query.detector_image(ray_map, "plane").channels.sum(axis=(0, 1))
    text = HANDED_ON.format(length="mm", unit="lm", file="light.tm25ray") + DOWNSTREAM
    if spectral:
        text = text.replace("[sources", SPECTRAL + "\n[sources", 1)
    second = trace(tmp_path, "second", text, 20_000)
    with raymap.open(second) as ray_map:
        image = query.detector_image(ray_map, "screen")
        channels = image.channels.sum(axis=(0, 1))
        if not spectral:
            np.testing.assert_allclose(
                channels / channels.sum(), before / before.sum(), atol=1 / 64
            )
            return
        # Narrow bands that look like it: more red than blue
        nm = np.linspace(430, 650, 23)
        assert channels[nm > 580].sum() > 3 * channels[nm < 500].sum() > 0


SPECTRAL = """
[spectrum]
kind = "spectral"
wavelengths_nm = { first = 430, last = 650, count = 23 }
"""

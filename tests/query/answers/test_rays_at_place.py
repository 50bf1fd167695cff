"""Selected rays at a place: fluxes, places, directions and colours of what is written."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import query
import raymap
from query.answers.reports.rays_at_place import rays_at, write_ray_file
from raymap import rayfiles
from raymap.model.errors import RayMapError, UnknownName
from raymap.rayfiles import RaySet

SCENE = """
length_unit = "mm"
flux_unit = "{unit}"

[spectrum]
{spectrum}

[media.glass]
index = 1.5

[surfaces.grey]
kind = "lambertian"
reflectance = {{ rgb = [0.8, 0.5, 0.2] }}

[bodies.plate]
kind = "box"
position = [0, 0, 10]
size = [20, 20, 2]
medium = "glass"

[bodies.key]
kind = "box"
position = [0, 0, 30]
size = [10, 10, 2]
surface = "grey"

[sources.lamp]
kind = "lambertian"
axis = [0, 0, 1]
size = [4, 2]
cone_deg = 40
flux = 5

[detectors.plane]
position = [0, 0, 20]
looks = [0, 0, -1]
size = [30, 20]
cells = [30, 20]

[detectors.wall]
position = [0, 0, 60]
looks = [0, 0, -1]
size = [100, 100]
cells = [10, 10]
blocking = true
"""
RGB = 'kind = "rgb"'
SPECTRAL = 'kind = "spectral"\nwavelengths_nm = [450, 550, 650]'


def record(folder: Path, unit: str = "W", spectrum: str = RGB, rays: int = 20_000) -> Path:
    import tracer

    scene = folder / "scene.toml"
    scene.write_text(SCENE.format(unit=unit, spectrum=spectrum))
    path = folder / "map.raymap"
    tracer.record(tracer.load_scene(scene), path, rays=rays, seed=3)
    return path


@pytest.fixture(scope="module")
def watt(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("watt"))


def collect(ray_map: Any, at: str, criterion: str | None = None, **options: Any) -> RaySet:
    pieces = list(rays_at(query.select(ray_map, criterion), at, **options))
    first = pieces[0]
    return RaySet(
        position=np.concatenate([each.position for each in pieces]),
        direction=np.concatenate([each.direction for each in pieces]),
        flux=np.concatenate([each.flux for each in pieces]),
        length_unit=first.length_unit,
        flux_unit=first.flux_unit,
        wavelength_nm=None
        if first.wavelength_nm is None
        else np.concatenate([each.wavelength_nm for each in pieces]),  # type: ignore[misc]
        tristimulus=None
        if first.tristimulus is None
        else np.concatenate([each.tristimulus for each in pieces]),  # type: ignore[misc]
    )


def test_flux_at_a_detector_is_what_it_counts(watt: Path) -> None:
    with raymap.open(watt) as ray_map:
        for criterion in (None, 'hit("key")', 'count(hit("plate", reflected)) >= 1'):
            for detector in ("plane", "wall"):
                image = query.detector_image(ray_map, detector, criterion)
                rays = collect(ray_map, detector, criterion)
                assert len(rays) == image.rays.sum()
                assert rays.total_flux == pytest.approx(image.total, rel=1e-5)


def test_places_and_directions_at_a_detector(watt: Path) -> None:
    with raymap.open(watt) as ray_map:
        rays = collect(ray_map, "plane")
        image = query.detector_image(ray_map, "plane")
    np.testing.assert_allclose(rays.position[:, 2], 20, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(rays.direction, axis=1), 1, atol=1e-6)
    assert (rays.direction[:, 2] > 0).all()
    # The cells that the recorder counted them in; u runs where the detector has it
    u = np.array(image.detector.axis_u)
    v = np.array(image.detector.axis_v)
    place = rays.position - np.array(image.detector.center)
    counts, _, _ = np.histogram2d(place @ v, place @ u, bins=(20, 30), range=((-10, 10), (-15, 15)))
    assert np.abs(counts - image.rays).sum() <= 0.002 * len(rays)


def test_arriving_at_and_leaving_a_face(watt: Path) -> None:
    with raymap.open(watt) as ray_map:
        arriving = collect(ray_map, "key.z_min")
        leaving = collect(ray_map, "key.z_min", leaving=True)
        selection = query.select(ray_map, 'hit("key.z_min")')
        absorbed = query.select(ray_map, 'last(hit("key.z_min", absorbed))')
    np.testing.assert_allclose(arriving.position[:, 2], 29, atol=1e-5)
    assert (arriving.direction[:, 2] > 0).all()
    assert (leaving.direction[:, 2] < 0).all()
    # Light that comes back from the plate meets the key again
    assert arriving.total_flux >= selection.flux
    lost = arriving.total_flux - leaving.total_flux
    assert lost == pytest.approx(absorbed.flux, rel=1e-4)


def test_first_and_last_crossings(watt: Path) -> None:
    with raymap.open(watt) as ray_map:
        selection = query.select(ray_map, 'hit("plate")')
        for crossings in ("first", "last"):
            rays = collect(ray_map, "plate", crossings=crossings)
            assert len(rays) == selection.matched
        assert len(collect(ray_map, "plate")) > selection.matched


def test_starting_before_the_surface(watt: Path) -> None:
    with raymap.open(watt) as ray_map:
        on = collect(ray_map, "key.z_min")
        before = collect(ray_map, "key.z_min", before=0.5)
        far = collect(ray_map, "key.z_min", before=1e6)
    np.testing.assert_allclose(before.position + 0.5 * before.direction, on.position, atol=1e-5)
    # Never before the point where the ray comes from: the back of the plate
    assert far.position[:, 2].min() >= -1e-5
    assert far.position[:, 2].max() <= 29


def test_wavelengths_keep_the_color(tmp_path: Path, watt: Path) -> None:
    with raymap.open(watt) as ray_map:
        shares = query.detector_image(ray_map, "wall", 'hit("key")').channels.sum(axis=(0, 1))
        rays = collect(ray_map, "wall", 'hit("key")')
    drawn = [rays.flux[rays.wavelength_nm == nm].sum() for nm in (611, 549, 464)]
    assert sum(drawn) == pytest.approx(rays.total_flux)
    n = len(rays)
    share = shares / shares.sum()
    np.testing.assert_allclose(np.array(drawn) / rays.total_flux, share, atol=4 * np.sqrt(0.25 / n))


def test_lumen_keep_their_color_in_tm25(tmp_path: Path) -> None:
    path = record(tmp_path, unit="lm", rays=4000)
    with raymap.open(path) as ray_map:
        selection = query.select(ray_map, 'hit("key")')
        written = write_ray_file(selection, tmp_path / "key.tm25ray", "key")
        write_ray_file(selection, tmp_path / "key.sdf", "key")
        image = query.detector_image(ray_map, "plane")
        at_plane = collect(ray_map, "plane")
    rays = rayfiles.read(tmp_path / "key.tm25ray")
    assert rays.flux_unit == "lm"
    assert rays.tristimulus is not None
    np.testing.assert_array_equal(rays.tristimulus[:, 1], rays.flux)
    assert rays.total_flux == pytest.approx(written["flux"], rel=1e-6)
    plain = rayfiles.read(tmp_path / "key.sdf")
    assert (plain.flux_unit, plain.wavelength_nm) == ("lm", None)
    assert at_plane.total_flux == pytest.approx(image.total, rel=1e-5)


def test_spectral_maps(tmp_path: Path) -> None:
    path = record(tmp_path, spectrum=SPECTRAL, rays=4000)
    with raymap.open(path) as ray_map:
        rays = collect(ray_map, "plane")
    assert set(rays.wavelength_nm.tolist()) <= {450, 550, 650}  # type: ignore[union-attr]


def test_refusals(tmp_path: Path, watt: Path) -> None:
    with raymap.open(watt) as ray_map:
        everything = query.select(ray_map)
        with pytest.raises(UnknownName, match="nearest: key"):
            list(rays_at(everything, "kex"))
        with pytest.raises(RayMapError, match="no selected ray meets"):
            write_ray_file(query.select(ray_map, '!hit("key")'), tmp_path / "x.sdf", "key")
        with pytest.raises(RayMapError, match="watt"):
            list(rays_at(everything, "key", color="xyz"))
        with pytest.raises(RayMapError, match="ray files end in"):
            write_ray_file(everything, tmp_path / "x.ray", "key")
    assert not list(tmp_path.iterdir())


def test_commands(tmp_path: Path, watt: Path, run: Any) -> None:
    out = tmp_path / "key.tm25ray"
    code, text, error = run("rayfile", watt, "key.z_min", 'hit("plate")', "-o", out, "--json")
    assert code == 0, error
    written = json.loads(text)
    assert written["rays"] > 100
    assert written["flux_unit"] == "W"
    found = json.loads(run("check-rays", out, "-o", tmp_path / "key.sdf", "--json")[1])
    assert found["rays"] == written["rays"]
    assert found["flux"] == pytest.approx(written["flux"], rel=1e-6)
    assert "wavelengths: 464 to 611 nm" in run("check-rays", tmp_path / "key.sdf")[1]
    assert run("rayfile", watt, "key", "-o", out)[0] == 1
    assert run("rayfile", watt, "key", "-o", out, "--force")[0] == 0
    code, _, error = run("query", watt, "-o", tmp_path / "x.sdf")
    assert code == 1
    assert "raymap rayfile" in error
    out.write_bytes(out.read_bytes()[:-1])
    code, _, error = run("check-rays", out)
    assert (code, error.count("\n")) == (1, 1)
    assert error.startswith("error: key.tm25ray: its header promises")

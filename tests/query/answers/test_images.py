"""Detector pictures against sums over single rays, and their files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import query
import raymap
from raymap import RayMapError
from tests.naive.rays import rays_of
from tests.query.by_hand import flux_of, flux_se_of, matching


def test_pictures_are_sums_over_registrations(map: Any) -> None:
    layers = {"all": None, "reflected": "event(reflected)", "part": 'hit("L*") & !event(left)'}
    pictures = query.detector_images(map, "screen", layers)
    for name, criterion in layers.items():
        width, height = 8, 6
        flux, rays = np.zeros((height, width)), np.zeros((height, width))
        registrations = []
        for ray in rays_of(map) if criterion is None else matching(map, criterion):
            for point in ray.points:
                for detector, registered, uv in point.crossings:
                    if detector == 0 and registered:
                        cell = [
                            min(uv[k] * n // 65535, n - 1) for k, n in enumerate((width, height))
                        ]
                        flux[cell[1], cell[0]] += flux_of(map, [ray])
                        rays[cell[1], cell[0]] += 1
                        registrations.append(ray)
        picture = pictures[name]
        np.testing.assert_allclose(picture.flux, flux, rtol=1e-4, atol=1e-9)
        np.testing.assert_array_equal(picture.rays, rays)
        # A ray that registers twice brings twice its weight
        assert picture.total_se == pytest.approx(flux_se_of(map, registrations), rel=1e-4)
        np.testing.assert_allclose(picture.irradiance, flux / 4e-6, rtol=1e-4, atol=1e-3)
        # 16 x 12 mm in 8 x 6 cells: 4 mm² each; luminous efficacies of the channels.
        efficacy = np.array([25.0, 680.0, 73.0])
        np.testing.assert_allclose(picture.illuminance, picture.channels @ efficacy / 4e-6)


def test_blocks_of_cells_are_sums(map: Any) -> None:
    fine = query.detector_image(map, "screen")
    coarse = query.detector_image(map, "screen", bin=2)
    assert coarse.detector.cells == (4, 3)
    for name in ("channels", "rays"):
        values = getattr(fine, name)
        blocks = values.reshape(3, 2, 4, 2, *values.shape[2:]).sum(axis=(1, 3))
        np.testing.assert_allclose(getattr(coarse, name), blocks, rtol=1e-6)
    np.testing.assert_allclose(coarse.irradiance.mean(), fine.irradiance.mean(), rtol=1e-6)
    # What one emission brings to several cells of a block goes together
    blocks = fine.variance.reshape(3, 2, 4, 2).sum(axis=(1, 3))
    assert (coarse.variance >= blocks * (1 - 1e-12)).all()
    with pytest.raises(RayMapError, match="sides that fit: 2"):
        query.detector_image(map, "screen", bin=3)


def test_the_grain_of_a_picture(maps: dict[str, Any]) -> None:
    picture = query.detector_image(maps["merged"], "screen")
    assert picture.grain == pytest.approx(
        1 / np.sqrt(np.median(picture.rays[picture.rays > 0])), rel=0.5
    )
    side, reached = picture.calmer()
    assert side == 2
    coarse = query.detector_image(maps["merged"], "screen", bin=2)
    assert reached == pytest.approx(coarse.grain, rel=0.1)
    assert picture.calmer(grain=1.0) is None
    eye = query.detector_image(maps["merged"], "eye", 'source("*") & !source("*")')
    assert (eye.grain, eye.calmer()) == (None, None)


def test_picture_files(maps: dict[str, Any], tmp_path: Path) -> None:
    picture = query.detector_image(maps["merged"], "screen")
    query.write_image(picture, tmp_path / "a.npy", "flux")
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), picture.flux)
    query.write_image(picture, tmp_path / "a.png")
    query.write_image(picture, tmp_path / "b.png", "flux")
    image = pytest.importorskip("PIL.Image")
    with image.open(tmp_path / "a.png") as file:
        np.testing.assert_array_equal(np.asarray(file)[::-1], picture.srgb())
    with image.open(tmp_path / "b.png") as file:
        grey = np.asarray(file)[::-1].astype(float)
    np.testing.assert_allclose(grey / 65535, picture.flux / picture.flux.max(), atol=1e-5)
    for name, kind in (("a.jpg", "rgb"), ("a.png", "colour"), ("a.png", "spectral")):
        with pytest.raises(RayMapError):
            query.write_image(picture, tmp_path / name, kind)
    with pytest.raises(RayMapError, match="no folder"):
        query.write_image(picture, tmp_path / "missing" / "a.png")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.npy", "a.png", "b.png"]


def test_every_format_holds_the_kind_that_was_asked_for(
    maps: dict[str, Any], tmp_path: Path
) -> None:
    picture = query.detector_image(maps["merged"], "screen")
    for kind in ("flux", "rays", "irradiance", "illuminance", "density", "flux_se"):
        expected = getattr(picture, kind) if kind != "density" else picture.density()
        table = read_csv(query.write_image(picture, tmp_path / "a.csv", kind))
        [name] = [key for key in table if key.split(" ")[0] == kind]
        np.testing.assert_allclose(table[name], expected.ravel(), rtol=1e-8)
        query.write_image(picture, tmp_path / "a.npy", kind)
        np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), expected)
    assert "illuminance [lx]" in read_csv(
        query.write_image(picture, tmp_path / "a.csv", "illuminance")
    )
    colors = read_csv(query.write_image(picture, tmp_path / "a.csv", "rgb"))
    np.testing.assert_allclose(
        colors["G [W per cell]"], picture.linear_rgb[:, :, 1].ravel(), rtol=1e-8
    )
    spectral = read_csv(query.write_image(picture, tmp_path / "a.csv", "spectral"))
    assert [key for key in spectral if "nm" in key] == ["450 nm [W]", "550 nm [W]", "650 nm [W]"]
    whole = read_csv(query.write_image(picture, tmp_path / "a.csv"))
    assert {"flux [W]", "rays", "irradiance [W/m²]", "450 nm [W]"} <= set(whole)
    for suffix in (".csv", ".npy", ".png", ".exr"):
        with pytest.raises(RayMapError, match="no candela; ask for its illuminance"):
            query.write_image(picture, tmp_path / f"b{suffix}", "candela")
    with pytest.raises(RayMapError, match=r"\.ies files hold candela, not flux"):
        query.write_image(picture, tmp_path / "b.ies", "flux")
    assert not list(tmp_path.glob("b.*"))


def test_dark_cells_are_numbers_of_their_column(maps: dict[str, Any], tmp_path: Path) -> None:
    """Polars takes the type of a column from its first rows."""
    polars = pytest.importorskip("polars")
    dark = query.detector_image(maps["merged"], "screen", 'source("*") & !source("*")')
    table = polars.read_csv(query.write_image(dark, tmp_path / "dark.csv"))
    kinds = {name: str(kind) for name, kind in table.schema.items()}
    integers = {name for name, kind in kinds.items() if kind.startswith("Int")}
    assert integers == {"column", "row", "rays"}
    assert set(kinds.values()) == {"Int64", "Float64"}


def read_csv(path: Path) -> dict[str, Any]:
    names, *rows = path.read_text(encoding="utf-8").splitlines()
    columns = np.array([[float(cell) for cell in row.split(",")] for row in rows]).T
    return dict(zip(names.split(","), columns, strict=True))


def test_light_of_other_channels_is_not_summed(tmp_path: Path) -> None:
    """R, G, B and three wavelengths are as many channels, and different light."""
    from tracer import parse_scene, record
    from tracer.run.results import OtherChannels

    text = """
length_unit = "mm"
[spectrum]
kind = "KIND"
[sources.s]
kind = "collimated"
diameter = 1
[detectors.d]
position = [0, 0, 5]
looks = [0, 0, -1]
size = [2, 2]
cells = [2, 2]
"""
    rgb = parse_scene(text.replace("KIND", "rgb"))
    lines = parse_scene(text.replace('"KIND"', '"spectral"\nwavelengths_nm = [450, 550, 650]'))
    for no_rays in (False, True):
        path = tmp_path / f"{no_rays}.raymap"
        record(rgb, path, rays=100, no_rays=no_rays)
        with raymap.open(path) as alone:
            assert query.detector_image(alone, "d").flux.sum() == pytest.approx(1.0)
        if no_rays:
            with pytest.raises(RayMapError):
                record(lines, path, rays=100, append=True, no_rays=no_rays)
            continue
        with pytest.warns(OtherChannels, match=r"channels R, G, B, .* 450, 550, 650 nm: rays"):
            found = record(lines, path, rays=100, append=True)
        assert "R, G, B" in found.warnings[0]
        with (
            raymap.open(path) as both,
            pytest.raises(RayMapError, match=r"different channels \(R, G, B and 450, 550, 650 nm"),
        ):
            query.detector_image(both, "d")

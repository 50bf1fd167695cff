"""Maps in lumen and maps in watt of one scene: lux, candela, lumen and colours agree.

Right values are those of formulas: V(λ) of CIE 018, Y of linear sRGB (IEC 61966-2-1).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.special import expn
from scipy.stats import chi2

import query
import raymap
from query.answers.reports.energy import audit
from raymap import rayfiles
from raymap.optics.colorimetry import chromaticity, photopic
from tests.raymap.optics.test_lumen_squares import asked_of_paths
from tracer import record
from tracer.run.results import RecordResult

LINES = """
length_unit = "m"
flux_unit = "{unit}"
[spectrum]
kind = "spectral"
wavelengths_nm = [450, 550, 610]
[surfaces.f]
kind = "filter"
index = 1.5
transmittance = {{ wavelength_nm = [400, 500, 501, 700], value = [0, 0, 1, 1] }}
[bodies.f]
kind = "rectangle"
size = [2, 2]
position = [0, 0, 0.5]
surface = "f"
[sources.s]
kind = "collimated"
diameter = 0.5
direction = [0, 0, 1]
flux = 100
flux_unit = "lm"
spectrum = {{ lines = {{ wavelength_nm = [450, 550], power = [1, 1] }} }}
[detectors.before]
position = [0, 0, 0.2]
looks = [0, 0, -1]
size = [1, 1]
cells = [1, 1]
[detectors.after]
position = [0, 0, 0.8]
looks = [0, 0, -1]
size = [1, 1]
cells = [1, 1]
"""

ROOM = """
length_unit = "m"
flux_unit = "{unit}"
[spectrum]
{spectrum}
[surfaces.wall]
kind = "lambertian"
reflectance = {{ {wall} }}
[surfaces.metal]
kind = "mirror"
reflectance = {{ {metal} }}
[media.dye]
index = 1.0
absorption = {{ {dye} }}
[bodies.wall]
kind = "rectangle"
size = [2, 2]
position = [0, 0, 1]
surface = "wall"
[bodies.metal]
kind = "rectangle"
size = [2, 2]
position = [0, 0, -1]
surface = "metal"
[bodies.dye]
kind = "box"
size = [2, 2, 0.3]
position = [0, 0, 0.4]
medium = "dye"
[sources.a]
kind = "point"
flux = 60
flux_unit = "lm"
share = 1
spectrum = {{ {a} }}
[sources.b]
kind = "point"
position = [0.3, 0, -0.2]
flux = 90
flux_unit = "lm"
share = 2
spectrum = {{ {b} }}
[detectors.plane]
position = [0, 0, 0.9]
looks = [0, 0, -1]
size = [2, 2]
cells = [2, 2]
[detectors.far]
kind = "far_field"
cells = [1, 6]
"""

SPECTRAL = {
    "spectrum": 'kind = "spectral"\nwavelengths_nm = [450, 500, 550, 610, 680]',
    "wall": "wavelength_nm = [400, 500, 600, 700], value = [0.1, 0.3, 0.8, 0.9]",
    "metal": "wavelength_nm = [400, 500, 600, 700], value = [0.4, 0.5, 0.9, 0.95]",
    "dye": "wavelength_nm = [400, 500, 600, 700], value = [3.0, 1.0, 0.2, 0.0]",
    "a": "blackbody = 2700",
    "b": "led = { peak_nm = 470, width_nm = 40 }",
}
COLORED = {
    "spectrum": 'kind = "rgb"',
    "wall": "rgb = [0.8, 0.3, 0.1]",
    "metal": "rgb = [0.9, 0.6, 0.4]",
    "dye": "rgb = [0.1, 1.0, 3.0]",
    "a": "color = [1.0, 0.8, 0.5]",
    "b": "color = [0.2, 0.4, 1.0]",
}


def recorded(text: str, path: Path, **options: Any) -> tuple[RecordResult, raymap.RayMap]:
    scene = path.with_suffix(".toml")
    scene.write_text(text, encoding="utf-8")
    result = record(scene, path, threads=1, force=True, **options)
    return result, raymap.open(path)


def test_a_filter_takes_one_of_two_lines(tmp_path: Path) -> None:
    """V(550) / (V(450) + V(550)) × 100 lm on 1 m² are left, 96.32 lx, and the rest is absorbed."""
    v450, v550 = photopic([450.0, 550.0])
    left = 100.0 * v550 / (v450 + v550)
    assert left == pytest.approx(96.32, abs=0.005)
    for unit in ("W", "lm"):
        result, ray_map = recorded(LINES.format(unit=unit), tmp_path / f"{unit}.raymap", rays=4_000)
        with ray_map:
            image = query.detector_image(ray_map, "after")
            assert image.illuminance[0, 0] == pytest.approx(
                left, abs=4 * image.quantity("illuminance")[1][0, 0]
            )
            assert query.detector_image(ray_map, "before").illuminance[0, 0] == pytest.approx(
                100.0, rel=1e-4
            )
            if unit == "W":
                continue
            for found in (
                result.fluxes["detectors"]["after"],
                result.fluxes["sources"]["s"]["left"],
                query.select(ray_map, 'detected("after")').summary(),
            ):
                assert found["flux_se"] == pytest.approx(left / np.sqrt(4_000), rel=0.1)
                assert found["flux"] == pytest.approx(left, abs=4 * found["flux_se"])
                assert found["flux"] == pytest.approx(image.flux[0, 0], rel=1e-6)
            lost = result.fluxes["absorbed_by"]["objects"]["f"]
            assert lost["flux"] == pytest.approx(100 - left, abs=4 * lost["flux_se"])
            ended = audit(ray_map)
            assert ended.flux[0].sum() == pytest.approx(
                100.0, abs=4 * np.hypot(*ended.flux_se[0][[0, 2]])
            )
            assert ended.missing_flux[0] == 0.0
            assert ended.absorbed_by["f"][0] == pytest.approx(lost["flux"], rel=1e-9)
            rows = query.path_table(ray_map).rows()
            assert rows[0].flux == pytest.approx(image.flux[0, 0], rel=1e-6)
            assert sum(row.share for row in rows) == pytest.approx(1.0)


@pytest.mark.parametrize("light", [SPECTRAL, COLORED], ids=["spectral", "rgb"])
@pytest.mark.parametrize("seed", [1, 2])
def test_maps_in_lumen_and_in_watt_agree(light: dict[str, str], seed: int, tmp_path: Path) -> None:
    """Two sources of different spectrum and share, coloured walls, metal and a dye."""
    found = {}
    for unit in ("W", "lm"):
        result, ray_map = recorded(
            ROOM.format(unit=unit, **light), tmp_path / f"{unit}.raymap", rays=3_000, seed=seed
        )
        with ray_map:
            found[unit] = everything(result, ray_map, tmp_path)
    for name, value in found["W"].items():
        np.testing.assert_allclose(found["lm"][name], value, rtol=2e-4, atol=1e-9, err_msg=name)


def everything(result: RecordResult, ray_map: raymap.RayMap, folder: Path) -> dict[str, Any]:
    """What every part of the product says of the light, in lumen, lux, candela and colours."""
    plane, far = (query.detector_image(ray_map, name) for name in ("plane", "far"))
    values: dict[str, Any] = {
        "lux": plane.illuminance,
        "lux_se": plane.quantity("illuminance")[1],
        "candela": far.candela,
        "W/m²": plane.irradiance,
        "W/m²_se": plane.quantity("irradiance")[1],
        "xyz": plane.xyz,
        "xy": chromaticity(plane.xyz),
        "picture": plane.srgb().astype(float),
    }
    unit = ray_map.directory.flux_unit
    for name, image in (("plane", plane), ("far", far)):
        counted = result.detectors[name]
        np.testing.assert_allclose(counted.flux, image.flux, rtol=1e-4)
        np.testing.assert_allclose(counted.channels, image.channels, rtol=1e-4, atol=1e-12)
        assert result.fluxes["detectors"][name]["flux"] == pytest.approx(image.total, rel=1e-4)
        # Sums that a map without rays keeps of a detector
        sums, _ = counted.relative_sums()
        watts = sums * ray_map.photometry(0).result_factor(ray_map.emitted)
        np.testing.assert_allclose(watts, image.watts, rtol=1e-4, atol=1e-12)
    whole = audit(ray_map)
    counted = [
        [
            result.fluxes["sources"][source][kind]["flux"]
            for kind in query.answers.reports.energy.CLASSES
        ]
        for source in ("a", "b")
    ]
    np.testing.assert_allclose(whole.flux, counted, rtol=1e-6, atol=1e-9)
    for name, taken in result.fluxes["absorbed_by"]["objects"].items():
        assert whole.absorbed_by[name].sum() == pytest.approx(taken["flux"], rel=1e-6)
    if unit == "lm":
        # Lumens close within their errors, though all light changes colour
        close = 4 * np.sqrt((whole.flux_se**2).sum(axis=1))
        assert (np.abs(whole.flux.sum(axis=1) - [60, 90]) < close + 1e-6).all()
    else:
        np.testing.assert_allclose(whole.flux.sum(axis=1), whole.emitted_flux, rtol=1e-9)
    selected = query.select(ray_map, None)
    if unit == "lm":
        path = folder / "light.tm25ray"
        query.write_ray_file(selected, path, "plane", force=True)
        rays = rayfiles.read(path)
        assert rays.total_flux == pytest.approx(plane.total, rel=1e-4)
        assert rays.tristimulus is not None
        np.testing.assert_allclose(
            rays.tristimulus.sum(axis=0), plane.xyz.sum(axis=(0, 1)), rtol=1e-4
        )
        table = query.path_table(ray_map, 'detected("plane")')
        assert table.total == pytest.approx(
            query.select(ray_map, 'detected("plane")').flux, rel=1e-6
        )
        each = [query.report(ray_map, ray)["flux"] for ray in range(50)]
        bright = query.select(ray_map, f"flux > {float(np.median(each))} lm").ray_ids
        assert {ray for ray in bright if ray < 50} == {
            ray for ray, flux in enumerate(each) if flux > float(np.median(each))
        }
    return values


def test_coloured_walls_in_rgb_against_their_formula(tmp_path: Path) -> None:
    """One diffuse reflection of a wall (r, g, b): lm = Φ Σ c ρ Y / Σ c Y of linear sRGB."""
    color, wall = np.array((0.2, 0.3, 0.5)), np.array((0.9, 0.2, 0.1))
    text = f"""
length_unit = "m"
flux_unit = "lm"
[spectrum]
kind = "rgb"
[surfaces.wall]
kind = "lambertian"
reflectance = {{ rgb = {wall.tolist()} }}
[bodies.wall]
kind = "rectangle"
size = [2, 2]
position = [0, 0, 1]
surface = "wall"
[sources.s]
kind = "collimated"
diameter = 0.1
direction = [0, 0, 1]
flux = 100
spectrum = {{ rgb = {color.tolist()} }}
[detectors.back]
kind = "far_field"
cells = [1, 1]
"""
    y = np.array((0.2126, 0.7152, 0.0722))
    expected = 100.0 * (color * wall) @ y / (color @ y)
    lost = 100.0 * (color * (1 - wall)) @ y / (color @ y)
    result, ray_map = recorded(text, tmp_path / "a.raymap", rays=20_000)
    with ray_map:
        back = result.fluxes["sources"]["s"]["left"]
        assert back["flux"] == pytest.approx(expected, abs=4 * back["flux_se"])
        taken = result.fluxes["absorbed_by"]["objects"]["wall"]
        assert taken["flux"] == pytest.approx(lost, abs=4 * taken["flux_se"])
        image = query.detector_image(ray_map, "back")
        np.testing.assert_allclose(image.xyz[0, 0, 1], back["flux"], rtol=1e-4)


def test_stated_errors_of_lumens_cover(tmp_path: Path) -> None:
    """Over seeds the lumens behind the filter scatter as their errors say: χ² of 30."""
    scene = tmp_path / "s.toml"
    scene.write_text(LINES.format(unit="lm"), encoding="utf-8")
    v450, v550 = photopic([450.0, 550.0])
    left = 100.0 * v550 / (v450 + v550)
    runs = [record(scene, rays=512, seed=k, no_rays=True, threads=1) for k in range(30)]
    found = [run.fluxes["detectors"]["after"] for run in runs]
    pulls = np.array([(item["flux"] - left) / item["flux_se"] for item in found])
    assert abs(pulls.mean()) < 4 / np.sqrt(30)
    # 0.999 of χ²/30 lies in 0.39 .. 2.0
    assert 0.39 < (pulls**2).mean() < 2.0


DYE = """
length_unit = "m"
flux_unit = "lm"
[spectrum]
kind = "spectral"
wavelengths_nm = [450, 550, 610]
[media.dye]
index = 1.0
absorption = { wavelength_nm = [400, 500, 501, 580, 581, 700], value = [0.3, 0.3, 3, 3, 1, 1] }
[bodies.plate]
kind = "box"
size = [200000, 200000, 1]
medium = "dye"
[sources.s]
kind = "point"
flux = 100
inside = "plate"
spectrum = { lines = { wavelength_nm = [450, 550, 610], power = [3, 1, 1] } }
"""
"""Light of one path ends in any mixture of three colours, by the way that it had in the plate."""


@pytest.mark.slow
def test_stated_errors_of_mixed_light_cover(tmp_path: Path) -> None:
    """200 maps of a point in the middle of an absorbing plate: Σ P V E₂(a h) / Σ P V leave it.

    E₂ is the exponential integral (Abramowitz & Stegun, 5.1.4): the mean of exp(−a h / cos θ) over
    all directions.
    """
    power, a = np.array([3.0, 1.0, 1.0]), np.array([0.3, 3.0, 1.0])
    v = power * photopic([450.0, 550.0, 610.0])
    left = 100.0 * (v @ expn(2, a * 0.5)) / v.sum()
    pulls = []
    for seed in range(200):
        _, ray_map = recorded(DYE, tmp_path / "a.raymap", rays=1_000, seed=seed)
        with ray_map:
            assert asked_of_paths(ray_map, "event(left)")
            found = query.select(ray_map, "event(left)").summary()
            pulls.append((found["flux"] - left) / found["flux_se"])
            [merged] = ray_map.merged.paths.sum_wc
            assert (merged > 0.0).all(axis=1).any()
    assert abs(np.mean(pulls)) < 4 / np.sqrt(200)
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 200) / 200
    assert low < np.mean(np.square(pulls)) < high
    # 95 of 100 within 1.96 standard errors, as far as 200 tell
    within = np.mean(np.abs(pulls) < 1.96)
    assert abs(within - 0.95) < 4 * np.sqrt(0.95 * 0.05 / 200)


def test_equal_energy_daylight_is_shown_white(tmp_path: Path) -> None:
    """D65 (x = 0.3127, y = 0.3290) is the white of sRGB; channels are summed before the gamut."""
    text = """
length_unit = "mm"
flux_unit = "lm"
[spectrum]
kind = "spectral"
wavelengths_nm = { first = 400, last = 700, count = 31 }
[sources.s]
kind = "collimated"
diameter = 1
direction = [0, 0, 1]
flux = 100
spectrum = "D65"
[detectors.d]
position = [0, 0, 1]
looks = [0, 0, -1]
size = [4, 4]
cells = [1, 1]
"""
    _, ray_map = recorded(text, tmp_path / "a.raymap", rays=500)
    with ray_map:
        image = query.detector_image(ray_map, "d")
        assert image.srgb()[0, 0].min() >= 253
        np.testing.assert_allclose(chromaticity(image.xyz[0, 0]), (0.3127, 0.3290), atol=1e-3)
        assert image.xyz[0, 0, 1] == pytest.approx(100.0, rel=1e-4)
        query.write_ray_file(query.select(ray_map, None), tmp_path / "a.tm25ray", "d")
        rays = rayfiles.read(tmp_path / "a.tm25ray")
        assert rays.tristimulus is not None
        xy = chromaticity(rays.tristimulus.astype(float))
        np.testing.assert_allclose(xy, np.broadcast_to((0.3127, 0.3290), xy.shape), atol=1e-3)
        point = query.report(ray_map, 0)["points"][0]
        np.testing.assert_allclose(point["color"], 1.0, atol=0.02)


def test_invisible_light_has_no_lumens(tmp_path: Path) -> None:
    text = LINES.format(unit="lm").replace("[450, 550, 610]", "[900, 950, 1000]")
    text = text.replace('flux_unit = "lm"\nspectrum = { lines', "spectrum = { lines")
    scene = tmp_path / "s.toml"
    scene.write_text(text.replace("[450, 550], power", "[900, 950], power"), encoding="utf-8")
    with pytest.raises(raymap.RayMapError, match=r"sources\.s: the eye sees none of its light"):
        record(scene, tmp_path / "a.raymap", rays=100)

"""Detectors at the image of a lens file: they hold its direct light and block none of it."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

import tracer
from raymap.model.errors import SceneError
from tests.tracer.importers.lens_texts import messages, opened, zemax
from tracer.importers.lens_scene import import_lens
from tracer.importers.prescription import ImportWarning
from tracer.scene.load import load_scene, parse_scene
from tracer.transport.trace import trace_rays

N = 1.51680
FRONT = "STOP;CURV 0.02;DISZ 5;GLAS N-BK7 0 0 1.5 40;DIAM 10 0"


def singlet(distance: float) -> str:
    """A lens of R = 50 and -50, with its image behind it at a distance."""
    return zemax(FRONT, f"CURV -0.02;DISZ {distance};DIAM 10 0", "CURV 0;DISZ 0")


def registered(folder: Path, text: str) -> tuple[float, float]:
    """Flux on the detector `image`, and its standard error, of 20,000 rays."""
    path = folder / "lens.zmx"
    path.write_text(text, encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ImportWarning)
        scene = load_scene(path)
    result = tracer.record(scene, folder / "lens.raymap", rays=20_000, seed=2, threads=1)
    found = result.to_json()["fluxes"]["detectors"]["image"]
    return found["flux"], found["flux_se"]


@pytest.mark.parametrize("distance", [46.5, 47.2, 44.0])
def test_the_image_holds_all_direct_light(distance: float, tmp_path: Path) -> None:
    # Two faces near normal incidence pass (1 - R)^2, R = ((n - 1) / (n + 1))^2: 0.917. Even next to
    # the focus of the edge rays, where light of the zones within lies furthest from the axis
    flux, error = registered(tmp_path, singlet(distance))
    assert flux == pytest.approx((1.0 - ((N - 1) / (N + 1)) ** 2) ** 2, abs=4 * error)


def test_the_size_is_that_of_the_whole_pupil(tmp_path: Path) -> None:
    # Meridional rays by Snell's law at two spheres; the largest height where they meet the image
    heights = np.linspace(0.0, 5.0, 2001)
    lens, _ = opened(tmp_path, singlet(46.5))
    assert lens.image is not None
    largest = np.abs([meridional(y, 51.5) for y in heights]).max()
    edge = abs(meridional(5.0, 51.5))
    assert largest > 1.5 * edge
    assert lens.image.half == pytest.approx(1.2 * largest, rel=2e-3)


def meridional(y: float, z_image: float) -> float:
    """Height at a plane of a ray parallel to the axis through the lens of `singlet`."""
    p, d = np.array([y, 0.0]), np.array([0.0, 1.0])
    for vertex, radius, n1, n2 in ((0.0, 50.0, 1.0, N), (5.0, -50.0, N, 1.0)):
        centre = np.array([0.0, vertex + radius])
        b = d @ (p - centre)
        root = np.sqrt(b * b - (p - centre) @ (p - centre) + radius**2)
        p = p + (-b - np.copysign(root, radius)) * d
        normal = (centre - p) / radius
        cosine, eta = d @ normal, n1 / n2
        d = eta * d + (np.sqrt(1 - eta**2 * (1 - cosine**2)) - eta * cosine) * normal
    return float(p[0] + (z_image - p[1]) * d[0] / d[1])


def test_a_virtual_image_gets_no_detector(tmp_path: Path) -> None:
    diverging = FRONT.replace("0.02", "-0.02")
    text = zemax(diverging, "CURV 0.02;DISZ -48.6;DIAM 12 0", "CURV 0;DISZ 0")
    lens, said = opened(tmp_path, text)
    assert lens.scene_tables()["detectors"] == {}
    assert "the image lies 48.6 before surface 2" in said[0]
    (tmp_path / "lens.zmx").write_text(text, encoding="utf-8")
    with pytest.warns(ImportWarning, match="virtual"):
        scene = load_scene(tmp_path / "lens.zmx")
    result = tracer.record(scene, tmp_path / "x.raymap", rays=100, threads=1)
    assert result.to_json()["rays"] == 100
    # Behind a plane where nothing happens the same image is real
    back = zemax(FRONT, "CURV -0.02;DISZ 60;DIAM 10 0", "DISZ -13.5", "CURV 0;DISZ 0")
    assert opened(tmp_path, back)[0].image is not None


def test_an_image_in_the_beam_lets_light_pass(tmp_path: Path) -> None:
    # A paraboloid brings all its light to the focus at R / 2
    stop, mirror = "STOP;DISZ 200;DIAM 10 0", "CURV -0.005;DISZ -100;GLAS MIRROR;CONI -1;DIAM 12 0"
    text = zemax(stop, mirror, "CURV 0;DISZ 0;DIAM 10 0", epd=20)
    lens, said = opened(tmp_path, text)
    assert lens.scene_tables()["detectors"]["image"]["blocking"] is False
    assert "the image lies in the light on its way to the lens" in said[0]
    assert registered(tmp_path, text) == pytest.approx((1.0, 0.0), abs=1e-6)
    assert opened(tmp_path, singlet(46.5))[0].image_parts()["detectors"]["image"]["blocking"]


SCHMIDT = zemax(
    "STOP;DISZ 200;DIAM 30 0", "CURV -0.005;DISZ -100;GLAS MIRROR;DIAM 50 0",
    "CURV -0.01;DISZ 0;DIAM 9 0",
    epd=60, head="FTYP 0 0 2 1\nXFLN 0 0\nYFLN 0 5",
)  # fmt: skip


def test_a_curved_image_is_a_surface(tmp_path: Path) -> None:
    # A spherical mirror with the stop at its centre: by vectors, |p| = 200 and then |p| = 100
    path = tmp_path / "lens.zmx"
    path.write_text(SCHMIDT, encoding="utf-8")
    with pytest.warns(ImportWarning, match="lies in the light on its way"):
        scene = load_scene(path)
    assert scene.detectors["image"].kind == "surface"
    rng = np.random.default_rng(4)
    r, phi = 30.0 * np.sqrt(rng.random(4000)), 2.0 * np.pi * rng.random(4000)
    p = np.column_stack([r * np.cos(phi), r * np.sin(phi), np.zeros(4000)])
    d = np.array([0.0, np.sin(np.radians(5.0)), np.cos(np.radians(5.0))])
    met = p + (np.sqrt(200.0**2 - np.sum(p * p, axis=1) + (p @ d) ** 2) - p @ d)[:, None] * d
    normal = -met / 200.0
    away = d - 2.0 * (normal @ d)[:, None] * normal
    along = np.sum(met * away, axis=1)
    expected = met + (-along - np.sqrt(along**2 - 200.0**2 + 100.0**2))[:, None] * away
    traced = trace_rays(scene, p - d, np.tile(d, (4000, 1)), wavelength_nm=587.5618)
    mirror, image = (traced.object_names.index(name) for name in ("M1", "image_surface"))
    at = np.flatnonzero((traced.object[1:] == image) & (traced.object[:-1] == mirror)) + 1
    assert len(at) == 4000
    spot = traced.points[at]
    assert np.abs(spot - expected).max() < 1e-9
    # Third order: the blur of an edge ray is r³ / (2 R²), its root mean square half of that
    rms = np.sqrt(np.mean(np.sum((spot - spot.mean(axis=0)) ** 2, axis=1)))
    assert rms == pytest.approx(30.0**3 / (2 * 200.0**2) / 2.0, rel=0.06)
    assert registered(tmp_path, SCHMIDT)[0] == pytest.approx(2.0, rel=0.01)


def test_a_curved_image_blocks_where_nothing_passes_it(tmp_path: Path) -> None:
    text = singlet(47.0).replace("CURV 0\n", "CURV -0.03\n")
    flux, error = registered(tmp_path, text)
    assert flux == pytest.approx((1.0 - ((N - 1) / (N + 1)) ** 2) ** 2, abs=4 * error)


def test_a_dark_field_is_left_out(tmp_path: Path) -> None:
    parts = (
        "DISZ 60;DIAM 6 1", "CURV 0.02;DISZ 5;GLAS N-BK7;DIAM 6 1", "CURV -0.02;DISZ 10;DIAM 6 1",
        "STOP;DISZ 37;DIAM 3 0", "CURV 0;DISZ 0",
    )  # fmt: skip
    text = zemax(*parts, head="FTYP 0 0 3 1\nXFLN 0 0 0\nYFLN 0 3 25", epd=6)
    lens, said = opened(tmp_path, text)
    assert list(lens.sources()) == ["axis", "field_2"]
    assert said == [
        "lens.zmx: field 3 (0, 25): no light gets through the stop, the apertures and its "
        "vignetting; the field is left out"
    ]


def test_a_lens_in_a_scene_brings_its_image(tmp_path: Path) -> None:
    (tmp_path / "lens.zmx").write_text(SCHMIDT, encoding="utf-8")
    text = """
length_unit = "cm"
[lens_files.eye]
file = "lens.zmx"
position = [1, 2, 3]
rotation = [20, -35, 80]
sources = true
image = true
"""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene = parse_scene(text, folder=tmp_path)
    assert len(messages(caught)) == 1
    assert scene.detectors["eye.image"].face == "eye.image_surface.back"
    result = tracer.record(scene, tmp_path / "x.raymap", rays=2000, threads=1)
    assert result.to_json()["fluxes"]["detectors"]["eye.image"]["flux"] == pytest.approx(
        2.0, rel=0.03
    )


def test_an_object_in_water_is_refused_by_name(tmp_path: Path) -> None:
    text = zemax("CURV 0;DISZ 1;GLAS N-BK7;DIAM 6 0", "STOP;CURV -0.1;DISZ 50;DIAM 5 0", "DISZ 0")
    path = tmp_path / "lens.zmx"
    path.write_text(text.replace("DISZ INFINITY", "DISZ 10\n  GLAS WATER"), encoding="utf-8")
    with pytest.raises(SceneError, match="surface 0: the object lies in WATER"):
        import_lens(path).scene_tables()

"""Formats of pictures, charts and 3D files of another distribution."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile

import query
import raymap
import viewer
from tests.plugins.installing import install, run
from tests.viewer.small_map import write_map


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(tmp_path_factory.mktemp("site"))


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("map") / "small.raymap"
    write_map(found)
    return found


def pixmap(path: Path) -> np.ndarray:
    kind, size, most, data = path.read_bytes().split(b"\n", 3)
    assert (kind, most) == (b"P6", b"255")
    width, height = map(int, size.split())
    return np.frombuffer(data, np.uint8).reshape(height, width, 3)


def test_an_image_is_written_by_its_suffix(site: Path, path: Path, tmp_path: Path) -> None:
    with raymap.open(path) as opened:
        name = opened.directory.detectors[0].name
        image = query.detector_image(opened, name)
    done = run(site, "-m", "raymap", "image", str(path), name, "-o", str(tmp_path / "a.ppm"))
    assert done.returncode == 0, done.stderr
    np.testing.assert_array_equal(pixmap(tmp_path / "a.ppm"), image.srgb()[::-1])


def test_a_picture_of_the_scene_too(site: Path, path: Path, tmp_path: Path) -> None:
    with raymap.open(path) as opened:
        right = viewer.picture(opened, size=(160, 90))
    words = (
        "picture",
        str(path),
        "-o",
        str(tmp_path / "a.ppm"),
        "--width",
        "160",
        "--height",
        "90",
    )
    done = run(site, "-m", "raymap", *words)
    assert done.returncode == 0, done.stderr
    np.testing.assert_array_equal(pixmap(tmp_path / "a.ppm"), right)


def test_a_3d_file_holds_every_segment(site: Path, path: Path, tmp_path: Path) -> None:
    with raymap.open(path) as opened:
        written = viewer.export_3d(opened, tmp_path / "right.glb")
    done = run(site, "-m", "raymap", "export-3d", str(path), "-o", str(tmp_path / "a.lines"))
    assert done.returncode == 0, done.stderr
    rows = (tmp_path / "a.lines").read_text(encoding="utf-8").splitlines()
    segments = [row for row in rows if row.startswith("ray")]
    assert len(segments) == written["segments"] > 0
    assert all(len(row.split()) == 7 for row in segments)
    assert any(row.startswith("body") for row in rows)


def test_a_chart_is_written_by_its_suffix(site: Path, path: Path, tmp_path: Path) -> None:
    with raymap.open(path) as opened:
        name = opened.directory.detectors[0].name
    chart = tmp_path / "a.eps"
    done = run(site, "-m", "raymap", "chart", str(path), name, "-o", str(chart))
    assert done.returncode == 0, done.stderr
    text = chart.read_text(encoding="latin-1")
    assert text.startswith("%!PS-Adobe-3.0 EPSF-3.0")
    assert text.endswith("showpage\n")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("image", "{map}", "{detector}", "-o", "a.xyz"),
            "pictures end in .png, .tiff, .tif, ",
        ),
        (("image", "{map}", "{detector}", "-o", "a.xyz"), ".ies, .ppm, not 'a.xyz'"),
        (
            ("image", "{map}", "{detector}", "-o", "a.ppm", "--kind", "flux"),
            ".ppm files hold rgb, not flux; leave the kind out, or write .png, .tiff",
        ),
        (
            ("picture", "{map}", "-o", "a.exr"),
            "in .png, .tiff, .tif, .jpg, .jpeg, .ppm, not 'a.exr'",
        ),
        (("chart", "{map}", "{detector}", "-o", "a.xyz"), ".png, .pdf, .svg, .eps, not 'a.xyz'"),
        (("export-3d", "{map}", "-o", "a.xyz"), ".step, .stp, .lines, not 'a.xyz'"),
    ],
)
def test_files_of_no_format_name_those_that_there_are(
    site: Path, path: Path, tmp_path: Path, words: tuple[str, ...], message: str
) -> None:
    with raymap.open(path) as opened:
        name = opened.directory.detectors[0].name
    given = (word.format(map=path, detector=name) for word in words)
    done = run(site, "-m", "raymap", *given, folder=tmp_path)
    assert done.returncode == 1
    assert message in done.stderr


def test_a_picture_is_a_tiff(path: Path, tmp_path: Path) -> None:
    with raymap.open(path) as opened:
        right = viewer.picture(opened, size=(64, 48), out=tmp_path / "a.tiff")
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "a.tiff"), right)

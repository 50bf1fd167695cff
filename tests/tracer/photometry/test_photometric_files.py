"""Photometric files of makers: flux, orientation, symmetry; and files that lie."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

from raymap.errors import SceneError
from tracer.light import IntensityGrid
from tracer.photometry import eulumdat, lm63

FILES = Path(__file__).parents[2] / "data" / "photometry"
HEADERS = {
    "projector.ldt": 6500 * 0.7771,
    "road_luminaire.ldt": 33200 * 0.8442,
    "floodlight_asymmetric.ldt": 123_000 * 0.998,
    "maxwell_measured.ies": 1000.0,
}


def read(path: Path) -> IntensityGrid:
    return (lm63 if path.suffix == ".ies" else eulumdat).read(path)


@pytest.mark.parametrize("name", HEADERS)
def test_total_flux_is_the_headers(name: str) -> None:
    assert read(FILES / name).flux == pytest.approx(HEADERS[name], rel=2e-4)


@pytest.mark.peers
@pytest.mark.parametrize(
    "name", ["projector.ldt", "road_luminaire.ldt", "floodlight_asymmetric.ldt"]
)
def test_intensities_are_those_of_another_reader(name: str) -> None:
    pyldt = pytest.importorskip("pyldt")
    other = pyldt.LdtReader.read(FILES / name)
    grid = read(FILES / name)
    head = other.header
    gamma, planes = np.meshgrid(head.g_angles, head.c_angles)
    found = grid.at(gamma, planes)
    wanted = np.array(other.intensities) * head.lamp_flux[0] / 1000
    # Ours are scaled to the flux of the header: the same factor everywhere
    factor = found.sum() / wanted.sum()
    np.testing.assert_allclose(found, factor * wanted, rtol=1e-9, atol=1e-9)
    assert factor == pytest.approx(1.0, abs=0.03)


@pytest.mark.peers
@pytest.mark.parametrize("name", ["italo.ies", "maxwell_measured.ies"])
def test_ies_intensities_are_those_of_another_reader(name: str) -> None:
    eulumdat_ies = pytest.importorskip("eulumdat_ies")
    with warnings.catch_warnings(action="ignore"):
        other = eulumdat_ies.ies_to_ldt(FILES / name)
    gamma, planes = np.meshgrid(other.header.g_angles, other.header.c_angles)
    found = read(FILES / name).at(gamma, planes)
    np.testing.assert_allclose(found, np.array(other.intensities), rtol=1e-9, atol=1e-9)


def test_the_planes_of_a_symmetry_about_c90() -> None:
    grid = read(FILES / "road_luminaire.ldt")
    for c in (0, 30, 45, 75):
        for gamma in (10, 35, 60):
            assert grid.at(gamma, c) == pytest.approx(grid.at(gamma, 180 - c))
    # The lines of C270 come first in the file: its 2nd gamma of the first plane
    lines = (FILES / "road_luminaire.ldt").read_text("latin-1").splitlines()
    first = 42 + 52 + 25
    ratio = grid.at(10.0, 270.0) / grid.at(10.0, 90.0)
    wanted = float(lines[first + 1]) / float(lines[first + 26 * 25 + 1])
    assert ratio == pytest.approx(wanted)


def test_the_luminous_opening() -> None:
    assert read(FILES / "italo.ies").opening == (0.146, 0.230)
    assert read(FILES / "floodlight_asymmetric.ldt").opening == (475.0, 400.0)
    assert read(FILES / "road_luminaire.ldt").opening == 472.0
    assert read(FILES / "maxwell_measured.ies").opening is None


IES = """IESNA:LM-63-2002
[TEST] none
TILT={tilt}
1 1000 {multiplier} {v} {h} {kind} 2 -0.1 -0.1 0
{ballast} 1 20
0 45 90
0 90
100 50 0
100 80 0
"""


def ies(tmp_path: Path, **changes: object) -> Path:
    values = {"tilt": "NONE", "multiplier": 1, "v": 3, "h": 2, "kind": 1, "ballast": 1} | changes
    path = tmp_path / "lamp.ies"
    path.write_text(IES.format(**values))
    return path


def test_factors_count(tmp_path: Path) -> None:
    plain = read(ies(tmp_path))
    assert plain.at(0, 0) == 100
    assert plain.at(45, 45) == pytest.approx(65)
    assert plain.at(45, 135) == pytest.approx(65)
    assert plain.opening == 0.1
    assert read(ies(tmp_path, multiplier=2, ballast=0.9)).at(0, 0) == pytest.approx(180)
    tilted = read(ies(tmp_path, tilt="INCLUDE\n1\n3\n0 45 90\n1 0.9 0.8"))
    np.testing.assert_array_equal(tilted.intensity, plain.intensity)


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"v": 4}, "promises 4 vertical and 2 horizontal angles"),
        ({"h": 3}, "the file has 24"),
        ({"v": 0}, "0 vertical angles"),
        ({"v": 1e30}, "vertical angles"),
        ({"kind": 3}, "photometric type A"),
        ({"multiplier": "x"}, "line 4 is not numbers"),
        ({"multiplier": "nan"}, "not a finite number"),
        ({"multiplier": 0}, "multiplier 0"),
        ({"tilt": "INCLUDE"}, "tilt angles|promises|ends before"),
    ],
)
def test_ies_files_that_lie(tmp_path: Path, changes: dict[str, object], what: str) -> None:
    with pytest.raises(SceneError, match=what) as error:
        read(ies(tmp_path, **changes))
    assert "lamp.ies" in str(error.value)


def test_files_of_another_kind(tmp_path: Path) -> None:
    for name in ("a.ies", "a.ldt"):
        path = tmp_path / name
        for raw in (b"", b"hello\n", bytes(range(256)) * 40):
            path.write_bytes(raw)
            with pytest.raises(SceneError, match=name):
                read(path)


@pytest.mark.parametrize(
    ("line", "text", "what"),
    [
        (3, "7", "symmetry 7"),
        (3, "3", "lines more than"),
        (44, "400", "must rise"),
        (4, "7", "lines more|do not|must"),
        (4, "8.5", "number of C planes is 8.5"),
        (4, "-8", "number of C planes is -8"),
        (4, "9", "ends at line|C angles must rise|gamma must rise|more"),
        (6, "1e9", "number of gamma angles"),
        (23, "0", "make no light"),
        (29, "many", "line 29 is 'many'"),
        (29, "nan", "line 29 is 'nan'"),
        (50, "x", "stand in EULUMDAT"),
    ],
)
def test_ldt_files_that_lie(tmp_path: Path, line: int, text: str, what: str) -> None:
    lines = (FILES / "floodlight_asymmetric.ldt").read_text("latin-1").splitlines()
    lines[line - 1] = text
    path = tmp_path / "bad.ldt"
    path.write_text("\n".join(lines), "latin-1")
    with pytest.raises(SceneError, match=what) as error:
        read(path)
    assert "bad.ldt" in str(error.value)


def test_a_flux_that_differs_warns(tmp_path: Path) -> None:
    lines = (FILES / "floodlight_asymmetric.ldt").read_text("latin-1").splitlines()
    lines[22] = "50"
    path = tmp_path / "half.ldt"
    path.write_text("\n".join(lines), "latin-1")
    with pytest.warns(UserWarning, match="the header counts"):
        assert read(path).flux == pytest.approx(61_500)

"""Photometric files of makers: flux, orientation, symmetry; and files that lie."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

from raymap.model.errors import SceneError
from tracer.light import IntensityGrid, Opening
from tracer.photometry import eulumdat, lm63

FILES = Path(__file__).parents[2] / "data" / "photometry"


def read(path: Path) -> IntensityGrid:
    return (lm63 if path.suffix == ".ies" else eulumdat).read(path)


def test_the_flux_of_absolute_photometry_is_its_integral() -> None:
    # The header of this file states the flux that the laboratory integrated
    assert read(FILES / "maxwell_measured.ies").flux == pytest.approx(1000.0, rel=2e-4)


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
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9)


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
    # 472 mm round with luminous sides of 140 mm, as lines 16 to 21 of the file say
    assert read(FILES / "road_luminaire.ldt").opening == Opening(
        shape="upright cylinder", size=(472.0, 472.0, 140.0)
    )
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
        ({"kind": 7}, "photometric type 7"),
        ({"multiplier": "x"}, "line 4 is not numbers"),
        ({"multiplier": "nan"}, "not a finite number"),
        ({"multiplier": "1_0"}, "line 4 is not numbers"),
        ({"kind": 1.7}, "photometric type 1.7"),
        ({"multiplier": 0}, "multiplier 0"),
        ({"tilt": "INCLUDE"}, "tilt angles|promises|ends before"),
    ],
)
def test_ies_files_that_lie(tmp_path: Path, changes: dict[str, object], what: str) -> None:
    with pytest.raises(SceneError, match=what) as error:
        read(ies(tmp_path, **changes))
    assert "lamp.ies" in str(error.value)


@pytest.mark.parametrize(
    ("first", "factor"),
    [
        ("IESNA:LM-63-2002", 1.0),
        ("IESNA: LM-63-2002", 1.0),
        ("IES LM-63-2019", 1.0),
        ("IESNA:LM-63-02", 1.0),
        ("\nIESNA:LM-63-1995", 1.0),
        ("IESNA91", 0.5),
        ("IESNA:LM-63-1991", 0.5),
        ("a lamp of 1986", 0.5),
    ],
)
@pytest.mark.filterwarnings("ignore:.*future use")
def test_the_edition_however_its_line_is_written(first: str, factor: float, tmp_path: Path) -> None:
    """The ballast-lamp factor counts up to 1991."""
    text = ies(tmp_path).read_text().replace("IESNA:LM-63-2002", first).replace("1 1 20", "1 .5 20")
    (tmp_path / "lamp.ies").write_text(text)
    assert read(tmp_path / "lamp.ies").at(0, 0) == pytest.approx(100 * factor)


@pytest.mark.parametrize("end", ["\x1a\r\n", "\r\n\x1a\r\n\r\n", "\0\0\n", "\x1a \x1a\n"])
def test_labels_that_begin_like_tilt_and_marks_of_the_end(end: str, tmp_path: Path) -> None:
    text = ies(tmp_path).read_text().replace("[TEST] none", "TILTED FLOODLIGHT\n[TEST] TILT=45")
    (tmp_path / "lamp.ies").write_bytes((text + end).encode())
    assert read(tmp_path / "lamp.ies").at(45, 45) == pytest.approx(65)


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
        (29, "0", "make no light"),
        (29, "many", "line 29 is 'many'"),
        (29, "nan", "line 29 is 'nan'"),
        (50, "x", "stand in EULUMDAT"),
        (50, "1_0", "line 50 is '1_0'"),
        (50, "inf", "line 50 is 'inf'"),
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
    """Intensities are cd/klm times the flux of the lamps; what the header says is named."""
    whole = read(FILES / "floodlight_asymmetric.ldt").flux
    lines = (FILES / "floodlight_asymmetric.ldt").read_text("latin-1").splitlines()
    lines[22] = "50"
    path = tmp_path / "half.ldt"
    path.write_text("\n".join(lines), "latin-1")
    with pytest.warns(UserWarning, match="would make 61500 lm"):
        assert read(path).flux == whole


def test_a_lamp_measured_at_a_tilt_is_named(tmp_path: Path) -> None:
    lines = (FILES / "floodlight_asymmetric.ldt").read_text("latin-1").splitlines()
    lines[24] = "15"
    path = tmp_path / "tilted.ldt"
    path.write_text("\n".join(lines), "latin-1")
    with pytest.warns(UserWarning, match="tilted by 15 degrees"):
        read(path)


@pytest.mark.parametrize(
    ("line", "step", "said"),
    [
        (5, "15", r"C planes 15 degrees apart, and lists them 5 degrees apart"),
        (7, "2.5", r"gamma angles 2\.5 degrees apart, and lists them .* degrees apart"),
    ],
)
def test_steps_that_the_lists_of_angles_do_not_have_are_named(
    line: int, step: str, said: str, tmp_path: Path
) -> None:
    """The format states the steps Dc and Dg beside the lists; 0 where they are unequal."""
    lines = (FILES / "projector.ldt").read_text("latin-1").splitlines()
    lines[line - 1] = step
    path = tmp_path / "steps.ldt"
    path.write_text("\n".join(lines), "latin-1")
    with pytest.warns(UserWarning, match=said):
        grid = read(path)
    np.testing.assert_array_equal(grid.intensity, read(FILES / "projector.ldt").intensity)


# -- text ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["projector.ldt", "italo.ies"])
@pytest.mark.parametrize("maker", ["Świetlenie Dąb", "Öçğş", "Завод Света", "照明"])
def test_names_in_any_encoding_change_nothing(tmp_path: Path, name: str, maker: str) -> None:
    lines = (FILES / name).read_text("latin-1").splitlines()
    path = tmp_path / name
    plain = read(FILES / name)
    place = 0 if name.endswith("ldt") else 1
    for encoding in ("utf-8", "utf-8-sig", "cp1250", "cp1251", "cp1254", "gb18030", "utf-16"):
        for end in ("\r\n", "\n", "\r"):
            text = end.join([*lines[:place], f"[OTHER] {maker} …", *lines[place + 1 :]])
            for behind in ("", "\x1a", "\r\n\x1a\0\0\0"):
                path.write_bytes((text + behind).encode(encoding, errors="replace"))
                found = read(path)
                np.testing.assert_array_equal(found.intensity, plain.intensity)
                assert found.opening == plain.opening


def test_every_byte_may_stand_in_a_name(tmp_path: Path) -> None:
    raw = (FILES / "projector.ldt").read_bytes().splitlines()
    plain = read(FILES / "projector.ldt")
    for byte in range(256):
        if byte in b"\r\n":
            continue
        raw[0] = b"Maker " + bytes([byte]) + b" of lamps"
        path = tmp_path / "lamp.ldt"
        path.write_bytes(b"\r\n".join(raw))
        np.testing.assert_array_equal(read(path).intensity, plain.intensity)


# -- openings of LM-63 ----------------------------------------------------------------------------

OPENINGS = """{edition}
[TEST] none
TILT=NONE
1 -1 1 3 1 1 2 {sizes}
1 1 10
0 45 90
0
1000 707.107 0
"""

# The tables of LM-63: until 1995, and from 2002 on. Sizes of ours: along C0 (length), along C90
# (width), height
EARLY, LATE = ("IESNA91", "IESNA:LM-63-1995"), ("IESNA:LM-63-2002", "IES:LM-63-2019")
BOTH = EARLY + LATE
TABLE: list[tuple[tuple[str, ...], str, object]] = [
    (BOTH, "0 0 0", None),
    (BOTH, "0.3 1.2 0", (1.2, 0.3)),
    (BOTH, "0.3 1.2 0.1", Opening(shape="box", size=(1.2, 0.3, 0.1))),
    (EARLY, "-0.3 0 0", 0.3),
    (EARLY, "-0.3 0 0.2", Opening(shape="upright cylinder", size=(0.3, 0.3, 0.2))),
    (EARLY, "-0.3 0 -0.3", Opening(shape="ellipsoid", size=(0.3, 0.3, 0.3))),
    (EARLY, "0 1.2 -0.03", Opening(shape="cylinder along C0", size=(1.2, 0.03, 0.03))),
    (EARLY, "1.2 0 -0.03", Opening(shape="cylinder along C90", size=(0.03, 1.2, 0.03))),
    (EARLY, "-0.3 1.2 0", Opening(shape="ellipse", size=(1.2, 0.3, 0.0))),
    (EARLY, "1.2 -0.3 0", Opening(shape="ellipse", size=(0.3, 1.2, 0.0))),
    (EARLY[1:], "-0.3 1.2 0.2", Opening(shape="upright cylinder", size=(1.2, 0.3, 0.2))),
    (EARLY, "-0.3 1.2 -0.2", Opening(shape="ellipsoid", size=(1.2, 0.3, 0.2))),
    (LATE, "-0.3 -0.3 0", 0.3),
    (LATE, "-0.3 -1.2 0", Opening(shape="ellipse", size=(1.2, 0.3, 0.0))),
    (LATE, "-0.3 -0.3 0.2", Opening(shape="upright cylinder", size=(0.3, 0.3, 0.2))),
    (LATE, "-0.3 -1.2 0.2", Opening(shape="upright cylinder", size=(1.2, 0.3, 0.2))),
    (LATE, "-0.3 -0.3 -0.3", Opening(shape="ellipsoid", size=(0.3, 0.3, 0.3))),
    (LATE, "-0.3 -1.2 -0.2", Opening(shape="ellipsoid", size=(1.2, 0.3, 0.2))),
    (LATE, "-0.03 1.2 -0.03", Opening(shape="cylinder along C0", size=(1.2, 0.03, 0.03))),
    (LATE, "-0.03 1.2 -0.05", Opening(shape="cylinder along C0", size=(1.2, 0.03, 0.05))),
    (LATE, "1.2 -0.03 -0.03", Opening(shape="cylinder along C90", size=(0.03, 1.2, 0.03))),
    (LATE, "-0.3 0 -0.2", Opening(shape="cylinder along C0", size=(0.0, 0.3, 0.2))),
]


@pytest.mark.parametrize(("editions", "sizes", "wanted"), TABLE)
def test_shapes_of_openings_are_those_of_the_standard(
    tmp_path: Path, editions: tuple[str, ...], sizes: str, wanted: object
) -> None:
    for edition in editions:
        path = tmp_path / "lamp.ies"
        path.write_text(OPENINGS.format(edition=edition, sizes=sizes))
        assert read(path).opening == wanted, edition


def test_an_opening_that_means_nothing_is_named(tmp_path: Path) -> None:
    path = tmp_path / "lamp.ies"
    path.write_text(OPENINGS.format(edition=LATE[0], sizes="0.3 1.2 -0.1"))
    with pytest.warns(UserWarning, match="mean nothing in LM-63"):
        assert read(path).opening == Opening(shape="box", size=(1.2, 0.3, 0.1))


def test_the_third_factor_counts_up_to_1991_only(tmp_path: Path) -> None:
    """2019 states there how the file was made (1.1: an accredited laboratory)."""
    path = tmp_path / "lamp.ies"
    for edition, wanted in (("IESNA91", 900.0), ("IES:LM-63-2019", 1000.0)):
        text = OPENINGS.format(edition=edition, sizes="0 0 0").replace("1 1 10", "1 0.9 10")
        path.write_text(text)
        assert read(path).at(0, 0) == pytest.approx(wanted)
    path.write_text(text.replace("2019", "2002"))
    with pytest.warns(UserWarning, match="future use"):
        assert read(path).at(0, 0) == pytest.approx(1000.0)


# -- types A and B --------------------------------------------------------------------------------


def of_type(tmp_path: Path, kind: int, vertical: np.ndarray, horizontal: np.ndarray,
            values: np.ndarray) -> IntensityGrid:  # fmt: skip
    """A file of photometric type 2 (B) or 3 (A); values (vertical, horizontal)."""
    words = [
        f"1 -1 1 {len(vertical)} {len(horizontal)} {kind} 2 0 0 0",
        "1 1 10",
        " ".join(f"{angle:g}" for angle in vertical),
        " ".join(f"{angle:g}" for angle in horizontal),
        *(" ".join(f"{value:.8g}" for value in row) for row in values.T),
    ]
    path = tmp_path / "lamp.ies"
    path.write_text("\n".join(["IESNA:LM-63-2002", "[TEST] x", "TILT=NONE", *words, ""]))
    return read(path)


def test_type_b_turns_about_the_width(tmp_path: Path) -> None:
    """Intensities of the directions that LM-63 names: V = 0 nadir, V = 90 C0, H clockwise."""
    vertical, horizontal = np.arange(-90.0, 91.0, 2.0), np.arange(-90.0, 91.0, 2.0)
    v, h = np.meshgrid(np.radians(vertical), np.radians(horizontal), indexing="ij")
    x, y, z = np.sin(v) * np.cos(h), -np.sin(h), -np.cos(v) * np.cos(h)

    def law(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        return (1 - z) * (1 + 0.5 * x + 0.25 * y) + 0.3

    grid = of_type(tmp_path, 2, vertical, horizontal, law(x, y, z))
    gamma, c = np.meshgrid(np.arange(0.0, 88.0, 7.0), np.arange(0.0, 360.0, 15.0))
    g, turn = np.radians(gamma), np.radians(c)
    wanted = law(np.sin(g) * np.cos(turn), np.sin(g) * np.sin(turn), -np.cos(g))
    np.testing.assert_allclose(grid.at(gamma, c), wanted, rtol=2e-3)
    # A half space of this law: 2 pi (1 + 1/2 + 0.3), since x and y cancel
    assert grid.flux == pytest.approx(2 * np.pi * 1.8, rel=2e-3)


def test_type_b_of_one_quarter_is_seen_in_both_planes(tmp_path: Path) -> None:
    angles = np.arange(0.0, 31.0, 1.0)
    # A pyramid of light between V and H of 30 degrees: in type B dV cos H dH is the solid angle
    grid = of_type(tmp_path, 2, angles, angles, np.ones((31, 31)))
    assert grid.flux == pytest.approx(np.radians(60) * 2 * np.sin(np.radians(30)), rel=0.01)
    assert grid.at([25, 25, 35], [0, 200, 0]) == pytest.approx([1, 1, 0])


def test_type_b_of_one_plane_is_round(tmp_path: Path) -> None:
    angles = np.arange(0.0, 91.0, 15.0)
    values = 300 * np.cos(np.radians(angles))[:, None]
    with pytest.warns(UserWarning, match="all round the direction"):
        grid = of_type(tmp_path, 2, angles, np.zeros(1), values)
    # A Lambertian lamp of 300 cd makes 300 pi lm; 15 degree steps are linear in between
    assert grid.flux == pytest.approx(300 * np.pi, rel=0.006)
    assert grid.at(30, 123) == pytest.approx(300 * np.cos(np.radians(30)))


def test_type_a_turns_about_the_upright_axis(tmp_path: Path) -> None:
    """A headlamp: V = H = 0 is C0 at the horizon; right of it (clockwise from above) is C270."""
    vertical, horizontal = np.arange(-10.0, 11.0, 1.0), np.arange(-30.0, 31.0, 1.0)
    v, h = np.meshgrid(vertical, horizontal, indexing="ij")
    values = 1000 + 10 * v + h
    grid = of_type(tmp_path, 3, vertical, horizontal, values)
    assert grid.at([90, 85, 95, 90, 90], [0, 0, 0, 340, 20]) == pytest.approx(
        [1000, 950, 1050, 1020, 980]
    )
    assert grid.at([90, 70, 90], [40, 0, 180]) == pytest.approx([0, 0, 0], abs=1e-9)
    wanted = 1000 * np.radians(60) * 2 * np.sin(np.radians(10))
    assert grid.flux == pytest.approx(wanted, rel=1e-3)


@pytest.mark.parametrize(
    ("kind", "vertical", "horizontal", "what"),
    [
        (2, [0, 45, 200], [-90, 0, 90], "vertical angles that rise within -180 .. 180"),
        (2, [0, 45, 90], [-120, 0, 90], "horizontal angles that rise within -90 .. 90"),
        (3, [-100, 0, 90], [-90, 0, 90], "vertical angles that rise within -90 .. 90"),
        (3, [0, 45, 90], [0], "two or more horizontal angles"),
        (2, [-20, 0, 90], [0], "alike to both sides"),
    ],
)
def test_angles_of_another_type(
    tmp_path: Path, kind: int, vertical: list[float], horizontal: list[float], what: str
) -> None:
    values = np.ones((len(vertical), len(horizontal)))
    with pytest.raises(SceneError, match=what):
        of_type(tmp_path, kind, np.array(vertical), np.array(horizontal), values)

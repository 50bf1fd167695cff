"""Every word of a lens file is read, known to be harmless, warned about or refused: none is lost.

Focal lengths are those of the thick lens, 1/f = (n - 1) (1/R1 - 1/R2 + (n - 1) d / (n R1 R2)), with
the index 1.51680 that Schott's catalogue gives N-BK7 at the d line.
"""

from __future__ import annotations

import contextlib
import json
import re
import warnings
from pathlib import Path

import pytest
from typer.testing import CliRunner

from raymap.cli import application
from raymap.model.errors import SceneError
from tests.tracer.importers.lens_texts import codev, opened, zemax
from tracer.importers.face_list import list_faces
from tracer.importers.lens_format import read_prescription
from tracer.importers.lens_formats import codev_words, zemax_words
from tracer.importers.lens_formats.codev import parse_codev
from tracer.importers.lens_formats.zemax import parse_zemax
from tracer.importers.prescription import ImportWarning
from tracer.scene.load import load_scene, parse_scene

N = 1.51680
PAGE = Path(__file__).parents[3] / "docs" / "lens_files.md"

FRONT = "STOP;TYPE STANDARD;CURV 0.02;DISZ 5;GLAS N-BK7 0 0 1.5 40;DIAM 10 0"
BACK = "TYPE STANDARD;CURV -0.02;DISZ 46.5;DIAM 10 0"
IMAGE = "TYPE STANDARD;CURV 0;DISZ 0"
SINGLET = zemax(FRONT, BACK, IMAGE)
BODY = "S 50 5 NBK7_SCHOTT\nSTO\nS -50 46\nSI 0 0"


def thick(r1: float, r2: float, d: float, n: float = N) -> float:
    """Focal length of a thick lens."""
    return 1.0 / ((n - 1.0) * (1.0 / r1 - 1.0 / r2 + (n - 1.0) * d / (n * r1 * r2)))


# -- Zemax ---------------------------------------------------------------------------------------


def test_a_plain_file_says_nothing(tmp_path: Path) -> None:
    lens, said = opened(tmp_path, SINGLET)
    assert said == []
    assert lens.design()["efl"] == pytest.approx(thick(50, -50, 5), rel=1e-5)


@pytest.mark.parametrize("word", sorted(zemax_words.HARMLESS_IN_SURFACES))
def test_harmless_words_of_surfaces_are_harmless(word: str, tmp_path: Path) -> None:
    lens, said = opened(tmp_path, zemax(f"{FRONT};{word} 1 2 3", BACK, IMAGE))
    assert said == []
    assert lens.design()["efl"] == pytest.approx(thick(50, -50, 5), rel=1e-5)


@pytest.mark.parametrize("word", sorted(set(zemax_words.VALUES) - {"SCBD"}))
def test_values_behind_those_of_a_word_are_heard(word: str, tmp_path: Path) -> None:
    """`CONI 0 7`: what nobody reads is said, what says nothing is not."""
    line = {
        "TYPE": "TYPE STANDARD", "CURV": 'CURV 0.02 0 0 0 0 ""', "DISZ": "DISZ 5", "STOP": "STOP",
        "GLAS": "GLAS N-BK7 0 0 1.5 40 0 0 0 0 0 0", "DIAM": 'DIAM 10 0 0 0 1 ""',
        "MODE": "MODE SEQ", "UNIT": "UNIT MM X W X CM MR CPMM", "WAVM": "WAVM 1 0.5875618 1",
        "ENPD": "ENPD 10 0", "FTYP": "FTYP 0 0 1 1 0 0 0", "PWAV": "PWAV 1", "MNUM": "MNUM 1 1",
        "ENVD": "ENVD 20 1 0", "PZUP": "PZUP 0 0 5 0", "PPAR": "PPAR 9 0 1 0 0",
    }.get(word, f"{word}{' 0' * zemax_words.VALUES[word]}")  # fmt: skip

    def heard(end: str) -> list[str]:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            head = word in zemax_words.WORDS_OF_HEAD
            front = FRONT if head else f"{FRONT};{line}{end}"
            text = zemax(front, BACK, IMAGE, head=f"{line}{end}" if head else "")
            with contextlib.suppress(SceneError):
                parse_zemax(text)
        return [str(one.message) for one in said if "at the end of" in str(one.message)]

    assert heard(' 0 0.0 ""') == []
    [warned] = heard(" 7")
    assert f": 7 at the end of {word}" in warned


@pytest.mark.parametrize("word", sorted(zemax_words.HARMLESS_IN_HEAD))
def test_harmless_words_of_the_head_are_harmless(word: str, tmp_path: Path) -> None:
    assert opened(tmp_path, zemax(FRONT, BACK, IMAGE, head=f"{word} 1 2 3"))[1] == []
    assert opened(tmp_path, SINGLET + f"{word} 1 2 3\n")[1] == []


@pytest.mark.parametrize(
    ("surface", "words"),
    [
        ("XYZW 1 2", r"line 18, surface 1: the word XYZW is not understood"),
        ("EDGE 3.2", r"surface 1: the word EDGE is not understood"),
        ("COAT AR", r"surfaces 1: coatings \(COAT\) are not taken"),
        ("SQAP 3 4 0", r"surface 1: SQAP, a rectangular aperture, is not round"),
        ("SPID 1 4", r"surface 1: SPID, a spider"),
        ("OBSC 1 2 0", r"the obscuration is a ring"),
        ("MAZH 0 0;DISZ 5", None),
    ],
)
def test_words_that_change_the_lens_are_heard(
    surface: str, words: str | None, tmp_path: Path
) -> None:
    text = zemax(f"{FRONT};{surface}", BACK, IMAGE)
    said = " | ".join(opened(tmp_path, text)[1])
    assert re.search(words or "its thickness follows", said), said


@pytest.mark.filterwarnings("ignore:.*stands twice")
@pytest.mark.parametrize(
    ("surface", "words"),
    [
        ("SCBD 0 0 0 0.0 0.0 5.0 0.0 0.0", r"line \d+, surface 1: is tilted or decentred \(SCBD"),
        ("SCBD 1 0 0 0 2 0 0 0", "surface 1: is tilted or decentred"),
        ("CLAP 0 5 0;OBDC 0 50.8", r"surface 1: its aperture is decentred \(OBDC 0 50.8\)"),
        ("TYPE COORDBRK;PARM 3 45", r"surface 1: is of type COORDBRK.*PARM 3 = 45"),
        ("GLAS N-BK7 4 0 0.01 1", "surface 1: its glass follows from a solve of type 4"),
        ("CURV 0.02 4 7 1", "surface 1: picks up from surface 7"),
        ("DISZ INFINITY", "surface 1: its thickness is infinite"),
        ("PARM x 1", "surface 1: 'x' stands where a number"),
    ],
)
def test_what_moves_or_changes_a_surface_is_refused(surface: str, words: str) -> None:
    with pytest.raises(SceneError, match=words):
        parse_zemax(zemax(f"{FRONT};{surface}", BACK, IMAGE))


@pytest.mark.parametrize("kind", [*sorted(set(zemax_words.TYPES) - {"COORDBRK"}), "NEWTYPE"])
def test_other_types_of_surfaces_are_refused_by_name(kind: str) -> None:
    with pytest.raises(SceneError, match=f"surface 1: is of type {kind}.*cannot be traced"):
        parse_zemax(SINGLET.replace("TYPE STANDARD", f"TYPE {kind}", 1))


def test_zeros_of_tilts_and_breaks_are_harmless(tmp_path: Path) -> None:
    zero = "TYPE COORDBRK;PARM 1 0.0;PARM 3 0;PARM 6 1;DISZ 2"
    still = f"{BACK};SCBD 0 0 0 0 0 0 0 0;OBDC 0 0"
    lens, said = opened(tmp_path, zemax(zero, FRONT, still, IMAGE))
    assert said == []
    assert lens.design()["efl"] == pytest.approx(thick(50, -50, 5), rel=1e-5)
    assert lens.sequence.z[-1] == pytest.approx(2.0 + 5.0 + 46.5)
    # A break within glass stays within it
    parts = (FRONT.replace("DISZ 5", "DISZ 2"), "TYPE COORDBRK;DISZ 3", BACK, IMAGE)
    lens, said = opened(tmp_path, zemax(*parts))
    assert (said, list(lens.bodies())) == ([], ["L1"])
    assert lens.design()["efl"] == pytest.approx(thick(50, -50, 5), rel=1e-5)


def test_unindented_files_read_the_same(tmp_path: Path) -> None:
    plain = re.sub(r"^ +", "", SINGLET, flags=re.M) + "TOL TOFF 0 0\nEFFL 0 2 0 0 0 0 50 1 0 0\n"
    tabbed = re.sub(r"^ +", "\t", SINGLET, flags=re.M)
    assert parse_zemax(plain) == parse_zemax(tabbed) == parse_zemax(SINGLET)
    moved = plain.replace("CURV -0.02", "CURV -0.02\nSCBD 0 0 0 0.0 0.0 5.0 0.0 0.0")
    with pytest.raises(SceneError, match="surface 2: is tilted"):
        parse_zemax(moved)
    assert "XYZW" in " ".join(opened(tmp_path, plain.replace("STOP", "STOP\nXYZW 3"))[1])


def test_pickups_are_followed(tmp_path: Path) -> None:
    second = "CURV -0.03 4 1 -1 0;DISZ 46.5"
    lens, said = opened(tmp_path, zemax(FRONT, second, IMAGE))
    assert lens.design()["efl"] == pytest.approx(thick(50, -50, 5), rel=1e-5)
    assert "the curvature is stored as -0.03, but CURV -0.03 4 1 -1 0 makes it -0.02" in said[0]
    with pytest.raises(SceneError, match=r"neither 0\.06 nor 0\.00666"):
        parse_zemax(zemax(FRONT, "CURV -0.03 4 1 3 0;DISZ 46.5", IMAGE))
    lens, said = opened(tmp_path, zemax(FRONT, f"{BACK};PZUP 1 2 0.5 0", IMAGE))
    assert lens.sequence.z[2:].tolist() == [5.0, 15.5]
    assert "the thickness is stored as 46.5, but PZUP 1 2 0.5 0 makes it 10.5" in said[0]
    asphere = "STOP;TYPE EVENASPH;CURV 0.02;DISZ 5;GLAS N-BK7;PARM 2 1e-6;DIAM 8 0"
    picked = "TYPE EVENASPH;CURV -0.02;DISZ 46;PPAR 2 1 -1 0 0;DIAM 8 0"
    lens, said = opened(tmp_path, zemax(asphere, picked, IMAGE))
    assert lens.prescription.surfaces[2].aspheric == (-1e-6,)
    assert len(said) == 1


def test_a_marginal_height_is_solved(tmp_path: Path) -> None:
    # Paraxial back focal length of a thick lens: f (1 - (n - 1) d / (n R1))
    f = thick(50, -50, 5)
    back = f * (1.0 - (N - 1.0) * 5 / (N * 50))
    lens, said = opened(tmp_path, zemax(FRONT, f"{BACK};MAZH 0 0".replace("46.5", "30"), IMAGE))
    assert lens.sequence.z[-1] == pytest.approx(5.0 + back, rel=2e-5)
    assert "surface 2: its thickness follows from a ray as 47.5" in said[0]
    assert (
        opened(tmp_path, zemax(FRONT, f"{BACK};MAZH 0 0".replace("46.5", "47.51"), IMAGE))[1] == []
    )


def test_all_fields_are_read(tmp_path: Path) -> None:
    angles = [0.3 * k for k in range(15)]
    y = " ".join(str(angle) for angle in angles)
    head = f"FTYP 0 0 15 1\nXFLN {'0 ' * 15}\nYFLN {y}\nFWGN {'1 ' * 15}"
    lens, said = opened(tmp_path, zemax(FRONT, BACK, IMAGE, head=head))
    assert said == []
    assert [field.y for field in lens.prescription.fields] == angles
    assert list(lens.sources()) == ["axis", *(f"field_{k}" for k in range(2, 16))]
    old = "FTYP 0 0 3 1\nXFLD 0 0 0\nYFLD 0 5 10\nFWGT 1 0.5 0"
    lens, said = opened(tmp_path, zemax(FRONT, BACK, IMAGE, head=old))
    assert [(f.y, f.weight) for f in lens.prescription.fields] == [(0, 1), (5, 0.5), (10, 0)]
    assert "field 3 has the weight 0; its source is switched off" in said[0]
    few = "FTYP 0 0 3 1\nXFLN 0\nYFLN 0"
    assert (
        "has 3 fields (FTYP), but lists 1"
        in opened(tmp_path, zemax(FRONT, BACK, IMAGE, head=few))[1][0]
    )


@pytest.mark.parametrize("index", [0.999982, 0.95])
def test_a_gas_that_is_thinner_than_air_is_a_model_glass(index: float, tmp_path: Path) -> None:
    """The lens maker's equation holds below an index of 1, too."""
    model = FRONT.replace("N-BK7 0 0 1.5 40", f"___BLANK 1 0 {index} 50")
    lens, said = opened(tmp_path, zemax(model, BACK, IMAGE))
    assert lens.design()["efl"] == pytest.approx(thick(50, -50, 5, index), rel=1e-4), said


def test_an_index_of_no_matter_is_refused(tmp_path: Path) -> None:
    model = FRONT.replace("N-BK7 0 0 1.5 40", "___BLANK 1 0 0.5 50")
    with pytest.raises(SceneError, match=r"index 0\.5 is not a glass \(least 0\.9\)"):
        opened(tmp_path, zemax(model, BACK, IMAGE))


@pytest.mark.parametrize(
    ("head", "words"),
    [
        ("ENVD 60 1 1", r"is for 60 °C and 1 atm \(ENVD\)"),
        ("ENVD 20 0 1", "is for 20 °C and 0 atm"),
        ("MNUM 3 2", "has 3 configurations; configuration 2, which was active"),
        ("MCON 1 THIC 2", "has several configurations"),
        ("GFAC 1 0.5", "the pupil is apodised"),
        ("ENPD 12", "ENPD stands twice"),
        ("FNUM 4 0", r"says its aperture twice \(ENPD, FNUM\)"),
        ("QQQQ 1", "line 6: the word QQQQ is not understood"),
    ],
)
def test_words_of_the_head_are_heard(head: str, words: str, tmp_path: Path) -> None:
    lens, said = opened(tmp_path, zemax(FRONT, BACK, IMAGE, head=head))
    assert re.search(words, " | ".join(said)), said
    assert lens.design()["efl"] == pytest.approx(thick(50, -50, 5), rel=1e-5)


def test_air_at_20_degrees_is_no_news(tmp_path: Path) -> None:
    for said in ("ENVD 20 1 1", "ENVD 60 1 0"):  # the second: the program does not use it
        assert opened(tmp_path, zemax(FRONT, BACK, IMAGE, head=said))[1] == []


def test_surfaces_are_numbered_in_order() -> None:
    with pytest.raises(SceneError, match="surface 3: stands where surface 2 is expected"):
        parse_zemax(SINGLET.replace("SURF 2", "SURF 3", 1))


def test_apertures_of_empty_surfaces_stand_as_rings(tmp_path: Path) -> None:
    ring = "CURV 0;DISZ 10;DIAM 4 1;CLAP 0 4 0"
    lens, said = opened(tmp_path, zemax(ring, FRONT, BACK, IMAGE))
    assert said == []
    table = lens.bodies()["aperture_1"]
    assert (table["kind"], table["inner"], table["position"]) == ("ring", 4.0, [0.0, 0.0, 0.0])
    # A fixed semi-diameter alone is no aperture where nothing is bent
    assert "aperture_1" not in opened(tmp_path, zemax(ring[:24], FRONT, BACK, IMAGE))[0].bodies()


def test_places_that_light_does_not_reach_are_refused(tmp_path: Path) -> None:
    virtual = "STOP;CURV 0;DISZ 56.5"
    parts = (FRONT[5:], BACK.replace("46.5", "-10"), virtual, IMAGE)
    with pytest.raises(SceneError, match="surface 3: lies 10 before surface 2"):
        opened(tmp_path, zemax(*parts))


# -- CODE V --------------------------------------------------------------------------------------


@pytest.mark.parametrize("word", sorted(set(codev_words.HARMLESS) - {"END"}))
def test_harmless_commands_are_harmless(word: str, tmp_path: Path) -> None:
    said_as = f"{word} S1" if word in codev_words.ALONE - {"GO"} else word
    said_as += "" if word in codev_words.ALONE else " 0 0"
    lens, said = opened(tmp_path, codev(BODY.replace("STO", f"STO\n{said_as}")), ".seq")
    assert said == []
    assert lens.design()["efl"] == pytest.approx(thick(50, -50, 5), rel=1e-5)


def test_commands_after_the_image_are_obeyed(tmp_path: Path) -> None:
    text = codev(
        BODY + "\nASP S1\nK S1 -1.0\nA S1 -1.0E-05\nTHI S2 30.0\nRDY S2 -80.0\nCIR S1..2 7\n"
        "GLA S1 NSF11_SCHOTT"
    )
    lens, said = opened(tmp_path, text, ".seq")
    front, back = lens.prescription.surfaces[1:3]
    assert (front.conic, front.aspheric, back.curvature) == (-1.0, (-1e-5,), -1.0 / 80.0)
    assert (front.semi_diameter, back.semi_diameter, back.thickness) == (7.0, 7.0, 30.0)
    assert said == []
    # Schott: N-SF11 has the index 1.78472 at the d line
    assert lens.design()["efl"] == pytest.approx(thick(50, -80, 5, 1.78472), rel=1e-5)


@pytest.mark.parametrize("stop", ["STO S3", "S3 0 5\nSTO"])
def test_surfaces_are_spoken_of_by_number(stop: str, tmp_path: Path) -> None:
    third = "S3 0 5\nS4 0 41" if stop.startswith("STO") else f"{stop}\nS4 0 41"
    after = stop if stop.startswith("STO") else ""
    body = f"S1 50 5 NBK7_SCHOTT\nS2 -50 1\n{third}\nSI 0 0\n{after}"
    lens, said = opened(tmp_path, codev(body), ".seq")
    assert (lens.prescription.stop, said) == (3, [])
    changed = parse_codev(codev(body + "\nS2 -60 2"))
    assert (changed.surfaces[2].curvature, changed.surfaces[2].thickness) == (-1 / 60, 2.0)
    with pytest.raises(SceneError, match="S7 stands where S3 is expected"):
        parse_codev(codev("S1 50 5 BK7\nS2 -50 1\nS7 0 1\nSI 0 0"))
    with pytest.raises(SceneError, match="speaks of surface S9, which does not stand"):
        parse_codev(codev(BODY + "\nTHI S9 3"))


def test_a_mirror_by_its_mode_is_a_mirror(tmp_path: Path) -> None:
    lens, _ = opened(tmp_path, codev("S -200 -100\n RMD REFL\n STO\nSI 0 0"), ".seq")
    assert list(lens.bodies()) == ["M1"]
    assert lens.design()["efl"] == pytest.approx(100.0)  # R / 2
    with pytest.raises(SceneError, match="RMD TIR is not understood"):
        parse_codev(codev("S -200 -100\nRMD TIR\nSTO\nSI 0 0"))


def test_the_first_position_of_a_zoom_lens_is_read(tmp_path: Path) -> None:
    body = BODY.replace("\nSI", "\nZOO THI S2 44 30\nSI").replace(
        "SI 0 0", "SI 0 0\nZOO YAN F1 0 0"
    )
    head = "RDM;LEN\nZOO 2\nTIT Z1 'wide'\nTIT Z2 'tele'\nZOO EPD 8 10"
    lens, said = opened(tmp_path, codev(body, head).replace("\nEPD 10", ""), ".seq")
    assert len(said) == 1
    assert "line 2: is a zoom lens of 2 positions (ZOO); the first is read" in said[0]
    assert (lens.prescription.aperture.value, lens.prescription.surfaces[2].thickness) == (8, 44)
    with (
        pytest.warns(ImportWarning),
        pytest.raises(SceneError, match="does not give a value for each of 2 positions"),
    ):
        parse_codev(codev(BODY + "\nZOO THI S2", "RDM\nZOO 2"))


def test_a_defocus_moves_the_image(tmp_path: Path) -> None:
    f = thick(50, -50, 5)
    back = f * (1.0 - (N - 1.0) * 5 / (N * 50))
    body = f"S 50 5 NBK7_SCHOTT\nSTO\nS -50 {back:.6f}\nPIM\nSI 0 -0.4"
    lens, said = opened(tmp_path, codev(body), ".seq")
    assert said == []
    assert lens.sequence.z[-1] == pytest.approx(5 + back - 0.4, abs=1e-4)
    stale = opened(tmp_path, codev(body.replace(f"{back:.6f}", "20")), ".seq")[0]
    assert stale.sequence.z[-1] == pytest.approx(5 + back - 0.4, abs=2e-3)


def test_code_v_pickups_are_followed(tmp_path: Path) -> None:
    lens, said = opened(tmp_path, codev(BODY + "\nPIK RDY S2 Z1 RDY S1 Z1 -1.0"), ".seq")
    assert said == []
    text = codev(BODY + "\nPIK RDY S2 RDY S1 -2\nPIK THI S2 THI S1 2 1\nPIK XYZ S1 XYZ S2")
    lens, said = opened(tmp_path, text, ".seq")
    assert lens.prescription.surfaces[2].curvature == -0.01
    assert lens.prescription.surfaces[2].thickness == 11.0
    assert len(said) == 3
    assert "PIK XYZ S1 XYZ S2 is not followed" in said[-1] + said[0]


@pytest.mark.parametrize(
    ("glass", "index"),
    [
        ("1.5168:64.17", 1.5168),
        ("517.642", 1.517),
        ("516800.641700", 1.5168),
        ("'GLUE'", 1.5597),
        ("'TABLE'", 1.61),
    ],
)
def test_glasses_of_the_file(glass: str, index: float, tmp_path: Path) -> None:
    private = (
        "PRV\nPWL 656.3 587.6 486.1\n'GLUE' LAU 2.36390625 0.0 0.025493134 -0.000580235 0 0\n"
        "'TABLE' 1.60 1.61 1.63\n'OTHER' SEL 1 2 3\nEND\n"
    )
    body = BODY.replace("NBK7_SCHOTT", glass)
    lens, said = opened(tmp_path, codev(private + body), ".seq")
    assert said == []
    # Of the Laurent series n² = A0 + A1 λ² + A2 λ⁻² + …: 2.4325 at 0.5876 µm
    assert lens.sequence.indices[1, 0] == pytest.approx(index, abs=1e-4)
    with pytest.raises(SceneError, match="its private glass OTHER has the formula SEL"):
        parse_codev(codev(private + BODY.replace("NBK7_SCHOTT", "'OTHER'")))


def test_numbers_without_a_mode_are_curvatures_if_they_can_be(tmp_path: Path) -> None:
    head = "TIT 'x'"
    lens, said = opened(
        tmp_path, codev("S 0.02 3 NBK7_SCHOTT\nSTO\nS -0.02 48\nSI 0 0", head), ".seq"
    )
    assert lens.design()["efl"] == pytest.approx(thick(50, -50, 3), rel=1e-5)
    assert "they are read as curvatures" in said[0]
    with pytest.raises(SceneError, match="could be either"):
        parse_codev(codev("S 0.5 3 NBK7_SCHOTT\nSTO\nS -50 48\nSI 0 0", head))


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("WIBBLE 3", "surface 1: the command WIB is not understood"),
        ("THI S1 Z2 5", "the command THI S1 Z2 5 is not understood"),
        ("REX 4", "its aperture REX is rectangular"),
        ("PUI 0.5", "the pupil is apodised"),
        ("MLT 'x'", "coatings are not taken"),
        ("TEM 60", r"is for 60 °C \(TEM\)"),
        ("THI OAL S1..2 20", "the solve THI OAL S1..2 20 is not evaluated"),
    ],
)
def test_commands_that_change_the_lens_are_heard(command: str, words: str, tmp_path: Path) -> None:
    text = codev(BODY.replace("STO", f"STO\n{command}"))
    assert re.search(words, " | ".join(opened(tmp_path, text, ".seq")[1]))


@pytest.mark.parametrize("command", sorted(codev_words.MOVED))
def test_shifts_are_refused_and_zeros_are_not(command: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=f"surface 1: is shifted or tilted .{command} 1"):
        parse_codev(codev(BODY.replace("STO", f"STO\n{command} 1")))
    assert opened(tmp_path, codev(BODY + f"\n{command} S2 0"), ".seq")[1] == []


@pytest.mark.parametrize("command", sorted(codev_words.TYPES))
def test_other_surfaces_are_refused(command: str) -> None:
    with pytest.raises(SceneError, match=rf"surface 1: is .*\({command}\)"):
        parse_codev(codev(BODY.replace("STO", f"STO\n{command} 1")))


QUALIFIED = [
    ("CIR OBS S1 2", "CIR S1 OBS 2"),
    ("CIR OBS S2 2", "CIR S2 OBS 2"),
    ("CIR EDG S1 9", "CIR S1 EDG 9"),
    ("CIR HOL Z1 S2 1", "CIR S2 HOL 1"),
    ("CIR L'a' OBS S1..2 2", "CIR S1 OBS 2\nCIR S2 OBS 2"),
    ("THI Z1 S2 30", "THI S2 30"),
    ("RDY Z1 S2 -80", "RDY S2 -80"),
    ("K Z1 S1 -1", "K S1 -1"),
    ("YAN Z1 F2 5", "YAN F2 5"),
    ("EPD Z1 8", "EPD 8"),
    ("SLB S1 'front'", "SLB S1 front"),
]


@pytest.mark.parametrize(("free", "usual"), QUALIFIED)
def test_qualifiers_before_the_value_stand_in_any_order(
    free: str, usual: str, tmp_path: Path
) -> None:
    lens, said = opened(tmp_path, codev(f"{BODY}\n{free}"), ".seq")
    assert said == []
    assert lens.prescription == parse_codev(codev(f"{BODY}\n{usual}"), origin="lens.seq")
    assert lens.prescription != parse_codev(codev(BODY), origin="lens.seq")


def test_obscurations_of_a_surface_that_is_named_last(tmp_path: Path) -> None:
    lens, _ = opened(tmp_path, codev(f"{BODY}\nCIR OBS S2 2\nCIR EDG S1 9\nSLB S1 'x'"), ".seq")
    surfaces = lens.prescription.surfaces
    assert [surface.obscuration for surface in surfaces] == [0, 0, 2, 0]
    assert [surface.mechanical for surface in surfaces] == [None, 9, None, None]
    assert [surface.label for surface in surfaces] == ["", "x", "", ""]


def test_silicon_is_a_glass_and_no_image(tmp_path: Path) -> None:
    prescription = parse_codev(codev(f"{BODY}\nGLA S1 SI"))
    assert prescription.surfaces[1].glass is not None
    assert prescription.surfaces[1].glass.name == "SI"


COMMANDS = [
    "EPD 10", "FNO 5", "NA 0.1", "NAO 0", "DIM M", "TEM 20", "PRE 760", "REF 1", "YAN F1 0",
    "WTF F1 1", "VUX F1 0", "WL W1 587.6", "WTW W1 1", "STO S1", "K S1 -1", "CUF S1 0",
    "A S1 1e-5", "F S1 0", "CIR S1 7", "CIR S1 OBS 2", "CIR OBS S1 2", "CIR S1 EDG 9",
    "CIR S1 HOL 1", "CIR S1 CLR 7", "GLA S1 NBK7_SCHOTT", "RMD S1 REFR", "PIM S2 NO",
    "THI S2 30", "THI S2 HMY 0", "RDY S2 -80", "CUY S2 -0.02", "REX S1 4", "ELX S1 4",
    "XDE S1 0", "ADE S1 0", "ASP S1", "CON S1", "SPH S1", "DAR S1", "BEN S1", "REV S1",
    "PIK RDY S2 RDY S1 -1 0", "WIBBLE 1", "MLT S1 'x'", "THI S2 OAL 30", "RDY S2 UMY 0",
    "S2 -50 46 AIR", "SLB S1 'x'",
]  # fmt: skip


@pytest.mark.parametrize("left", ["S2", "Z2", "F7", "OBS", "EDG", "HOL", "77", "WORD", "'word'"])
@pytest.mark.parametrize("command", COMMANDS)
def test_words_left_over_are_heard(command: str, left: str) -> None:
    """By name, or with the command that names them."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            parse_codev(codev(f"{BODY}\n{command} {left}"))
        except SceneError as error:
            heard = [str(error)]
        else:
            heard = []
        heard += [str(item.message) for item in caught]
    name = command.split()[0][:3]
    whole = ("WIB", "MLT")  # the warning is about all that such a command says
    assert any(left in words or (name in whole and name in words) for words in heard), heard


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("CIR OBS S1 2 7", r"surface 1: 7 in CIR OBS S1 2 7 is not understood and is left out"),
        ("CIR S1 EDG 2", "surface 1: its edge, of radius 2, lies within its clear aperture of 5"),
        ("STO S1 S2", "surface 1: S2 stands where STO S1 S2 does not expect it"),
        ("THI 3 S2", "S2 stands where THI 3 S2 does not expect it; write it right behind THI"),
        ("RDY -80 S2", "S2 stands where RDY -80 S2 does not expect it"),
        ("CIR 2 OBS", "OBS stands where CIR 2 OBS does not expect it"),
        ("CIR OBS EDG S1 2", "CIR OBS EDG S1 2 is not understood"),
        ("THI S1 S2 3", "the solve THI S2 3 is not evaluated"),
        ("ASP S1 K -1", "surface 1: K in ASP S1 K -1 is not understood"),
        ("REF 1 2", "2 in REF 1 2 is not understood"),
        ("YAN W1 5", "'W1' stands where YAN expects a number"),
        ("PIK RDY S2 Z2 RDY S1 Z2 -1", "PIK RDY S2 Z2 RDY S1 Z2 -1 is not followed"),
        ("STO 5", "5 in STO 5 is not understood"),
    ],
)
def test_what_is_left_over_is_said(command: str, words: str, tmp_path: Path) -> None:
    try:
        said = opened(tmp_path, codev(f"{BODY}\n{command}"), ".seq")[1]
    except SceneError as error:
        said = [str(error)]
    assert re.search(words, " | ".join(said)), said


# -- both ----------------------------------------------------------------------------------------


def test_check_says_what_was_warned_of(tmp_path: Path) -> None:
    path = tmp_path / "lens.zmx"
    path.write_text(zemax(FRONT, BACK, IMAGE, head="ENVD 60 1 1\nQQQQ 3"), encoding="utf-8")
    result = CliRunner().invoke(application(), ["check", str(path)])
    assert result.exit_code == 0
    assert result.stderr.count("ENVD") == 1
    assert "QQQQ" in result.stderr
    result = CliRunner().invoke(application(), ["check", str(path), "--json"])
    report = json.loads(result.stdout)
    assert [line.split(":")[0] for line in report["warnings"]] == ["lens.zmx", "lens.zmx"]


@pytest.mark.parametrize("suffix", [".zar", ".zos", ".len", ".roa", ".ZMX.zar"])
def test_other_files_of_lens_programs_are_named(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"lens{suffix}"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(SceneError, match=rf"lens{suffix}: is .*save the lens as .*(zmx|seq)"):
        load_scene(path)
    with pytest.raises(SceneError, match="save the lens as"):
        list_faces(path)


def test_a_lens_without_a_medium_says_what_to_write() -> None:
    text = """
length_unit = "mm"
[bodies.L1]
kind = "lens"
thickness = 4
diameter = 10
front = { radius = 50 }
back = { radius = -50 }
"""
    with pytest.raises(SceneError, match=r"bodies\.L1\.medium: is missing; .*\[media\.NAME\]"):
        parse_scene(text)


def test_the_page_lists_the_harmless_words() -> None:
    page = PAGE.read_text(encoding="utf-8")
    words = re.findall(r"`([A-Z]{1,4})`", page)
    for table in (
        zemax_words.HARMLESS_IN_HEAD,
        zemax_words.HARMLESS_IN_SURFACES,
        zemax_words.APERTURES_NOT_ROUND,
        codev_words.HARMLESS,
        codev_words.NOT_TAKEN,
        codev_words.APERTURES_NOT_ROUND,
    ):
        assert set(table) <= set(words)


# -- slips that a number hides -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("surface", "words"),
    [
        ("DISZ 6;DISZ 5", r"surface 1: DISZ stands twice; it is taken, not that of line \d+, surf"),
        ("CURV 0.03;CURV 0.02", r"CURV stands twice.*CURV stands twice"),
        ("PARM 2 1e-4;PARM 2 2e-4", r"PARM stands twice.*\| .*type STANDARD, which has no param"),
        ("PARM 3 0.5", r"surface 1: is of type STANDARD, which has no parameters"),
        ("XDAT 1 2.5 0 0", r"surface 1: is of type STANDARD, which has no extra data; XDAT 1 2.5"),
        ("TYPE EVENASPH;PARM 9 1", r"TYPE stands twice.*EVENASPH has no parameter 9"),
    ],
)
def test_what_stands_twice_or_means_nothing_is_heard(
    surface: str, words: str, tmp_path: Path
) -> None:
    lens, said = opened(tmp_path, zemax(f"{FRONT};{surface}", BACK, IMAGE))
    assert re.search(words, " | ".join(said)), said
    assert lens.design()["efl"] == pytest.approx(thick(50, -50, 5), rel=1e-5)


@pytest.mark.parametrize("kind", ["STANDARD", "EVENASPH"])
def test_extra_data_of_zero_is_harmless(kind: str, tmp_path: Path) -> None:
    front = FRONT.replace("STANDARD", kind)
    assert opened(tmp_path, zemax(f"{front};XDAT 1 0.0 0 0 1.0", BACK, IMAGE))[1] == []
    said = opened(tmp_path, zemax(f"{front};XDAT 1 3 0 0 1.0", BACK, IMAGE))[1]
    assert [f"is of type {kind}, which has no extra data" in words for words in said] == [True]


def test_the_partial_dispersion_of_a_model_glass_is_heard(tmp_path: Path) -> None:
    model = FRONT.replace("N-BK7 0 0 1.5 40", "___BLANK 1 0 1.6 50 {}")
    assert opened(tmp_path, zemax(model.format("0"), BACK, IMAGE))[1] == []
    said = opened(tmp_path, zemax(model.format("0.02"), BACK, IMAGE))[1]
    assert "the partial dispersion of its model glass deviates by 0.02" in " | ".join(said)


@pytest.mark.parametrize(
    ("head", "words"),
    [
        ("FTYP 0 0 1 1 0 0 1\nXFLN 0\nYFLN 0", "its image space is afocal"),
        ("FTYP 0 0 1 3\nXFLN 0\nYFLN 0", r"has 3 wavelengths \(FTYP\), but lists 1"),
        ("WAVM 1 0.6 1", "wavelength 1 stands twice; the first is taken"),
    ],
)
def test_counts_of_the_head_are_compared(head: str, words: str, tmp_path: Path) -> None:
    said = opened(tmp_path, zemax(FRONT, BACK, IMAGE, head=head))[1]
    assert re.search(words, " | ".join(said)), said


def test_a_primary_wavelength_that_is_none_is_heard(tmp_path: Path) -> None:
    said = opened(tmp_path, SINGLET.replace("PWAV 1", "PWAV 2"))[1]
    assert "its primary wavelength is number 2 of 1 (PWAV); number 1 is taken" in " | ".join(said)


@pytest.mark.parametrize("slip", ["0,02", "0.0_2", "\u0660.02", "0x1p3", "INFINITY"])
def test_slips_in_numbers_are_no_numbers(slip: str) -> None:
    with pytest.raises(SceneError, match=r"surface 1: .*number is expected"):
        parse_zemax(SINGLET.replace("CURV 0.02", f"CURV {slip}"))
    with pytest.raises(SceneError, match=r"expects a"):
        parse_codev(codev(f"{BODY}\nK S1 {slip}"))


@pytest.mark.parametrize("end", ["\r", "\r\n", "\n"])
def test_letters_of_other_alphabets_end_no_line(end: str, tmp_path: Path) -> None:
    """0x85 is a letter or an ellipsis in encodings of one byte; as U+0085 it would end a line."""
    noted = SINGLET.replace("MODE SEQ", "MODE SEQ\nNAME lens \x85 SURF 7\x0cENPD 3")
    path = tmp_path / "lens.zmx"
    path.write_bytes(noted.replace("\n", end).encode("latin-1"))
    prescription = read_prescription(path)
    assert prescription.aperture.value == 10.0
    assert len(prescription.surfaces) == 4
    path = tmp_path / "lens.seq"
    titled = codev(f"TIT 'lens \x85 EPD 3'\n{BODY}").replace("\n", end)
    path.write_bytes(titled.encode("latin-1"))
    assert read_prescription(path).aperture.value == 10.0


def test_f_numbers_of_near_objects(tmp_path: Path) -> None:
    """The stop stands at the lens: the entrance pupil has the diameter f/F of Zemax' F, which is
    that at infinity; the working one is 1/(2 sin) of the paraxial cone behind, s'/(2 y)."""
    f, near = thick(50, -50, 5), 150.0
    front = (N - 1) * 5 * f / (N * 50)  # principal planes, behind the front and before the back
    behind = 1.0 / (1.0 / f - 1.0 / (near + front))
    for word, height in (
        ("FNUM 4 0", f / 8.0),
        ("FNUM 4 1", behind / 8.0 * near / (near + front)),
    ):
        text = SINGLET.replace("ENPD 10", word).replace("DISZ INFINITY", f"DISZ {near}")
        lens, _ = opened(tmp_path, text)
        assert lens.bundles.marginal[0] == pytest.approx(height, rel=1e-5)
    text = codev(BODY).replace("EPD 10", "FNO 4").replace("SO 0 1e13", f"SO 0 {near}")
    lens, _ = opened(tmp_path, text, ".seq")
    assert lens.bundles.marginal[0] == pytest.approx(height, rel=1e-5)


def test_a_mode_behind_surfaces_is_refused() -> None:
    with pytest.raises(SceneError, match="RDM N stands behind surfaces"):
        parse_codev(codev("S 50 5 NBK7_SCHOTT\nRDM N\nSTO\nS -0.02 46\nSI 0 0"))
    with pytest.raises(SceneError, match=r"the unit must be M \(mm\), C \(cm\) or I"):
        parse_codev(codev(BODY).replace("DIM M", "DIM METER"))


def test_what_a_file_must_say_is_missed(tmp_path: Path) -> None:
    text = SINGLET.replace("UNIT MM\n", "").replace("ENPD 10\n", "")
    lens, said = opened(tmp_path, text)
    assert "gives no unit of its lengths (UNIT); mm are taken" in " | ".join(said)
    assert "says nothing of its aperture (ENPD, FNUM, OBNA, FLOA); the semi" in " | ".join(said)
    assert lens.bundles.marginal[0] == pytest.approx(10.0)
    said = opened(tmp_path, codev(BODY).replace("DIM M\n", ""), ".seq")[1]
    assert said == ["lens.seq: gives no unit of its lengths (DIM); mm are taken"]
    with pytest.raises(SceneError, match="FNUM of kind 2 is not understood"):
        parse_zemax(SINGLET.replace("ENPD 10", "FNUM 5 2"))


def test_weights_of_fields_are_fluxes(tmp_path: Path) -> None:
    head = "FTYP 0 0 2 1\nXFLN 0 0\nYFLN {} 5\nFWGN {} 3"
    for first, weight, flux in ((0, 2, 2.0), (0, 0, 1.0), (1, 2, 1.0)):
        text = zemax(FRONT, BACK, IMAGE, head=head.format(first, weight))
        lens, said = opened(tmp_path, text)
        with warnings.catch_warnings(action="ignore", category=ImportWarning):
            sources = lens.sources()
        assert sources["axis"]["flux"] == flux
        assert sources["axis"].get("on", True) is (weight > 0)
        assert sources["field_2"]["flux"] == 3.0
        assert len(said) == (weight == 0)
    with pytest.raises(SceneError, match="the weight -2 of a field is negative"):
        parse_zemax(zemax(FRONT, BACK, IMAGE, head=head.format(0, -2)))
    lens, _ = opened(tmp_path, codev(f"{BODY}\nWTF F1 2"), ".seq")
    assert lens.sources()["axis"]["flux"] == 2.0


@pytest.mark.parametrize("command", ["WTF 1 2", "VUY 0 0.2", "WTW 1 2"])
def test_values_for_fields_that_are_none_are_heard(command: str, tmp_path: Path) -> None:
    said = " | ".join(opened(tmp_path, codev(f"{BODY}\n{command}"), ".seq")[1])
    assert re.search(r"has 2 values for 1 (fields|wavelengths); 1 are taken", said), said


def test_an_image_solve_that_is_switched_off_is_none(tmp_path: Path) -> None:
    lens, said = opened(tmp_path, codev(BODY.replace("SI", "PIM NO\nSI")), ".seq")
    assert said == []
    assert lens.sequence.z[-1] == 51.0


def test_a_sphere_has_no_conic_and_no_coefficients() -> None:
    """What a surface is said to be last is what it is."""
    body = "S 50 5 NBK7_SCHOTT\nSTO\nASP\nK -1\nA 1e-6\n{}\nS -50 46\nSI 0 0"
    shapes = {
        word: parse_codev(codev(body.format(word))).surfaces[1]
        for word in ("", "SPH", "CON", "SPH\nCON\nK -2")
    }
    found = {word: (shape.conic, shape.aspheric) for word, shape in shapes.items()}
    assert found == {
        "": (-1.0, (1e-6,)),
        "SPH": (0.0, ()),
        "CON": (-1.0, ()),
        "SPH\nCON\nK -2": (-2.0, ()),
    }
    numbered = codev(body.format("") + "\nSPH S1")
    assert parse_codev(numbered).surfaces[1].conic == 0.0


@pytest.mark.parametrize("command", ["GLA S1", "GLA", "GLA S1 Z1"])
def test_a_glass_without_a_name_is_refused(command: str) -> None:
    with pytest.raises(SceneError, match=r"surface \d: GLA.* names no glass; AIR stands for none"):
        parse_codev(codev(BODY.replace("S -50", f"{command}\nS -50")))

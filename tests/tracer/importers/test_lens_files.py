"""Lens files as scenes: encodings, bodies, apertures, placing, bad input."""

from __future__ import annotations

import json
import math
import tomllib
import warnings
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from raymap.cli import application
from raymap.model.errors import RayMapError, SceneError
from tests.examples import examples
from tracer.bodies.lens import LensBody
from tracer.bodies.ring import RingBody
from tracer.importers.lens_formats.codev import parse_codev
from tracer.importers.lens_formats.zemax import parse_zemax, read_zemax
from tracer.importers.lens_scene import import_lens
from tracer.importers.prescription import ImportWarning
from tracer.importers.toml_text import toml_text
from tracer.scene.compile import compile_scene
from tracer.scene.load import load_scene, parse_scene
from tracer.transport.trace import trace_rays

LENSES = Path(__file__).parents[2] / "data" / "lenses"
PHOTO = LENSES / "US08427765-1.zmx"
MIRRORS = LENSES / "US05331467-1.zmx"
SILICA = LENSES / "US05831776-1.zmx"
COLLIMATOR = LENSES / "354710-C.zmx"

SINGLET = """MODE SEQ
NAME A singlet of 50 mm Ø
UNIT MM X W X CM MR CPMM
ENPD 10
GCAT SCHOTT
FTYP 0 0 2 2 0 0 0
XFLN 0 0
YFLN 0 3
WAVM 1 0.4861 1
WAVM 2 0.5876 2
PWAV 2
SURF 0
  TYPE STANDARD
  CURV 0.0
  DISZ INFINITY
SURF 1
  STOP
  TYPE STANDARD
  CURV 0.02
  DISZ 4
  GLAS N-BK7 0 0 1.5 40
  DIAM 8 1
SURF 2
  TYPE STANDARD
  CURV -0.02
  DISZ 47
  DIAM 8 1
SURF 3
  TYPE STANDARD
  CURV 0
  DISZ 0
"""

DOUBLET = """RDM;LEN "VERSION: 11.2"
TITLE 'A doublet with it''s stop' ! a remark; not a command
EPD 20.0; DIM M
WL 656.3 587.6 486.1
REF 2
WTW 1 2 &
    1
YAN 0.0 1.0
VUY 0.0 0.1
VLY 0.0 0.2
SO 0.0 0.1e14
S 61.47 6.0 NBK7_SCHOTT
  STO
  CIR 12.0
S -44.64 2.5 'mine'
S -129.94 10.0
  CIR EDG 13.0
S 0.0 5.0 517.642
  CIR OBS L'A' 2.0
S 50.0 80.0
  K -0.5; A 1.0D-6
  B 2.0e-9
SI 0.0 0.0
PRV
  PWL 656.3 587.6 486.1
  'mine' 1.664 1.672 1.690
END
GO
"""


@pytest.mark.parametrize(
    "encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1"]
)
def test_every_encoding_reads_the_same(encoding: str, tmp_path: Path) -> None:
    path = tmp_path / "lens.zmx"
    path.write_bytes(SINGLET.replace("\n", "\r\n").encode(encoding))
    assert read_zemax(path) == parse_zemax(SINGLET, origin="lens.zmx")
    assert read_zemax(path).title == "A singlet of 50 mm Ø"


def test_apertures_are_those_that_the_program_found() -> None:
    # The file's automatic semi-diameters are what its program got from its own rays
    lens = import_lens(SILICA)
    reach = lens.bundles.reach
    for k, surface in enumerate(lens.prescription.surfaces):
        assert surface.semi_diameter == pytest.approx(reach[k], rel=3e-6), surface.number


def test_real_image_heights_are_met_by_the_chief_rays() -> None:
    for path in (PHOTO, SILICA):
        lens = import_lens_quietly(path)
        for field, origin in zip(lens.prescription.fields, lens.bundles.origins, strict=True):
            points = lens.bundles.trace(origin, lens.bundles.chief(origin)).points[:, 0]
            assert points[-1, 1] == pytest.approx(field.y, abs=1e-9)
            if not lens.prescription.telecentric:
                assert np.abs(points[lens.prescription.stop, :2]).max() < 1e-9


def import_lens_quietly(path: Path):  # type: ignore[no-untyped-def]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ImportWarning)
        lens = import_lens(path)
        _ = lens.elements
        return lens


def test_an_element_met_twice_is_one_body_with_its_hole() -> None:
    with pytest.warns(ImportWarning, match=r"L2 \(surfaces 3, 4, 5\) gets a hole of radius 17\.39"):
        scene = load_scene(MIRRORS)
    lenses = [name for name, body in scene.bodies.items() if isinstance(body, LensBody)]
    assert sorted(lenses, key=lambda name: int(name[1:])) == [f"L{k}" for k in range(1, 13)]
    primary, secondary = scene.bodies["L2"], scene.bodies["L3"]
    assert isinstance(primary, LensBody)
    assert isinstance(secondary, LensBody)
    assert primary.back.surface == "mirror"
    assert secondary.front.surface == "mirror"
    assert primary.position[2] == pytest.approx(108.15)
    assert secondary.position[2] == pytest.approx(14.53)
    directory = compile_scene(scene).directory
    (cement,) = [
        f for o in directory.objects if o.name == "L4" for f in o.faces if f.name == "back"
    ]
    assert cement.aliases == ("L5.front",)
    disc = scene.bodies["obscuration_2"]
    assert isinstance(disc, RingBody)
    assert (disc.inner, disc.outer) == (0.0, 25.0)


def test_light_goes_through_a_hole_and_meets_its_wall() -> None:
    scene = parse_scene("""
length_unit = "mm"
[media.glass]
index = 1.5
[surfaces.black]
kind = "absorber"
[bodies.lens]
kind = "lens"
medium = "glass"
thickness = 5
hole = 4
front = { radius = 40, semi_diameter = 10 }
back = { radius = -40, semi_diameter = 10 }
[sources.s]
kind = "collimated"
position = [0, 0, -10]
diameter = 4
""")
    x = np.array([0.0, 1.9, 2.1, 9.9, 10.1])
    start = np.column_stack([x, 0 * x, 0 * x - 10.0])
    ahead = np.tile([0.0, 0.0, 1.0], (len(x), 1))
    traced = trace_rays(scene, start, ahead, wavelength_nm=550.0)
    assert (np.diff(traced.offsets) - 2).tolist() == [0, 0, 2, 2, 0]
    slanted = trace_rays(scene, [[-1.9, 0, -1]], [[1.0, 0, 1.0]], wavelength_nm=550.0)
    assert np.hypot(*slanted.points[-1, :2]) == pytest.approx(2.0, abs=1e-12)
    assert slanted.points[-1, 2] == pytest.approx(2.9, abs=1e-12)
    result = json.loads(scene.bodies["lens"].model_dump_json())
    assert result["hole"] == 4.0


@pytest.mark.parametrize("path", [PHOTO, COLLIMATOR])
def test_a_placed_lens_is_the_lens_moved(path: Path, tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ImportWarning)
        alone = load_scene(path)
        (tmp_path / path.name).write_bytes(path.read_bytes())
        placed = parse_scene(
            f"""
length_unit = "in"
[lens_files.eye]
file = "{path.name}"
position = [1, 2, 3]
rotation = [20, -35, 80]
sources = true
image = true
""",
            folder=tmp_path,
        )
        assert {f"eye.{name}" for name in alone.bodies} == set(placed.bodies)
        lens = import_lens(path)
        p, d = lens.bundles.launch(lens.bundles.axis, 0.6 * lens.bundles.edge(lens.bundles.axis))
        p = p - 3.0 * d
        origin, frame = placed.bodies["eye.L1"].frame()
        assert np.allclose(origin, [1, 2, 3])
        one = trace_rays(alone, p, d, wavelength_nm=1000.0)
        two = trace_rays(placed, origin + p / 25.4 @ frame.T, d @ frame.T, wavelength_nm=1000.0)
    ends = slice(None)
    assert np.array_equal(one.offsets, two.offsets)
    assert np.allclose(origin + one.points[ends] / 25.4 @ frame.T, two.points, atol=1e-12)
    assert two.object_names[two.object[-1]] == "eye.image"


def test_a_code_v_lens(tmp_path: Path) -> None:
    (tmp_path / "doublet.seq").write_text(DOUBLET, encoding="utf-8")
    lens = import_lens(tmp_path / "doublet.seq")
    p = lens.prescription
    assert (p.unit, p.primary, p.weights) == ("mm", 1, (1.0, 2.0, 1.0))
    assert p.fields[1].vignetting == (0.0, 0.0, 0.1, 0.2)
    assert [round(1 / s.curvature, 2) if s.curvature else 0 for s in p.surfaces[1:-1]] == [
        61.47, -44.64, -129.94, 0, 50,
    ]  # fmt: skip
    assert p.surfaces[5].aspheric == (1e-6, 2e-9)
    assert p.surfaces[5].conic == -0.5
    assert p.surfaces[4].obscuration == 2.0
    indices = lens.sequence.indices
    assert indices[1, 1] == pytest.approx(1.5168, abs=2e-5)
    assert indices[2].tolist() == [1.664, 1.672, 1.690]
    assert indices[4, 1] == pytest.approx(1.517, abs=1e-4)
    scene = load_scene(tmp_path / "doublet.seq")
    assert set(scene.bodies) == {"L1", "L2", "L3", "obscuration_4"}
    assert set(scene.sources) == {"axis", "field_2"}
    # Exact points lie on the asphere, and the image of the axis is where first order says
    points = lens.bundles.trace(lens.bundles.axis, lens.bundles.edge(lens.bundles.axis)).points
    r = np.hypot(points[5, :, 0], points[5, :, 1])
    sag = [p.surfaces[5].sag(float(value)) for value in r]
    assert points[5, :, 2] - lens.sequence.z[5] == pytest.approx(sag, abs=1e-13)


def test_curvatures_or_radii(tmp_path: Path) -> None:
    by_radius = parse_codev(
        "RDM\nDIM M\nWL 587.6\nEPD 5\nSO 0 1e11\nS 50 3 BK7\nSTO\nS -50 40\nSI 0 0\nGO\n"
    )
    by_curvature = parse_codev(
        "rdm n\ndim m\nwl 587.6\nepd 5\nso 0 1e11\ns .02 3 bk7\nsto\ns -.02 40\nsi 0 0\n"
    )
    for a, b in zip(by_radius.surfaces, by_curvature.surfaces, strict=True):
        assert a.curvature == b.curvature
    assert by_curvature.stop == 1
    with pytest.warns(ImportWarning, match=r"radii \(RDM\) or curvatures"):
        unsaid = parse_codev(
            "DIM M\nWL 587.6\nEPD 5\nSO 0 1e11\nS 50 3 BK7\nSTO\nS -50 40\nSI 0 0\n"
        )
    assert unsaid.surfaces == by_radius.surfaces


def test_check_reports_the_design(tmp_path: Path) -> None:
    path = tmp_path / "lens.zmx"
    path.write_text(SINGLET, encoding="utf-8")
    result = CliRunner().invoke(application(), ["check", str(path), "--json"])
    assert result.exit_code == 0
    report = json.loads(result.stdout)
    # Thick lens: 1/f = (n - 1) (1/R1 - 1/R2 + (n - 1) d / (n R1 R2))
    n = 1.51680
    power = (n - 1) * (0.04 - (n - 1) * 4 / (n * 2500))
    assert report["design"]["efl"] == pytest.approx(1 / power, rel=1e-5)
    assert report["design"]["entrance_diameter"] == 10.0
    assert report["design"]["faces"] == {"1": "L1.front", "2": "L1.back"}
    assert report["efl"] == pytest.approx(report["design"]["efl"], rel=1e-4)


def test_edges_that_cross_are_trimmed(tmp_path: Path) -> None:
    path = tmp_path / "lens.zmx"
    path.write_text(SINGLET.replace("DIAM 8 1", "DIAM 16 1"), encoding="utf-8")
    with pytest.warns(ImportWarning, match=r"L1 \(surfaces 1, 2\): its faces cross at the edge"):
        lens = load_scene(path).bodies["L1"]
    assert isinstance(lens, LensBody)
    # Both sags of 2 mm together are the thickness: r = sqrt(2 * 50 * 2 - 4)
    assert lens.outer_radius() == pytest.approx(14.0, rel=0.01)
    assert not lens.problems()
    with pytest.warns(ImportWarning) as caught:
        load_scene(SILICA)
    text = " ".join(str(item.message) for item in caught)
    assert "L8 (surfaces 15, 16): its faces cross" in text
    assert "L12 and L13 (surfaces 23, 24; 25, 26) run into each other" in text


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("STANDARD\n  CURV -0.02", "BICONICX\n  CURV -0.02"), "surface 2: is of type BICONICX"),
        (("STANDARD\n  CURV 0\n", "COORDBRK\n  PARM 3 5\n"), "surface 3: is of type COORDBRK"),
        (("N-BK7", "N-BK77"), "surface 1: no catalogue .* 'N-BK77'; the nearest names are N-BK7"),
        (("CURV 0.02", "CURV o.o2"), "surface 1: 'o.o2' stands where a number"),
        (("MODE SEQ", "MODE NSC"), "is not sequential"),
        (("UNIT MM", "UNIT LY"), "there is no unit 'LY'"),
        (("ENPD 10", "ENPD 0"), "must be positive"),
        (("DISZ 4\n", "DISZ -4\n"), "surface 1: its thickness -4 runs against the light"),
        (("DISZ 47", "DISZ nan"), "not a number"),
        (
            ("TYPE STANDARD\n  CURV 0.02", "TYPE EVENASPH\n  PARM 1 1e-3\n  CURV 0.02"),
            "surface 1: has a term in r²",
        ),
        (
            ("TYPE STANDARD\n  CURV 0.02", "TYPE EVENASPH\n  PARM 8 1e-3\n  CURV 0.02"),
            "surface 1: has a term in r\\^16",
        ),
    ],
)
def test_what_cannot_be_taken_is_named(change: tuple[str, str], words: str, tmp_path: Path) -> None:
    path = tmp_path / "lens.zmx"
    assert change[0] in SINGLET
    path.write_text(SINGLET.replace(*change, 1), encoding="utf-8")
    with pytest.raises(SceneError, match=f"lens.zmx: {words}|lens.zmx.*{words}"):
        load_scene(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "RDM\nSO 0 1e11\nS 50 3 BK7\nSTO\nS -50 40\nSI 0 0\n",
            "says neither how wide its beam is",
        ),
        ("EPD 5\nSO 0 1e11\nS 50 3 BK7\nCYL\nS 0 5\nSI 0 0\n", "surface 1: is a cylinder"),
        ("EPD 5\nSO 0 1e11\nS 50 3 BK7\nADE 5\nS 0 5\nSI 0 0\n", "surface 1: is shifted or tilted"),
        ("EPD 5\nSO 0 1e11\nS 50 3 BK7\nS x 5\nSI 0 0\n", "'x' stands where S expects a number"),
        ("EPD 5\nhello\n", "is not a CODE V lens file"),
        ("EPD 5\nSO 0 1e11\nS 50 3 BK7\nJ 5\nS 0 5\nSI 0 0\n", "has the coefficient J"),
    ],
)
def test_bad_code_v_files_are_named(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "lens.seq"
    path.write_text(text, encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ImportWarning)
        with pytest.raises(SceneError, match=f"lens.seq.*({words})"):
            load_scene(path)


def test_files_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="there is no lens file"):
        load_scene(tmp_path / "none.zmx")
    (tmp_path / "binary.zmx").write_bytes(bytes(range(256)) * 16)
    with pytest.raises(SceneError, match=r"binary\.zmx"):
        load_scene(tmp_path / "binary.zmx")
    (tmp_path / "empty.zmx").write_bytes(b"")
    with pytest.raises(SceneError, match="is empty: no lens file"):
        load_scene(tmp_path / "empty.zmx")


def test_glasses_may_be_said(tmp_path: Path) -> None:
    (tmp_path / "lens.zmx").write_text(SINGLET.replace("N-BK7", "HOUSE-1"), encoding="utf-8")
    scene = 'length_unit = "mm"\n{}\n[lens_files.a]\nfile = "lens.zmx"\n{}\n'
    for media, glasses, medium in (
        ("", 'glasses = { "HOUSE-1" = "SF11" }', "SF11"),
        ('[media."HOUSE-1"]\nindex = 1.6', "", "HOUSE-1"),
        ("[media.mine]\nindex = 1.6", 'glasses = { "HOUSE-1" = "mine" }', "mine"),
    ):
        loaded = parse_scene(scene.format(media, glasses), folder=tmp_path)
        assert loaded.bodies["a.L1"].medium == medium
        assert medium in loaded.media
    with pytest.raises(SceneError, match="said to be 'nobody'"):
        parse_scene(scene.format("", 'glasses = { "HOUSE-1" = "nobody" }'), folder=tmp_path)


@settings(max_examples=examples(60), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_torn_files_never_crash(data: st.DataObject) -> None:
    for text, parse in ((SINGLET, parse_zemax), (DOUBLET, parse_codev)):
        words = text.split(" ")
        for _ in range(data.draw(st.integers(1, 4))):
            place = data.draw(st.integers(0, len(words) - 1))
            words[place] = data.draw(
                st.sampled_from(
                    ["", "\n", "nan", "-1", "1e400", "x", "SURF", "S", "'", "0", "S 1 2"]
                )
            )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ImportWarning)
            with suppress(RayMapError):
                parse(" ".join(words))


values = st.recursive(
    st.booleans()
    | st.integers(-(2**53), 2**53)
    | st.floats(allow_nan=False)
    | st.text(st.characters(exclude_categories=["Cs", "Cc"]), max_size=8),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.text("abc .\"'-é", min_size=1, max_size=5), inner, max_size=3)
    ),
    max_leaves=8,
)


@given(st.dictionaries(st.text("abc .-é", min_size=1, max_size=5), values, max_size=4))
def test_written_toml_reads_back(tables: dict[str, object]) -> None:
    assert tomllib.loads(toml_text(tables)) == tables
    assert math.isinf(tomllib.loads(toml_text({"a": math.inf}))["a"])

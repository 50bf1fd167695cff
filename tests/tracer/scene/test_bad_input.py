"""Input that cannot be traced as it stands: one clear line with its place, or a counted warning."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from raymap.cli import main
from raymap.model.errors import RayMapError, SceneError
from tracer.geometry.mesh import MeshWarning
from tracer.run.recording import record
from tracer.scene.compile import Compilation, compile_scene
from tracer.scene.load import load_scene, parse_scene
from tracer.studies.section import draw_section

HEAD = 'length_unit = "mm"\n[sources.s]\nkind = "point"\nposition = [0, 0, 9]\n'
MESH = """
[media.g]
index = 1.5
[bodies.b]
kind = "mesh"
file = "b.stl"
scale = 1
medium = "g"
"""
BALL = '[bodies.b]\nkind = "sphere"\nradius = 1\n'
LIT = BALL + 'surface = "absorber"\n'
INDEX = BALL + 'medium = "g"\n[media.g]\nindex = '
SURFACE = BALL + 'surface = "m"\n[surfaces.m]\n'

CASES = {
    "no unit of length": ("!", r"length_unit: is missing"),
    "unknown unit": ("!furlong", r"length_unit: input should be 'mm'"),
    "a unit with a slip": ("!mmm", r"length_unit: .*\(it is 'mmm'\); did you mean 'mm'\?"),
    "a word of few with a slip": (
        '[spectrum]\nkind = "spectrall"\n',
        r"spectrum\.kind: .*; did you mean 'spectral'\?",
    ),
    "a key of a surface with a slip": (
        SURFACE + 'kind = "lambertian"\nreflectanse = 0.5\n',
        r"surfaces\.m\.reflectanse: .* it takes reflectance, .*; did you mean 'reflectance'\?",
    ),
    "a kind where a name belongs": (
        BALL + 'surface = "mirror"',
        r"there is no surface 'mirror'; it is a kind: add \[surfaces\.mirror\] with kind",
    ),
    "built-in surfaces are known": (
        BALL + 'surface = "absorbr"',
        r"there is no surface 'absorbr'; did you mean 'absorber'\?",
    ),
    "no surfaces but those built in": (
        BALL + 'surface = "zzz"',
        r"there is no surface 'zzz'; known are bare, absorber \(or add \[surfaces\.zzz\]\)",
    ),
    "mesh without a unit": (MESH.replace("scale = 1\n", ""), r"bodies\.b\.scale: is missing"),
    "gap in an index": (
        INDEX + "{ wavelength_nm = [400, 700], value = [1.5, nan] }",
        r"media\.g\.index: entry 2 is nan: a gap",
    ),
    "table that ends early": (
        INDEX + "{ wavelength_nm = [500, 700], value = [1.5, 1.5] }",
        r"media\.g\.index: a table covers 500 to 700 nm, the trace needs 464 to 611 nm",
    ),
    "index below zero": (INDEX + "-1", r"media\.g: the refractive index must be positive"),
    "reflectance that is no number": (
        SURFACE + 'kind = "lambertian"\nreflectance = nan',
        r"surfaces\.m\.reflectance: entry 1 is nan",
    ),
    "diffuse energy": (
        SURFACE + 'kind = "lambertian"\nreflectance = 0.7\ntransmittance = 0.5',
        r"surfaces\.m: reflectance \+ transmittance is 1\.2",
    ),
    "scatter that creates energy": (
        SURFACE + 'kind = "mirror"\nreflectance = 1\nscatter = { abg = [5, 0.01, 1.5] }',
        r"surface 'm' scatters 46\.\d+ times the light that arrives",
    ),
    "measurement that creates energy": (
        SURFACE
        + 'kind = "tabulated"\n[surfaces.m.reflected]\ntheta_i_deg = [0, 90]\n'
        + "theta_o_deg = [0, 90]\nphi_deg = [0, 180]\n"
        + "values = [[[0.9, 0.9], [0.9, 0.9]], [[0.9, 0.9], [0.9, 0.9]]]",
        r"surface 'm': its BSDF table creates energy: at 0 degrees it scatters 2\.827 times",
    ),
    "brackets without end": ("x = " + "[" * 5000 + "]" * 5000, r"brackets nest too deep"),
    "number of thousands of digits": ("x = " + "1" * 5000, r"a number cannot be read"),
    "body whose kind is a list": ("[bodies.b]\nkind = [1]\n", r"bodies\.b\.kind: there is no body"),
    "variant that is a number": ("\n[variants]\nx = 3\n", r"variants\.x: must be a table"),
    "place beyond all bounds": (
        BALL.replace("radius", "position = [0, 0, inf]\nradius"),
        r"bodies\.b\.position\.2: input should be a finite number",
    ),
}


def compiled(text: str, folder: Path) -> Compilation:
    if text.startswith("!"):
        unit = f'length_unit = "{text[1:]}"\n' if text[1:] else ""
        return compile_scene(parse_scene(unit + HEAD.partition("\n")[2], folder=folder))
    return compile_scene(parse_scene(HEAD + text, folder=folder))


@pytest.mark.parametrize("case", CASES)
def test_bad_input_is_refused_in_one_line(case: str, tmp_path: Path) -> None:
    text, message = CASES[case]
    with pytest.raises(SceneError, match=message) as caught:
        compiled(text, tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("table", ["bodies", "sources", "detectors", "variants"])
def test_a_number_for_a_table_is_refused(table: str) -> None:
    with pytest.raises(SceneError, match=f"{table}: must be a table of named entries"):
        parse_scene(f'{table} = 3\nlength_unit = "mm"\n')


def test_a_byte_order_mark_is_read(tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(HEAD, encoding="utf-8-sig")
    assert load_scene(scene).length_unit == "mm"


def test_a_drawing_without_a_place_is_refused(tmp_path: Path) -> None:
    target = tmp_path / "missing" / "section.svg"
    with pytest.raises(RayMapError, match="cannot be written: there is no folder"):
        draw_section(parse_scene(HEAD + LIT), target)


def test_a_seed_that_is_too_large_is_refused() -> None:
    with pytest.raises(SceneError, match="seed must be from 0 to"):
        record(parse_scene(HEAD + LIT), rays=1, seed=2**70, no_rays=True)


def test_the_scene_is_never_written_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(HEAD, encoding="utf-8")
    monkeypatch.setattr("sys.argv", ["raymap", "record", str(scene), "-o", str(scene), "--force"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    assert "is the scene file: name another file for the map" in capsys.readouterr().err
    assert scene.read_text(encoding="utf-8") == HEAD


def test_bad_meshes_are_refused_or_warned_about(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    box = trimesh.creation.box(extents=[2, 2, 2])
    file = tmp_path / "b.stl"
    opened = box.copy()
    opened.update_faces(np.arange(11))
    opened.export(file)
    with pytest.raises(SceneError, match=r"mesh 'b' is open: 3 edges .* \(without a medium\)"):
        compiled(MESH, tmp_path)
    turned = box.copy()
    turned.invert()
    turned.export(file)
    with pytest.raises(SceneError, match=r"mesh 'b' is inside out: .* flip = true"):
        compiled(MESH, tmp_path)
    compiled(MESH + "flip = true\n", tmp_path)
    other = trimesh.creation.box(extents=[2, 2, 2])
    other.apply_translation([1, 0.5, 0.3])
    trimesh.util.concatenate([box, other]).export(file)
    with pytest.warns(MeshWarning, match="mesh 'b': 12 edges run through triangles elsewhere"):
        compiled(MESH, tmp_path)


LENS = (
    '[media.g]\nindex = 1.5\n[bodies.b]\nkind = "lens"\nmedium = "g"\nthickness = 3\n'
    "front = { radius = 50, semi_diameter = 9 }\n"
)
SECOND = (
    'back = { radius = -50, semi_diameter = 9 }\n[bodies.c]\nkind = "lens"\nmedium = "g"\n'
    'position = [0, 0, 3]\nthickness = 3\nfront = { cemented = "b" }\n'
)

SLIPS = {
    "aperture of 1e308": (
        LENS.replace("9 }", "1e308 }") + "back = { radius = -50, semi_diameter = 9 }",
        r"bodies\.b\.front\.semi_diameter: input should be less than or equal to 1000000000000",
    ),
    "body of no size": (
        BALL.replace("= 1", "= 1e-300"), r"bodies\.b\.radius: must be at least 1e-12",
    ),
    "unknown table": (
        BALL + "[foo]\nx = 1\n",
        r"foo: unknown key; known are bodies, cad_files, .*contacts, detectors, .*, world$",
    ),
    "name of what scenes hold within": ('[text]\na = 1\n', r"text: unknown key; known are"),
    "glass of a body": (
        BALL + 'glass = "N-BK7"\n',
        r"bodies\.b\.glass: unknown key; glass belongs to a medium: write \[media\.NAME\]",
    ),
    "medium that is a glass": (
        BALL + 'medium = "N-BK7"\n',
        r"no medium 'N-BK7'; it is a glass of the catalogue: add \[media\.N-BK7\] glass = 'N-BK7'",
    ),
    "cement in a circle": (
        LENS.replace("front = { radius = 50, semi_diameter = 9 }", 'front = { cemented = "c" }')
        + SECOND + "back = { radius = 70, semi_diameter = 9 }\n",
        r"bodies\.b\.front\.cemented: .*'b' and 'c' are cemented in a circle",
    ),
    "cement twice": (
        LENS + SECOND + 'back = { radius = 70, semi_diameter = 9 }\n'
        + SECOND.partition("\n")[2].replace("bodies.c", "bodies.d")
        + "back = { radius = 70, semi_diameter = 9 }\n",
        r"bodies\.d\.front\.cemented: the back of 'b' is cemented to 'c' already",
    ),
    "cement at a back": (
        LENS + 'back = { cemented = "b" }\n', r"bodies\.b\.back\.cemented: lenses are cemented at"
    ),
    "direction of no length": (
        BALL + "axis = [1e-300, 0, 0]\n", r"bodies\.b: axis must not be the zero vector"
    ),
    "contacts without crystals": (
        'contacts = [["b", "b"]]\n', r"contacts: is for scenes with crystals"
    ),
    "depth beyond all bounds": ("[limits]\ndepth = 10000000\n", r"limits\.depth: input should be"),
    "rays of an emission": (
        '[trace]\nmode = "weighted"\nsplit_depth = 1\nrays_per_emission = 1000000\n',
        r"trace\.rays_per_emission: input should be less than or equal to 65536",
    ),
    "key of an inner table": (
        '[surfaces.x]\nkind = "mirror"\nreflectance = { rgbb = [1, 1, 1] }\n',
        r"surfaces\.x\.reflectance\.rgbb: unknown key; did you mean 'rgb'",
    ),
    "key of a spectrum": (
        '[sources.x]\nkind = "point"\nspectrum = { led = { peak_nm = 525, share = 1 } }\n',
        r"sources\.x\.spectrum\.led\.share: unknown key; known are peak_nm, width_nm",
    ),
    "word for a list": (
        '[sources.x]\nkind = "point"\nposition = "here"\n',
        r"sources\.x\.position: input should be a list in brackets \(it is 'here'\)",
    ),
    "list that is too long": (
        '[sources.x]\nkind = "point"\nposition = [1, 2, 3, 4]\n',
        r"sources\.x\.position: takes at most 3 entries, not 4",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", SLIPS)
def test_slips_of_the_pen_are_refused_in_one_line(case: str, tmp_path: Path) -> None:
    text, message = SLIPS[case]
    if text.startswith("contacts"):
        unit, _, rest = HEAD.partition("\n")
        text = f"!{unit}\n{text}{rest}"
    with pytest.raises(SceneError, match=message) as caught:
        compile_scene(parse_scene(text[1:] if text[0] == "!" else HEAD + text, folder=tmp_path))
    assert "\n" not in str(caught.value)


def test_a_lens_without_a_rim_has_a_black_one() -> None:
    from tests.tracer.transport.tracing import trace

    text = LENS + "back = { radius = inf, semi_diameter = 9 }\n"
    text += '[sources.s]\nkind = "collimated"\nposition = [0, 0, -9]\ndiameter = 1\n'
    found = trace(text, 100)
    faces = found.compilation.directory.objects[0].faces
    surface = found.compilation.directory.surfaces[faces[2].surface]
    assert (faces[2].name, surface.name) == ("rim", "absorber")


def _many(kind, table, count):
    source = '[sources.s]\nkind = "collimated"\ndirection = [0, 0, 1]\ndiameter = 1\n'
    head = f'length_unit = "mm"\n{source}'
    copies = "copies = {{ count = {}, step = [5, 0, 0] }}\n"
    parts = [f"[{kind}.{name}]\n{table}{copies.format(n)}" for name, n in count.items()]
    return head + '[surfaces.w]\nkind = "absorber"\n' + "\n".join(parts)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            _many(
                "bodies",
                'kind = "disc"\nouter = 1\nsurface = "w"\n',
                dict.fromkeys("abcd", 10_000),
            ),
            "there are 40000 bodies and blocking detectors; a ray map numbers at most 32767",
        ),
        (
            _many("bodies", 'kind = "disc"\nouter = 1\nsurface = "w"\n', {"x" * 1100: 2}),
            "names have 1 to 1024 characters",
        ),
    ],
    ids=["bodies", "names"],
)
def test_more_than_a_map_can_number_is_refused_before_it_is_compiled(tmp_path, text, words):
    path = tmp_path / "many.toml"
    path.write_text(text)
    with pytest.raises(SceneError, match=words):
        compile_scene(load_scene(path))

"""STEP files as bodies: volumes, areas, names, colours, units, exact shapes, bad files."""

from __future__ import annotations

import itertools
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
from OCP.BRepPrimAPI import (
    BRepPrimAPI_MakeBox,
    BRepPrimAPI_MakeCone,
    BRepPrimAPI_MakeCylinder,
    BRepPrimAPI_MakeSphere,
    BRepPrimAPI_MakeTorus,
)
from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt
from typer.testing import CliRunner

import raymap
from raymap.cli import application
from raymap.model.errors import SceneError
from tests.tracer.importers.step_files import Part, faces_only, write_step
from tracer.geometry.mesh import TriangleMesh
from tracer.geometry.shapes import Cylinder, Frustum, SphereCap
from tracer.importers.cad_bodies import CadBody, CadMeshBody
from tracer.importers.cad_formats.step_error import reflection_error_mrad
from tracer.importers.cad_formats.step_mesh import mesh_of_solid
from tracer.importers.cad_formats.step_read import read_step
from tracer.importers.prescription import ImportWarning
from tracer.run.recording import record
from tracer.scene.compile import compile_scene
from tracer.scene.load import load_scene, parse_scene
from tracer.transport.trace import trace_rays

SCENE = """
length_unit = "mm"
[media.glass]
index = 1.5
[surfaces.black]
kind = "absorber"
[cad_files.cad]
file = "part.step"
medium = "glass"
{more}
[sources.beam]
kind = "collimated"
position = [0, 0, -30]
direction = [0, 0, 1]
diameter = 4
[detectors.screen]
position = [0, 0, 60]
looks = [0, 0, -1]
size = [40, 40]
cells = [10, 10]
blocking = true
"""


def ball(radius: float = 5.0) -> Part:
    return Part("ball", BRepPrimAPI_MakeSphere(radius).Shape())


def test_volumes_areas_names_and_colours(tmp_path: Path) -> None:
    block = BRepPrimAPI_MakeBox(2.0, 3.0, 4.0).Shape()
    parts = [
        Part("block", block, ((0, 0, 0), (10, 0, 0)), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        Part("ball", BRepPrimAPI_MakeSphere(5.0).Shape(), ((30, 0, 0),)),
        Part("cup", BRepPrimAPI_MakeCone(3.0, 1.0, 4.0).Shape(), ((50, 0, 0),)),
        Part("ring", BRepPrimAPI_MakeTorus(8.0, 2.0).Shape(), ((70, 0, 0),)),
    ]
    path = write_step(tmp_path / "all.step", parts, face_names=["mirror side", "back.of*it"])
    solids = {solid.name: solid for solid in read_step(path)}
    assert list(solids) == ["block_1", "block_2", "ball", "cup", "ring"]
    cone = math.pi * 4.0 * (9.0 + 3.0 + 1.0) / 3.0
    volumes = {"block_1": 24.0, "block_2": 24.0, "ball": 4 / 3 * math.pi * 125.0, "cup": cone,
               "ring": 2 * math.pi**2 * 8.0 * 4.0}  # fmt: skip
    for name, volume in volumes.items():
        assert solids[name].volume == pytest.approx(volume, rel=1e-9)
    names = [face.name for face in solids["block_1"].faces]
    assert names[:3] == ["mirror_side", "back_of_it", "face_3"]
    assert sorted(face.area for face in solids["block_2"].faces) == pytest.approx(
        [6, 6, 8, 8, 12, 12]
    )
    assert solids["block_2"].color == "#ff0000"
    assert solids["block_1"].faces[0].color == "#0000ff"
    assert [face.kind for face in solids["cup"].faces] == ["cone", "plane", "plane"]
    assert solids["ring"].faces[0].area == pytest.approx(4 * math.pi**2 * 16.0)
    # Copies stand apart
    low = [mesh_of_solid(solids[f"block_{k}"], chord_mm=1, angle_deg=20).vertices for k in (1, 2)]
    assert np.allclose(low[1].min(axis=0) - low[0].min(axis=0), [10, 0, 0])


def test_inches_become_scene_units(tmp_path: Path) -> None:
    # OpenCASCADE takes its numbers for millimetres and writes them in inches
    path = write_step(tmp_path / "part.step", [ball(25.4)], unit="INCH")
    assert "'INCH'" in path.read_text(encoding="utf-8")
    assert read_step(path)[0].volume == pytest.approx(4 / 3 * math.pi * 25.4**3, rel=1e-6)
    text = SCENE.format(more="").replace('"mm"', '"in"')
    body = parse_scene(text, folder=tmp_path).bodies["cad.ball"]
    (cap,) = body.plan()[0].shapes
    assert isinstance(cap, SphereCap)
    assert cap.radius == pytest.approx(1.0, rel=1e-9)


@pytest.mark.filterwarnings("ignore:.*turn the light that it reflects")
@pytest.mark.parametrize(
    ("shape", "kinds"),
    [
        (BRepPrimAPI_MakeSphere(5.0).Shape(), {SphereCap}),
        (BRepPrimAPI_MakeCylinder(2.0, 6.0).Shape(), {Cylinder}),
        (BRepPrimAPI_MakeCone(3.0, 0.0, 6.0).Shape(), {Frustum}),
        (BRepPrimAPI_MakeCone(1.0, 3.0, 6.0).Shape(), {Frustum}),
        (
            BRepPrimAPI_MakeSphere(
                gp_Ax2(gp_Pnt(1, 2, 3), gp_Dir(1, 2, 2)), 5.0, 0.3, math.pi / 2
            ).Shape(),
            {SphereCap},
        ),
        (
            BRepAlgoAPI_Cut(
                BRepPrimAPI_MakeCylinder(4.0, 6.0).Shape(),
                BRepPrimAPI_MakeCylinder(2.0, 6.0).Shape(),
            ).Shape(),
            {Cylinder},
        ),
        (
            BRepAlgoAPI_Cut(
                BRepPrimAPI_MakeBox(4.0, 4.0, 4.0).Shape(),
                BRepPrimAPI_MakeBox(2.0, 2.0, 4.0).Shape(),
            ).Shape(),
            set(),
        ),
    ],
)
def test_closed_forms_are_where_the_triangles_are(
    tmp_path: Path, shape: object, kinds: set[type]
) -> None:
    write_step(tmp_path / "part.step", [Part("part", shape)])
    exact = parse_scene(SCENE.format(more=""), folder=tmp_path)
    rough = parse_scene(
        SCENE.format(more="triangles = true\nchord = 0.002\nangle_deg = 5"), folder=tmp_path
    )
    body, mesh = exact.bodies["cad.part"], rough.bodies["cad.part"]
    assert isinstance(body, CadBody)
    assert isinstance(mesh, CadMeshBody)
    assert kinds <= {type(shape) for plan in body.plan() for shape in plan.shapes}
    # The same rays meet the same faces at the same places, and go the same way behind
    generator = np.random.default_rng(4)
    n = 60
    origins = generator.uniform(-30, 30, (n, 3))
    origins *= 30.0 / np.linalg.norm(origins, axis=1, keepdims=True)
    directions = generator.uniform(-1.5, 2.5, (n, 3)) - origins
    traced = [
        trace_rays(scene, origins, directions, wavelength_nm=550.0) for scene in (exact, rough)
    ]
    same = hits = 0
    for ray in range(n):
        a, b = (t.points[t.offsets[ray] : t.offsets[ray + 1]] for t in traced)
        if len(a) > 2:
            hits += 1
            same += len(a) == len(b) and bool(np.abs(a[1:-1] - b[1:-1]).max() < 0.02)
    assert hits > 10
    assert same >= 0.9 * hits


def test_triangles_keep_the_chord_and_have_the_normals_of_the_surface(tmp_path: Path) -> None:
    path = write_step(
        tmp_path / "ring.step", [Part("ring", BRepPrimAPI_MakeTorus(8.0, 2.0).Shape())]
    )
    mesh = mesh_of_solid(read_step(path)[0], chord_mm=0.02, angle_deg=30)
    assert mesh.face_names == ("face_1",)
    assert mesh.closed
    corners = mesh.vertices[mesh.triangles]

    def off(p: np.ndarray) -> np.ndarray:
        return np.hypot(np.hypot(p[..., 0], p[..., 1]) - 8.0, p[..., 2]) - 2.0

    assert np.abs(off(corners)).max() < 1e-9
    for weights in ((1, 1, 1), (1, 1, 0), (0, 1, 1), (1, 0, 1), (4, 1, 1)):
        inside = np.einsum("k,mkj->mj", np.array(weights) / sum(weights), corners)
        assert np.abs(off(inside)).max() < 0.02 * 1.05
    ring = np.dstack([corners[..., 0], corners[..., 1], 0.0 * corners[..., 0]])
    ring *= 8.0 / np.linalg.norm(ring, axis=2, keepdims=True)
    expected = (corners - ring) / 2.0
    assert mesh.corner_normals is not None
    assert np.abs(mesh.corner_normals - expected).max() < 1e-9
    assert mesh.volume == pytest.approx(2 * math.pi**2 * 8.0 * 4.0, rel=0.02)


def test_a_ball_of_step_traces_as_the_sphere(tmp_path: Path) -> None:
    write_step(tmp_path / "part.step", [ball()])
    step = parse_scene(SCENE.format(more=""), folder=tmp_path)
    own = parse_scene(
        SCENE.format(more="").replace(
            '[cad_files.cad]\nfile = "part.step"', '[bodies.ball]\nkind = "sphere"\nradius = 5'
        )
    )
    fine = parse_scene(
        SCENE.format(more="triangles = true\nchord = 0.001\nangle_deg = 3"), folder=tmp_path
    )
    x = np.linspace(-3.0, 3.0, 41)
    origins = np.column_stack([x, 0.3 * x + 0.1, np.full(len(x), -30.0)])
    directions = np.tile([0.0, 0.0, 1.0], (len(x), 1))
    ends = [
        trace_rays(scene, origins, directions, wavelength_nm=550.0) for scene in (own, step, fine)
    ]
    assert np.array_equal(ends[0].offsets, ends[1].offsets)
    assert np.abs(ends[0].points - ends[1].points).max() < 1e-12
    assert np.array_equal(ends[0].offsets, ends[2].offsets)
    # 50 mm behind the ball, through two refractions at triangles with exact normals
    off = np.linalg.norm(ends[0].points - ends[2].points, axis=1)
    assert off.max() < 0.01


def test_the_map_names_what_took_part(tmp_path: Path) -> None:
    block = BRepPrimAPI_MakeBox(gp_Pnt(-4, -4, 10), 8.0, 8.0, 1.0).Shape()
    write_step(tmp_path / "part.step", [ball(), Part("block", block, color=(0.0, 1.0, 0.0))])
    more = (
        '[cad_files.cad.bodies.block]\nsurface = "black"\nfaces = { "face_[56]" = "bare" }\n'
        '[simulations.without]\nleave_out = ["*.block"]\n'
    )
    for name, objects in ((None, ["cad.ball", "cad.block", "screen"]), ("without", ["cad.ball", "screen"])):  # fmt: skip # noqa: E501
        scene = parse_scene(SCENE.format(more=more), folder=tmp_path, simulation=name)
        record(scene, tmp_path / "m.raymap", rays=500, force=True, threads=1)
        with raymap.open(tmp_path / "m.raymap") as map_:
            directory = map_.directory
        assert [item.name for item in directory.objects] == objects
        if name is None:
            block_object = directory.objects[1]
            assert block_object.parameters["color"] == "#00ff00"
            assert [face.name for face in block_object.faces] == [f"face_{k}" for k in range(1, 7)]
            surfaces = [directory.surfaces[face.surface].name for face in block_object.faces]
            assert surfaces == ["black"] * 4 + ["bare"] * 2
            assert directory.parameters == {}
        else:
            assert directory.parameters["simulation"] == {
                "simulation": "without",
                "leave_out": ["*.block"],
                "left_out": {"bodies": ["cad.block"]},
            }


def test_bad_files_are_one_clear_error(tmp_path: Path) -> None:
    path = tmp_path / "part.step"
    write_step(path, [Part("shells", faces_only())])
    with pytest.raises(SceneError, match=r"part.step: holds no solid \(6 faces, 24 edges\)"):
        read_step(path)
    path.write_text("no step at all", encoding="utf-8")
    with pytest.raises(SceneError, match=r"part.step: cannot be read as a STEP file"):
        read_step(path)
    with pytest.raises(SceneError, match="there is no CAD file"):
        read_step(tmp_path / "none.step")
    # A face is gone from the shell
    text = write_step(path, [Part("box", BRepPrimAPI_MakeBox(1, 1, 1).Shape())]).read_text("utf-8")
    start = text.index("CLOSED_SHELL('',(") + len("CLOSED_SHELL('',(")
    path.write_text(text[:start] + text[text.index(",", start) + 1 :], encoding="utf-8")
    with pytest.raises(SceneError, match=r"holds no solid \(5 faces"):
        read_step(path)
    # A corner lies elsewhere: the edges of three faces miss each other
    corner = re.search(r"VERTEX_POINT\('',(#\d+)\)", text)
    assert corner is not None
    moved = re.sub(
        rf"{corner[1]} = CARTESIAN_POINT\('',\([^)]*\)\)",
        f"{corner[1]} = CARTESIAN_POINT('',(5.,5.,7.))",
        text,
    )
    path.write_text(moved, encoding="utf-8")
    with pytest.raises(SceneError, match=r"part.step: 'box': its face 'face_\d' is broken"):
        read_step(path)
    path.write_text(text[: len(text) // 2], encoding="utf-8")
    with pytest.raises(SceneError, match="cannot be read as a STEP file"):
        read_step(path)


def test_loose_faces_are_told(tmp_path: Path) -> None:
    path = write_step(tmp_path / "part.step", [ball(), Part("sheet", faces_only())])
    with pytest.warns(ImportWarning, match="6 faces belong to no solid"):
        assert [solid.name for solid in read_step(path)] == ["ball"]


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ('use = ["bal"]', r"cad_files.cad.use: the file has no solid 'bal'; it has ball"),
        ('faces = { fae_1 = "black" }', r"no solid has such a face; there are face_1"),
        ("chrod = 1", r"cad_files.cad.chrod: unknown key; did you mean 'chord'"),
        ('[cad_files.cad.bodies.bell]\nsurface = "black"', "no solid 'bell'; it has ball"),
    ],
)
def test_bad_keys_are_named(tmp_path: Path, more: str, words: str) -> None:
    write_step(tmp_path / "part.step", [ball()])
    with pytest.raises(SceneError, match=words):
        parse_scene(SCENE.format(more=more), folder=tmp_path)


def test_faces_are_listed(tmp_path: Path) -> None:
    path = write_step(tmp_path / "part.step", [ball()])
    (tmp_path / "scene.toml").write_text(SCENE.format(more="triangles = true"), encoding="utf-8")
    for file, name in ((path, "ball"), (tmp_path / "scene.toml", "cad.ball")):
        result = CliRunner().invoke(application(), ["faces", str(file), "--json"])
        assert result.exit_code == 0
        listed = json.loads(result.stdout)
        assert listed["length_unit"] == "mm"
        (body,) = listed["bodies"]
        assert body["name"] == name
        (face,) = body["faces"]
        assert (face["name"], face["kind"]) == ("face_1", "sphere")
        assert face["area"] == pytest.approx(100 * math.pi)
    result = CliRunner().invoke(application(), ["faces", str(path)])
    assert "1 bodies, 1 faces" in result.stdout
    result = CliRunner().invoke(application(), ["record", str(path), "-o", "x.raymap"])
    assert isinstance(result.exception, SceneError)
    assert "cad_files" in str(result.exception)


CURVES = """#9001=SHAPE_REPRESENTATION('',(#11),#{context});
#9002=SHAPE_REPRESENTATION_RELATIONSHIP('None','rep and solids',#9001,#10);
#9003=GEOMETRICALLY_BOUNDED_WIREFRAME_SHAPE_REPRESENTATION('',(#9010),#{context});
#9004=SHAPE_REPRESENTATION_RELATIONSHIP('None','rep and curves',#9001,#9003);
#9010=GEOMETRIC_CURVE_SET('',(#9011));
#9011=POLYLINE('',(#9012,#9013));
#9012=CARTESIAN_POINT('',(0.,0.,20.));
#9013=CARTESIAN_POINT('',(5.,0.,20.));
"""


def part_file(path: Path, product: str, *, curves: bool, solid: str = "") -> Path:
    """A box of one product, written by OpenCASCADE, with curves beside it where they are wanted."""
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
    from OCP.STEPControl import STEPControl_StepModelType, STEPControl_Writer

    writer = STEPControl_Writer()
    shape = BRepPrimAPI_MakeBox(10.0, 10.0, 10.0).Shape()
    writer.Transfer(shape, STEPControl_StepModelType.STEPControl_AsIs)
    writer.Write(str(path))
    text = path.read_text()
    text = re.sub(r"PRODUCT\('[^']*',\s*'[^']*'", f"PRODUCT('{product}','{product}'", text)
    text = text.replace("MANIFOLD_SOLID_BREP(''", f"MANIFOLD_SOLID_BREP('{solid}'")
    if curves:
        head = "#3 = SHAPE_DEFINITION_REPRESENTATION(#4,#10)"
        assert head in text
        found = re.search(r"#10 = ADVANCED_BREP_SHAPE_REP\w+\('',\(#11,#15\),\s*#(\d+)\)", text)
        assert found is not None
        text = text.replace(head, head.replace("#10", "#9001"))
        at = text.rindex("ENDSEC;")
        text = text[:at] + CURVES.format(context=found[1]) + text[at:]
    path.write_text(text)
    return path


@pytest.mark.parametrize("curves", [False, True])
@pytest.mark.parametrize("product", ["LIGHTGUIDE", "4711", "SOLID", "COMPOUND", "Part 7.b"])
@pytest.mark.parametrize("solid", ["", "Body1", "12"])
def test_a_solid_has_the_name_of_its_product(
    tmp_path: Path, product: str, solid: str, curves: bool
) -> None:
    path = part_file(tmp_path / "part.step", product, curves=curves, solid=solid)
    (found,) = read_step(path)
    assert found.name == product.replace(" ", "_").replace(".", "_")
    assert found.volume == pytest.approx(1000.0)


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
@pytest.mark.parametrize("triangles", ["false", "true"])
def test_cavities_are_wound_inward_in_exports(tmp_path: Path, suffix: str, triangles: str) -> None:
    """trimesh sums signed volumes: a box less the ball in it."""
    trimesh = pytest.importorskip("trimesh")
    from viewer.export import export_3d

    box = BRepPrimAPI_MakeBox(10.0, 10.0, 10.0).Shape()
    ball = BRepPrimAPI_MakeSphere(gp_Pnt(5.0, 5.0, 5.0), 3.0).Shape()
    write_step(tmp_path / "void.step", [Part("void", BRepAlgoAPI_Cut(box, ball).Shape())])
    text = f"""
length_unit = "mm"
[media.glass]
index = 1.5
[cad_files.v]
file = "void.step"
medium = "glass"
triangles = {triangles}
[sources.s]
kind = "point"
position = [0, 0, 50]
"""
    (tmp_path / "scene.toml").write_text(text)
    scene = load_scene(tmp_path / "scene.toml")
    record(scene, tmp_path / "void.raymap", rays=100)
    with raymap.open(tmp_path / "void.raymap") as ray_map:
        export_3d(ray_map, tmp_path / f"void{suffix}")
    bodies = trimesh.load_scene(tmp_path / f"void{suffix}").geometry.values()
    volume = sum(body.volume for body in bodies if hasattr(body, "faces"))
    assert volume == pytest.approx(1000.0 - 36.0 * math.pi, rel=0.001)


# -- what triangles do to reflected light -------------------------------------------------------


def turned_light_mrad(mesh: TriangleMesh, radius: float) -> np.ndarray:
    """Errors of light reflected at 45 degrees by the triangles of a ball, against the ball's."""
    random = np.random.default_rng(1)
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen = random.choice(len(area), 20_000, p=area / area.sum())
    u = random.random((20_000, 2))
    u[u.sum(axis=1) > 1] = 1 - u[u.sum(axis=1) > 1]
    w = np.column_stack([1 - u.sum(axis=1), u])[:, :, None]
    places = (w * np.stack([a, b, c], axis=1)[chosen]).sum(axis=1)
    assert mesh.corner_normals is not None
    normals = (w * mesh.corner_normals[chosen]).sum(axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    across = np.cross(normals, random.normal(size=normals.shape))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    d = math.sqrt(0.5) * (across - normals)
    # Where the ray meets the ball itself, nearest to where it meets the triangle
    along = np.einsum("ij,ij->i", places, d)
    root = np.sqrt(along**2 - (places**2).sum(axis=1) + radius**2)
    t = np.where(np.abs(root - along) < np.abs(root + along), root - along, -root - along)
    true = (places + t[:, None] * d) / radius
    reflected = [d - 2 * np.einsum("ij,ij->i", d, n)[:, None] * n for n in (normals, true)]
    return np.asarray(1e3 * np.linalg.norm(reflected[0] - reflected[1], axis=1))


@pytest.mark.parametrize("chord", [0.4, 0.1, 0.02])
def test_the_estimate_of_turned_light_is_that_of_rays(tmp_path: Path, chord: float) -> None:
    """On a ball, whose normals are known: the error that 95 % of the rays stay below."""
    (solid,) = read_step(write_step(tmp_path / "ball.step", [ball(20.0)]))
    mesh = mesh_of_solid(solid, chord_mm=chord, angle_deg=40.0)
    wanted = float(np.percentile(turned_light_mrad(mesh, 20.0), 95))
    assert reflection_error_mrad(solid.faces[0]) == pytest.approx(wanted, rel=0.25)


def dish(path: Path) -> Path:
    """A block with a paraboloid of focal length 25 cut out of it by revolution."""
    from OCP.BRepBuilderAPI import (
        BRepBuilderAPI_MakeEdge,
        BRepBuilderAPI_MakeFace,
        BRepBuilderAPI_MakeWire,
    )
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeRevol
    from OCP.gp import gp_Ax1, gp_Parab

    plane = gp_Ax2(gp_Pnt(0, 0, 0), gp_Dir(0, -1, 0), gp_Dir(0, 0, 1))
    rim = gp_Pnt(50, 0, 25)
    arc = BRepBuilderAPI_MakeEdge(gp_Parab(plane, 25.0), gp_Pnt(0, 0, 0), rim).Edge()
    points = [rim, gp_Pnt(50, 0, -5), gp_Pnt(0, 0, -5), gp_Pnt(0, 0, 0)]
    wire = BRepBuilderAPI_MakeWire(arc)
    for start, end in itertools.pairwise(points):
        wire.Add(BRepBuilderAPI_MakeEdge(start, end).Edge())
    face = BRepBuilderAPI_MakeFace(wire.Wire()).Face()
    shape = BRepPrimAPI_MakeRevol(face, gp_Ax1(gp_Pnt(0, 0, 0), gp_Dir(0, 0, 1))).Shape()
    return write_step(path, [Part("dish", shape)])


DISH = """
length_unit = "mm"
[surfaces.alu]
kind = "mirror"
reflectance = 0.9
[surfaces.grey]
kind = "lambertian"
reflectance = 0.5
[cad_files.r]
file = "dish.step"
surface = "{surface}"
{more}
[sources.s]
kind = "point"
position = [0, 0, 25]
"""


def test_mirrors_get_finer_triangles_or_a_warning(tmp_path: Path) -> None:
    dish(tmp_path / "dish.step")

    def triangles(surface: str, more: str = "") -> int:
        path = tmp_path / "scene.toml"
        path.write_text(DISH.format(surface=surface, more=more))
        compiled = compile_scene(load_scene(path))
        return sum(object.primitive_count for object in compiled.directory.objects[0].faces)

    coarse, fine = triangles("grey"), triangles("alu")
    assert fine > 4 * coarse
    with pytest.warns(
        ImportWarning, match=r"turn the light that it reflects by up to about [\d.]+ mrad"
    ):
        assert triangles("alu", "chord = 0.15") < fine
    # Nothing is said of what scatters
    triangles("grey", "chord = 0.15")


def test_triangles_do_not_depend_on_what_was_asked_before(tmp_path: Path) -> None:
    (solid,) = read_step(write_step(tmp_path / "ball.step", [ball(20.0)]))
    counts = [
        len(mesh_of_solid(solid, chord_mm=chord, angle_deg=40.0).triangles)
        for chord in (0.4, 0.02, 0.4)
    ]
    assert counts[0] == counts[2] < counts[1]

"""3D files of rays and scene, read back by the programs' own libraries."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import raymap
from raymap.model.errors import MapExists, RayMapError
from viewer.drawn.answers import draw_rays
from viewer.drawn.scene import load_bodies
from viewer.export import EXPORT_FORMATS, export_3d


def positions(document: dict[str, Any], node: dict[str, Any]) -> np.ndarray:
    data = base64.b64decode(document["buffers"][0]["uri"].partition("base64,")[2])
    primitive = document["meshes"][node["mesh"]]["primitives"][0]
    accessor = document["accessors"][primitive["attributes"]["POSITION"]]
    view = document["bufferViews"][accessor["bufferView"]]
    found = np.frombuffer(data, np.float32, 3 * accessor["count"], view["byteOffset"])
    return found.reshape(-1, 3)


def test_gltf_has_names_and_metres(small_map: raymap.RayMap, tmp_path: Path) -> None:
    written = export_3d(small_map, tmp_path / "a.gltf", rays=40)
    document = json.loads((tmp_path / "a.gltf").read_text())
    *parts, root = document["nodes"]
    assert document["scenes"][0]["nodes"] == [len(parts)]
    assert small_map.directory.length_unit == "mm"
    scale = 1e-3
    assert root["scale"] == [scale] * 3
    assert [node["name"] for node in parts] == written["objects"] + written["groups"]
    rays = draw_rays(small_map, None, 40).rays
    points = np.concatenate(
        [positions(document, node) for node in parts if node["name"] in written["groups"]]
    )
    assert len(points) == 2 * (rays.n_records - rays.n_rays) == 2 * written["segments"]
    np.testing.assert_array_equal(points.min(axis=0), rays.position.min(axis=0))


def test_groups_and_tails(small_map: raymap.RayMap, tmp_path: Path) -> None:
    by_source = export_3d(small_map, tmp_path / "a.glb", rays=60, scene=False)
    assert set(by_source["groups"]) <= {
        f"rays {source.name}" for source in small_map.directory.sources
    }
    by_path = export_3d(small_map, tmp_path / "b.glb", rays=60, group="path")
    assert len(by_path["groups"]) > 1
    assert export_3d(small_map, tmp_path / "c.glb", rays=60, group="none")["groups"] == ["rays"]
    export_3d(small_map, tmp_path / "d.gltf", "event(left)", rays=60, tail=0.0, group="none")
    document = json.loads((tmp_path / "d.gltf").read_text())
    short = positions(document, document["nodes"][-2])
    sphere = small_map.directory.bounding_sphere
    away = np.linalg.norm(short - np.array(sphere.center), axis=1)
    assert away.max() < 0.999 * sphere.radius


def test_vtp_has_bodies_and_rays(small_map: raymap.RayMap, tmp_path: Path) -> None:
    import pyvista

    written = export_3d(small_map, tmp_path / "a.vtp", rays=40)
    data = pyvista.read(tmp_path / "a.vtp")
    rays = draw_rays(small_map, None, 40).rays
    assert data.n_lines == written["segments"]
    names = list(data.field_data["object_names"])
    assert [name for name in names if name] == written["objects"]
    assert list(data.field_data["length_unit"]) == [small_map.directory.length_unit]
    lines = data["object"] < 0
    assert set(data["ray_id"][lines]) == set(rays.ray_ids.tolist())
    assert (data["ray_id"][~lines] == -1).all()
    assert len(data["rgba"]) == data.n_cells
    triangles = data.extract_cells(np.flatnonzero(data["object"] == names.index("L1")))
    box = small_map.meshes[names.index("L1")].vertices
    np.testing.assert_allclose(triangles.bounds[4:], (box[:, 2].min(), box[:, 2].max()), rtol=1e-6)


@pytest.mark.peers
def test_dxf_opens_with_layers_and_units(small_map: raymap.RayMap, tmp_path: Path) -> None:
    ezdxf = pytest.importorskip("ezdxf")
    written = export_3d(small_map, tmp_path / "a.dxf", rays=40)
    document = ezdxf.readfile(tmp_path / "a.dxf")
    assert not document.audit().errors
    assert document.header["$INSUNITS"] == {"mm": 4, "m": 6}[small_map.directory.length_unit]
    layers = {layer.dxf.name for layer in document.layers}
    assert set(written["objects"]) | set(written["groups"]) <= layers
    space = document.modelspace()
    rays = draw_rays(small_map, None, 40).rays
    lines = [line for line in space.query("POLYLINE") if line.dxf.layer in written["groups"]]
    assert len(lines) == rays.n_rays
    ends = {tuple(np.round(line.vertices[-1].dxf.location, 4)) for line in lines}
    wanted = np.round(rays.position[rays.offsets[1:] - 1].astype(float), 4)
    assert ends == {tuple(point) for point in wanted}
    bodies = load_bodies(small_map.directory, small_map.meshes)
    assert len(space.query("3DFACE")) == sum(len(body.corners) for body in bodies)


def read_step(path: Path) -> dict[str, tuple[int, list[float]]]:
    """Edges and box [mm] of each named part."""
    from OCP import (
        Bnd,
        BRepBndLib,
        IFSelect,
        STEPCAFControl,
        TCollection,
        TDataStd,
        TDocStd,
        TopAbs,
        TopExp,
        XCAFDoc,
        collections,
    )

    document = TDocStd.TDocStd_Document(TCollection.TCollection_ExtendedString("XmlOcaf"))
    reader = STEPCAFControl.STEPCAFControl_Reader()
    reader.SetNameMode(True)
    assert reader.ReadFile(str(path)) == IFSelect.IFSelect_ReturnStatus.IFSelect_RetDone
    assert reader.Transfer(document)
    shapes = XCAFDoc.XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    labels = collections.Sequence_TDF_Label()
    shapes.GetShapes(labels)
    found = {}
    for k in range(1, labels.Length() + 1):
        name = TDataStd.TDataStd_Name()
        assert labels.Value(k).FindAttribute(TDataStd.TDataStd_Name.GetID_s(), name)
        shape = shapes.GetShape_s(labels.Value(k))
        explorer, edges = TopExp.TopExp_Explorer(shape, TopAbs.TopAbs_ShapeEnum.TopAbs_EDGE), 0
        while explorer.More():
            edges += 1
            explorer.Next()
        box = Bnd.Bnd_Box()
        BRepBndLib.BRepBndLib.AddOptimal_s(shape, box, False, False)
        corners = [
            p for end in (box.CornerMin(), box.CornerMax()) for p in (end.X(), end.Y(), end.Z())
        ]
        found[name.Get().ToExtString()] = (edges, corners)
    return found


@pytest.mark.peers
def test_step_opens_with_names_in_millimetres(
    small_map: raymap.RayMap, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("OCP")
    written = export_3d(small_map, tmp_path / "a.step", rays=40, group="source")
    assert capfd.readouterr().out == ""
    parts = read_step(tmp_path / "a.step")
    rays = draw_rays(small_map, None, 40).rays
    assert sum(parts[name][0] for name in written["groups"]) == rays.n_rays
    for k, name in enumerate(written["groups"]):
        source = [f"rays {s.name}" for s in small_map.directory.sources].index(name)
        rows = np.repeat(rays.source, np.diff(rays.offsets)) == source
        box = np.array(parts[name][1])
        np.testing.assert_allclose(
            box[:3], rays.position[rows].min(axis=0), atol=1e-4, err_msg=str(k)
        )
        np.testing.assert_allclose(box[3:], rays.position[rows].max(axis=0), atol=1e-4)
    assert "L1" in parts


def test_refusals(small_map: raymap.RayMap, tmp_path: Path) -> None:
    with pytest.raises(RayMapError, match="3D files end in"):
        export_3d(small_map, tmp_path / "a.obj")
    with pytest.raises(RayMapError, match="no colour rule"):
        export_3d(small_map, tmp_path / "a.glb", color="nice")
    with pytest.raises(RayMapError, match="grouped by"):
        export_3d(small_map, tmp_path / "a.glb", group="object")
    with pytest.raises(RayMapError, match="no folder"):
        export_3d(small_map, tmp_path / "no" / "a.glb")
    export_3d(small_map, tmp_path / "a.glb", rays=3)
    with pytest.raises(MapExists):
        export_3d(small_map, tmp_path / "a.glb")
    assert [each.name for each in tmp_path.iterdir()] == ["a.glb"]


WITH_CAD = [
    pytest.param(each, marks=pytest.mark.peers) if each in (".dxf", ".step", ".stp") else each
    for each in EXPORT_FORMATS
]


@pytest.mark.parametrize("suffix", WITH_CAD)
def test_nothing_selected(small_map: raymap.RayMap, tmp_path: Path, suffix: str) -> None:
    if suffix in (".dxf", ".step", ".stp"):
        pytest.importorskip("ezdxf")
        pytest.importorskip("OCP")
    nothing = 'source("star") & source("lamp")'
    written = export_3d(small_map, tmp_path / f"a{suffix}", nothing)
    assert (written["rays"], written["groups"]) == (0, [])
    assert (tmp_path / f"a{suffix}").stat().st_size > 100


def test_the_command(map_path: Path, tmp_path: Path, run: Any) -> None:
    code, text, error = run("export-3d", map_path, "-o", tmp_path / "a.glb", "--rays", 7, "--json")
    assert code == 0, error
    written = json.loads(text)
    assert written["rays"] == 7
    with raymap.open(map_path) as whole:
        assert written["selected"] == whole.rays
    _, text, _ = run("export-3d", map_path, "-o", tmp_path / "b.glb", "--rays", 7)
    assert f"{written['selected'] - 7:,} rays are left out" in text
    _, text, _ = run("export-3d", map_path, "-o", tmp_path / "c.glb", "--rays", 1_000_000)
    assert "left out" not in text
    code, _, error = run("export-3d", map_path, "-o", tmp_path / "a.glb")
    assert (code, error.count("\n")) == (1, 1)

"""Meshes: read from files, divided into faces, refused when they cannot be traced."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from raymap.model.errors import SceneError
from tracer.geometry.mesh import (
    MeshWarning,
    TriangleMesh,
    faces_by_angle,
    make_mesh,
    smooth_normals,
)
from tracer.geometry.mesh_files import load_mesh

V = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
T = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip


def cube(**options: object) -> TriangleMesh:
    return make_mesh(V, T, name="cube", **options)  # type: ignore[arg-type]


def test_volume_area_and_display() -> None:
    mesh = cube()
    assert mesh.volume == pytest.approx(1)
    assert mesh.areas.sum() == pytest.approx(6)
    assert mesh.display().triangles.shape == (12, 3)


def test_a_moved_mirrored_mesh_stays_outward() -> None:
    matrix = np.array([[-2.0, 0, 0, 5], [0, 1, 0.3, 0], [0, 0, 3, 1]])
    assert cube().transformed(matrix).volume == pytest.approx(6)


def test_labels_make_contiguous_faces() -> None:
    labels = ["side", "side", "top", "side", "side", "top"] * 2
    mesh = cube(labels=labels)
    assert mesh.face_names == ("side", "top")
    assert mesh.face_counts.tolist() == [8, 4]
    assert np.all(np.diff(mesh.face) >= 0)


def test_faces_end_at_sharp_edges() -> None:
    mesh = faces_by_angle(cube(), 30)
    assert mesh.face_names == tuple(f"face_{k}" for k in range(1, 7))
    assert mesh.face_counts.tolist() == [2] * 6
    assert faces_by_angle(cube(), 120).face_names == ("face_1",)


def test_smooth_normals_respect_the_crease() -> None:
    flat = smooth_normals(cube(), 45).corner_normals
    assert flat is not None
    assert np.abs(flat).max(axis=2) == pytest.approx(1)
    rounded = smooth_normals(cube(), 120)
    corners = rounded.corner_normals
    assert corners is not None
    # Weighted by angle, a cube's corner normal is its diagonal however the faces are split
    diagonal = (rounded.vertices[rounded.triangles] - 0.5) / np.sqrt(0.75)
    np.testing.assert_allclose(corners, diagonal, atol=1e-12)


@pytest.mark.parametrize(
    ("vertices", "triangles", "options", "words"),
    [
        (V, T[:-1], {}, r"is open: 3 edges .*close the mesh"),
        (V, T[:, ::-1], {}, r"inside out.*flip = true"),
        (V, np.concatenate((T, T[:1])), {}, r"more than two triangles"),
        (V, np.concatenate((T[:-1], T[-1:, ::-1])), {}, r"opposite order"),
        (V, T + 1, {}, r"names vertex 8 of 8"),
        (V * np.nan, T, {}, r"not a finite number"),
        (V, T[:0], {}, r"no triangles"),
        (V[:, :2], T, {}, r"needs vertices"),
        (V, T, {"labels": ["a"]}, r"1 face labels for 12"),
        (V * 0, T, {"solid": False}, r"no triangle has an area"),
    ],
)
@pytest.mark.filterwarnings("ignore::tracer.geometry.mesh.MeshWarning")
def test_what_cannot_be_traced_is_refused(vertices, triangles, options, words) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(SceneError, match=words):
        make_mesh(vertices, triangles, name="bad", **options)


def test_open_meshes_are_surfaces() -> None:
    assert not make_mesh(V, T[:2], solid=False).closed
    assert make_mesh(V, T[:, ::-1], flip=True).volume == pytest.approx(1)


def test_triangles_without_area_are_counted_and_split_vertices_joined() -> None:
    soup = V[T].reshape(-1, 3)
    triangles = np.arange(36).reshape(-1, 3)
    with pytest.warns(MeshWarning, match="1 of 13 triangles have no area"):
        mesh = make_mesh(soup, np.concatenate((triangles, [[0, 0, 1]])))
    assert len(mesh.vertices) == 8
    assert len(mesh.triangles) == 12


def write_obj(path: Path) -> Path:
    lines = [f"v {x} {y} {z}" for x, y, z in V]
    for name, rows in (("top", T[2:4]), ("rest", np.delete(T, [2, 3], axis=0))):
        lines.append(f"o {name}")
        lines += ["f " + " ".join(str(k + 1) for k in row) for row in rows]
    path.write_text("\n".join(lines))
    return path


def write_stl(path: Path) -> Path:
    lines = ["solid cube"]
    for row in T:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex {} {} {}".format(*V[k]) for k in row]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid cube"]))
    return path


def test_files_are_read(tmp_path: Path) -> None:
    obj = load_mesh(write_obj(tmp_path / "box.obj"))
    assert obj.name == "box"
    assert sorted(obj.face_names) == ["rest", "top"]
    assert obj.volume == pytest.approx(1)
    stl = load_mesh(write_stl(tmp_path / "box.stl"), scale=10.0, faces="angle", name="b")
    assert stl.volume == pytest.approx(1000)
    assert len(stl.face_names) == 6


@pytest.mark.parametrize("word", ["g", "o"])
def test_groups_named_like_their_file(tmp_path: Path, word: str) -> None:
    lines = write_obj(tmp_path / "top.obj").read_text().replace("o top", f"{word} top")
    lines = lines.replace("g top", f"{word} top").replace("\no rest", f"\n{word} rest")
    (tmp_path / "top.obj").write_text(lines)
    assert sorted(load_mesh(tmp_path / "top.obj").face_names) == ["rest", "top"]


def test_ply_colours_and_gltf_nodes(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    colors = np.tile([255, 0, 0, 255], (12, 1)).astype(np.uint8)
    colors[:2] = [0, 0, 255, 255]
    box = trimesh.Trimesh(V, T, face_colors=colors, process=False)
    box.export(tmp_path / "box.ply")
    mesh = load_mesh(tmp_path / "box.ply", faces="color")
    assert set(mesh.face_names) == {"#0000ff", "#ff0000"}
    scene = trimesh.Scene()
    matrix = np.eye(4)
    matrix[0, 3] = 3
    plain = trimesh.Trimesh(V, T, process=False)
    scene.add_geometry(plain, node_name="left")
    scene.add_geometry(plain, node_name="right", transform=matrix)
    (tmp_path / "two.glb").write_bytes(scene.export(file_type="glb"))
    both = load_mesh(tmp_path / "two.glb")
    assert set(both.face_names) == {"left", "right"}
    assert both.volume == pytest.approx(2)
    assert both.vertices[:, 0].max() == pytest.approx(4)


def test_cavities_are_allowed_but_parts_inside_out_are_not() -> None:
    inner = make_mesh(
        np.concatenate((V, 0.25 + 0.5 * V)), np.concatenate((T, T[:, ::-1] + 8)), name="hollow"
    )
    assert inner.volume == pytest.approx(1 - 0.125)
    with pytest.raises(SceneError, match=r"one of its 2 parts is inside out, the one about \(3"):
        make_mesh(np.concatenate((2 * V, V + 3)), np.concatenate((T, T[:, ::-1] + 8)))


def test_self_intersections_are_a_counted_warning(tmp_path: Path) -> None:
    lines = [f"v {x} {y} {z}" for x, y, z in np.concatenate((V, V + np.array([0.4, 0.3, 0.6])))]
    lines += ["f " + " ".join(str(k + 1) for k in row) for row in np.concatenate((T, T + 8))]
    (tmp_path / "both.obj").write_text("\n".join(lines))
    with pytest.warns(MeshWarning, match=r"'both': \d+ edges run through"):
        load_mesh(tmp_path / "both.obj")


def test_bad_files_are_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="there is no mesh file"):
        load_mesh(tmp_path / "none.stl")
    broken = tmp_path / "broken.ply"
    broken.write_text("not a mesh")
    (tmp_path / "part.STEP").write_text("ISO-10303-21;")
    with pytest.raises(SceneError, match=r"name it in \[cad_files\]"):
        load_mesh(tmp_path / "part.STEP")
    with pytest.raises(SceneError, match="cannot be read as a mesh"):
        load_mesh(broken)
    with pytest.raises(SceneError, match="no colours"):
        load_mesh(write_stl(tmp_path / "box.stl"), faces="color")
    with pytest.raises(SceneError, match="scale must be positive"):
        load_mesh(tmp_path / "box.stl", scale=0)

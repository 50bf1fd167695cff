"""Small files that claim to be large: one clear line before anything is allocated for it."""

from __future__ import annotations

import json
import struct
import tracemalloc
import zlib

import numpy as np
import pytest

from raymap.model.errors import SceneError
from tracer.description.channels import Spectrum
from tracer.geometry.mesh_files import load_mesh
from tracer.sources.pictures import read_picture

_MOST = 100 * 2**20


def _png(width, height):
    """A PNG of one colour; rows are packed as they would lie in it."""

    def chunk(tag, data):
        return struct.pack(">I", len(data)) + tag + data + struct.pack(">I", zlib.crc32(tag + data))

    rows = zlib.compress(bytes(min((width + 1) * height, 2**22)), 9)
    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def _npy(shape, kind):
    head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".encode()
    head += b" " * (63 - (len(head) + 10) % 64) + b"\n"
    return b"\x93NUMPY\1\0" + struct.pack("<H", len(head)) + head + bytes(100)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.png", _png(100_000, 100_000), "10000000000 pixels"),
        ("a.png", _png(13_000, 13_000), "claims 169000000 pixels"),
        ("a.npy", _npy("(1000000000000,)", "<f8"), "cannot read the picture a.npy"),
        ("a.npy", _npy("(1000000, 1000000)", "<f4"), "cannot read the picture a.npy"),
        ("a.npy", _npy("(10, 10)", "|O"), "cannot read the picture a.npy"),
        ("a.npy", _npy("(-1, 10)", "<f8"), "cannot read the picture a.npy"),
        ("a.hdr", b"#?RADIANCE\n\n-Y 100000 +X 100000\n" + bytes(99), "cannot read the picture"),
        ("a.exr", b"\x76\x2f\x31\x01" + bytes(999), "cannot read the picture"),
    ],
)
def test_a_picture_pays_for_its_pixels(tmp_path, name, content, words):
    pytest.importorskip("PIL")
    (tmp_path / name).write_bytes(content)
    tracemalloc.start()
    with pytest.raises(SceneError, match=words) as found:
        read_picture(tmp_path, name)
    assert tracemalloc.get_traced_memory()[1] < _MOST
    tracemalloc.stop()
    assert "\n" not in str(found.value)


def test_an_honest_picture_of_one_colour_is_read(tmp_path):
    pytest.importorskip("PIL")
    (tmp_path / "a.png").write_bytes(_png(1000, 1000))
    assert read_picture(tmp_path, "a.png").shape == (1000, 1000, 3)


def test_a_picture_costs_its_linear_values_and_little_more(tmp_path):
    """24 bytes a pixel: three values in float64; the file's own three bytes are there beside it."""
    pytest.importorskip("PIL")
    (tmp_path / "a.png").write_bytes(_png(2000, 1000))
    read_picture(tmp_path, "a.png")
    tracemalloc.start()
    read_picture(tmp_path, "a.png")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1.4 * 24 * 2_000_000


def _gltf(count, nodes, view):
    triangles = 100
    vertices = np.zeros((3 * triangles, 3), "<f4")
    vertices[:, 0] = np.arange(len(vertices))
    corners = np.arange(3 * triangles, dtype="<u4")
    data = vertices.tobytes() + corners.tobytes()
    place = {"bufferView": 0} if view else {}
    text = json.dumps(
        {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": list(range(nodes))}],
            "nodes": [{"mesh": 0, "name": f"n{k}"} for k in range(nodes)],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
            "buffers": [{"byteLength": len(data)}],
            "bufferViews": [
                {"buffer": 0, "byteOffset": 0, "byteLength": vertices.nbytes},
                {"buffer": 0, "byteOffset": vertices.nbytes, "byteLength": corners.nbytes},
            ],
            "accessors": [
                {**place, "componentType": 5126, "count": count, "type": "VEC3"},
                {"bufferView": 1, "componentType": 5125, "count": len(corners), "type": "SCALAR"},
            ],
        }
    ).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<II", 2, 28 + len(text) + len(data))
    begin = b"glTF" + head + struct.pack("<I4s", len(text), b"JSON") + text
    return begin + struct.pack("<I4s", len(data), b"BIN\0") + data


_PLY = (
    b"ply\nformat %s 1.0\nelement vertex 1000000000\nproperty float x\nproperty float y\n"
    b"property float z\nelement face 1000000000\nproperty list uchar int vertex_indices\n"
    b"end_header\n0 0 0\n"
)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 1000000000\n"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -1000000000\n"),
        ("a.ply", _PLY % b"binary_little_endian"),
        ("a.ply", _PLY % b"ascii"),
        ("a.stl", bytes(80) + struct.pack("<I", 10**9) + bytes(100)),
        ("a.glb", _gltf(10**9, 1, False)),
        ("a.glb", _gltf(10**9, 1, True)),
    ],
)
def test_a_mesh_pays_for_its_triangles(tmp_path, name, content):
    pytest.importorskip("trimesh")
    (tmp_path / name).write_bytes(content)
    tracemalloc.start()
    with pytest.raises(SceneError) as found:
        load_mesh(tmp_path / name)
    assert tracemalloc.get_traced_memory()[1] < 3 * _MOST
    tracemalloc.stop()
    assert name in str(found.value) or "'a'" in str(found.value)


def test_nodes_that_place_a_mesh_many_times_pay_for_it(tmp_path, monkeypatch):
    pytest.importorskip("trimesh")
    monkeypatch.setattr("tracer.geometry.trimesh_files._TRIANGLES_FLOOR", 1000)
    monkeypatch.setattr("tracer.geometry.trimesh_files._TRIANGLES_PER_BYTE", 0)
    (tmp_path / "a.glb").write_bytes(_gltf(300, 11, True))
    with pytest.raises(SceneError, match=r"a\.glb places 1100 triangles"):
        load_mesh(tmp_path / "a.glb")


def _changed(change):
    """A glTF file with another description."""
    sound = _gltf(300, 1, True)
    length = int.from_bytes(sound[12:16], "little")
    described = json.loads(sound[20 : 20 + length])
    change(described)
    text = json.dumps(described).encode()
    text += b" " * (-len(text) % 4)
    rest = sound[20 + length :]
    head = struct.pack("<II", 2, 20 + len(text) + len(rest))
    return b"glTF" + head + struct.pack("<I4s", len(text), b"JSON") + text + rest


def _many_primitives(described):
    described["meshes"][0]["primitives"] *= 50_000


def _few_nodes_of_many_primitives(described):
    described["meshes"][0]["primitives"] *= 100
    described["nodes"] = [{"mesh": 0}] * 100
    described["scenes"][0]["nodes"] = list(range(100))


def _twice_below(described):
    # 2^60 ways to the last node
    described["nodes"] = [{"children": [k + 1, k + 1]} for k in range(60)] + [{"mesh": 0}]


def _ring(described):
    described["nodes"] = [{"children": [1]}, {"children": [0], "mesh": 0}]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (_gltf(300, 50_000, True), "has 100001 nodes, primitives or groups"),
        (_changed(_many_primitives), "has 100001 nodes, primitives or groups"),
        (_changed(_few_nodes_of_many_primitives), "has 10200 nodes, primitives or groups"),
        (_changed(_twice_below), "glTF wants a tree"),
        (_changed(_ring), "glTF wants a tree"),
    ],
)
def test_nodes_and_primitives_of_a_mesh_file_are_paid_for(tmp_path, content, words):
    """Refused before trimesh, which takes milliseconds for each, sees the file."""
    pytest.importorskip("trimesh")
    (tmp_path / "a.glb").write_bytes(content)
    with pytest.raises(SceneError, match=words) as found:
        load_mesh(tmp_path / "a.glb")
    assert "\n" not in str(found.value)


_ZEROS = {"componentType": 5126, "count": 3 * 2**18, "type": "VEC3"}
_VIEW = {"bufferView": 0, "componentType": 5126, "count": 87_381, "type": "VEC3"}


def _glb(accessors, primitives, nodes=1, views=(), data=b""):
    """A glTF file of one mesh, whose tables without a view have no bytes."""
    text = json.dumps(
        {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": list(range(nodes))}],
            "nodes": [{"mesh": 0}] * nodes,
            "meshes": [{"primitives": primitives}],
            "accessors": accessors,
            "bufferViews": list(views),
            "buffers": [{"byteLength": len(data)}] if data else [],
        }
    ).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text
    if data:
        body += struct.pack("<I4s", len(data), b"BIN\0") + data
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


_ONE = {"attributes": {"POSITION": 0}}
_VIEWED = {"buffer": 0, "byteLength": 2**20}


@pytest.mark.parametrize(
    "content",
    [
        _glb([_ZEROS], [_ONE] * 64),
        _glb([_ZEROS], [_ONE], nodes=64),
        _glb([_ZEROS], [_ONE | {"mode": 5}] * 2),
        _glb([_ZEROS], [_ONE | {"mode": 1}] * 64 + [_ONE]),
        _glb([_ZEROS], [{"attributes": dict.fromkeys(("POSITION", "NORMAL", "_A", "_B"), 0)}]),
        _glb([_ZEROS | {"type": "MAT4"}] * 1000, [_ONE]),
        _glb([_VIEW] * 500, [_ONE], views=[_VIEWED], data=bytes(2**20)),
        _glb([_VIEW], [_ONE], views=[_VIEWED] * 500, data=bytes(2**20)),
    ],
)
def test_all_that_is_made_of_a_mesh_file_is_paid_for(tmp_path, content):
    """The sum over tables, primitives and placements, though each of them is small enough."""
    pytest.importorskip("trimesh")
    (tmp_path / "a.glb").write_bytes(content)
    tracemalloc.start()
    with pytest.raises(SceneError, match=r"'a': a\.glb makes \d+ bytes of tables"):
        load_mesh(tmp_path / "a.glb")
    assert tracemalloc.get_traced_memory()[1] < 2**24
    tracemalloc.stop()


@pytest.mark.filterwarnings("ignore:.*have no area")
def test_a_mesh_file_may_place_a_part_a_thousand_times(tmp_path):
    """100 triangles, each node at a place of its own: 100,000 triangles of 30 kB."""
    pytest.importorskip("trimesh")

    def many(described):
        described["nodes"] = [{"mesh": 0, "translation": [0, 0, k]} for k in range(1000)]
        described["scenes"][0]["nodes"] = list(range(1000))

    (tmp_path / "a.glb").write_bytes(_changed(many))
    # Points of the part lie on a line
    with pytest.raises(SceneError, match="no triangle has an area"):
        load_mesh(tmp_path / "a.glb", solid=False)


@pytest.mark.filterwarnings("ignore:.*have no area")
def test_a_buffer_that_is_named_often_is_read_once(tmp_path):
    pytest.importorskip("trimesh")
    (tmp_path / "shared.bin").write_bytes(bytes(2**22))
    described = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [_ONE]}],
        "accessors": [_ZEROS | {"count": 3}],
        "bufferViews": [],
        "buffers": [{"uri": "shared.bin", "byteLength": 2**22}] * 100,
    }
    (tmp_path / "a.gltf").write_text(json.dumps(described))
    tracemalloc.start()
    with pytest.raises(SceneError, match="no triangle has an area"):
        load_mesh(tmp_path / "a.gltf", solid=False)
    assert tracemalloc.get_traced_memory()[1] < 2**25
    tracemalloc.stop()


@pytest.mark.parametrize("name", ["a.obj", "a.ply"])
def test_textures_are_not_looked_at(tmp_path, monkeypatch, name):
    """They cost what their pixels cost, and EPS starts another program."""
    pytest.importorskip("trimesh")
    images = pytest.importorskip("PIL.Image")

    def opened(*given, **options):
        raise AssertionError("a texture was opened")

    monkeypatch.setattr(images, "open", opened)
    (tmp_path / "a.eps").write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n")
    (tmp_path / "m.mtl").write_text("newmtl red\nmap_Kd a.eps\nnewmtl blue\nmap_Kd a.eps\n")
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n"
    uses = "".join(f"usemtl {name}\nf 1/1 2/1 3/1\n" for name in ("red", "blue"))
    (tmp_path / "a.obj").write_text("mtllib m.mtl\n" + corners + uses)
    head = "ply\nformat ascii 1.0\ncomment TextureFile a.eps\nelement vertex 3\n"
    head += "".join(f"property float {axis}\n" for axis in "xyzst")
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_text(head + "0 0 0 0 0\n1 0 0 0 0\n0 1 0 0 0\n3 0 1 2\n")
    found = load_mesh(tmp_path / name, solid=False)
    # Materials of OBJ still name faces
    assert found.face_names == (("blue", "red") if name == "a.obj" else ("surface",))


def test_solids_of_an_stl_text_are_paid_for(tmp_path):
    pytest.importorskip("trimesh")
    facet = "facet normal 0 0 1\nouter loop\n" + "vertex 0 0 0\n" * 3 + "endloop\nendfacet\n"
    (tmp_path / "a.stl").write_text(f"solid a\n{facet}endsolid a\n" * 5000)
    with pytest.raises(SceneError, match=r"a\.stl has 5000 nodes, primitives or groups"):
        load_mesh(tmp_path / "a.stl")


def test_groups_of_an_obj_file_are_paid_for(tmp_path):
    pytest.importorskip("trimesh")
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\n" + "g a\nf 1 2 3\n" * 5000
    (tmp_path / "a.obj").write_text(text)
    with pytest.raises(SceneError, match=r"a\.obj has 5000 nodes, primitives or groups"):
        load_mesh(tmp_path / "a.obj")


def test_a_scene_has_no_more_wavelengths_than_a_map():
    Spectrum(kind="spectral", wavelengths_nm=tuple(range(1, 4097)))
    with pytest.raises(ValueError, match="1000000 wavelengths; a map may have 4096 channels"):
        Spectrum(kind="spectral", wavelengths_nm=tuple(range(1, 1_000_001)))

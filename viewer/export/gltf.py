"""What is shown, as files for other programs: glTF (binary) and VTK PolyData.

Both are written here without a graphics library; the formats are documented by the Khronos Group
(glTF 2.0) and Kitware (XML PolyData, appended raw data).
"""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.units import length_scale
from raymap.optics.colorimetry import decode_srgb
from viewer.drawn.bodies import Body
from viewer.drawn.lines import Lines
from viewer.drawn.rays import DrawnRays

__all__ = ["to_glb", "to_gltf", "to_vtp"]

_FLOAT, _UBYTE = 5126, 5121
_LINES, _TRIANGLES = 1, 4


class _Glb:
    """A binary glTF file in the making."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self.meshes: list[dict[str, Any]] = []
        self.nodes: list[dict[str, Any]] = []
        self.materials: list[dict[str, Any]] = []

    def accessor(self, array: NDArray[Any], kind: str, component: int, **more: Any) -> int:
        raw = np.ascontiguousarray(array).tobytes()
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(raw)})
        self.data += raw + b"\0" * (-len(raw) % 4)
        entry = {
            "bufferView": len(self.views) - 1,
            "componentType": component,
            "count": len(array),
            "type": kind,
            **more,
        }
        self.accessors.append(entry)
        return len(self.accessors) - 1

    def positions(self, points: NDArray[np.float32]) -> int:
        low, high = points.min(axis=0).tolist(), points.max(axis=0).tolist()
        return self.accessor(points, "VEC3", _FLOAT, min=low, max=high)

    def add(self, name: str, attributes: dict[str, int], mode: int, color: list[float]) -> None:
        material: dict[str, Any] = {
            "name": name,
            "doubleSided": True,
            "pbrMetallicRoughness": {
                "baseColorFactor": color,
                "metallicFactor": 0.0,
                "roughnessFactor": 0.4,
            },
        }
        if color[3] < 1 or mode == _LINES:
            material["alphaMode"] = "BLEND"
        self.materials.append(material)
        primitive = {
            "attributes": attributes,
            "mode": mode,
            "material": len(self.materials) - 1,
        }
        self.meshes.append({"name": name, "primitives": [primitive]})
        self.nodes.append({"name": name, "mesh": len(self.meshes) - 1})

    def document(self, scale: float, title: str) -> dict[str, Any]:
        nodes, top = list(self.nodes), list(range(len(self.nodes)))
        if scale != 1.0 and nodes:
            nodes.append({"name": title, "children": top, "scale": [scale] * 3})
            top = [len(nodes) - 1]
        document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "Raymap"},
            "scene": 0,
            "scenes": [{"nodes": top}],
        }
        if nodes:
            document |= {
                "nodes": nodes,
                "meshes": self.meshes,
                "materials": self.materials,
                "accessors": self.accessors,
                "bufferViews": self.views,
                "buffers": [{"byteLength": len(self.data)}],
            }
        else:
            document["scenes"] = [{"name": "empty"}]
        return document

    def to_text(self, scale: float, title: str) -> bytes:
        document = self.document(scale, title)
        if self.data:
            data = base64.b64encode(bytes(self.data)).decode()
            document["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{data}"
        return json.dumps(document, separators=(",", ":")).encode()

    def to_bytes(self, scale: float, title: str) -> bytes:
        text = json.dumps(self.document(scale, title), separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        if self.data:
            chunks += struct.pack("<I4s", len(self.data), b"BIN\0") + bytes(self.data)
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def to_glb(
    bodies: Sequence[Body],
    lines: Lines,
    rgba: NDArray[np.uint8],
    *,
    groups: Sequence[tuple[str, NDArray[np.bool_]]] | None = None,
    length_unit: str = "m",
    title: str = "scene",
) -> bytes:
    """Bodies and rays as one binary glTF 2.0 file.

    Parameters
    ----------
    bodies : as shown
    lines : segments of the rays [scene units]
    rgba : (n_segments, 4) uint8 sRGB
    groups : (name, (n_segments,) bool) for each node of rays; None: one node "rays"
    length_unit : of the scene; another one than metres becomes the scale of a node above all others
    title : name of that node

    Raises
    ------
    RayMapError
        The unit of length is not known, so nothing could be converted to metres.
    """
    scale = length_scale(length_unit, "m")
    return _glb(bodies, lines, rgba, groups).to_bytes(scale, title)


def to_gltf(
    bodies: Sequence[Body],
    lines: Lines,
    rgba: NDArray[np.uint8],
    *,
    groups: Sequence[tuple[str, NDArray[np.bool_]]] | None = None,
    length_unit: str = "m",
    title: str = "scene",
) -> bytes:
    """The same as one text file of glTF 2.0, its numbers embedded."""
    scale = length_scale(length_unit, "m")
    return _glb(bodies, lines, rgba, groups).to_text(scale, title)


def _glb(
    bodies: Sequence[Body],
    lines: Lines,
    rgba: NDArray[np.uint8],
    groups: Sequence[tuple[str, NDArray[np.bool_]]] | None,
) -> _Glb:
    glb = _Glb()
    for body in bodies:
        if len(body.corners) == 0:
            continue
        attributes = {
            "POSITION": glb.positions(body.corners.reshape(-1, 3)),
            "NORMAL": glb.accessor(_unit(body.normals.reshape(-1, 3)), "VEC3", _FLOAT),
        }
        color = [*(float(value) for value in decode_srgb(body.color)), float(body.opacity)]
        glb.add(body.name, attributes, _TRIANGLES, color)
    if groups is None:
        groups = [("rays", np.ones(len(lines), np.bool_))]
    for name, chosen in groups:
        if not chosen.any():
            continue
        # glTF wants colours of vertices as linear light
        linear = decode_srgb(rgba[chosen, :3] / 255.0)
        color8 = np.column_stack([np.rint(linear * 255), rgba[chosen, 3]]).astype(np.uint8)
        points = lines.segments[chosen].reshape(-1, 3)
        attributes = {
            "POSITION": glb.positions(points),
            "COLOR_0": glb.accessor(np.repeat(color8, 2, axis=0), "VEC4", _UBYTE, normalized=True),
        }
        glb.add(name, attributes, _LINES, [1.0, 1.0, 1.0, 1.0])
    return glb


def _unit(normals: NDArray[np.float32]) -> NDArray[np.float32]:
    """Unit length; interpolation at a cut shortens normals."""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    straight = np.array([0, 0, 1], np.float32)
    safe = np.where(length > 1e-6, normals / np.maximum(length, 1e-6), straight)
    return safe.astype(np.float32)


_VTK_TYPES = {"f4": "Float32", "f8": "Float64", "i8": "Int64", "i4": "Int32", "u1": "UInt8"}


def to_vtp(
    rays: DrawnRays,
    lines: Lines,
    rgba: NDArray[np.uint8],
    bodies: Sequence[Body] = (),
    *,
    length_unit: str = "",
) -> bytes:
    """The rays' segments, and bodies, as an XML PolyData file.

    Every line has its ray number, step, flux and colour; every triangle of a body the number of
    its ``object`` and ``face`` (both -1 on lines), the names of the objects stand in the field
    ``object_names``, the unit of length in ``length_unit``.

    Parameters
    ----------
    rays : the drawn rays
    lines : their segments [scene units]
    rgba : (n_segments, 4) uint8
    bodies : drawn as triangles
    """
    n = len(lines)
    corners = [body.corners.reshape(-1, 3) for body in bodies]
    triangles = sum(len(body.corners) for body in bodies)
    step = lines.record - rays.offsets[:-1][lines.ray] if n else np.empty(0, np.int64)
    colors = [
        np.tile(np.append(np.rint(body.color * 255), 255 * body.opacity), (len(body.corners), 1))
        for body in bodies
    ]
    owners = [np.full(len(body.corners), body.index) for body in bodies]

    def column(values: NDArray[Any], kind: str, rest: Sequence[Any] = ()) -> NDArray[Any]:
        filler = list(rest) or [np.full(triangles, -1)]
        return np.concatenate([values, *filler]).astype(kind)

    cells = {
        "ray_id": column(rays.ray_ids[lines.ray], "<i8"),
        "step": column(step, "<i4"),
        "flux": column(rays.flux[lines.ray], "<f8", [np.zeros(triangles)]),
        "rgba": column(rgba, "u1", [np.rint(color) for color in colors]) if colors else rgba,
        "object": column(np.full(n, -1), "<i4", owners),
        "face": column(np.full(n, -1), "<i4", [body.face for body in bodies]),
    }
    blocks: list[bytes] = []

    def array(name: str, values: NDArray[Any]) -> str:
        raw = np.ascontiguousarray(values).tobytes()
        offset = sum(len(block) for block in blocks)
        blocks.append(struct.pack("<Q", len(raw)) + raw)
        kind = _VTK_TYPES[values.dtype.str[1:]]
        width = 1 if values.ndim == 1 else values.shape[1]
        return (
            f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{width}" '
            f'format="appended" offset="{offset}"/>'
        )

    points = array(
        "Points", np.concatenate([lines.segments.reshape(-1, 3), *corners]).astype("<f4")
    )
    connectivity = array("connectivity", np.arange(2 * n, dtype="<i8"))
    ends = array("offsets", 2 * np.arange(1, n + 1, dtype="<i8"))
    polygons = ""
    if triangles:
        polygons = array("connectivity", 2 * n + np.arange(3 * triangles, dtype="<i8"))
        polygons += array("offsets", 3 * np.arange(1, triangles + 1, dtype="<i8"))
    data = "".join(array(name, values) for name, values in cells.items())
    names = {body.index: body.name for body in bodies}
    labels = [names.get(k, "") for k in range(max(names, default=-1) + 1)]
    field = _strings("object_names", labels) + _strings("length_unit", [length_unit])
    head = (
        '<?xml version="1.0"?>\n'
        '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">'
        f"<PolyData><FieldData>{field}</FieldData>"
        f'<Piece NumberOfPoints="{2 * n + 3 * triangles}" NumberOfVerts="0" '
        f'NumberOfLines="{n}" NumberOfStrips="0" NumberOfPolys="{triangles}">'
        f"<CellData>{data}</CellData><Points>{points}</Points>"
        f"<Lines>{connectivity}{ends}</Lines><Polys>{polygons}</Polys>"
        '</Piece></PolyData><AppendedData encoding="raw">_'
    )
    return head.encode() + b"".join(blocks) + b"</AppendedData></VTKFile>\n"


def _strings(name: str, texts: Sequence[str]) -> str:
    """An array of texts: their bytes, each ended by a zero."""
    codes = " ".join(" ".join(map(str, [*text.encode(), 0])) for text in texts)
    return (
        f'<Array type="String" Name="{name}" NumberOfTuples="{len(texts)}" format="ascii">'
        f"{codes}</Array>"
    )

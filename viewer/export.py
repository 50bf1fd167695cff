"""What is shown, as files for other programs: glTF (binary) and VTK PolyData.

Both are written here without a graphics library; the formats are documented by the Khronos Group
(glTF 2.0) and Kitware (XML PolyData, appended raw data).
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from viewer.bodies import Body
from viewer.lines import Lines
from viewer.rays import DrawnRays

__all__ = ["to_glb", "to_vtp"]

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

    def to_bytes(self) -> bytes:
        document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "Raymap"},
            "scene": 0,
            "scenes": [{"nodes": list(range(len(self.nodes)))}],
        }
        if self.nodes:
            document |= {
                "nodes": self.nodes,
                "meshes": self.meshes,
                "materials": self.materials,
                "accessors": self.accessors,
                "bufferViews": self.views,
                "buffers": [{"byteLength": len(self.data)}],
            }
        else:
            document["scenes"] = [{"name": "empty"}]
        text = json.dumps(document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        if self.data:
            chunks += struct.pack("<I4s", len(self.data), b"BIN\0") + bytes(self.data)
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def to_glb(bodies: Sequence[Body], lines: Lines, rgba: NDArray[np.uint8]) -> bytes:
    """Bodies and rays as one binary glTF 2.0 file.

    Parameters
    ----------
    bodies : as shown
    lines : segments of the rays [scene units]
    rgba : (n_segments, 4) uint8 sRGB
    """
    glb = _Glb()
    for body in bodies:
        if len(body.corners) == 0:
            continue
        attributes = {
            "POSITION": glb.positions(body.corners.reshape(-1, 3)),
            "NORMAL": glb.accessor(_unit(body.normals.reshape(-1, 3)), "VEC3", _FLOAT),
        }
        linear = np.where(
            body.color <= 0.04045, body.color / 12.92, ((body.color + 0.055) / 1.055) ** 2.4
        )
        color = [*(float(value) for value in linear), float(body.opacity)]
        glb.add(body.name, attributes, _TRIANGLES, color)
    if len(lines):
        # glTF wants colours of vertices as linear light
        display = rgba[:, :3] / 255.0
        linear = np.where(display <= 0.04045, display / 12.92, ((display + 0.055) / 1.055) ** 2.4)
        color8 = np.column_stack([np.rint(linear * 255), rgba[:, 3]]).astype(np.uint8)
        attributes = {
            "POSITION": glb.positions(lines.segments.reshape(-1, 3)),
            "COLOR_0": glb.accessor(np.repeat(color8, 2, axis=0), "VEC4", _UBYTE, normalized=True),
        }
        glb.add("rays", attributes, _LINES, [1.0, 1.0, 1.0, 1.0])
    return glb.to_bytes()


def _unit(normals: NDArray[np.float32]) -> NDArray[np.float32]:
    """Unit length; interpolation at a cut shortens normals."""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    straight = np.array([0, 0, 1], np.float32)
    safe = np.where(length > 1e-6, normals / np.maximum(length, 1e-6), straight)
    return safe.astype(np.float32)


_VTK_TYPES = {"f4": "Float32", "f8": "Float64", "i8": "Int64", "i4": "Int32", "u1": "UInt8"}


def to_vtp(rays: DrawnRays, lines: Lines, rgba: NDArray[np.uint8]) -> bytes:
    """The rays' segments as an XML PolyData file, with ray number, step, flux and colour per line.

    Parameters
    ----------
    rays : the drawn rays
    lines : their segments [scene units]
    rgba : (n_segments, 4) uint8
    """
    n = len(lines)
    step = lines.record - rays.offsets[:-1][lines.ray] if n else np.empty(0, np.int64)
    cells = {
        "ray_id": rays.ray_ids[lines.ray].astype("<i8"),
        "step": step.astype("<i4"),
        "flux": rays.flux[lines.ray].astype("<f8"),
        "rgba": np.ascontiguousarray(rgba),
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

    points = array("Points", lines.segments.reshape(-1, 3).astype("<f4"))
    connectivity = array("connectivity", np.arange(2 * n, dtype="<i8"))
    ends = array("offsets", 2 * np.arange(1, n + 1, dtype="<i8"))
    data = "".join(array(name, values) for name, values in cells.items())
    head = (
        '<?xml version="1.0"?>\n'
        '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">'
        f'<PolyData><Piece NumberOfPoints="{2 * n}" NumberOfVerts="0" NumberOfLines="{n}" '
        'NumberOfStrips="0" NumberOfPolys="0">'
        f"<CellData>{data}</CellData><Points>{points}</Points>"
        f"<Lines>{connectivity}{ends}</Lines></Piece></PolyData>"
        '<AppendedData encoding="raw">_'
    )
    return head.encode() + b"".join(blocks) + b"</AppendedData></VTKFile>\n"

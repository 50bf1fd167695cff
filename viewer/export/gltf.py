"""glTF 2.0, binary or text, written here without a graphics library.

The format is documented by the Khronos Group.
"""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.units import length_scale
from raymap.optics.colorimetry import decode_srgb
from viewer.drawn.bodies import Body
from viewer.drawn.lines import Lines
from viewer.export.content import Content
from viewer.export.format import ExportFormat

__all__ = ["GLB", "GLTF", "to_glb", "to_gltf"]

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


def _as(make: Callable[..., bytes]) -> Callable[[Content, Path], None]:
    def write(content: Content, path: Path) -> None:
        path.write_bytes(
            make(
                content.bodies,
                content.lines,
                content.rgba,
                groups=content.segment_groups(),
                length_unit=content.length_unit,
                title=content.title,
            )
        )

    return write


GLB = ExportFormat(
    suffixes=(".glb",),
    title="triangles and lines of glTF 2.0 in metres, binary",
    place=1.0,
    write=_as(to_glb),
)
GLTF = ExportFormat(
    suffixes=(".gltf",),
    title="triangles and lines of glTF 2.0 in metres, text",
    place=1.5,
    write=_as(to_gltf),
)

KINDS = (GLB, GLTF)

"""VTK PolyData: XML with appended raw data, as Kitware documents it."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from viewer.drawn.bodies import Body
from viewer.drawn.lines import Lines
from viewer.drawn.rays import DrawnRays
from viewer.export.content import Content
from viewer.export.format import ExportFormat

__all__ = ["VTP", "to_vtp"]

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


def _write(content: Content, path: Path) -> None:
    path.write_bytes(
        to_vtp(
            content.rays,
            content.lines,
            content.rgba,
            content.bodies,
            length_unit=content.length_unit,
        )
    )


VTP = ExportFormat(
    suffixes=(".vtp",),
    title="lines and triangles of VTK, with the number and flux of each ray",
    place=2.0,
    write=_write,
)

KINDS = (VTP,)

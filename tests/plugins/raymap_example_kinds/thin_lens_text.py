"""A lens as one line ``radius radius thickness index semi-diameter back`` [mm] (``.onelens``)."""

from __future__ import annotations

from pathlib import Path

from raymap.model.errors import SceneError
from tracer.importers.lens_format import LensFormat
from tracer.importers.lens_formats.zemax import parse_zemax
from tracer.importers.prescription import Prescription

__all__ = ["FORMAT"]

_TEXT = """MODE SEQ
UNIT MM
ENPD {diameter}
WAVM 1 0.5876 1
FTYP 0 0 1 1
XFLN 0
YFLN 0
SURF 0
  CURV 0
  DISZ INFINITY
SURF 1
  STOP
  CURV {first}
  DISZ {thickness}
  GLAS MODEL 1 0 {index} 64
  DIAM {radius}
SURF 2
  CURV {second}
  DISZ {back}
  DIAM {radius}
SURF 3
  CURV 0
  DISZ 0
"""


def read(path: Path) -> Prescription:
    """The lens of a file, through the text of a format that is known."""
    try:
        r1, r2, thickness, index, radius, back = map(float, path.read_text().split())
    except ValueError:
        raise SceneError(f"{path.name}: write six numbers") from None
    text = _TEXT.format(
        first=1 / r1, second=1 / r2, thickness=thickness, index=index, radius=radius, back=back,
        diameter=2 * radius,
    )  # fmt: skip
    return parse_zemax(text, origin=path.name)


FORMAT = LensFormat(suffixes=(".onelens",), title="one lens in six numbers", read=read)

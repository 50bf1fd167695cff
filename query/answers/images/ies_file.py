"""The intensity of a far field as a luminaire's file: IES LM-63-2002, type C, absolute."""

from __future__ import annotations

from datetime import date
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from query.answers.images.beams import beam_of
from query.answers.images.pictures import DetectorImage
from raymap.model.errors import RayMapError

__all__ = ["ies_text", "write_ies"]

Array = NDArray[np.float64]


def write_ies(image: DetectorImage, path: Path) -> None:
    """Write the candela of a far field as an IES file.

    Raises
    ------
    RayMapError
        as `ies_text`
    """
    path.write_text(ies_text(image), encoding="ascii", newline="\r\n")


def ies_text(image: DetectorImage, *, issued: date | None = None) -> str:
    """An IES LM-63-2002 file of a far field.

    The intensities are those of `query.answers.images.beams`, at the corners of cells: what charts
    draw. The luminaire is a point, the lumens are those of its intensities.

    Raises
    ------
    RayMapError
        another kind of detector, angles other than C and gamma from 0 on, or a map whose light has
        no lumens.
    """
    detector = image.detector
    gamma = detector.parameters.get("gamma_deg")
    if detector.kind != "far_field" or gamma is None:
        raise RayMapError(
            f"an IES file takes the intensity of a far field; {detector.name!r} is of kind "
            f"{detector.kind}: write .csv, .exr, .tiff or .npy"
        )
    if detector.parameters.get("angles", "type_c") != "type_c" or gamma[0] != 0.0:
        raise RayMapError(
            f"an IES file has C planes and gamma from 0 on: give the detector {detector.name!r} "
            'angles = "type_c" and gamma_deg = [0, …], or write .csv'
        )
    c, angles, candela = _planes(image)
    name = "".join(ch if " " <= ch <= "~" else "?" for ch in detector.name)
    lines = [
        "IESNA:LM-63-2002",
        "[TEST] simulation",
        "[TESTLAB] Raymap",
        f"[ISSUEDATE] {issued or date.today():%d-%b-%Y}",
        "[MANUFAC] unknown",
        f"[LUMINAIRE] {name[:200]}",
        "TILT=NONE",
        f"1 -1 1 {len(angles)} {len(c)} 1 2 0 0 0",
        "1 1 0",
        *_rows(angles, "{:.6g}"),
        *_rows(c, "{:.6g}"),
    ]
    for plane in candela:
        lines += _rows(plane, "{:.6g}")
    return "\n".join(lines) + "\n"


def _planes(image: DetectorImage) -> tuple[Array, Array, Array]:
    """C and gamma [deg], and (n_c, n_gamma) candela."""
    beam = beam_of(image, "candela")
    values = beam.values.T
    if len(values) == 1:
        return np.zeros(1), beam.gamma_deg, values
    c = np.append(beam.c_deg, 360.0)
    return c, beam.gamma_deg, np.concatenate((values, values[:1]))


def _rows(numbers: Array, form: str) -> list[str]:
    """Numbers in lines of at most ten, shorter than the format's 256 letters."""
    return [
        " ".join(form.format(x) for x in numbers[k : k + 10]) for k in range(0, len(numbers), 10)
    ]

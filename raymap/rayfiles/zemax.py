"""Zemax source files (.dat, .sdf): binary of both versions and text are read, binary is written.

The header is that of the OpticStudio manual, "Binary Source File format" (`NSC_RAY_DATA_HEADER`),
208 bytes, little-endian; of its fields OpticStudio uses the number of rays, the unit of length, the
kind of rays and the unit of flux. Rays are seven f4 (position, direction, flux) or, in the spectral
kind, eight (and the wavelength in µm). Version 1 has the identifier 8675309, version 2 has 1010.
The text form begins with the number of rays and the unit of length; a line holds the same seven
or eight numbers.
"""

from __future__ import annotations

import codecs
import re
import struct
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO, Literal, NamedTuple

import numpy as np

from raymap.rayfiles.format import RayFormat
from raymap.rayfiles.rays import FluxFrom, FluxUnit, RayFileError, RaySet, checked, with_flux_of

__all__ = ["IDENTIFIERS", "ZemaxWriter", "is_binary", "read"]

IDENTIFIERS = {1: 8675309, 2: 1010}
"""First number of the file by version."""

_HEADER = struct.Struct("<iI100s7fI13f4i")


class _Header(NamedTuple):
    """Fields of ``NSC_RAY_DATA_HEADER``, with what is written into those that nobody uses."""

    identifier: int
    rays: int
    description: bytes
    source_flux: float
    ray_set_flux: float
    wavelength_um: float = 0.0
    inclination_begin: float = 0.0
    inclination_end: float = 180.0
    azimuth_begin: float = 0.0
    azimuth_end: float = 360.0
    length_unit: int = 4
    place_x: float = 0.0
    place_y: float = 0.0
    place_z: float = 0.0
    rotation_x: float = 0.0
    rotation_y: float = 0.0
    rotation_z: float = 0.0
    scale_x: float = 1.0
    scale_y: float = 1.0
    scale_z: float = 1.0
    unused_1: float = 0.0
    unused_2: float = 0.0
    unused_3: float = 0.0
    unused_4: float = 0.0
    ray_kind: int = 0
    flux_unit: int = 0
    reserved_1: int = 0
    reserved_2: int = 0


_UNITS = ("m", "in", "cm", "ft", "mm")
_MOST_RAYS = 4_000_000_000
_FLUX_ONLY, _SPECTRAL = 0, 2


def is_binary(start: bytes) -> bool:
    """Whether a file that starts with these bytes is a binary source file."""
    return len(start) >= 4 and struct.unpack_from("<i", start)[0] in IDENTIFIERS.values()


def read(path: Path, flux_from: FluxFrom = "header") -> RaySet:
    """Read a source file, binary or text.

    Parameters
    ----------
    flux_from : what counts where the header states another flux than its rays carry

    Raises
    ------
    RayFileError
        The header contradicts itself or the length of the file, or its rays are no light.
    """
    with path.open("rb") as file:
        if is_binary(file.read(4)):
            return _read_binary(path, flux_from)
    return _read_text(path)


def _read_binary(path: Path, flux_from: FluxFrom) -> RaySet:
    size, name = path.stat().st_size, path.name
    if size < _HEADER.size:
        raise RayFileError(
            f"{name}: {size} bytes are too few for the header of a Zemax source file "
            f"({_HEADER.size})"
        )
    with path.open("rb") as file:
        head = _Header._make(_HEADER.unpack(file.read(_HEADER.size)))
        rays, unit, kind, flux_type = head.rays, head.length_unit, head.ray_kind, head.flux_unit
        if kind not in (_FLUX_ONLY, _SPECTRAL):
            raise RayFileError(
                f"{name}: rays of kind {kind}; kinds are 0 (flux only) and 2 (spectral)"
            )
        if unit >= len(_UNITS):
            raise RayFileError(f"{name}: unit of length {unit}; units are 0 (m) to 4 (mm)")
        if flux_type not in (0, 1) or (kind == _SPECTRAL and flux_type):
            raise RayFileError(
                f"{name}: unit of flux {flux_type}; units are 0 (W) and, without wavelengths, "
                "1 (lm)"
            )
        width = 8 if kind == _SPECTRAL else 7
        if rays == 0:
            raise RayFileError(f"{name}: its header promises no rays")
        if _HEADER.size + rays * width * 4 != size:
            held = (size - _HEADER.size) / (4 * width)
            raise RayFileError(
                f"{name}: its header promises {rays} rays of {width} numbers, the file holds "
                f"{held:.6g}; get it again"
            )
    table = np.memmap(path, "<f4", "r", offset=_HEADER.size, shape=(rays, width))
    known = kind == _FLUX_ONLY and 0.1 <= head.wavelength_um <= 100.0
    single = head.wavelength_um if known else None
    found = _ray_set(table, name, _UNITS[unit], "lm" if flux_type else "W", single)
    found = with_flux_of(found, flux_from, name, stated=head.ray_set_flux)
    title = head.description.split(b"\0", 1)[0].decode("latin-1").strip()
    return RaySet(**{**vars(found), "title": title})


def _read_text(path: Path) -> RaySet:
    name = path.name
    with path.open("rb") as raw:
        wide = raw.read(2) in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
    with path.open(encoding="utf-16" if wide else "utf-8-sig", errors="replace") as file:
        lines = _content(file)
        rays, unit = _first_line(next(lines, ""), name)
        try:
            with warnings.catch_warnings(action="ignore"):
                table = np.loadtxt(lines, np.float64, ndmin=2)
        except ValueError as error:
            row = re.search(r"at row (\d+)", str(error))
            which = f"ray {int(row[1]) + 1}" if row else "a ray"
            raise RayFileError(
                f"{name}: {which} is not the seven or eight numbers of the rays before it "
                f"({str(error).splitlines()[0]})"
            ) from None
    if table.size and table.shape[1] not in (7, 8):
        raise RayFileError(f"{name}: {table.shape[1]} numbers a line, rays have seven or eight")
    if rays != len(table) or not rays:
        raise RayFileError(
            f"{name}: its first line promises {rays} rays, the file holds {len(table)}"
        )
    return _ray_set(table.astype(np.float32), name, _UNITS[unit], "W", None)


def _first_line(line: str, name: str) -> tuple[int, int]:
    """Number of rays and place of the unit of length; whole numbers, however they are written."""
    try:
        rays, unit = (float(word) for word in line.split()[:2])
        if not (rays.is_integer() and unit.is_integer() and 0 <= rays <= _MOST_RAYS):
            raise ValueError
    except (ValueError, OverflowError):
        raise RayFileError(
            f"{name}: is not a Zemax source file: neither the binary header nor a first line with "
            "the number of rays and the unit of length (0 m, 1 in, 2 cm, 3 ft, 4 mm), then seven "
            "or eight numbers a line"
        ) from None
    if not 0 <= unit < len(_UNITS):
        raise RayFileError(f"{name}: unit of length {unit:g}; units are 0 (m) to 4 (mm)")
    return int(rays), int(unit)


def _content(text: Iterable[str]) -> Iterator[str]:
    """Lines with numbers: comments, blank lines and what old systems put behind the text left out.

    Commas between numbers and decimal commas are told apart by the numbers that a line then has.
    """
    for raw in text:
        line = raw.partition("!")[0].strip("\0\x1a \t\r\n\f")
        if "," in line:
            decimal = len(line.split()) in (2, 7, 8) and ", " not in line
            line = line.replace(",", "." if decimal else " ")
        if line:
            yield line


def _ray_set(
    table: np.ndarray[tuple[int, ...], np.dtype[np.float32]],
    name: str,
    length_unit: str,
    flux_unit: FluxUnit,
    single_um: float | None,
) -> RaySet:
    wavelength = None
    if table.shape[1] == 8:
        wavelength = table[:, 7] * np.float32(1000.0)
    elif single_um is not None:
        wavelength = np.full(len(table), 1000.0 * single_um, np.float32)
    rays = RaySet(
        position=table[:, :3].astype(np.float32),
        direction=table[:, 3:6].astype(np.float32),
        flux=table[:, 6].astype(np.float32),
        length_unit=length_unit,
        flux_unit=flux_unit,
        wavelength_nm=wavelength,
    )
    return checked(rays, name)


class ZemaxWriter:
    """Writes a binary source file piece by piece; counts and fluxes are entered by `finish`.

    Parameters
    ----------
    file : opened for writing and seeking
    like : rays whose units and columns all pieces share; its own rays are not written
    version : of the header: 1 for old programs, 2 for today's

    Raises
    ------
    RayFileError
        Wavelengths go with radiant flux only.
    """

    def __init__(self, file: BinaryIO, like: RaySet, *, version: Literal[1, 2] = 2) -> None:
        if like.wavelength_nm is not None and like.flux_unit == "lm":
            raise RayFileError(
                "Zemax source files state wavelengths for radiant flux only: leave them out, or "
                "write rays in W"
            )
        self._file, self._like, self._version = file, like, version
        self._unit = like.length_unit if like.length_unit in _UNITS else "mm"
        self._n, self._flux = 0, 0.0
        file.write(bytes(_HEADER.size))

    def append(self, rays: RaySet) -> None:
        """Write rays.

        Raises
        ------
        RayFileError
            More rays than the header can number.
        """
        rays = rays.in_unit(self._unit)
        columns = [rays.position, rays.direction, rays.flux[:, None]]
        if self._like.wavelength_nm is not None and rays.wavelength_nm is not None:
            columns.append((rays.wavelength_nm / np.float32(1000.0))[:, None])
        np.concatenate(columns, axis=1).astype("<f4").tofile(self._file)
        self._n += len(rays)
        self._flux += rays.total_flux
        if self._n > _MOST_RAYS:
            raise RayFileError(f"a Zemax source file holds at most {_MOST_RAYS} rays")

    def finish(self) -> None:
        """Enter the header."""
        spectral = self._like.wavelength_nm is not None
        head = _Header(
            identifier=IDENTIFIERS[self._version],
            rays=self._n,
            description=(self._like.title or "written by Raymap").encode("latin-1", "replace")[:99],
            source_flux=self._flux,
            ray_set_flux=self._flux,
            length_unit=_UNITS.index(self._unit),
            ray_kind=_SPECTRAL if spectral else _FLUX_ONLY,
            flux_unit=1 if self._like.flux_unit == "lm" else 0,
        )
        self._file.seek(0)
        self._file.write(_HEADER.pack(*head))


KINDS = (
    RayFormat(
        suffixes=(".dat", ".sdf"),
        title="source files of Zemax, binary or text",
        place=20,
        read=read,
        writer=lambda file, like, version: ZemaxWriter(
            file, like, version=1 if version == 1 else 2
        ),
    ),
)

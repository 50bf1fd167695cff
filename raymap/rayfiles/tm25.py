"""IES TM-25 ray files (.tm25ray): reading and writing.

The layout is that of IES TM-25-13, "Ray File Format for the Description of the Emission Properties
of Light Sources", section 4.7, little-endian, as the public readers of J. Muschaweck
(TM25RaySetTools) and L. Boxler (IESTM25RayFiles) have it; ANSI/IES TM-25-20 keeps it. In bytes::

    0      "TM25", version i4, creation method i4 (0 simulated, 1 measured),
           luminous flux f4 [lm], radiant flux f4 [W] (NaN unknown), rays u8, date 28 characters,
           start position i4, spectral data i4, wavelength f4, least, greatest wavelength f4 [nm],
           spectral tables i4, additional columns i4, bytes of additional text i4, 168 reserved
    256    flags i4: position, direction, radiant flux, wavelength, luminous flux, Stokes,
           tristimulus, spectrum index
    288    nine texts of 1000 UTF-32 characters
    36288  spectral tables: n i4, n pairs f4 of wavelength and weight; zeros up to a multiple of 32
    then   512 bytes of UTF-32 per additional column, the additional text, and the rays: f4 columns
           x y z [mm], direction, radiant flux, wavelength [nm], luminous flux (Y), S1 S2 S3 and the
           axis of the polarisation ellipse (3), X, Z, spectrum index (from 1), additional columns
"""

from __future__ import annotations

import math
import struct
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.rayfiles.format import RayFormat
from raymap.rayfiles.rays import FluxFrom, RayFileError, RaySet, Spectrum, checked, with_flux_of

__all__ = ["TEXTS", "Tm25Writer", "read"]

MAGIC = b"TM25"
VERSION = 2013
_VERSIONS = (2013, 2020)
_FIXED = struct.Struct("<4siiffQ28siifffiii168x")
_FLAGS = struct.Struct("<8i")


class _Header(NamedTuple):
    """The first 256 bytes of a file (TM-25-13, 4.7.1)."""

    magic: bytes
    version: int
    creation_method: int
    luminous_flux: float
    radiant_flux: float
    rays: int
    date: bytes
    start_position: int
    spectral_kind: int
    wavelength_nm: float
    least_nm: float
    greatest_nm: float
    tables: int
    columns: int
    text_bytes: int


_TEXT_BYTES = 4000
_LABEL_BYTES = 512
_TABLES_AT = 256 + 32 + 9 * _TEXT_BYTES
_MOST = 2**20
Floats = NDArray[np.float32]

TEXTS = (
    "name",
    "manufacturer",
    "model_creator",
    "ray_file_creator",
    "equipment",
    "camera",
    "operation",
    "information",
    "reference",
)
"""The nine texts of the description block, in order."""

_FLAG_COLUMNS = (
    ("x", "y", "z"),
    ("kx", "ky", "kz"),
    ("radiant",),
    ("wavelength",),
    ("luminous",),
    ("S1", "S2", "S3", "Px", "Py", "Pz"),
    ("X", "Z"),
    ("index",),
)


def read(path: Path, flux_from: FluxFrom = "header") -> RaySet:
    """Read a TM-25 file.

    Parameters
    ----------
    flux_from : what counts where the header states another flux than its rays carry

    Raises
    ------
    RayFileError
        It is not a TM-25 file, its header contradicts itself or the length of the file, or its rays
        are no light.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        if size < _TABLES_AT:
            raise RayFileError(
                f"{path.name}: {size} bytes are too few for the header of a TM-25 file "
                f"({_TABLES_AT})"
            )
        head = _Header._make(_FIXED.unpack(file.read(_FIXED.size)))
        flags = _FLAGS.unpack(file.read(_FLAGS.size))
        _check_head(path.name, head, flags)
        texts = [_text(file.read(_TEXT_BYTES), path.name) for _ in TEXTS]
        spectra = _tables(file, head.tables, size, path.name)
        extra, text_bytes = head.columns, head.text_bytes
        if file.tell() + extra * _LABEL_BYTES + text_bytes > size:
            raise RayFileError(f"{path.name}: ends within the header; {_AGAIN}")
        file.seek(extra * _LABEL_BYTES + text_bytes, 1)
        names = [name for flag, group in zip(flags, _FLAG_COLUMNS, strict=True) if flag
                 for name in group]  # fmt: skip
        width = len(names) + extra
        start, rays = file.tell(), head.rays
        if start + rays * width * 4 != size:
            raise RayFileError(
                f"{path.name}: its header promises {rays} rays of {width} numbers, that is "
                f"{start + rays * width * 4} bytes, but the file has {size}; {_AGAIN}"
            )
    table: Floats = np.memmap(path, "<f4", "r", offset=start, shape=(rays, width))
    columns = {name: table[:, index] for index, name in enumerate(names)}
    found = _ray_set(path.name, head, columns, spectra, texts)
    radiant = found.flux_unit == "W"
    return with_flux_of(
        found,
        flux_from,
        path.name,
        stated=head.radiant_flux if radiant else head.luminous_flux,
        stated_luminous=head.luminous_flux,
    )


_AGAIN = "get it again, or the file is of another version"


def _check_head(name: str, head: _Header, flags: tuple[int, ...]) -> None:
    """Refuse headers that contradict themselves (TM-25-13, 4.7.1 and 4.7.2)."""
    spectral, tables, extra, text_bytes = (
        head.spectral_kind, head.tables, head.columns, head.text_bytes,
    )  # fmt: skip
    trouble = ""
    if head.magic != MAGIC:
        raise RayFileError(f"{name}: is not a TM-25 file (it does not begin with TM25)")
    if head.version not in _VERSIONS:
        raise RayFileError(
            f"{name}: TM-25 version {head.version} is not known; known are 2013 and 2020"
        )
    if head.rays == 0:
        raise RayFileError(f"{name}: its header promises no rays")
    if any(flag not in (0, 1) for flag in flags):
        trouble = f"flags must be 0 or 1, are {list(flags)}"
    elif not (flags[0] and flags[1]):
        trouble = "positions or directions are missing"
    elif not (flags[2] or flags[4]):
        trouble = "there is neither radiant nor luminous flux"
    elif not 0 <= spectral <= 4:
        trouble = f"spectral data of kind {spectral}; kinds are 0 to 4"
    elif spectral == 2 and not flags[3]:
        trouble = "spectral data of kind 2, but no column of wavelengths"
    elif spectral in (3, 4) and tables < 1:
        trouble = f"spectral data of kind {spectral}, but no spectral table"
    elif bool(flags[7]) != (spectral == 4):
        trouble = "a column of spectrum indices goes with spectral data of kind 4, and only then"
    elif flags[6] and not flags[4]:
        trouble = "X and Z without luminous flux (Y)"
    elif not (0 <= tables <= _MOST and 0 <= extra <= _MOST and 0 <= text_bytes <= 2**30):
        trouble = f"{tables} spectral tables, {extra} columns, {text_bytes} bytes of text"
    if trouble:
        raise RayFileError(f"{name}: its header contradicts itself: {trouble}")


def _tables(file: BinaryIO, count: int, size: int, name: str) -> list[Spectrum]:
    spectra = []
    used = 0
    for number in range(1, count + 1):
        n = int.from_bytes(file.read(4), "little", signed=True)
        if n < 1 or file.tell() + 8 * n > size:
            raise RayFileError(f"{name}: spectral table {number} has {n} rows; {_AGAIN}")
        pairs = np.fromfile(file, "<f4", 2 * n).reshape(n, 2)
        if not (np.isfinite(pairs).all() and (pairs[:, 0] > 0).all() and (pairs[:, 1] >= 0).all()):
            raise RayFileError(
                f"{name}: spectral table {number} has wavelengths or weights that are negative or "
                "not finite"
            )
        spectra.append(Spectrum(wavelength_nm=pairs[:, 0].copy(), power=pairs[:, 1].copy()))
        used += 4 + 8 * n
    file.seek(-used % 32, 1)
    return spectra


def _ray_set(
    name: str,
    head: _Header,
    columns: dict[str, Floats],
    spectra: list[Spectrum],
    texts: list[str],
) -> RaySet:
    def group(*keys: str) -> Floats:
        return np.stack([columns[key] for key in keys], axis=1).astype(np.float32)

    radiant, luminous = columns.get("radiant"), columns.get("luminous")
    flux = radiant if radiant is not None else columns["luminous"]
    wavelength = columns.get("wavelength")
    if wavelength is None and head.spectral_kind == 1:
        wavelength = np.full(len(flux), head.wavelength_nm, np.float32)
    spectrum = None
    if "index" in columns:
        index = columns["index"]
        if not ((index >= 1) & (index <= len(spectra)) & (index == np.rint(index))).all():
            raise RayFileError(
                f"{name}: a ray names a spectral table that is none of the {len(spectra)} there are"
            )
        spectrum = index.astype(np.int32) - 1
    return checked(
        RaySet(
            position=group("x", "y", "z"),
            direction=group("kx", "ky", "kz"),
            flux=flux.astype(np.float32),
            flux_unit="W" if radiant is not None else "lm",
            wavelength_nm=None if wavelength is None else wavelength.astype(np.float32),
            luminous_flux=None
            if radiant is None or luminous is None
            else luminous.astype(np.float32),
            tristimulus=group("X", "luminous", "Z") if "X" in columns else None,
            spectra=tuple(spectra),
            spectrum=spectrum,
            title=texts[0],
            description=dict(zip(TEXTS[1:], texts[1:], strict=True)),
        ),
        name,
    )


def _text(raw: bytes, name: str) -> str:
    """The characters up to the first zero."""
    end = next((at for at in range(0, len(raw), 4) if raw[at : at + 4] == b"\0\0\0\0"), len(raw))
    try:
        return raw[:end].decode("utf-32-le").strip()
    except UnicodeDecodeError:
        raise RayFileError(f"{name}: a text of its header is not UTF-32; {_AGAIN}") from None


class Tm25Writer:
    """Writes a TM-25 file piece by piece; counts and totals are entered by `finish`.

    Parameters
    ----------
    file : opened for writing and seeking
    like : rays whose units, columns and texts all pieces share; its own rays are not written

    Raises
    ------
    RayFileError
        Wavelengths go with radiant flux only, tristimulus values with luminous flux only
        (TM-25-13, 4.7.2).
    """

    def __init__(self, file: BinaryIO, like: RaySet) -> None:
        if like.flux_unit == "lm" and (like.wavelength_nm is not None or like.spectra):
            raise RayFileError(
                "TM-25 states wavelengths for radiant flux only: leave them out, or write rays in W"
            )
        if like.tristimulus is not None and like.flux_unit == "W":
            raise RayFileError("TM-25 states tristimulus values for luminous flux only")
        self._file, self._like = file, like
        self._n, self._flux, self._luminous = 0, 0.0, 0.0
        self._low, self._high = math.inf, 0.0
        for spectrum in like.spectra:
            self._low = min(self._low, float(spectrum.wavelength_nm.min()))
            self._high = max(self._high, float(spectrum.wavelength_nm.max()))
        file.write(bytes(_TABLES_AT))
        block = b"".join(
            len(each.power).to_bytes(4, "little")
            + np.stack([each.wavelength_nm, each.power], 1).astype("<f4").tobytes()
            for each in like.spectra
        )
        file.write(block + bytes(-len(block) % 32))

    def append(self, rays: RaySet) -> None:
        """Write rays; positions are converted to mm."""
        rays = rays.in_unit("mm")
        like = self._like
        columns = [rays.position, rays.direction]
        if like.flux_unit == "W":
            columns.append(rays.flux[:, None])
        if like.wavelength_nm is not None and rays.wavelength_nm is not None:
            columns.append(rays.wavelength_nm[:, None])
            if len(rays):
                self._low = min(self._low, float(rays.wavelength_nm.min()))
                self._high = max(self._high, float(rays.wavelength_nm.max()))
        if like.flux_unit == "lm":
            columns.append(rays.flux[:, None])
        elif like.luminous_flux is not None and rays.luminous_flux is not None:
            columns.append(rays.luminous_flux[:, None])
            self._luminous += float(rays.luminous_flux.sum(dtype=np.float64))
        if like.tristimulus is not None and rays.tristimulus is not None:
            columns.append(rays.tristimulus[:, ::2])
        if like.spectrum is not None and rays.spectrum is not None:
            columns.append((rays.spectrum + 1).astype(np.float32)[:, None])
        np.concatenate(columns, axis=1).astype("<f4").tofile(self._file)
        self._n += len(rays)
        self._flux += rays.total_flux

    def finish(self) -> None:
        """Enter the header."""
        like, radiant = self._like, self._like.flux_unit == "W"
        spectral = 0
        if like.wavelength_nm is not None:
            spectral = 2
        elif like.spectra:
            spectral = 3 if like.spectrum is None else 4
        known = self._high > 0 and spectral >= 2
        luminous = math.nan if radiant and like.luminous_flux is None else self._luminous
        head = _Header(
            magic=MAGIC,
            version=VERSION,
            creation_method=0,
            luminous_flux=luminous if radiant else self._flux,
            radiant_flux=self._flux if radiant else math.nan,
            rays=self._n,
            date=datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S+00:00").encode(),
            start_position=0,
            spectral_kind=spectral,
            wavelength_nm=math.nan,
            least_nm=self._low if known else math.nan,
            greatest_nm=self._high if known else math.nan,
            tables=len(like.spectra),
            columns=0,
            text_bytes=0,
        )
        flags = _FLAGS.pack(
            1,
            1,
            radiant,
            like.wavelength_nm is not None,
            not radiant or like.luminous_flux is not None,
            0,
            like.tristimulus is not None,
            spectral == 4,
        )
        texts = {"name": like.title, "ray_file_creator": "Raymap"} | like.description
        self._file.seek(0)
        self._file.write(_FIXED.pack(*head) + flags)
        for key in TEXTS:
            raw = texts.get(key, "").encode("utf-32-le")[:_TEXT_BYTES]
            self._file.write(raw + bytes(_TEXT_BYTES - len(raw)))


KINDS = (
    RayFormat(
        suffixes=(".tm25ray",),
        title="rays of IES TM-25",
        place=10,
        sniff=lambda head: head.startswith(MAGIC),
        read=read,
        writer=lambda file, like, version: Tm25Writer(file, like),
    ),
)

"""Read sequential lens files of Zemax OpticStudio (``.zmx``).

The format is lines of a four-letter word and its values; the lines of a surface are indented below
``SURF n``. What is said twice in different versions of the program (``WAVM`` and ``WAVL``) is read
either way; words that do not describe the lens are passed over.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from raymap.errors import SceneError
from tracer.importers.prescription import (
    Aperture,
    FieldPoint,
    GlassName,
    ImportWarning,
    LensSurface,
    Prescription,
)
from tracer.importers.text import read_text

__all__ = ["parse_zemax", "read_zemax"]

_UNITS: dict[str, Literal["mm", "cm", "m", "in"]] = {
    "MM": "mm", "CM": "cm", "METER": "m", "METERS": "m", "M": "m", "IN": "in", "INCH": "in",
    "INCHES": "in",
}  # fmt: skip
_FIELDS: tuple[
    Literal["angle", "object_height", "paraxial_image_height", "real_image_height"], ...
] = ("angle", "object_height", "paraxial_image_height", "real_image_height")
_ROUND = {"CLAP", "FLAP", "OBSC"}
_OTHER_APERTURES = {"SQAP", "SQOB", "ELAP", "ELOB", "SPID", "UDAP", "UDOB"}
_MODEL_GLASS = 1
_MOST_COEFFICIENTS = 6


def read_zemax(path: str | Path) -> Prescription:
    """The lens of a ``.zmx`` file, whatever its encoding.

    Raises
    ------
    SceneError
        where the file is none, is not sequential, or has a surface that cannot be traced
    """
    return parse_zemax(read_text(path), origin=Path(path).name)


@dataclass
class _Block:
    """The lines of one surface."""

    number: int
    lines: dict[str, list[str]] = field(default_factory=dict)
    parameters: dict[int, float] = field(default_factory=dict)
    apertures: dict[str, list[str]] = field(default_factory=dict)


def parse_zemax(text: str, *, origin: str = "lens") -> Prescription:
    """As `read_zemax`, from the text of a file."""
    reader = _Reader(origin)
    for line in text.splitlines():
        reader.take(line)
    return reader.finish()


class _Reader:
    def __init__(self, origin: str) -> None:
        self.origin = origin
        self.header: dict[str, list[str]] = {}
        self.wavelengths: dict[int, tuple[float, float]] = {}
        self.blocks: list[_Block] = []

    def fail(self, place: str, message: str) -> SceneError:
        return SceneError(f"{self.origin}: {place}: {message}")

    def take(self, line: str) -> None:
        word, *values = line.split() or [""]
        word = word.upper()
        if word == "SURF":
            self.blocks.append(_Block(self._integer(values, 0, "SURF")))
        elif not line[:1].isspace() or not self.blocks:
            if word == "WAVM" and len(values) >= 2:
                number = self._integer(values, 0, word)
                weight = self._number(values, 2, word) if len(values) > 2 else 1.0
                self.wavelengths[number] = (self._number(values, 1, word), weight)
            elif word and word not in self.header:
                self.header[word] = values
        else:
            block = self.blocks[-1]
            place = f"surface {block.number}"
            if word == "PARM":
                number = self._integer(values, 0, place)
                block.parameters[number] = self._number(values, 1, place)
            elif word in _ROUND or word in _OTHER_APERTURES:
                block.apertures[word] = values
            else:
                block.lines[word] = values

    # -- numbers ---------------------------------------------------------------------------------

    def _number(self, values: list[str], index: int, place: str) -> float:
        try:
            number = float(values[index])
        except (IndexError, ValueError):
            shown = values[index] if index < len(values) else "nothing"
            raise self.fail(place, f"{shown!r} stands where a number is expected") from None
        if math.isnan(number):
            raise self.fail(place, "a value is not a number")
        return number

    def _integer(self, values: list[str], index: int, place: str) -> int:
        number = self._number(values, index, place)
        if not number.is_integer() or abs(number) > 1e6:
            raise self.fail(place, f"{number:g} is not the number of anything")
        return int(number)

    def _list(self, word: str, count: int) -> list[float]:
        values = self.header.get(word, [])
        return [self._number(values, k, word) if k < len(values) else 0.0 for k in range(count)]

    # -- surfaces --------------------------------------------------------------------------------

    def surfaces(self) -> Iterator[LensSurface]:
        for block in self.blocks:
            yield self._surface(block)

    def _surface(self, block: _Block) -> LensSurface:
        place = f"surface {block.number}"
        kind = (block.lines.get("TYPE") or ["STANDARD"])[0].upper()
        if kind not in ("STANDARD", "EVENASPH"):
            raise self.fail(
                place,
                f"is of type {kind}, which cannot be traced; STANDARD and EVENASPH (spheres, "
                "conics, even aspheres) are understood: replace it in the design program",
            )
        curvature = self._number(block.lines.get("CURV", ["0"]), 0, place)
        conic = self._number(block.lines.get("CONI", ["0"]), 0, place)
        aspheric: tuple[float, ...] = ()
        if kind == "EVENASPH":
            curvature, conic, aspheric = self._even_asphere(block, curvature, conic, place)
        glass, mirror = self._glass(block, place)
        diameter = block.lines.get("DIAM", [])
        semi_diameter = abs(self._number(diameter, 0, place)) if diameter else 0.0
        fixed = len(diameter) > 1 and self._number(diameter, 1, place) != 0.0
        mechanical = block.lines.get("MEMA", [])
        clear, hole, obscuration = self._apertures(block, place)
        if clear and (not semi_diameter or clear < semi_diameter):
            semi_diameter, fixed = clear, True
        return LensSurface(
            number=block.number,
            curvature=curvature,
            conic=conic,
            aspheric=aspheric,
            thickness=self._thickness(block, place),
            glass=glass,
            mirror=mirror,
            semi_diameter=semi_diameter or None,
            automatic=not fixed,
            mechanical=abs(self._number(mechanical, 0, place)) or None if mechanical else None,
            hole=hole,
            obscuration=obscuration,
            stop="STOP" in block.lines,
            label=" ".join(block.lines.get("COMM", [])),
        )

    def _thickness(self, block: _Block, place: str) -> float:
        thickness = self._number(block.lines.get("DISZ", ["0"]), 0, place)
        return math.inf if abs(thickness) >= 1e10 else thickness

    def _even_asphere(
        self, block: _Block, curvature: float, conic: float, place: str
    ) -> tuple[float, float, tuple[float, ...]]:
        """Curvature, conic and coefficients of r^4 …; a term in r² belongs to the curvature."""
        square = block.parameters.get(1, 0.0)
        if square != 0.0:
            if curvature != 0.0 and conic != -1.0:
                raise self.fail(
                    place,
                    f"has a term in r² ({square:g}) beside a curvature, which cannot be traced; "
                    "take it into the radius in the design program",
                )
            curvature, conic = curvature + 2.0 * square, -1.0
        terms = [block.parameters.get(k, 0.0) for k in range(2, 9)]
        while terms and terms[-1] == 0.0:
            terms.pop()
        if len(terms) > _MOST_COEFFICIENTS:
            raise self.fail(
                place, f"has a term in r^16 ({terms[-1]:g}); terms up to r^14 can be traced"
            )
        return curvature, conic, tuple(terms)

    def _glass(self, block: _Block, place: str) -> tuple[GlassName | None, bool]:
        values = block.lines.get("GLAS", [])
        if not values:
            return None, False
        name = values[0]
        if name.upper() == "MIRROR":
            return None, True
        if len(values) > 4 and self._integer(values, 1, place) == _MODEL_GLASS:
            index, abbe = self._number(values, 3, place), self._number(values, 4, place)
            if index <= 1.0:
                raise self.fail(place, f"a model glass of index {index:g} is not a glass")
            return GlassName(name=name, model=(index, abbe)), False
        return GlassName(name=name), False

    def _apertures(self, block: _Block, place: str) -> tuple[float, float, float]:
        """Radius of the clear aperture (0: not said), of a hole in it, of an obscuration."""
        other = sorted(_OTHER_APERTURES & set(block.apertures))
        if other:
            warnings.warn(
                f"{self.origin}: {place}: its aperture {other[0]} is not round; the semi-diameter "
                "is taken instead",
                ImportWarning,
                stacklevel=2,
            )
        clear = hole = obscuration = 0.0
        for word in ("CLAP", "FLAP"):
            if word in block.apertures:
                hole = self._number(block.apertures[word], 0, place)
                clear = self._number(block.apertures[word], 1, place)
        if "OBSC" in block.apertures:
            obscuration = self._number(block.apertures["OBSC"], 1, place)
        return clear, hole, obscuration

    # -- the whole -------------------------------------------------------------------------------

    def finish(self) -> Prescription:
        mode = (self.header.get("MODE") or ["SEQ"])[0].upper()
        if mode != "SEQ":
            raise SceneError(
                f"{self.origin}: is not sequential (mode {mode}); save the sequential lens, or "
                "export its parts as STEP"
            )
        surfaces = tuple(self.surfaces())
        if len(surfaces) < 3:
            raise SceneError(
                f"{self.origin}: is not a Zemax lens file: it has {len(surfaces)} surfaces (SURF), "
                "at least object, one surface and image are needed"
            )
        configurations = self.header.get("MNUM") or ["1"]
        if self._integer(configurations, 0, "MNUM") > 1:
            warnings.warn(
                f"{self.origin}: has {configurations[0]} configurations; the one that was active "
                "when it was saved is read",
                ImportWarning,
                stacklevel=2,
            )
        units = (self.header.get("UNIT") or ["MM"])[0].upper()
        if units not in _UNITS:
            raise self.fail("UNIT", f"there is no unit {units!r}; {', '.join(_UNITS)} are known")
        kind, fields, telecentric = self._fields()
        wavelengths, weights, primary = self._wavelengths()
        return Prescription(
            origin=self.origin,
            title=" ".join(self.header.get("NAME", [])),
            unit=_UNITS[units],
            surfaces=surfaces,
            aperture=self._aperture(),
            field_kind=kind,
            fields=fields,
            telecentric=telecentric,
            wavelengths_nm=wavelengths,
            weights=weights,
            primary=primary,
            catalogues=tuple(self.header.get("GCAT", [])),
        )

    def _aperture(self) -> Aperture:
        if "ENPD" in self.header:
            return Aperture(
                kind="entrance_diameter", value=self._number(self.header["ENPD"], 0, "ENPD")
            )
        if "FNUM" in self.header:
            values = self.header["FNUM"]
            working = len(values) > 1 and self._number(values, 1, "FNUM") == 1.0
            return Aperture(
                kind="working_f_number" if working else "f_number",
                value=self._number(values, 0, "FNUM"),
            )
        if "OBNA" in self.header:
            values = self.header["OBNA"]
            value = self._number(values, 0, "OBNA")
            if len(values) > 1 and self._number(values, 1, "OBNA") == 1.0:
                value = math.sin(math.radians(value))
            return Aperture(kind="object_na", value=value)
        return Aperture(kind="stop")

    def _fields(
        self,
    ) -> tuple[
        Literal["angle", "object_height", "paraxial_image_height", "real_image_height"],
        tuple[FieldPoint, ...],
        bool,
    ]:
        values = self.header.get("FTYP", ["0"])
        number = self._integer(values, 0, "FTYP")
        if not 0 <= number < len(_FIELDS):
            raise self.fail(
                "FTYP", f"fields of type {number} are not understood; use angles or heights"
            )
        telecentric = len(values) > 1 and self._integer(values, 1, "FTYP") == 1
        y = self.header.get("YFLN", [])
        count = self._integer(values, 2, "FTYP") if len(values) > 2 else max(1, len(y))
        count = min(max(count, 1), 12, max(1, len(y)))
        columns = [
            self._list(word, count)
            for word in ("XFLN", "YFLN", "FWGN", "VDXN", "VDYN", "VCXN", "VCYN")
        ]
        fields = tuple(
            FieldPoint(
                x=x,
                y=y,
                weight=weight if "FWGN" in self.header else 1.0,
                vignetting=(vcx - vdx, vcx + vdx, vcy - vdy, vcy + vdy),
            )
            for x, y, weight, vdx, vdy, vcx, vcy in zip(*columns, strict=True)
        )
        return _FIELDS[number], fields, telecentric

    def _wavelengths(self) -> tuple[tuple[float, ...], tuple[float, ...], int]:
        """Wavelengths [nm], their weights, and which is the primary one."""
        if self.wavelengths:
            numbers = sorted(self.wavelengths)
            types = self.header.get("FTYP", [])
            if len(types) > 3:
                count = self._integer(types, 3, "FTYP")
                numbers = [number for number in numbers if number <= count] or numbers[:1]
            pairs = [self.wavelengths[number] for number in numbers]
        else:
            values = self.header.get("WAVL") or self.header.get("WAVN") or ["0.5875618"]
            weights = self.header.get("WWGT") or self.header.get("WWGN") or []
            pairs = [
                (
                    self._number(values, k, "WAVL"),
                    self._number(weights, k, "WWGT") if k < len(weights) else 1.0,
                )
                for k in range(len(values))
            ]
        if min(pair[0] for pair in pairs) <= 0.0:
            raise self.fail("WAVM", "a wavelength must be positive")
        primary = self._integer(self.header.get("PWAV", ["1"]), 0, "PWAV") - 1
        return (
            tuple(round(1000.0 * wavelength, 9) for wavelength, _ in pairs),
            tuple(weight for _, weight in pairs),
            min(max(primary, 0), len(pairs) - 1),
        )

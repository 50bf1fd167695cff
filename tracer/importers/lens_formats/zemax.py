"""Read sequential lens files of Zemax OpticStudio (``.zmx``).

The format is lines of a four-letter word and its values; the lines of a surface stand below
``SURF n``, indented by most programs. What is said twice in different versions of the program
(``WAVM`` and ``WAVL``) is read either way. A word is read, or known to be harmless
(`zemax_words`), or else warned about or refused by name: none is passed over.
"""

from __future__ import annotations

import math
import re
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from raymap.model.errors import SceneError
from raymap.model.textfile import plain_number, split_lines
from tracer.importers.lens_format import LensFormat
from tracer.importers.lens_formats.zemax_words import (
    APERTURES_NOT_ROUND,
    HARMLESS_IN_HEAD,
    HARMLESS_IN_SURFACES,
    TYPES,
    VALUES,
    WORDS_OF_HEAD,
    WORDS_OF_SURFACES,
)
from tracer.importers.prescription import (
    Aperture,
    FieldKind,
    FieldPoint,
    GlassName,
    ImportWarning,
    LensSurface,
    Prescription,
    ThicknessSolve,
)
from tracer.importers.text import read_text

__all__ = ["parse_zemax", "read_zemax"]

_UNITS: dict[str, Literal["mm", "cm", "m", "in"]] = {
    "MM": "mm", "CM": "cm", "METER": "m", "METERS": "m", "M": "m", "IN": "in", "INCH": "in",
    "INCHES": "in",
}  # fmt: skip
_FIELDS: tuple[FieldKind, ...] = (
    "angle", "object_height", "paraxial_image_height", "real_image_height",
)  # fmt: skip
_OF_SURFACES = WORDS_OF_SURFACES | set(HARMLESS_IN_SURFACES) | set(APERTURES_NOT_ROUND)
_OF_HEAD = WORDS_OF_HEAD | set(HARMLESS_IN_HEAD)
_APERTURES = ("ENPD", "FNUM", "OBNA", "FLOA")
_FIXED, _MODEL, _PICKED_UP, _SUBSTITUTE = range(4)
_CURVATURE_PICKUP = 4
_PLACEHOLDERS = {(1.5, 40.0), (1.5, 50.0), (0.0, 0.0)}
"""Index and Abbe number that programs write beside a catalogue's glass without meaning them."""

_LEAST_INDEX = 0.9
_MOST_COEFFICIENTS = 6
_MERIT_VALUES = 8
_NORMAL_C, _NORMAL_ATM = 20.0, 1.0


def read_zemax(path: str | Path) -> Prescription:
    """The lens of a ``.zmx`` file, whatever its encoding.

    Raises
    ------
    SceneError
        where the file is none, is not sequential, or says what cannot be traced
    """
    return parse_zemax(read_text(path), origin=Path(path).name)


def parse_zemax(text: str, *, origin: str = "lens") -> Prescription:
    """As `read_zemax`, from the text of a file."""
    lines = split_lines(text)
    joined = "\n".join(lines)
    reader = _Reader(
        origin, indented=bool(re.search(r"^SURF .*\n([ \t]*\n)*[ \t]+\S", joined, re.M))
    )
    for number, line in enumerate(lines, 1):
        reader.take(line, number)
    return reader.finish()


@dataclass(frozen=True)
class _Line:
    """A word, its values, and where it stands."""

    word: str
    values: list[str]
    place: str

    @property
    def shown(self) -> str:
        return " ".join((self.word, *self.values[:8]))


@dataclass
class _Block:
    """The lines of one surface."""

    number: int
    lines: dict[str, _Line] = field(default_factory=dict)
    parameters: dict[int, float] = field(default_factory=dict)
    places: dict[int, str] = field(default_factory=dict)
    picked: list[_Line] = field(default_factory=list)
    tilts: list[_Line] = field(default_factory=list)
    extra: list[_Line] = field(default_factory=list)

    @property
    def kind(self) -> str:
        line = self.lines.get("TYPE")
        return line.values[0].upper() if line and line.values else "STANDARD"


class _Reader:
    def __init__(self, origin: str, *, indented: bool) -> None:
        self.origin = origin
        self.indented = indented
        self.header: dict[str, _Line] = {}
        self.wavelengths: dict[int, tuple[float, float]] = {}
        self.blocks: list[_Block] = []
        self.unknown: dict[str, list[str]] = {}
        self.coatings: list[int] = []
        self.configured = False
        self.solves: list[ThicknessSolve] = []

    def fail(self, where: str, message: str) -> SceneError:
        return SceneError(f"{self.origin}: {where}: {message}")

    def warn(self, message: str) -> None:
        warnings.warn(f"{self.origin}: {message}", ImportWarning, stacklevel=2)

    # -- lines -----------------------------------------------------------------------------------

    def take(self, text: str, number: int) -> None:
        word, *values = text.split() or [""]
        word = word.upper()
        if not word:
            return
        if word == "SURF":
            line = _Line(word, values, f"line {number}")
            self.blocks.append(_Block(self._integer(line, 0)))
        elif self.blocks and self._belongs_to_surface(text, word):
            block = self.blocks[-1]
            self._take_of_surface(
                block, _Line(word, values, f"line {number}, surface {block.number}")
            )
        else:
            self._take_of_head(_Line(word, values, f"line {number}"))

    def _belongs_to_surface(self, text: str, word: str) -> bool:
        """Whether a line after ``SURF`` is one of that surface."""
        if word in _OF_SURFACES or self.indented:
            return word in _OF_SURFACES or text[:1].isspace()
        return word not in _OF_HEAD and not _is_row(text.split()[1:])

    def _say_of_further_values(self, line: _Line) -> None:
        """Values behind those that a word has, unless they are zeros and empty texts."""
        further = line.values[VALUES.get(line.word, len(line.values)) :]
        if any(plain_number(value) != 0.0 and value != '""' for value in further):
            self.warn(
                f"{line.place}: {' '.join(further)} at the end of {line.shown} is not understood "
                "and is left out"
            )

    def _take_of_head(self, line: _Line) -> None:
        self._say_of_further_values(line)
        if line.word == "WAVM" and len(line.values) >= 2:
            weight = self._number(line, 2) if len(line.values) > 2 else 1.0
            number, pair = self._integer(line, 0), (self._number(line, 1), weight)
            if self.wavelengths.setdefault(number, pair) != pair:
                self.warn(f"{line.place}: wavelength {number} stands twice; the first is taken")
        elif line.word == "MCON":
            self.configured = True
        elif line.word in WORDS_OF_HEAD:
            first = self.header.setdefault(line.word, line)
            if first.values != line.values:
                self.warn(f"{line.place}: {line.word} stands twice; that of {first.place} is taken")
        elif line.word in HARMLESS_IN_HEAD or (self.blocks and _is_row(line.values)):
            # Behind the surfaces stand the rows of the merit function and the configurations
            return
        elif line.word in _OF_SURFACES:
            raise self.fail(line.place, f"{line.word} belongs to a surface, but follows none")
        else:
            self.unknown.setdefault(line.word, []).append(line.place)

    def _take_of_surface(self, block: _Block, line: _Line) -> None:
        self._say_of_further_values(line)
        word = line.word
        if word == "PARM":
            number, value = self._integer(line, 0), self._number(line, 1)
            if block.parameters.get(number, value) != value:
                self._say_of_second(line, block.places[number])
            block.parameters[number], block.places[number] = value, line.place
        elif word == "PPAR":
            block.picked.append(line)
        elif word == "SCBD":
            block.tilts.append(line)
        elif word == "XDAT":
            block.extra.append(line)
        elif word == "COAT":
            if line.values:
                self.coatings.append(block.number)
        elif word in WORDS_OF_SURFACES or word in APERTURES_NOT_ROUND:
            first = block.lines.get(word, line)
            if first.values != line.values:
                self._say_of_second(line, first.place)
            block.lines[word] = line
        elif word not in HARMLESS_IN_SURFACES:
            self.unknown.setdefault(word, []).append(line.place)

    def _say_of_second(self, line: _Line, first: str) -> None:
        self.warn(f"{line.place}: {line.word} stands twice; it is taken, not that of {first}")

    # -- numbers ---------------------------------------------------------------------------------

    def _number(self, line: _Line, index: int) -> float:
        values = line.values
        shown = values[index] if index < len(values) else "nothing"
        number = plain_number(shown)
        if number is None:
            raise self.fail(line.place, f"{shown!r} stands where a number is expected")
        if math.isnan(number):
            raise self.fail(line.place, "a value is not a number")
        if math.isinf(number) and line.word not in ("DISZ", "DIAM"):
            raise self.fail(line.place, f"{shown!r} stands where a finite number is expected")
        return number

    def _integer(self, line: _Line, index: int) -> int:
        number = self._number(line, index)
        if not number.is_integer() or abs(number) > 1e6:
            raise self.fail(line.place, f"{number:g} is not the number of anything")
        return int(number)

    def _optional(self, line: _Line | None, index: int, default: float = 0.0) -> float:
        if line is None or index >= len(line.values):
            return default
        return self._number(line, index)

    def _whole(self, line: _Line | None, index: int, default: float = 0.0) -> int:
        """As `_optional`, of a whole number."""
        if line is None or index >= len(line.values):
            return int(default)
        return self._integer(line, index)

    def _column(self, words: tuple[str, ...], count: int, default: float = 0.0) -> list[float]:
        """Values of the first of some words that the head has, filled up with ``default``."""
        line = next((self.header[word] for word in words if word in self.header), None)
        return [self._optional(line, k, default) for k in range(count)]

    # -- surfaces --------------------------------------------------------------------------------

    def surfaces(self) -> list[LensSurface]:
        """The surfaces, pickups followed."""
        built: list[LensSurface] = []
        for index, block in enumerate(self.blocks):
            if block.number != index:
                raise self.fail(
                    f"surface {block.number}",
                    f"stands where surface {index} is expected; surfaces must be numbered 0, 1, 2 "
                    "… in their order",
                )
        for index in range(len(self.blocks)):
            built.append(self._surface(index, built))
        return built

    def _surface(self, index: int, before: list[LensSurface]) -> LensSurface:
        block = self.blocks[index]
        where = f"surface {block.number}"
        self._refuse_what_is_moved(block)
        for line in block.picked:
            self._pick_parameter(block, line)
        dummy = block.kind == "COORDBRK"
        if dummy:
            self._refuse_break(block, where)
        elif block.kind not in ("STANDARD", "EVENASPH"):
            called = f", {TYPES[block.kind]}," if block.kind in TYPES else ","
            raise self.fail(
                where,
                f"is of type {block.kind}{called} which cannot be traced; STANDARD and EVENASPH "
                "(spheres, conics, even aspheres) are understood: replace it in the design program",
            )
        curvature = 0.0 if dummy else self._curvature(block, before)
        conic = 0.0 if dummy else self._optional(block.lines.get("CONI"), 0)
        aspheric: tuple[float, ...] = ()
        if block.kind == "STANDARD" and any(block.parameters.values()):
            self.warn(
                f"{where}: is of type STANDARD, which has no parameters; its PARM are left out"
            )
        for line in block.extra:
            if self._optional(line, 1) != 0.0:
                self.warn(
                    f"{line.place}: is of type {block.kind}, which has no extra data; {line.shown} "
                    "is left out"
                )
        if block.kind == "EVENASPH":
            beyond = [number for number, value in block.parameters.items() if value and number > 8]
            if beyond:
                self.warn(f"{where}: EVENASPH has no parameter {beyond[0]}; it is left out")
            curvature, conic, aspheric = self._even_asphere(block, curvature, conic, where)
        glass, mirror = self._glass(block, before)
        if dummy:
            glass, mirror = _behind(before), False
        mechanical = block.lines.get("MEMA")
        return LensSurface(
            number=block.number,
            curvature=curvature,
            conic=conic,
            aspheric=aspheric,
            thickness=self._thickness(block, before),
            glass=glass,
            mirror=mirror,
            mechanical=abs(self._number(mechanical, 0)) or None if mechanical else None,
            stop="STOP" in block.lines,
            label=" ".join(block.lines["COMM"].values) if "COMM" in block.lines else "",
            **self._apertures(block),
        )

    def _refuse_what_is_moved(self, block: _Block) -> None:
        """Refuse tilts and decentres of the surface and of its aperture."""
        for line in block.tilts:
            if any(self._number(line, k) != 0.0 for k in range(3, len(line.values))):
                raise self.fail(
                    line.place,
                    f"is tilted or decentred ({line.shown}), which is not understood; surfaces "
                    "must stand about one axis",
                )
        line_of = block.lines.get("OBDC")
        if line_of and any(self._number(line_of, k) != 0.0 for k in range(len(line_of.values))):
            raise self.fail(
                line_of.place,
                f"its aperture is decentred ({line_of.shown}), which is not understood; apertures "
                "must stand about the axis",
            )

    def _refuse_break(self, block: _Block, where: str) -> None:
        """Refuse a coordinate break, unless nothing is moved by it."""
        moved = {k: v for k, v in sorted(block.parameters.items()) if 1 <= k <= 5 and v != 0.0}
        if moved:
            shown = ", ".join(f"PARM {k} = {v:g}" for k, v in moved.items())
            raise self.fail(
                where,
                f"is of type COORDBRK, a coordinate break ({shown}), which cannot be traced; "
                "surfaces must stand about one axis: place the bodies of its parts one by one "
                "([lens_files.NAME] with position and rotation)",
            )

    def _pick_parameter(self, block: _Block, line: _Line) -> None:
        """A parameter that follows that of another surface: number, surface, scale, offset."""
        number, source = self._integer(line, 0), self._integer(line, 1)
        if not 0 <= source < len(self.blocks):
            raise self.fail(line.place, f"takes a parameter from surface {source}, which is none")
        column = self._whole(line, 4) or number
        value = self._optional(line, 2, 1.0) * self.blocks[source].parameters.get(column, 0.0)
        value += self._optional(line, 3)
        self._compare(line, block.parameters.get(number, 0.0), value, f"parameter {number}")
        block.parameters[number] = value

    def _compare(self, line: _Line, stored: float, found: float, what: str) -> None:
        """Say where a pickup does not give what is stored beside it."""
        if not math.isclose(stored, found, rel_tol=1e-9, abs_tol=1e-15):
            self.warn(
                f"{line.place}: {what} is stored as {stored:g}, but {line.shown} makes it "
                f"{found:g}, which is taken"
            )

    def _curvature(self, block: _Block, before: list[LensSurface]) -> float:
        line = block.lines.get("CURV")
        if line is None:
            return 0.0
        value, solve = self._number(line, 0), self._whole(line, 1)
        if solve == _CURVATURE_PICKUP:
            source = self._source(line, self._integer(line, 2), before)
            scale = self._optional(line, 3, 1.0)
            found = scale * before[source].curvature
            # Programs scale the radius or the curvature; where that differs, the stored one speaks
            by_radius = before[source].curvature / scale if scale else 0.0
            if abs(scale) != 1.0 and math.isclose(value, by_radius, rel_tol=1e-6):
                return value
            if abs(scale) != 1.0 and not math.isclose(value, found, rel_tol=1e-6):
                raise self.fail(
                    line.place,
                    f"its curvature is picked up ({line.shown}), but the stored {value:g} is "
                    f"neither {found:g} nor {by_radius:g}; fix it in the design program",
                )
            self._compare(line, value, found, "the curvature")
            return found
        if solve > 1:
            self.warn(
                f"{line.place}: the curvature follows from a solve of type {solve}, which is not "
                f"evaluated; the stored {value:g} is taken"
            )
        return value

    def _source(self, line: _Line, index: int, before: list[LensSurface]) -> int:
        """The surface that a pickup takes its value from."""
        if not 0 <= index < len(before):
            raise self.fail(
                line.place,
                f"picks up from surface {index} ({line.shown}), which does not stand before it",
            )
        return index

    def _thickness(self, block: _Block, before: list[LensSurface]) -> float:
        line = block.lines.get("DISZ")
        thickness = self._optional(line, 0)
        if abs(thickness) >= 1e10:
            if before and line is not None:
                raise self.fail(line.place, "its thickness is infinite; only an object's can be")
            return math.inf
        pickup, solve = block.lines.get("PZUP"), block.lines.get("MAZH")
        if pickup is not None:
            source = self._source(pickup, self._integer(pickup, 0), before)
            if self._optional(pickup, 3) != 0.0:
                self.warn(
                    f"{pickup.place}: {pickup.shown} takes the thickness from another column, "
                    f"which is not followed; the stored {thickness:g} is taken"
                )
                return thickness
            found = self._optional(pickup, 1, 1.0) * before[source].thickness
            found += self._optional(pickup, 2)
            self._compare(pickup, thickness, found, "the thickness")
            return found
        if solve is not None:
            self.solves.append(
                ThicknessSolve(
                    surface=len(before),
                    height=self._optional(solve, 0),
                    zone=self._optional(solve, 1),
                )
            )
        return thickness

    def _even_asphere(
        self, block: _Block, curvature: float, conic: float, where: str
    ) -> tuple[float, float, tuple[float, ...]]:
        """Curvature, conic and coefficients of r^4 …; a term in r² belongs to the curvature."""
        square = block.parameters.get(1, 0.0)
        if square != 0.0:
            if curvature != 0.0 and conic != -1.0:
                raise self.fail(
                    where,
                    f"has a term in r² ({square:g}) beside a curvature, which cannot be traced; "
                    "take it into the radius in the design program",
                )
            curvature, conic = curvature + 2.0 * square, -1.0
        terms = [block.parameters.get(k, 0.0) for k in range(2, 9)]
        while terms and terms[-1] == 0.0:
            terms.pop()
        if len(terms) > _MOST_COEFFICIENTS:
            raise self.fail(
                where, f"has a term in r^16 ({terms[-1]:g}); terms up to r^14 can be traced"
            )
        return curvature, conic, tuple(terms)

    def _glass(self, block: _Block, before: list[LensSurface]) -> tuple[GlassName | None, bool]:
        line = block.lines.get("GLAS")
        if line is None or not line.values:
            return None, False
        name = line.values[0]
        if name.upper() == "MIRROR":
            return None, True
        solve = self._whole(line, 1)
        if solve == _PICKED_UP and len(line.values) > 2:
            source = before[self._source(line, self._integer(line, 2), before)]
            return source.glass, source.mirror
        if solve > _SUBSTITUTE:
            raise self.fail(
                line.place,
                f"its glass follows from a solve of type {solve} ({line.shown}), which is not "
                "understood; fix the glass in the design program",
            )
        if name.upper() in ("AIR", "VACUUM"):
            if name.upper() == "VACUUM":
                self.warn(
                    f"{line.place}: VACUUM is taken for air, as which glasses are listed; its "
                    "index is lower by 0.00027"
                )
            return None, False
        values = (self._optional(line, 3), self._optional(line, 4))
        if solve == _MODEL or "___BLANK" in name.upper():
            # Relative to air a vacuum or light gas is a little below 1
            if values[0] < _LEAST_INDEX:
                raise self.fail(
                    line.place,
                    f"a model glass of index {values[0]:g} is not a glass (least {_LEAST_INDEX:g})",
                )
            if self._optional(line, 5) != 0.0:
                self.warn(
                    f"{line.place}: the partial dispersion of its model glass deviates by "
                    f"{self._optional(line, 5):g}, which is not taken; its index follows from nd "
                    "and the Abbe number alone"
                )
            return GlassName(name=name, model=values), False
        return GlassName(name=name, said=None if values in _PLACEHOLDERS else values), False

    def _apertures(self, block: _Block) -> dict[str, Any]:
        """Semi-diameter, hole and obscuration of a surface."""
        for word, called in APERTURES_NOT_ROUND.items():
            if word in block.lines:
                self.warn(
                    f"{block.lines[word].place}: {word}, {called}, is not round and is left out; "
                    "the semi-diameter is taken instead"
                )
        diameter = block.lines.get("DIAM")
        semi = abs(self._optional(diameter, 0))
        if diameter is not None and not math.isfinite(semi):
            raise self.fail(diameter.place, "its semi-diameter is infinite")
        fixed = self._optional(diameter, 1) not in (0.0, 3.0)
        hole, clips = 0.0, False
        for word in ("CLAP", "FLAP"):
            line = block.lines.get(word)
            if line is None:
                continue
            hole, clear = self._number(line, 0), self._number(line, 1)
            hard = word == "CLAP" or fixed
            if clear and (not semi or clear < semi or (hard and clear == semi)):
                semi, fixed = clear, True
            clips |= hard
        blocked = block.lines.get("OBSC")
        if blocked is not None and self._number(blocked, 0) != 0.0:
            self.warn(
                f"{blocked.place}: the obscuration is a ring; it is taken whole, without the "
                f"opening of radius {self._number(blocked, 0):g} in it"
            )
        return {
            "semi_diameter": semi or None,
            "automatic": not fixed,
            "hole": hole,
            "obscuration": self._number(blocked, 1) if blocked is not None else 0.0,
            "clips": clips and fixed,
        }

    # -- the whole -------------------------------------------------------------------------------

    def finish(self) -> Prescription:
        mode = self._word("MODE", "SEQ")
        if mode != "SEQ":
            raise SceneError(
                f"{self.origin}: is not sequential (mode {mode}); save the sequential lens, or "
                "export its parts as STEP"
            )
        if len(self.blocks) < 3:
            raise SceneError(
                f"{self.origin}: is not a Zemax lens file: it has {len(self.blocks)} surfaces "
                "(SURF), at least object, one surface and image are needed"
            )
        surfaces = self.surfaces()
        self._say_what_is_left_out(surfaces)
        if "UNIT" not in self.header:
            self.warn("gives no unit of its lengths (UNIT); mm are taken")
        units = self._word("UNIT", "MM")
        if units not in _UNITS:
            raise self.fail("UNIT", f"there is no unit {units!r}; {', '.join(_UNITS)} are known")
        kind, fields, telecentric = self._fields()
        wavelengths, weights, primary = self._wavelengths()
        return Prescription(
            origin=self.origin,
            title=" ".join(self.header["NAME"].values) if "NAME" in self.header else "",
            unit=_UNITS[units],
            surfaces=tuple(surfaces),
            aperture=self._aperture(),
            field_kind=kind,
            fields=fields,
            telecentric=telecentric,
            wavelengths_nm=wavelengths,
            weights=weights,
            primary=primary,
            catalogues=tuple(self.header["GCAT"].values) if "GCAT" in self.header else (),
            solves=tuple(self.solves),
        )

    def _word(self, word: str, default: str) -> str:
        line = self.header.get(word)
        return line.values[0].upper() if line and line.values else default

    def _say_what_is_left_out(self, surfaces: list[LensSurface]) -> None:
        for word, places in self.unknown.items():
            more = f" and {len(places) - 1} more" if len(places) > 1 else ""
            self.warn(
                f"{places[0]}{more}: the word {word} is not understood and is left out; check what "
                "it says in the design program"
            )
        if self.coatings:
            numbers = ", ".join(str(number) for number in self.coatings)
            self.warn(f"surfaces {numbers}: coatings (COAT) are not taken; the faces are bare")
        configurations = self.header.get("MNUM")
        count = self._integer(configurations, 0) if configurations else 1
        if count > 1 or self.configured:
            active = self._whole(configurations, 1, 1.0)
            self.warn(
                f"has {count if count > 1 else 'several'} configurations; configuration {active}, "
                "which was active when it was saved, is read"
            )
        self._say_of_air()
        if self._optional(self.header.get("GFAC"), 0) != 0.0:
            self.warn("the pupil is apodised (GFAC); the sources fill it evenly")
        if self._optional(self.header.get("FTYP"), 6) != 0.0:
            self.warn(
                "its image space is afocal (FTYP); the detector stands at the last surface, and "
                "measures places, not angles"
            )
        if surfaces[0].curvature and math.isfinite(surfaces[0].thickness):
            self.warn("surface 0: the object is curved; its points are put in a plane")
        if sum(surface.stop for surface in surfaces) != 1:
            marked = [str(surface.number) for surface in surfaces if surface.stop]
            which = f"surfaces {', '.join(marked)} are marked" if marked else "no surface is marked"
            taken = marked[0] if marked else "1"
            self.warn(f"{which} as the stop (STOP); surface {taken} is taken")

    def _say_of_air(self) -> None:
        line = self.header.get("ENVD")
        if line is None or self._optional(line, 2) == 0.0:
            return
        celsius, pressure = self._optional(line, 0, _NORMAL_C), self._optional(line, 1, _NORMAL_ATM)
        if (celsius, pressure) != (_NORMAL_C, _NORMAL_ATM):
            self.warn(
                f"{line.place}: is for {celsius:g} °C and {pressure:g} atm (ENVD); indices are "
                "taken at 20 °C in air of 1 atm, lengths as they are stored"
            )

    def _aperture(self) -> Aperture:
        said = [word for word in _APERTURES if word in self.header]
        if len(said) > 1:
            self.warn(f"says its aperture twice ({', '.join(said)}); {said[0]} is taken")
        if "ENPD" in self.header:
            return Aperture(kind="entrance_diameter", value=self._number(self.header["ENPD"], 0))
        if "FNUM" in self.header:
            line = self.header["FNUM"]
            return Aperture(
                kind="working_f_number" if self._second_kind(line) else "f_number",
                value=self._number(line, 0),
            )
        if "OBNA" in self.header:
            line = self.header["OBNA"]
            value = self._number(line, 0)
            if self._second_kind(line):
                value = math.sin(math.radians(value))
            return Aperture(kind="object_na", value=value)
        if "FLOA" not in self.header:
            self.warn(
                f"says nothing of its aperture ({', '.join(_APERTURES)}); the semi-diameter of the "
                "stop is taken"
            )
        return Aperture(kind="stop")

    def _second_kind(self, line: _Line) -> bool:
        """Whether an aperture is of the second of its two kinds."""
        kind = self._whole(line, 1)
        if kind not in (0, 1):
            raise self.fail(line.place, f"{line.word} of kind {kind} is not understood")
        return kind == 1

    def _fields(self) -> tuple[FieldKind, tuple[FieldPoint, ...], bool]:
        line = self.header.get("FTYP")
        number = self._whole(line, 0)
        if not 0 <= number < len(_FIELDS):
            raise self.fail(
                "FTYP", f"fields of type {number} are not understood; use angles or heights"
            )
        listed = max(
            len(self.header[word].values) if word in self.header else 0
            for word in ("XFLN", "YFLN", "XFLD", "YFLD")
        )
        count = self._whole(line, 2, float(max(listed, 1)))
        if not 1 <= count <= max(listed, 1):
            self.warn(
                f"has {count} fields (FTYP), but lists {listed}; "
                f"{min(max(count, 1), max(listed, 1))} are read"
            )
            count = min(max(count, 1), max(listed, 1))
        x, y = self._column(("XFLN", "XFLD"), count), self._column(("YFLN", "YFLD"), count)
        weights = self._column(("FWGN", "FWGT"), count, 1.0)
        if min(weights) < 0.0:
            raise self.fail("FWGN", f"the weight {min(weights):g} of a field is negative")
        vdx, vdy = self._column(("VDXN", "ZVDX"), count), self._column(("VDYN", "ZVDY"), count)
        vcx, vcy = self._column(("VCXN", "ZVCX"), count), self._column(("VCYN", "ZVCY"), count)
        turns = self._column(("VANN", "ZVAN"), count)
        # p' = VD + p (1 - VC) reaches from VD - (1 - VC) to VD + (1 - VC), and is turned by VAN
        fields = tuple(
            FieldPoint(
                x=x[k],
                y=y[k],
                weight=weights[k],
                vignetting=(vcx[k] - vdx[k], vcx[k] + vdx[k], vcy[k] - vdy[k], vcy[k] + vdy[k]),
                turn_deg=turns[k],
            )
            for k in range(count)
        )
        return _FIELDS[number], fields, self._optional(line, 1) == 1.0

    def _wavelengths(self) -> tuple[tuple[float, ...], tuple[float, ...], int]:
        """Wavelengths [nm], their weights, and which is the primary one."""
        if self.wavelengths:
            numbers = sorted(self.wavelengths)
            types = self.header.get("FTYP")
            if types is not None and len(types.values) > 3:
                count = self._integer(types, 3)
                if count > numbers[-1]:
                    self.warn(
                        f"has {count} wavelengths (FTYP), but lists {len(numbers)} (WAVM); "
                        f"{len(numbers)} are read"
                    )
                numbers = [number for number in numbers if number <= count] or numbers[:1]
            pairs = [self.wavelengths[number] for number in numbers]
        else:
            line = self.header.get("WAVL") or self.header.get("WAVN")
            weights = self.header.get("WWGT") or self.header.get("WWGN")
            if line is None:
                self.warn("gives no wavelengths; 587.5618 nm is taken")
                line = _Line("WAVL", ["0.5875618"], "WAVL")
            pairs = [
                (self._number(line, k), self._optional(weights, k, 1.0))
                for k in range(len(line.values))
            ]
        if min(pair[0] for pair in pairs) <= 0.0:
            raise self.fail("WAVM", "a wavelength must be positive")
        primary = self._whole(self.header.get("PWAV"), 0, 1.0) - 1
        if not 0 <= primary < len(pairs):
            taken = min(max(primary, 0), len(pairs) - 1)
            self.warn(
                f"its primary wavelength is number {primary + 1} of {len(pairs)} (PWAV); number "
                f"{taken + 1} is taken"
            )
            primary = taken
        return (
            tuple(round(1000.0 * wavelength, 9) for wavelength, _ in pairs),
            tuple(weight for _, weight in pairs),
            primary,
        )


def _behind(before: list[LensSurface]) -> GlassName | None:
    """The glass behind the last surface: that before it, where it is a mirror."""
    return next((surface.glass for surface in reversed(before) if not surface.mirror), None)


def _is_row(values: list[str]) -> bool:
    """Whether values are those of a row of the merit function or of the configurations."""
    numbers = sum(bool(re.fullmatch(r"[-+.\deE]+", value)) for value in values)
    return numbers >= _MERIT_VALUES


KINDS = (
    LensFormat(
        suffixes=(".zmx",),
        title="lenses of Zemax OpticStudio, sequential",
        place=10,
        sniff=lambda head: b"\nSURF 0" in head.replace(b"\0", b"").replace(b"\r", b""),
        read=read_zemax,
    ),
)

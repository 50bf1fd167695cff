"""Read sequential lens files of CODE V (``.seq``).

A file is a list of commands, split by line ends and semicolons; ``&`` goes on with the next line
and ``!`` begins a comment. ``S radius thickness glass`` starts a surface, the commands after it say
more about it; ``THI S2 5`` speaks about a surface by its number, wherever it stands. A command is
read, or known to be harmless (`codev_words`), or else warned about or refused by
name: none is passed over, and no word of one that is read (`codev_command`).
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from raymap.model.errors import SceneError
from raymap.model.textfile import plain_number, split_lines
from tracer.importers.lens_format import LensFormat
from tracer.importers.lens_formats.codev_command import KINDS_OF_APERTURES, QUALIFIER, Command
from tracer.importers.lens_formats.codev_words import (
    ALONE,
    APERTURES_NOT_ROUND,
    HARMLESS,
    MOVED,
    NOT_TAKEN,
    TYPES,
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

__all__ = ["parse_codev", "read_codev"]

_UNITS: dict[str, Literal["mm", "cm", "m", "in"]] = {
    "M": "mm", "MM": "mm", "C": "cm", "CM": "cm", "I": "in", "IN": "in",
}  # fmt: skip
_FIELDS: dict[str, FieldKind] = {
    "AN": "angle",
    "OB": "object_height",
    "IM": "paraxial_image_height",
    "RI": "real_image_height",
}
_LISTS = {
    "WL", "WTW", "WTF", "REF", "VUX", "VLX", "VUY", "VLY",
    *(f"{axis}{letters}" for axis in "XY" for letters in _FIELDS),
}  # fmt: skip
_COEFFICIENTS = "ABCDEFGHJ"
_MOST_COEFFICIENTS = 6
_SURFACE = re.compile(r"S(O|I|\d+)?", re.IGNORECASE)
_NORMAL = {"TEM": (20.0, "°C"), "PRE": (760.0, "mm of mercury")}
_LAURENT_GRID_NM = tuple(range(350, 1101, 25))


def read_codev(path: str | Path) -> Prescription:
    """The lens of a ``.seq`` file, whatever its encoding.

    Raises
    ------
    SceneError
        where the file is none, or says what cannot be traced
    """
    return parse_codev(read_text(path), origin=Path(path).name)


def parse_codev(text: str, *, origin: str = "lens") -> Prescription:
    """As `read_codev`, from the text of a file."""
    reader = _Reader(origin)
    for line, command in _commands(text):
        reader.take(command, line)
    return reader.finish()


def _commands(text: str) -> Iterator[tuple[int, list[str]]]:
    """The line and the words of each command; quotes keep a word together and are kept."""
    words: list[str] = []
    began = 1
    for number, line in enumerate(split_lines(text), 1):
        goes_on = False
        for word in re.findall(r"L?'[^']*'|L?\"[^\"]*\"|!.*|;|&|[^\s;!'\"&]+|['\"]", line):
            if word.startswith("!"):
                break
            goes_on = word == "&"
            if word == ";":
                if words:
                    yield began, words
                words = []
            elif word != "&":
                began = began if words else number
                words.append(word)
        if words and not goes_on:
            yield began, words
            words = []
    if words:
        yield began, words


@dataclass
class _Draft:
    """A surface while its commands come in; ``shape`` is a radius or a curvature."""

    shape: float
    thickness: float
    glass: str = ""
    curvature: float | None = None
    mirror: bool = False
    conic: float = 0.0
    terms: dict[int, float] = field(default_factory=dict)
    clear: float = 0.0
    edge: float = 0.0
    hole: float = 0.0
    obscuration: float = 0.0
    stop: bool = False
    label: str = ""


class _Reader:
    def __init__(self, origin: str) -> None:
        self.origin = origin
        self.drafts: list[_Draft] = []
        self.ended = False
        self.radius_mode = True
        self.mode_said = False
        self.private: dict[str, list[str]] = {}
        self.in_private = False
        self.private_nm: list[float] = []
        self.lists: dict[str, list[float]] = {}
        self.title = ""
        self.unit: Literal["mm", "cm", "m", "in"] | None = None
        self.aperture = Aperture(kind="stop")
        self.positions = 1
        self.line = 1
        self.spoken_of: int | None = None
        self.solves: list[ThicknessSolve] = []
        self.pickups: list[tuple[str, list[str]]] = []
        self.unknown: dict[str, list[str]] = {}
        self.not_taken: dict[str, str] = {}

    def fail(self, where: str, message: str) -> SceneError:
        return SceneError(f"{self.origin}: {where}: {message}")

    def warn(self, message: str) -> None:
        warnings.warn(f"{self.origin}: {message}", ImportWarning, stacklevel=2)

    @property
    def place(self) -> str:
        if self.spoken_of is None:
            return f"line {self.line}, head"
        return f"line {self.line}, surface {self.spoken_of}"

    def number(self, words: list[str], index: int) -> float:
        """A number of a command."""
        shown = words[index] if index < len(words) else "nothing"
        value = plain_number(shown)
        if value is None:
            raise self.fail(self.place, f"{shown!r} stands where {words[0]} expects a number")
        if math.isnan(value):
            raise self.fail(self.place, f"{words[0]} is not a number")
        endless = words[0].upper()[:3] in ("THI", "RDY") or _SURFACE.fullmatch(words[0])
        if math.isinf(value) and not endless:
            raise self.fail(self.place, f"{shown!r} stands where {words[0]} expects a finite one")
        return value

    def value(self, command: Command) -> float:
        """The next word of a command, a number."""
        return self.number([command.word, command.take() or "nothing"], 1)

    # -- commands --------------------------------------------------------------------------------

    def take(self, words: list[str], line: int) -> None:
        """One command."""
        self.line = line
        self.spoken_of = len(self.drafts) - 1 if self.drafts else None
        name = words[0].upper()
        command = Command(words)
        if self.in_private:
            self._private(name[:3], command)
        elif name.startswith("ZOO"):
            self._zoom(command.take_all())
        elif _SURFACE.fullmatch(name):
            self._surface(name, command.take_all())
        elif name[:3] == "STO" and len(words) > 2 and plain_number(words[1]) is not None:
            self._surface("S", command.take_all())
            self.drafts[-1].stop = True
        else:
            self._command(name[:3], command)
        self._say_what_is_left_over(command)

    def _say_what_is_left_over(self, command: Command) -> None:
        """Words that nobody took: refused where they say which value is meant, else warned of."""
        for word in command.rest:
            if QUALIFIER.fullmatch(word) or word.upper() in KINDS_OF_APERTURES:
                raise self.fail(
                    self.place,
                    f"{word} stands where {command.shown} does not expect it; write it right "
                    f"behind {command.word}, if it belongs to it",
                )
            self.warn(f"{self.place}: {word} in {command.shown} is not understood and is left out")

    def _command(self, name: str, command: Command) -> None:
        if name in _HEAD:
            if self._is_of_first_position(command):
                _HEAD[name](self, command)
        elif name in _LISTS:
            which = "" if name == "REF" else "W" if name in ("WL", "WTW") else "F"
            if self._is_of_first_position(command, f"{which}Z"):
                self._list(name, command)
        elif name in ("SLB", "SLA") or name in ALONE:
            self._of_surfaces(name, command)
        elif name in HARMLESS:
            command.take_all()
        elif name == "PIK":
            self.pickups.append((self.place, command.take_all()))
        else:
            self._of_surfaces(name, command)

    def _is_of_first_position(self, command: Command, qualifiers: str = "Z") -> bool:
        """Take the qualifiers before the value; whether it belongs to the position that is read."""
        command.take_qualifiers(qualifiers)
        position = command.qualifiers.get("Z", "Z1")
        if position.upper() == "Z1":
            return True
        if self.positions < 2:
            self.unknown.setdefault(command.shown, []).append(self.place)
        command.take_all()  # the warning of the zoom positions speaks of the others
        return False

    def _of_surfaces(self, name: str, command: Command) -> None:
        """A command once for each surface that it speaks of."""
        if name in ("CIR", *APERTURES_NOT_ROUND):
            command.takes_kinds = True
        if not self._is_of_first_position(command, "SZ"):
            return
        word = command.qualifiers.get("S")
        match = QUALIFIER.fullmatch(word) if word else None
        if word is None or match is None:
            self._detail(name, command)
            return
        values = list(command.rest)
        for index in self._range(match, word):
            self.spoken_of, command.rest = index, list(values)
            self._detail(name, command)

    def _range(self, match: re.Match[str], word: str) -> range:
        ends = [match[2].upper()]
        if match[3]:
            ends.append(match[3][2:].upper().removeprefix("S"))
        if ends == ["A"]:
            return range(1, len(self.drafts) - self.ended)
        numbers = [self._index(end, word) for end in ends]
        return range(numbers[0], numbers[-1] + 1)

    def _index(self, end: str, word: str) -> int:
        if end == "O":
            return 0
        if end == "I" and self.ended:
            return len(self.drafts) - 1
        if end.isdigit() and int(end) < len(self.drafts):
            return int(end)
        raise self.fail(
            f"line {self.line}", f"speaks of surface {word}, which does not stand before it"
        )

    # -- the head --------------------------------------------------------------------------------

    def _mode(self, command: Command) -> None:
        answer = command.rest[0].upper()[:1] if command.rest else "Y"
        if answer in "YN" and command.rest:
            command.take()
        mode = answer != "N"
        curved = any(draft.shape for draft in self.drafts)
        if curved and (not self.mode_said or mode != self.radius_mode):
            raise self.fail(
                self.place,
                f"{command.shown} stands behind surfaces, whose numbers it does not mean; put it "
                "before them, and write all as radii or all as curvatures",
            )
        self.mode_said, self.radius_mode = True, mode

    def _title(self, command: Command) -> None:
        self.title = " ".join(command.take_all(shown=False)[1:]).strip("'\"")

    def _unit(self, command: Command) -> None:
        word = command.take().upper()
        if word not in _UNITS:
            raise self.fail("DIM", "the unit must be M (mm), C (cm) or I (inches)")
        self.unit = _UNITS[word]

    def _light(self, command: Command) -> None:
        name, value = command.word.upper()[:3], self.value(command)
        if name == "NA":
            self.aperture = Aperture(kind="working_f_number", value=0.5 / value if value else 0.0)
            return
        # Its f-number is that at the conjugates in use, 1 / (2 NA)
        kinds: dict[str, Literal["entrance_diameter", "working_f_number", "object_na"]] = {
            "EPD": "entrance_diameter", "FNO": "working_f_number", "NAO": "object_na",
        }  # fmt: skip
        self.aperture = Aperture(kind=kinds[name], value=value)

    def _air(self, command: Command) -> None:
        name, value = command.word.upper()[:3], self.value(command)
        normal, unit = _NORMAL[name]
        if value != normal:
            self.warn(
                f"line {self.line}: is for {value:g} {unit} ({name}); indices are taken at 20 °C "
                "in air of 1 atm, lengths as they are stored"
            )

    def _zoom(self, words: list[str]) -> None:
        """``ZOO n``, or a command with a value for each of the n positions."""
        count = plain_number(words[1]) if len(words) > 1 else None
        if len(words) == 2 and count is not None and count.is_integer() and count >= 1.0:
            self.positions = int(count)
            if self.positions > 1:
                self.warn(
                    f"line {self.line}: is a zoom lens of {self.positions} positions (ZOO); the "
                    "first is read"
                )
            return
        if self.positions < 2 or len(words) < 2 + self.positions:
            raise self.fail(
                self.place,
                f"{' '.join(words)} does not give a value for each of {self.positions} positions",
            )
        for word in words[-self.positions :]:
            if QUALIFIER.fullmatch(word) and not words[1].upper().startswith("GLA"):
                raise self.fail(self.place, f"{word} stands among the values of {' '.join(words)}")
        self.take([*words[1 : -self.positions], words[-self.positions]], self.line)

    def _list(self, name: str, command: Command) -> None:
        """Values of all fields or wavelengths, or of the one that a qualifier names."""
        word = command.qualifiers.get("F") or command.qualifiers.get("W")
        match = QUALIFIER.fullmatch(word) if word else None
        if match is None and name == "REF":
            self.lists[name] = [self.value(command)]
            return
        if match is None:
            words = command.take_all(shown=False)
            self.lists[name] = [self.number(words, k) for k in range(1, len(words))]
            return
        if match[3] or not match[2].isdigit() or match[2] == "0":
            raise self.fail(self.place, f"{word} is not understood after {name}")
        values, index = self.lists.setdefault(name, []), int(match[2])
        if index > 1000:
            raise self.fail(self.place, f"there is no {word}")
        values.extend([1.0 if name.startswith("WT") else 0.0] * (index - len(values)))
        values[index - 1] = self.value(command)

    def _begin_private(self, command: Command) -> None:
        self.in_private = True

    def _private(self, name: str, command: Command) -> None:
        """A line between PRV and END: wavelengths, or a glass; it is read when it is used."""
        if name == "END":
            self.in_private = False
            return
        words = command.take_all()
        if name == "PWL":
            self.private_nm = [self.number(words, k) for k in range(1, len(words))]
        elif words[0][0] in "'\"" or len(words) > 1:
            self.private[words[0].strip("'\"").upper()] = words
        else:
            self.unknown.setdefault(f"{words[0]} (between PRV and END)", []).append(
                f"line {self.line}"
            )

    # -- surfaces --------------------------------------------------------------------------------

    def _surface(self, name: str, words: list[str]) -> None:
        """``S``, ``SO``, ``SI`` or ``S3`` with radius, thickness, glass."""
        if len(words) > 4:
            raise self.fail(
                f"line {self.line}",
                f"{' '.join(words)!r} has more than a radius, a thickness and a glass",
            )
        if name[1:].isdigit() and int(name[1:]) < len(self.drafts):
            self._changed(int(name[1:]), words)
            return
        if name[1:].isdigit() and int(name[1:]) != max(len(self.drafts), 1):
            raise self.fail(
                f"line {self.line}",
                f"{name} stands where S{max(len(self.drafts), 1)} is expected; surfaces must be "
                "numbered in their order",
            )
        if name == "SI" and self.ended:
            self._changed(len(self.drafts) - 1, words)
            return
        if self.ended:
            raise self.fail(f"line {self.line}, {name}", "stands after the image surface SI")
        if name == "SO" and self.drafts:
            raise self.fail(f"line {self.line}, SO", "stands after a surface; begin with it")
        if not self.drafts and name != "SO":
            self.drafts.append(_Draft(0.0, math.inf))
        self.spoken_of = len(self.drafts)
        shape = self.number(words, 1) if len(words) > 1 else 0.0
        thickness = self.number(words, 2) if len(words) > 2 else 0.0
        self.drafts.append(_Draft(shape, thickness, words[3] if len(words) > 3 else ""))
        self.ended = name == "SI"

    def _changed(self, index: int, words: list[str]) -> None:
        """New values for a surface that stands already."""
        self.spoken_of, draft = index, self.drafts[index]
        if len(words) > 1:
            draft.shape, draft.curvature = self.number(words, 1), None
        if len(words) > 2:
            draft.thickness = self.number(words, 2)
        if len(words) > 3:
            draft.glass = words[3]

    def _detail(self, name: str, command: Command) -> None:
        """What a command says about a surface."""
        if name in NOT_TAKEN:
            self.not_taken.setdefault(f"{name}: {NOT_TAKEN[name]}", self.place)
            command.take_all()
        elif name in MOVED:
            if any(self.value(command) != 0.0 for _ in range(len(command.rest))):
                raise self.fail(
                    self.place,
                    f"is shifted or tilted ({command.plain}), which is not understood; surfaces "
                    "and apertures must stand about one axis",
                )
        elif name in TYPES:
            raise self.fail(
                self.place,
                f"is {TYPES[name]} ({name}), which cannot be traced; spheres, conics and even "
                "aspheres are understood: replace it in the design program",
            )
        elif name in APERTURES_NOT_ROUND:
            command.take()
            self.warn(
                f"{self.place}: its aperture {name} is {APERTURES_NOT_ROUND[name]}, not round, and "
                "is left out; the semi-diameter is taken instead"
            )
        elif name in ("SLB", "SLA"):
            quoted = command.rest and command.rest[0][0] in "'\""
            words = [command.take()] if quoted else command.take_all(shown=False)[1:]
            label = " ".join(words).strip("'\"")
            if self.spoken_of is not None and label:
                self.drafts[self.spoken_of].label = label
        elif name in _OF_SURFACE or (len(name) == 1 and name in _COEFFICIENTS):
            if self.spoken_of is None:
                raise self.fail(self.place, f"{name} belongs to a surface, but none stands here")
            self._set(name, command, self.drafts[self.spoken_of])
        elif name not in ALONE:
            self.unknown.setdefault(name, []).append(self.place)
            command.take_all()

    def _set(self, name: str, command: Command, draft: _Draft) -> None:
        if name in _COEFFICIENTS:
            draft.terms[_COEFFICIENTS.index(name)] = self.value(command)
        elif name == "STO":
            for other in self.drafts:
                other.stop = False
            draft.stop = True
        elif name == "K":
            draft.conic = self.value(command)
        elif name in ("SPH", "CON"):
            # A surface of that type has no coefficients, a sphere no conic
            draft.terms.clear()
            draft.conic = draft.conic if name == "CON" else 0.0
        elif name == "CUF":
            if self.value(command) != 0.0:
                raise self.fail(
                    self.place, "is a Fresnel surface on a curve (CUF), which cannot be traced"
                )
        elif name == "CIR":
            self._circle(command, draft)
        elif name == "GLA":
            draft.glass = command.take()
            if not draft.glass:
                raise self.fail(self.place, f"{command.shown} names no glass; AIR stands for none")
        elif name == "RMD":
            self._refract_mode(command, draft)
        elif name == "PIM":
            answer = command.rest[0].upper()[:1] if command.rest else "Y"
            if answer in "YN" and command.rest:
                command.take()
            if answer != "N":
                self.solves.append(ThicknessSolve(surface=self.spoken_of or 0))
        elif command.rest and plain_number(command.rest[0]) is None:
            self._solve(name, command)
        elif name == "THI":
            draft.thickness = self.value(command)
        elif name == "RDY":
            radius = self.value(command)
            draft.curvature = 1.0 / radius if radius else 0.0
        else:
            draft.curvature = self.value(command)

    def _refract_mode(self, command: Command, draft: _Draft) -> None:
        mode = command.take().upper()[:4]
        if mode not in ("REFL", "REFR"):
            raise self.fail(
                self.place, f"{command.plain} is not understood; it may reflect or refract"
            )
        draft.mirror = mode == "REFL"

    def _solve(self, name: str, command: Command) -> None:
        """A thickness or curvature that follows from a ray: heights of the marginal ray count."""
        if name == "THI" and command.rest[0].upper() in ("HMY", "PIM"):
            command.take()
            height = self.value(command) if command.rest else 0.0
            self.solves.append(ThicknessSolve(surface=self.spoken_of or 0, height=height))
            return
        self.warn(
            f"{self.place}: the solve {command.plain} is not evaluated; the stored value is taken"
        )
        command.take_all()

    def _circle(self, command: Command, draft: _Draft) -> None:
        if len(command.kinds) > 1 or (command.rest and plain_number(command.rest[0]) is None):
            raise self.fail(self.place, f"{command.shown} is not understood")
        radius, kind = abs(self.value(command)), (command.kinds or ["CLR"])[0]
        if kind == "HOL":
            draft.hole = radius
        elif kind == "OBS":
            draft.obscuration = radius
        elif kind == "EDG":
            draft.edge = radius
        else:
            draft.clear = radius

    def _glass(self, written: str, where: str) -> tuple[GlassName | None, bool]:
        name = written.strip("'\"")
        if not name or name.upper() == "AIR":
            return None, False
        if name.upper() in ("REFL", "REF"):
            return None, True
        if name.upper() in self.private:
            return GlassName(name=name, table=self._private_table(name, where)), False
        code = re.fullmatch(r"(\d{3,9})[.:](\d{3,9})", name)
        if code:
            index = 1.0 + float(f"0.{code[1]}")
            return GlassName(name=name, model=(index, float(f"{code[2][:2]}.{code[2][2:]}"))), False
        pair = re.fullmatch(r"(\d\.\d+):(\d+\.?\d*)", name)
        if pair:
            return GlassName(name=name, model=(float(pair[1]), float(pair[2]))), False
        stem, _, maker = name.partition("_")
        return GlassName(name=stem, maker=maker), False

    def _private_table(self, name: str, where: str) -> tuple[tuple[float, float], ...]:
        """Index of a private glass at wavelengths [nm]: as listed, or by a Laurent series."""
        words = self.private[name.upper()]
        if len(words) > 1 and words[1].upper() == "LAU":
            terms = [self.number(words, k) for k in range(2, len(words))]
            wavelengths = sorted({*_LAURENT_GRID_NM, *self.lists.get("WL", [])})
            return tuple((nm, _laurent(terms, 1e-3 * nm, where, self)) for nm in wavelengths)
        if len(words) > 1 and plain_number(words[1]) is None:
            raise self.fail(
                where,
                f"its private glass {name} has the formula {words[1]}, which is not understood; "
                "indices at the wavelengths PWL, or LAU, are",
            )
        values = [self.number(words, k) for k in range(1, len(words))]
        if len(values) != len(self.private_nm):
            raise self.fail("PRV", f"glass {words[0]} needs an index for each PWL wavelength")
        return tuple(zip(self.private_nm, values, strict=True))

    def _curvature(self, draft: _Draft) -> float:
        if draft.curvature is not None:
            return draft.curvature
        if self.radius_mode:
            return 1.0 / draft.shape if draft.shape else 0.0
        return draft.shape

    def _built(self, number: int, draft: _Draft) -> LensSurface:
        where = f"surface {number}"
        glass, mirror = self._glass(draft.glass, where)
        terms = [draft.terms.get(k, 0.0) for k in range(len(_COEFFICIENTS))]
        while terms and terms[-1] == 0.0:
            terms.pop()
        if len(terms) > _MOST_COEFFICIENTS:
            letter = _COEFFICIENTS[len(terms) - 1]
            raise self.fail(
                where, f"has the coefficient {letter}; A to F (up to r^14) can be traced"
            )
        return LensSurface(
            number=number,
            curvature=self._curvature(draft),
            conic=draft.conic,
            aspheric=tuple(terms),
            thickness=math.inf if abs(draft.thickness) >= 1e10 else draft.thickness,
            glass=glass,
            mirror=mirror or draft.mirror,
            semi_diameter=draft.clear or None,
            automatic=not draft.clear,
            mechanical=draft.edge or None,
            hole=draft.hole,
            obscuration=draft.obscuration,
            clips=bool(draft.clear),
            stop=draft.stop,
            label=draft.label,
        )

    # -- the whole -------------------------------------------------------------------------------

    def finish(self) -> Prescription:
        if len(self.drafts) < 3 or not self.ended:
            raise SceneError(
                f"{self.origin}: is not a CODE V lens file: it needs an object SO, surfaces S and "
                "an image SI"
            )
        if not self.mode_said:
            self._choose_mode()
        self._pick_up()
        self._say_what_is_left_out()
        wavelengths = self.lists.get("WL", [])
        if not wavelengths:
            self.warn("gives no wavelengths (WL); 587.5618 nm is taken")
            wavelengths = [587.5618]
        weights = self.lists.get("WTW") or []
        weights = [weights[k] if k < len(weights) else 1.0 for k in range(len(wavelengths))]
        if min(wavelengths) <= 0.0:
            raise self.fail("WL", "a wavelength must be positive")
        reference = (self.lists.get("REF") or [1 + len(wavelengths) // 2])[0]
        if not 1 <= reference <= len(wavelengths):
            raise self.fail("REF", f"there is no wavelength {reference:g}")
        defocus = self.drafts[-1].thickness
        self.drafts[-1].thickness = 0.0
        self.drafts[-2].thickness += defocus
        kind, fields = self._fields()
        return Prescription(
            origin=self.origin,
            title=self.title,
            unit=self.unit or "mm",
            surfaces=tuple(self._built(k, draft) for k, draft in enumerate(self.drafts)),
            aperture=self.aperture,
            field_kind=kind,
            fields=fields,
            wavelengths_nm=tuple(wavelengths),
            weights=tuple(weights),
            primary=int(reference) - 1,
            solves=tuple(self._placed(solve, defocus) for solve in self.solves),
        )

    def _placed(self, solve: ThicknessSolve, defocus: float) -> ThicknessSolve:
        last = solve.surface == len(self.drafts) - 2
        return ThicknessSolve(
            surface=solve.surface,
            height=solve.height,
            zone=solve.zone,
            offset=defocus if last else 0.0,
        )

    def _choose_mode(self) -> None:
        """Without RDM numbers are curvatures, as the program has it, if they can be such."""
        sizes = [abs(draft.shape) for draft in self.drafts if draft.shape]
        if sizes and min(sizes) < 1.0 <= max(sizes):
            raise self.fail(
                "RDM",
                "the file does not say whether its surfaces have radii (RDM) or curvatures "
                "(RDM N), and its numbers could be either; add the line",
            )
        self.radius_mode = bool(sizes) and min(sizes) >= 1.0
        self.warn(
            "does not say whether its surfaces have radii (RDM) or curvatures (RDM N); they are "
            f"read as {'radii' if self.radius_mode else 'curvatures'}"
        )

    def _pick_up(self) -> None:
        """Follow ``PIK value surface value surface scale offset``."""
        for where, words in self.pickups:
            said = f"{where}: {' '.join(words)}"
            plain = [word.upper() for word in words[1:] if word.upper() != "Z1"]
            match = re.fullmatch(
                r"(THI|RDY|CUY|GLA|K) S(O|I|\d+) (THI|RDY|CUY|GLA|K) S(O|I|\d+)((?: \S+){0,2})",
                " ".join(plain),
            )
            numbers = [plain_number(word) for word in match[5].split()] if match else []
            if match is None or match[1] != match[3] or None in numbers:
                self.warn(f"{said} is not followed; the stored value is taken")
                continue
            target, source = (self.drafts[self._index(match[k], said)] for k in (2, 4))
            scale, offset, *_ = (
                *(number or 0.0 for number in numbers),
                *(1.0, 0.0)[len(numbers) :],
            )
            self._follow(match[1], target, source, (scale, offset), said)

    def _follow(
        self, name: str, target: _Draft, source: _Draft, law: tuple[float, float], said: str
    ) -> None:
        """Give one surface the value of another one, times a scale, plus an offset."""
        if name == "GLA":
            if target.glass.upper() != source.glass.upper():
                self.warn(f"{said} makes {source.glass!r} of {target.glass!r}, and is followed")
            target.glass, target.mirror = source.glass, source.mirror
            return
        scale, offset = law
        if name == "THI":
            stored, found = target.thickness, scale * source.thickness + offset
            target.thickness = found
        elif name == "K":
            stored, found = target.conic, scale * source.conic + offset
            target.conic = found
        else:
            stored, value = self._curvature(target), self._curvature(source)
            if name == "RDY":
                radius = scale / value + offset if value else 0.0
                found = 1.0 / radius if radius else 0.0
            else:
                found = scale * value + offset
            target.curvature = found
        if not math.isclose(stored, found, rel_tol=1e-9, abs_tol=1e-15):
            self.warn(f"{said} makes {found:g} of the stored {stored:g}, and is followed")

    def _say_what_is_left_out(self) -> None:
        if self.unit is None:
            self.warn("gives no unit of its lengths (DIM); mm are taken")
        self._say_of_long_lists()
        for word, places in self.unknown.items():
            more = f" and {len(places) - 1} more" if len(places) > 1 else ""
            self.warn(
                f"{places[0]}{more}: the command {word} is not understood and is left out; check "
                "what it says in the design program"
            )
        for message, where in self.not_taken.items():
            self.warn(f"{where}: {message}")
        first = self.drafts[0]
        if self._curvature(first) and math.isfinite(first.thickness) and first.thickness < 1e10:
            self.warn("surface 0: the object is curved; its points are put in a plane")
        if not any(draft.stop for draft in self.drafts):
            self.warn("no surface is marked as the stop (STO); surface 1 is taken")

    def _say_of_long_lists(self) -> None:
        """Values for fields or wavelengths that are none."""
        fields = max((len(self.lists.get(f"{a}{k}", [])) for a in "XY" for k in _FIELDS), default=0)
        for name in ("WTF", "VUX", "VLX", "VUY", "VLY", "WTW"):
            count = max(len(self.lists.get("WL", [])) if name == "WTW" else fields, 1)
            values = self.lists.get(name, [])
            if len(values) > count:
                what = "wavelengths" if name == "WTW" else "fields"
                self.warn(f"{name} has {len(values)} values for {count} {what}; {count} are taken")
            if name.startswith("WT") and min(values, default=0.0) < 0.0:
                raise self.fail(name, f"the weight {min(values):g} is negative")

    def _fields(self) -> tuple[FieldKind, tuple[FieldPoint, ...]]:
        said = {
            letters
            for letters in _FIELDS
            if f"X{letters}" in self.lists or f"Y{letters}" in self.lists
        }
        if len(said) > 1:
            raise self.fail("fields", f"are given in several ways ({', '.join(sorted(said))})")
        for letters, kind in _FIELDS.items():
            x, y = self.lists.get(f"X{letters}", []), self.lists.get(f"Y{letters}", [])
            count = max(len(x), len(y))
            if not count:
                continue
            names = ("VUX", "VLX", "VUY", "VLY")
            return kind, tuple(
                FieldPoint(
                    x=_item(x, k, 0.0),
                    y=_item(y, k, 0.0),
                    weight=_item(self.lists.get("WTF", []), k, 1.0),
                    vignetting=tuple(  # type: ignore[arg-type]
                        _item(self.lists.get(name, []), k, 0.0) for name in names
                    ),
                )
                for k in range(count)
            )
        return "angle", (FieldPoint(x=0.0, y=0.0),)


def _laurent(terms: list[float], micrometre: float, where: str, reader: _Reader) -> float:
    """Index from n² = A0 + A1 λ² + A2 λ⁻² + A3 λ⁻⁴ + …, λ in µm."""
    powers = (0, 2, *range(-2, -2 * len(terms), -2))
    square = sum(a * micrometre**p for a, p in zip(terms, powers, strict=False))
    if square <= 1.0:
        raise reader.fail(where, f"its private glass has no index at {1e3 * micrometre:g} nm")
    return math.sqrt(square)


def _item(values: list[float], index: int, default: float) -> float:
    return values[index] if index < len(values) else default


_OF_SURFACE = {"STO", "K", "SPH", "CON", "CUF", "CIR", "GLA", "RMD", "PIM", "THI", "RDY", "CUY"}

_HEAD: dict[str, Callable[[_Reader, Command], None]] = {
    "RDM": _Reader._mode,
    "TIT": _Reader._title,
    "DIM": _Reader._unit,
    "EPD": _Reader._light,
    "FNO": _Reader._light,
    "NA": _Reader._light,
    "NAO": _Reader._light,
    "TEM": _Reader._air,
    "PRE": _Reader._air,
    "PRV": _Reader._begin_private,
}


KINDS = (
    LensFormat(
        suffixes=(".seq",),
        title="lenses of CODE V",
        place=20,
        sniff=lambda head: head.lstrip().upper().startswith((b"RDM", b"LEN NEW")),
        read=read_codev,
    ),
)

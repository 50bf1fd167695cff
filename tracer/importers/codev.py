"""Read sequential lens files of CODE V (``.seq``).

A file is a list of commands, split by line ends and semicolons; ``&`` goes on with the next line
and ``!`` begins a comment. ``S radius thickness glass`` starts a surface, the commands after it say
more about it. Commands that do not describe the lens are passed over.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from raymap.errors import SceneError
from tracer.importers.prescription import (
    Aperture,
    FieldKind,
    FieldPoint,
    GlassName,
    ImportWarning,
    LensSurface,
    Prescription,
)
from tracer.importers.text import read_text

__all__ = ["parse_codev", "read_codev"]

_UNITS: dict[str, Literal["mm", "cm", "m", "in"]] = {"M": "mm", "C": "cm", "I": "in"}
_FIELDS: dict[str, FieldKind] = {
    "AN": "angle",
    "OB": "object_height",
    "IM": "paraxial_image_height",
    "RI": "real_image_height",
}
_COEFFICIENTS = "ABCDEFGHJ"
_MOST_COEFFICIENTS = 6
_MOVED = {"XDE", "YDE", "ZDE", "ADE", "BDE", "CDE"}
_TYPES = {
    "CYL": "a cylinder", "YTO": "a toroid", "XTO": "a toroid", "AAS": "an anamorphic asphere",
    "SPS": "a special surface", "DIF": "a diffractive surface", "GRT": "a grating",
    "HOE": "a hologram", "UDS": "a user-defined surface", "MFL": "an ideal lens module",
    "FRE": "a Fresnel surface", "SCO": "a splined or Zernike surface", "BIR": "birefringent",
    "GRI": "a gradient index",
}  # fmt: skip
_OTHER_APERTURES = {"REX", "REY", "ELX", "ELY"}


def read_codev(path: str | Path) -> Prescription:
    """The lens of a ``.seq`` file, whatever its encoding.

    Raises
    ------
    SceneError
        where the file is none, or has a surface that cannot be traced
    """
    return parse_codev(read_text(path), origin=Path(path).name)


def parse_codev(text: str, *, origin: str = "lens") -> Prescription:
    """As `read_codev`, from the text of a file."""
    reader = _Reader(origin)
    for command in _commands(text):
        reader.take(command)
    return reader.finish()


def _commands(text: str) -> Iterator[list[str]]:
    """Each command as its words; quotes keep a word together and are kept at its start."""
    joined = re.sub(r"&[ \t]*(![^\n]*)?\n", " ", text.replace("\r\n", "\n").replace("\r", "\n"))
    words: list[str] = []
    for word in re.findall(r"L?'[^'\n]*'|L?\"[^\"\n]*\"|![^\n]*|;|\n|[^\s;!'\"]+", joined):
        if word.startswith("!"):
            continue
        if word in (";", "\n"):
            if words:
                yield words
            words = []
        else:
            words.append(word)
    if words:
        yield words


@dataclass
class _Draft:
    """A surface while its commands come in."""

    shape: float
    thickness: float
    glass: str = ""
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
        self.private: dict[str, tuple[tuple[float, float], ...]] = {}
        self.in_private = False
        self.private_nm: list[float] = []
        self.lists: dict[str, list[float]] = {}
        self.title = ""
        self.unit: Literal["mm", "cm", "m", "in"] = "mm"
        self.aperture = Aperture(kind="stop")

    def fail(self, place: str, message: str) -> SceneError:
        return SceneError(f"{self.origin}: {place}: {message}")

    @property
    def place(self) -> str:
        return f"surface {len(self.drafts) - 1}" if self.drafts else "head"

    def number(self, words: list[str], index: int) -> float:
        """A number of a command."""
        shown = words[index] if index < len(words) else "nothing"
        try:
            value = float(shown.upper().replace("D", "E"))
        except ValueError:
            raise self.fail(
                self.place, f"{shown!r} stands where {words[0]} expects a number"
            ) from None
        if math.isnan(value):
            raise self.fail(self.place, f"{words[0]} is not a number")
        return value

    def take(self, words: list[str]) -> None:
        """One command."""
        name = words[0].upper()[:3]
        if self.in_private:
            self._private(name, words)
        elif name in ("SO", "SI", "S") or (name == "STO" and len(words) > 2):
            self._surface(name, words)
        elif name in _HEAD:
            _HEAD[name](self, words)
        elif name in ("WL", "WTW", "WTF", "REF", "VUX", "VLX", "VUY", "VLY") or (
            name[:1] in "XY" and name[1:] in _FIELDS
        ):
            self.lists[name] = [self.number(words, k) for k in range(1, len(words))]
        elif self.drafts and not self.ended:
            self._detail(name, words)

    # -- the head --------------------------------------------------------------------------------

    def _mode(self, words: list[str]) -> None:
        self.mode_said = True
        self.radius_mode = len(words) < 2 or words[1].upper().startswith("Y")

    def _title(self, words: list[str]) -> None:
        self.title = " ".join(words[1:]).strip("'\"")

    def _unit(self, words: list[str]) -> None:
        letter = words[1][:1].upper() if len(words) > 1 else ""
        if letter not in _UNITS:
            raise self.fail("DIM", "the unit must be M (mm), C (cm) or I (inches)")
        self.unit = _UNITS[letter]

    def _light(self, words: list[str]) -> None:
        name, value = words[0].upper()[:3], self.number(words, 1)
        if name == "NA":
            self.aperture = Aperture(kind="working_f_number", value=0.5 / value if value else 0.0)
            return
        kinds: dict[str, Literal["entrance_diameter", "f_number", "object_na"]] = {
            "EPD": "entrance_diameter", "FNO": "f_number", "NAO": "object_na",
        }  # fmt: skip
        self.aperture = Aperture(kind=kinds[name], value=value)

    def _zoom(self, words: list[str]) -> None:
        if len(words) > 1 and self.number(words, 1) > 1:
            warnings.warn(
                f"{self.origin}: is a zoom lens of {words[1]} positions; the first is read",
                ImportWarning,
                stacklevel=2,
            )

    def _begin_private(self, words: list[str]) -> None:
        self.in_private = True

    def _private(self, name: str, words: list[str]) -> None:
        """A line between PRV and END: wavelengths, or a glass and its indices."""
        if name == "END":
            self.in_private = False
        elif name == "PWL":
            self.private_nm = [self.number(words, k) for k in range(1, len(words))]
        elif words[0][0] in "'\"" or len(words) == len(self.private_nm) + 1:
            values = [self.number(words, k) for k in range(1, len(words))]
            if len(values) != len(self.private_nm):
                raise self.fail("PRV", f"glass {words[0]} needs an index for each PWL wavelength")
            key = words[0].strip("'\"").upper()
            self.private[key] = tuple(zip(self.private_nm, values, strict=True))

    # -- surfaces --------------------------------------------------------------------------------

    def _surface(self, name: str, words: list[str]) -> None:
        if self.ended:
            raise self.fail(name, "stands after the image surface SI")
        if not self.drafts and name != "SO":
            self.drafts.append(_Draft(0.0, math.inf))
        shape = self.number(words, 1) if len(words) > 1 else 0.0
        thickness = self.number(words, 2) if len(words) > 2 else 0.0
        self.drafts.append(
            _Draft(shape, thickness, words[3] if len(words) > 3 else "", stop=name == "STO")
        )
        self.ended = name == "SI"

    def _detail(self, name: str, words: list[str]) -> None:
        """What a command says about the surface before it."""
        draft = self.drafts[-1]
        if name == "STO":
            draft.stop = True
        elif name == "K":
            draft.conic = self.number(words, 1)
        elif len(name) == 1 and name in _COEFFICIENTS and len(words) > 1:
            draft.terms[_COEFFICIENTS.index(name)] = self.number(words, 1)
        elif name == "CIR":
            self._circle(words)
        elif name in ("SLB", "SLA") and len(words) > 1:
            draft.label = words[1].strip("'\"")
        elif name in _MOVED:
            if len(words) > 1 and self.number(words, 1) != 0.0:
                raise self.fail(
                    self.place,
                    f"is shifted or tilted ({' '.join(words)}), which is not understood; place "
                    "the bodies of a straight lens by position and rotation instead",
                )
        elif name in _TYPES:
            raise self.fail(
                self.place,
                f"is {_TYPES[name]} ({name}), which cannot be traced; spheres, conics and even "
                "aspheres are understood: replace it in the design program",
            )
        elif name in _OTHER_APERTURES:
            warnings.warn(
                f"{self.origin}: {self.place}: its aperture {name} is not round and is left out",
                ImportWarning,
                stacklevel=2,
            )

    def _circle(self, words: list[str]) -> None:
        draft = self.drafts[-1]
        kind = [word.upper() for word in words[1:-1] if not word.upper().startswith("L'")]
        radius = abs(self.number(words, len(words) - 1))
        if "HOL" in kind:
            draft.hole = radius
        elif "OBS" in kind:
            draft.obscuration = radius
        elif "EDG" in kind:
            draft.edge = radius
        else:
            draft.clear = radius

    def _glass(self, written: str, place: str) -> tuple[GlassName | None, bool]:
        name = written.strip("'\"")
        if not name or name.upper() == "AIR":
            return None, False
        if name.upper() in ("REFL", "REF"):
            return None, True
        if name.upper() in self.private:
            return GlassName(name=name, table=self.private[name.upper()]), False
        code = re.fullmatch(r"(\d{3,9})[.:](\d{3,9})", name)
        if code:
            index = 1.0 + float(f"0.{code[1]}")
            return GlassName(name=name, model=(index, float(f"{code[2][:2]}.{code[2][2:]}"))), False
        stem, _, maker = name.partition("_")
        return GlassName(name=stem, maker=maker), False

    def _built(self, number: int, draft: _Draft) -> LensSurface:
        place = f"surface {number}"
        glass, mirror = self._glass(draft.glass, place)
        terms = [draft.terms.get(k, 0.0) for k in range(len(_COEFFICIENTS))]
        while terms and terms[-1] == 0.0:
            terms.pop()
        if len(terms) > _MOST_COEFFICIENTS:
            letter = _COEFFICIENTS[len(terms) - 1]
            raise self.fail(
                place, f"has the coefficient {letter}; A to F (up to r^14) can be traced"
            )
        curvature = draft.shape
        if self.radius_mode:
            curvature = 1.0 / draft.shape if draft.shape else 0.0
        return LensSurface(
            number=number,
            curvature=curvature,
            conic=draft.conic,
            aspheric=tuple(terms),
            thickness=math.inf if abs(draft.thickness) >= 1e10 else draft.thickness,
            glass=glass,
            mirror=mirror,
            semi_diameter=draft.clear or None,
            automatic=not draft.clear,
            mechanical=draft.edge or None,
            hole=draft.hole,
            obscuration=draft.obscuration,
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
            warnings.warn(
                f"{self.origin}: does not say whether its surfaces have radii (RDM) or curvatures "
                "(RDM N); they are read as radii",
                ImportWarning,
                stacklevel=2,
            )
        wavelengths = self.lists.get("WL") or [587.5618]
        weights = self.lists.get("WTW") or []
        weights = [weights[k] if k < len(weights) else 1.0 for k in range(len(wavelengths))]
        if min(wavelengths) <= 0.0:
            raise self.fail("WL", "a wavelength must be positive")
        reference = self.lists.get("REF") or [1 + len(wavelengths) // 2]
        kind, fields = self._fields()
        return Prescription(
            origin=self.origin,
            title=self.title,
            unit=self.unit,
            surfaces=tuple(self._built(k, draft) for k, draft in enumerate(self.drafts)),
            aperture=self.aperture,
            field_kind=kind,
            fields=fields,
            wavelengths_nm=tuple(wavelengths),
            weights=tuple(weights),
            primary=min(max(int(reference[0]) - 1, 0), len(wavelengths) - 1),
        )

    def _fields(self) -> tuple[FieldKind, tuple[FieldPoint, ...]]:
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


def _item(values: list[float], index: int, default: float) -> float:
    return values[index] if index < len(values) else default


_HEAD: dict[str, Callable[[_Reader, list[str]], None]] = {
    "RDM": _Reader._mode,
    "TIT": _Reader._title,
    "DIM": _Reader._unit,
    "EPD": _Reader._light,
    "FNO": _Reader._light,
    "NA": _Reader._light,
    "NAO": _Reader._light,
    "ZOO": _Reader._zoom,
    "PRV": _Reader._begin_private,
}

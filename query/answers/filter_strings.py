"""Filter strings of commercial ray databases as criteria: ``H3 & !R4`` and the like.

Objects and sources are numbered from 1 in the order of the map's directory; 0 means any. Faces of
an object are numbered from 1 in their order; face 0 is every face after the second (the sides).

======================  =================================================================
``Hn`` ``Mn`` ``Ln``    hit, missed, ended on object n
``Rn`` ``Tn``           reflected from, transmitted by object n
``Sn`` ``Fn``           scattered by object n
``Gn``                  specular reflection at object n (a ghost, at refracting surfaces)
``Bn``                  scattered in a volume after hitting object n as the last surface
``On``                  emitted by source n
``Wn``                  wavelength of channel n
``X_HITFACE(n,f)``      hit face f of object n
``X_HITFACE2(n,f,b)``   hit it exactly b times
``X_GHOST(n,b)``        exactly b specular reflections at object n
``_n``                  path n of the path table by objects, strongest first (needs the map)
======================  =================================================================

Operators: ``!`` not, ``&`` and, ``^`` xor, ``|`` or, parentheses.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from query.atoms.count import count
from query.atoms.event import event
from query.atoms.hit import Hit, hit
from query.atoms.last import last
from query.atoms.path import path
from query.atoms.source import source
from query.atoms.wavelength import wavelength
from query.expression.atom import Compare
from query.expression.criterion import And, Criterion, Or, Xor
from query.expression.grammar import mark, parse
from query.expression.names import PATH_SPECIAL, escape
from raymap.model.directory import Directory
from raymap.model.errors import CriterionError

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["translate"]

_TOKEN = re.compile(r"\s*(?:(X_[A-Za-z0-9]+)\s*\(([^()]*)\)|(_\d+)|([A-Z])(\d+)|([()!&|^]))")
_REFUSED = {
    "D": "diffraction is not recorded",
    "E": "diffraction orders are not recorded",
    "J": "it changes intensities, which a criterion cannot do; use Gn",
    "Z": "user-defined flags are not recorded",
}
_MAX_DEPTH = 60


def translate(text: str, map: RayMap | Directory) -> Criterion:
    """A filter string as a criterion.

    Parameters
    ----------
    text : the filter string
    map : an open ray map, or its `Directory` (then without ``Wn`` and ``_n``)

    Raises
    ------
    CriterionError
        with the place; parts that have no counterpart are refused by name.
    """
    return _Translator(text, map).whole()


class _Translator:
    def __init__(self, text: str, map: RayMap | Directory) -> None:
        self.text = text
        self.map = None if isinstance(map, Directory) else map
        self.directory: Directory = map if isinstance(map, Directory) else map.directory
        self.place = 0
        self.depth = 0

    def fail(self, message: str, start: int, end: int) -> CriterionError:
        where = f"{message} (column {start + 1})"
        return CriterionError(f"{where}\n{mark(self.text, start, end)}")

    def peek(self) -> re.Match[str] | None:
        match = _TOKEN.match(self.text, self.place)
        if match is None and self.text[self.place :].strip():
            start = (
                self.place + len(self.text[self.place :]) - len(self.text[self.place :].lstrip())
            )
            raise self.fail("no filter flag begins here", start, start + 1)
        return match

    def take(self, symbol: str) -> bool:
        match = self.peek()
        if match is None or match.group(6) != symbol:
            return False
        self.place = match.end()
        return True

    def whole(self) -> Criterion:
        result = self.level(0)
        if self.peek() is not None:
            raise self.fail("this closes nothing", self.place, self.place + 1)
        return result

    def level(self, rank: int) -> Criterion:
        """Operators of one rank and everything that binds more tightly."""
        if rank == 3:
            return self.unary()
        symbol, kind = (("|", Or), ("^", Xor), ("&", And))[rank]
        args = [self.level(rank + 1)]
        while self.take(symbol):
            args.append(self.level(rank + 1))
        return args[0] if len(args) == 1 else kind(tuple(args))

    def unary(self) -> Criterion:
        self.depth += 1
        if self.depth > _MAX_DEPTH:
            raise self.fail(f"deeper than {_MAX_DEPTH}", self.place, self.place + 1)
        try:
            if self.take("!"):
                return ~self.unary()
            start = self.place
            if self.take("("):
                inner = self.level(0)
                if not self.take(")"):
                    raise self.fail("this bracket is never closed", start, start + 1)
                return inner
            return self.flag()
        finally:
            self.depth -= 1

    def flag(self) -> Criterion:
        match = self.peek()
        if match is None:
            raise self.fail("the filter ends too early", len(self.text), len(self.text) + 1)
        start = self.place + len(match.group(0)) - len(match.group(0).lstrip())
        self.place = match.end()
        try:
            if match.group(1):
                return self.function(match.group(1), match.group(2))
            if match.group(3):
                return self.path_number(int(match.group(3)[1:]))
            if match.group(4):
                return self.letter(match.group(4), int(match.group(5)))
        except CriterionError as error:
            raise self.fail(str(error).split("\n")[0], start, match.end()) from None
        raise self.fail(f"expected a flag, found {match.group(6)!r}", start, match.end())

    def letter(self, letter: str, number: int) -> Criterion:
        if letter in _REFUSED:
            raise CriterionError(f"{letter}{number} cannot be translated: {_REFUSED[letter]}")
        if letter == "O":
            names = [item.name for item in self.directory.sources]
            return source(self.name(number, names, "source"))
        if letter == "W":
            return self.channel(number)
        if letter == "B":
            if number == 0:
                return event("volume_scatter")
            inside = self.path_object(number)
            return path(f".+ {inside} (:volume_scatter)+ .*")
        name = self.object(number)
        words = {
            "R": "reflected",
            "T": "transmitted",
            "S": "scattered",
            "F": "scattered",
            "G": "specular_reflection",
        }
        if letter == "H":
            return hit(name)
        if letter == "M":
            return ~hit(name)
        if letter == "L":
            return last(hit(name))
        if letter in words:
            return Hit((name,), (), ((words[letter],),))
        raise CriterionError(f"{letter}{number} cannot be translated: unknown flag")

    def function(self, name: str, text: str) -> Criterion:
        pieces = [piece.strip() for piece in text.split(",")]
        wanted = {"X_HITFACE": 2, "X_HITFACE2": 3, "X_GHOST": 2}
        if name not in wanted:
            known = ", ".join(wanted)
            raise CriterionError(f"{name} cannot be translated; known functions: {known}")
        if len(pieces) != wanted[name] or not all(re.fullmatch(r"\d+", p) for p in pieces):
            raise CriterionError(f"{name} takes {wanted[name]} whole numbers, found ({text})")
        numbers = [int(piece) for piece in pieces]
        if name == "X_GHOST":
            ghost = Hit((self.object(numbers[0]),), (), (("specular_reflection",),))
            return count(ghost) == numbers[1]  # type: ignore[no-any-return]
        face = Hit(self.faces(numbers[0], numbers[1]))
        if name == "X_HITFACE":
            return face
        return count(face) == numbers[2]  # type: ignore[no-any-return]

    def name(self, number: int, names: list[str], kind: str) -> str:
        """Pattern of thing ``number``; 0 is any."""
        if number == 0:
            return "*"
        if number > len(names):
            raise CriterionError(f"there is no {kind} {number}: the map has {len(names)}")
        return escape(names[number - 1])

    def object(self, number: int) -> str:
        return self.name(number, [item.name for item in self.directory.objects], "object")

    def path_object(self, number: int) -> str:
        self.object(number)
        return escape(self.directory.objects[number - 1].name, PATH_SPECIAL)

    def faces(self, owner: int, face: int) -> tuple[str, ...]:
        pattern = self.object(owner)
        if owner == 0:
            raise CriterionError("faces are those of one object: give its number")
        names = [item.name for item in self.directory.objects[owner - 1].faces]
        chosen = names[2:] if face == 0 else names[face - 1 : face]
        if not chosen:
            raise CriterionError(
                f"object {owner} ({self.directory.objects[owner - 1].name}) has no face {face}: "
                f"it has {', '.join(names) or 'none'}"
            )
        return tuple(f"{pattern}.{escape(name)}" for name in chosen)

    def channel(self, number: int) -> Criterion:
        sets = [] if self.map is None else self.map.channel_sets
        if not sets:
            raise CriterionError(f"W{number} needs an open map, whose channels it counts")
        waves = sets[0].wavelengths_nm
        if not 1 <= number <= len(waves):
            raise CriterionError(f"there is no channel {number}: the map has {len(waves)}")
        return Compare(wavelength, "==", waves[number - 1], "nm")

    def path_number(self, number: int) -> Criterion:
        if self.map is None:
            raise CriterionError(f"_{number} needs an open map, whose path table it counts")
        from query.answers.paths.tables import path_table

        rows = path_table(self.map, by="object").rows(number)[:-1]
        if not 1 <= number <= len(rows):
            raise CriterionError(f"there is no path {number}: the path table has {len(rows)}")
        text = rows[number - 1].criterion
        assert text is not None
        return parse(text)

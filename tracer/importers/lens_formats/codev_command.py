"""One command of a CODE V lens file, whose words are taken one after the other.

Who reads a command takes its qualifiers, then its values; what is left in ``rest`` afterwards was
understood by nobody.
"""

from __future__ import annotations

import re

__all__ = ["KINDS_OF_APERTURES", "QUALIFIER", "Command"]

QUALIFIER = re.compile(r"([SFWZ])(\d+|O|I|A)(\.\.\w+)?", re.IGNORECASE)
"""Which surface, field, wavelength or zoom position is meant."""

KINDS_OF_APERTURES = ("CLR", "OBS", "EDG", "HOL")
"""What an aperture bounds: clear aperture, obscuration, edge, hole."""

_LABEL = re.compile(r"L'[^']*'|L\"[^\"]*\"", re.IGNORECASE)


class Command:
    """The words of a command, and which of them are not yet taken."""

    def __init__(self, words: list[str]) -> None:
        self.word = words[0]
        self.written = list(words)
        self.rest = list(words[1:])
        self.qualifiers: dict[str, str] = {}
        self.kinds: list[str] = []
        self.takes_kinds = False
        self._values: list[str] = []

    @property
    def shown(self) -> str:
        """The command as it is written."""
        return " ".join(self.written)

    @property
    def plain(self) -> str:
        """The command without its qualifiers."""
        return " ".join((self.word, *self._values))

    def take(self) -> str:
        """The next word, empty where there is none."""
        return self.rest.pop(0) if self.rest else ""

    def take_all(self, *, shown: bool = True) -> list[str]:
        """All words as they are written; unless ``shown`` those that are not yet taken."""
        words = self.written if shown else [self.word, *self.rest]
        self.rest = []
        return list(words)

    def take_qualifiers(self, letters: str) -> None:
        """Take qualifiers of these letters before the value, in any order, each letter once.

        A second one is a value: ``GLA S1 SI`` speaks of silicon.
        """
        while self.rest:
            word = self.rest[0]
            match = QUALIFIER.fullmatch(word)
            letter = match[1].upper() if match else ""
            if letter and letter in letters and letter not in self.qualifiers:
                self.qualifiers[letter] = word
            elif self.takes_kinds and word.upper() in KINDS_OF_APERTURES:
                self.kinds.append(word.upper())
            elif not (self.takes_kinds and _LABEL.fullmatch(word)):
                break
            self.rest.pop(0)
        self._values = list(self.rest)

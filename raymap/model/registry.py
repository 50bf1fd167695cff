"""Kinds by name: a kind is a file, and whatever lists kinds asks the registry of its sort.

Built-in kinds are found by scanning the package in which they stand: a module declares its kinds as
``KINDS``, a tuple. Kinds of other rooms and other distributions register by an entry point of the
registry's group, which has the word of the kind as its name; they are imported when they are used.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any, TypeVar

from raymap.model.errors import RayMapError
from raymap.model.names import nearest_names
from raymap.model.parts import OURS, is_there

__all__ = ["Entry", "Registry"]

Kind = TypeVar("Kind")

LAST_PLACE = 1000.0
"""In lists, of kinds that do not say theirs (``place``)."""


@dataclass(frozen=True)
class Entry:
    """A kind in lists.

    Attributes
    ----------
    word, kind : by which it is asked for first, and itself
    words : all by which it is asked for
    origin : its module, or the value of its entry point
    distribution : that registers it, "" for kinds that are found by scanning
    """

    word: str
    kind: Any
    origin: str
    distribution: str = ""
    words: tuple[str, ...] = ()

    @property
    def title(self) -> str:
        """What it is, in a few words."""
        told = getattr(self.kind, "title", "") or (self.kind.__doc__ or "").partition("\n")[0]
        return str(told).rstrip(".").replace("``", "`")

    @property
    def spelling(self) -> str:
        """How it is written, or all of its words."""
        spelled = getattr(self.kind, "spelling", None)
        return ", ".join(self.words) if spelled is None else str(spelled())

    @property
    def place(self) -> float:
        """In lists, from the lowest; kinds of one place stand as they were found."""
        return float(getattr(self.kind, "place", LAST_PLACE))


@dataclass(frozen=True)
class _Pending:
    """A kind that is not imported yet."""

    point: Any


class Registry(Mapping[str, Kind]):
    """The kinds of a sort, by the words that users write; in the order of their names' files.

    Nothing is imported before the first look.

    Parameters
    ----------
    group : of the entry points of kinds of other distributions
    package : whose modules hold the built-in kinds; empty where there are none
    words : the words of a kind, the first of them the one that is shown
    of : what a kind must be an instance of, or a class that it must derive from
    sort : what they are, in the plural, for lists
    """

    def __init__(
        self,
        group: str,
        package: str,
        *,
        words: Callable[[Kind], Sequence[str]],
        of: type[Any] | None = None,
        sort: str = "",
    ) -> None:
        self.group = group
        self.package = package
        self.sort = sort or group
        self._words = words
        self._of = of
        self._known: dict[str, Kind | _Pending] | None = None
        self._listed: list[Entry] | None = None
        self._looked: list[tuple[str, str, str, Kind | _Pending]] | None = None

    def kinds(self) -> list[Kind]:
        """Every kind once, in the order of lists."""
        return [entry.kind for entry in self.entries()]

    def entries(self, *, ours: bool = False) -> list[Entry]:
        """Every kind once with where it comes from, in the order of lists.

        Parameters
        ----------
        ours : only those of this distribution, whatever else is installed
        """
        if not ours and self._listed is not None:
            return self._listed
        found: dict[int, Entry] = {}
        for origin, distribution, word, _ in self._places():
            if ours and distribution not in ("", OURS):
                continue
            kind: Any = self[word]
            words = tuple(self._words(kind))
            found.setdefault(id(kind), Entry(word, kind, origin, distribution, words))
        listed = sorted(found.values(), key=lambda entry: entry.place)
        if not ours:
            self._listed = listed
        return listed

    def nearest(self, word: str) -> str:
        """'; did you mean …' for a word that no kind has."""
        return nearest_names(word, self)

    def _all(self) -> dict[str, Kind | _Pending]:
        if self._known is None:
            known: dict[str, Kind | _Pending] = {}
            for origin, distribution, word, kind in self._places():
                if word in known:
                    raise RayMapError(
                        f"{_place(origin, distribution)}: there is a kind {word!r} of {self.group} "
                        f"already; uninstall {distribution or 'one of them'}, or rename its kind"
                    )
                known[word] = kind
            self._known = known
        return self._known

    def _places(self) -> list[tuple[str, str, str, Kind | _Pending]]:
        """As `_found`, once: what distributions say of themselves lies in many files."""
        if self._looked is None:
            self._looked = list(self._found())
        return self._looked

    def _found(self) -> Iterator[tuple[str, str, str, Kind | _Pending]]:
        if self.package:
            package = import_module(self.package)
            for module in sorted(pkgutil.iter_modules(package.__path__), key=lambda m: m.name):
                name = f"{self.package}.{module.name}"
                for kind in getattr(import_module(name), "KINDS", ()):
                    for word in self._words(kind):
                        yield name, "", word, kind
        # A distribution that two folders of the path hold is there once
        points = {(p.name, p.value): p for p in reversed(list(entry_points(group=self.group)))}
        for (name, value), point in sorted(points.items()):
            if not is_there(point):
                continue
            yield value, point.dist.name if point.dist else "", name, _Pending(point)

    def _loaded(self, pending: _Pending) -> Kind:
        point = pending.point
        distribution = point.dist.name if point.dist else ""
        where = f"{_place(point.value, distribution)}, registered under {self.group}"
        try:
            kind = point.load()
        except Exception as error:
            # Whatever the module of somebody else does while it is loaded
            raise RayMapError(
                f"{where}, cannot be loaded ({type(error).__name__}: {error}); upgrade or "
                f"uninstall {distribution or 'its distribution'}"
            ) from error
        wanted = self._of
        fits = wanted is None or isinstance(kind, wanted)
        if not fits and not (isinstance(kind, type) and issubclass(kind, wanted)):  # type: ignore[arg-type]
            raise RayMapError(f"{where}: {kind!r} is no {wanted.__name__}")  # type: ignore[union-attr]
        if point.name not in self._words(kind):
            raise RayMapError(
                f"{where}: is called {point.name!r}, but its kind {', '.join(self._words(kind))}"
            )
        return kind  # type: ignore[no-any-return]

    def __getitem__(self, word: str) -> Kind:
        kind = self._all()[word]
        if isinstance(kind, _Pending):
            kind = self._loaded(kind)
            self._all()[word] = kind
        return kind

    def __contains__(self, word: object) -> bool:
        return word in self._all()

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())


def _place(origin: str, distribution: str) -> str:
    return f"{origin!r} of the distribution {distribution!r}" if distribution else origin

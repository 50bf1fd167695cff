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

__all__ = ["Registry"]

Kind = TypeVar("Kind")


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
    """

    def __init__(
        self,
        group: str,
        package: str,
        *,
        words: Callable[[Kind], Sequence[str]],
        of: type[Any] | None = None,
    ) -> None:
        self.group = group
        self.package = package
        self._words = words
        self._of = of
        self._known: dict[str, Kind | _Pending] | None = None

    def kinds(self) -> list[Kind]:
        """Every kind once."""
        return list({id(kind): kind for kind in self.values()}.values())

    def nearest(self, word: str) -> str:
        """'; did you mean …' for a word that no kind has."""
        return nearest_names(word, self)

    def _all(self) -> dict[str, Kind | _Pending]:
        if self._known is None:
            known: dict[str, Kind | _Pending] = {}
            for place, word, kind in self._found():
                if word in known:
                    raise RayMapError(
                        f"{place}: there is a kind {word!r} of {self.group} already; uninstall or "
                        "rename one of them"
                    )
                known[word] = kind
            self._known = known
        return self._known

    def _found(self) -> Iterator[tuple[str, str, Kind | _Pending]]:
        if self.package:
            package = import_module(self.package)
            for module in sorted(pkgutil.iter_modules(package.__path__), key=lambda m: m.name):
                name = f"{self.package}.{module.name}"
                for kind in getattr(import_module(name), "KINDS", ()):
                    for word in self._words(kind):
                        yield name, word, kind
        for point in sorted(entry_points(group=self.group), key=lambda point: point.name):
            yield f"entry point {point.value!r}", point.name, _Pending(point)

    def _loaded(self, point: Any) -> Kind:
        place = f"entry point {point.value!r} of {self.group}"
        try:
            kind = point.load()
        except (ImportError, AttributeError) as error:
            raise RayMapError(
                f"{place} cannot be loaded ({error}); mend or uninstall its distribution"
            ) from error
        wanted = self._of
        fits = wanted is None or isinstance(kind, wanted)
        if not fits and not (isinstance(kind, type) and issubclass(kind, wanted)):  # type: ignore[arg-type]
            raise RayMapError(f"{place}: {kind!r} is no {wanted.__name__}")  # type: ignore[union-attr]
        if point.name not in self._words(kind):
            raise RayMapError(
                f"{place}: is called {point.name!r}, but its kind {', '.join(self._words(kind))}"
            )
        return kind  # type: ignore[no-any-return]

    def __getitem__(self, word: str) -> Kind:
        kind = self._all()[word]
        if isinstance(kind, _Pending):
            kind = self._loaded(kind.point)
            self._all()[word] = kind
        return kind

    def __contains__(self, word: object) -> bool:
        return word in self._all()

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())

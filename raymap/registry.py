"""Kinds of one sort: ours, found by scanning a package, and those that other distributions add.

A kind is a module that declares itself in one constant. Ours lie in one package; a foreign one is
named by an entry point of its distribution, whose value is ``package.module:CONSTANT``. Whatever
lists kinds (grammar, completion, help, pages of the documentation) iterates the registry, so that
a new kind touches no file of the product.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Generic, Protocol, TypeVar

from raymap.model.errors import RayMapError
from raymap.rooms import ROOMS, check_room

__all__ = ["Entry", "Kind", "PluginError", "Registry", "registries"]


class PluginError(RayMapError, ImportError):
    """A kind of another distribution cannot be used."""


class Kind(Protocol):
    """What every kind says of itself.

    Attributes
    ----------
    word : by which it is asked for
    title : what it is, in a few words
    place : in lists, from the lowest; kinds of the same place stand by their words
    """

    @property
    def word(self) -> str: ...
    @property
    def title(self) -> str: ...
    @property
    def place(self) -> float: ...


K = TypeVar("K", bound=Kind)


@dataclass(frozen=True)
class Entry(Generic[K]):
    """A kind and where it comes from: a module of ours, or a distribution and its object."""

    kind: K
    origin: str
    distribution: str = ""


class Registry(Generic[K]):
    """The kinds of one sort, by word.

    Parameters
    ----------
    sort : what they are, in the plural: "atoms of criteria"
    package : whose modules declare ours; names that begin with ``_`` are left out
    constant : in each module
    group : of the entry points of others
    fits : whether an object can be such a kind
    words : further words under which a kind is found
    """

    def __init__(
        self,
        sort: str,
        *,
        package: str,
        constant: str,
        group: str,
        fits: Callable[[Any], bool],
        words: Callable[[K], tuple[str, ...]] = lambda kind: (kind.word,),
    ) -> None:
        self.sort, self.package, self.constant, self.group = sort, package, constant, group
        self._fits, self._words = fits, words

    def __iter__(self) -> Iterator[K]:
        return (entry.kind for entry in self.entries)

    def __contains__(self, word: object) -> bool:
        return word in self.by_word

    def get(self, word: str) -> K | None:
        """The kind of a word, None where there is none."""
        return self.by_word.get(word)

    @cached_property
    def by_word(self) -> dict[str, K]:
        """Every kind under each of its words, in the order of lists."""
        return {word: kind for kind in self for word in self._words(kind)}

    @cached_property
    def entries(self) -> list[Entry[K]]:
        """All kinds in the order of lists.

        Raises
        ------
        PluginError
            A foreign one cannot be loaded, is none, or takes a word that another has.
        """
        found = [*self.own(), *(self.foreign(point) for point in self.points())]
        taken: dict[str, Entry[K]] = {}
        for entry in found:
            for word in self._words(entry.kind):
                if word in taken:
                    raise PluginError(
                        f"{entry.origin} of {entry.distribution or 'Raymap'} takes the word "
                        f"{word!r} among the {self.sort}, which {taken[word].origin} has already: "
                        f"rename it, or uninstall {entry.distribution}"
                    )
                taken[word] = entry
        return self._in_order(found)

    def own_in_order(self) -> list[Entry[K]]:
        """Ours in the order of lists, whatever else is installed."""
        return self._in_order(self.own())

    @staticmethod
    def _in_order(entries: list[Entry[K]]) -> list[Entry[K]]:
        return sorted(entries, key=lambda entry: (entry.kind.place, entry.kind.word))

    def own(self) -> list[Entry[K]]:
        """Ours: a module each."""
        package = importlib.import_module(self.package)
        names = sorted(
            module.name
            for module in pkgutil.iter_modules(package.__path__)
            if not module.name.startswith("_")
        )
        modules = [importlib.import_module(f"{self.package}.{name}") for name in names]
        return [Entry(getattr(module, self.constant), module.__name__) for module in modules]

    def points(self) -> list[EntryPoint]:
        """Entry points of other distributions, in an order that installing does not change."""
        points = {(point.name, point.value): point for point in entry_points(group=self.group)}
        return [points[key] for key in sorted(points)]

    def foreign(self, point: EntryPoint) -> Entry[K]:
        """What an entry point names.

        Raises
        ------
        PluginError
        """
        distribution = point.dist.name if point.dist is not None else ""
        whose = f"{point.value!r} of the distribution {distribution or 'unknown'!r}"
        remedy = f"upgrade or uninstall {distribution or 'it'}"
        room = point.module.partition(".")[0]
        if room in ROOMS:
            check_room(room)
        try:
            kind = point.load()
        except Exception as error:
            # Whatever a module of others does while it is loaded
            raise PluginError(
                f"{whose}, registered under {self.group}, cannot be loaded "
                f"({type(error).__name__}: {error}): {remedy}"
            ) from error
        if not self._fits(kind):
            raise PluginError(f"{whose} is none of the {self.sort}: {remedy}")
        return Entry(kind, point.value, distribution)


def registries() -> dict[str, Registry[Any]]:
    """The registries of all installed rooms by name; each room lists its own in ``registries``."""
    found: dict[str, Registry[Any]] = {}
    for room in ROOMS:
        check_room(room)
        try:
            module = importlib.import_module(f"{room}.registries")
        except ModuleNotFoundError as error:
            if error.name not in (room, f"{room}.registries"):
                raise
            continue
        found |= module.REGISTRIES
    return found

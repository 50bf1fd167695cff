"""Binding: a criterion against the names, units and channels of one map.

Operators are bound here; every atom binds itself (`query.expression.atom.Condition.bind`) with what
a `Binder` offers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from query.engine.bound import BoundNode
from query.engine.kleene import Bools
from query.engine.logic import BoundLogic, BoundThen
from query.expression.atom import Compare, Comparison, Condition
from query.expression.criterion import And, Criterion, Not, Or, Then, Xor
from query.expression.grammar import mark
from query.expression.names import FaceNames, match_indices
from query.expression.units import convert
from query.expression.words import quoted
from raymap.model.directory import ChannelSet, Directory
from raymap.model.errors import CriterionError, UnknownName

__all__ = ["Binder", "MapFacts", "Misfit", "bind"]


@dataclass(frozen=True, eq=False, kw_only=True)
class MapFacts:
    """What binding needs to know of a map.

    Attributes
    ----------
    emitted : (n_sources,) int64, rays emitted by each source in the portions served
    weighted : some portion stores weights
    worth_by_color : the flux of a ray depends on its colour, as lumens do
    has_column : whether some portion has an optional column of this name
    """

    directory: Directory
    channel_sets: Sequence[ChannelSet] = ()
    emitted: NDArray[np.int64]
    weighted: bool = False
    worth_by_color: bool = False
    has_column: Callable[[str], bool] = lambda name: False


class Misfit(Exception):
    """An error that does not know its place in the text yet: that of ``needle``."""

    def __init__(self, error: CriterionError, needle: str) -> None:
        super().__init__(str(error))
        self.error, self.needle = error, needle

    def located(self, text: str) -> CriterionError:
        """The error with carets under its place in a text."""
        start = text.find(self.needle)
        if start < 0:
            return self.error
        carets = mark(text, start, start + len(self.needle))
        return type(self.error)(f"{self.error} (column {start + 1})\n{carets}")


class Binder:
    """Binds criteria to one map; equal sub-expressions become one node."""

    def __init__(self, facts: MapFacts) -> None:
        self.facts = facts
        self.directory = facts.directory
        self.names = FaceNames(facts.directory)
        self.known: dict[Criterion, BoundNode] = {}

    def bind(self, node: Criterion, text: str | None = None) -> BoundNode:
        """Resolve a criterion; ``text`` is how the user wrote it, for carets.

        Raises
        ------
        UnknownName, CriterionError
            with the place in the text.
        """
        try:
            return self.node(node)
        except Misfit as misfit:
            shown = text if text is not None else str(node)
            raise misfit.located(shown) from None

    def node(self, node: Criterion) -> BoundNode:
        """A part of the criterion, bound.

        Raises
        ------
        Misfit
        """
        if node not in self.known:
            self.known[node] = self._new(node)
        return self.known[node]

    def _new(self, node: Criterion) -> BoundNode:
        text = str(node)
        if isinstance(node, Not | And | Or | Xor):
            args = tuple(self.node(arg) for arg in node.children)
            return BoundLogic(text=text, operator=node.op, args=args, is_point=node.is_point)
        if isinstance(node, Then):
            return BoundThen(text=text, args=tuple(self.node(arg) for arg in node.args))
        bound: BoundNode | None = None
        if isinstance(node, Compare):
            bound = node.quantity.bind(self, self._comparison(node), text)
        elif isinstance(node, Condition):
            bound = node.bind(self, text)
        if bound is None:
            raise CriterionError(f"cannot ask for {type(node).__name__}")
        return bound

    def _comparison(self, node: Compare) -> Comparison:
        """With the number in the unit of the map."""
        quantity, directory = node.quantity, self.directory
        try:
            value = convert(
                node.value,
                node.unit,
                quantity.dimension,
                quantity.measured if quantity.dimension else quantity.word,
                directory.length_unit,
                directory.flux_unit,
            )
        except CriterionError as error:
            raise Misfit(error, node.unit) from None
        return Comparison(node.operator, value)

    def table(self, patterns: Sequence[str], names: Sequence[str], kind: str) -> Bools:
        """(len(names) + 1,) which of the names the patterns match; the last answers for none.

        Raises
        ------
        Misfit
            A pattern matches nothing.
        """
        table = np.zeros(len(names) + 1, np.bool_)
        for pattern in patterns:
            try:
                table[match_indices(pattern, names, kind)] = True
            except UnknownName as error:
                raise Misfit(error, quoted(pattern)) from None
        return table


def bind(node: Criterion, facts: MapFacts, text: str | None = None) -> BoundNode:
    """Resolve one criterion against a map."""
    return Binder(facts).bind(node, text)

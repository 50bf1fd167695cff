"""What a criterion is, and how operators join criteria: ``!``, ``->``, ``&``, ``^``, ``|``.

A criterion speaks about one ray. Some are *point conditions* (`Criterion.is_point`): they can be
asked of a single point, and mean "at some point of the ray" where they stand alone. Text
(`query.expression.grammar`), Python operators and JSON (`query.expression.json_form`) are three
spellings of one immutable tree; nothing in it knows a map.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from raymap.model.errors import CriterionError
from raymap.model.unfinished import Unfinished

__all__ = ["OPERATORS", "And", "Criterion", "Not", "Or", "Then", "Xor", "check_point", "joinable"]


class Criterion:
    """A logical expression over one ray; ``str`` gives its text, which reads back the same.

    Attributes
    ----------
    rank : how tightly it binds in text; what binds less tightly than its surroundings is bracketed
    """

    rank: ClassVar[int] = 6

    @property
    def is_point(self) -> bool:
        """Whether the expression can be asked of a single point."""
        return False

    @property
    def is_crossing(self) -> bool:
        """Whether it speaks of crossings of detectors, which stand between two points."""
        return False

    @property
    def children(self) -> Sequence[Criterion]:
        """Criteria that it is made of."""
        return ()

    def __and__(self, other: Criterion) -> Criterion:
        return And((self, joinable(other, "&")))

    def __or__(self, other: Criterion) -> Criterion:
        return Or((self, joinable(other, "|")))

    def __xor__(self, other: Criterion) -> Criterion:
        return Xor((self, joinable(other, "^")))

    def __invert__(self) -> Criterion:
        return Not(self)

    def then(self, *others: Criterion) -> Criterion:
        """This first, then the others, in this order along the ray (``->``)."""
        return Then((self, *others))

    def __bool__(self) -> bool:
        raise TypeError(
            "a criterion has no truth value before it is asked of a map: write & | ~ instead of "
            "and, or, not; put comparisons in parentheses; ask with query.select(map, criterion)"
        )

    def to_json(self) -> dict[str, Any]:
        """The criterion as a JSON tree."""
        raise Unfinished(self, "to_json")


def joinable(value: object, operator: str) -> Criterion:
    """The value, if an operator can join it."""
    if not isinstance(value, Criterion):
        advice = ""
        if hasattr(type(value), "word"):  # a quantity
            advice = "; compare it with a number, in parentheses: (count(...) >= 2)"
        raise TypeError(f"{operator} joins criteria, not {type(value).__name__}{advice}")
    return value


def check_point(value: Criterion, where: str) -> None:
    """Refuse what cannot be asked of a single point."""
    if not isinstance(value, Criterion) or not value.is_point:
        raise CriterionError(
            f"{where} takes a point condition (hit, event, all and their combinations), "
            f"not {value if isinstance(value, Criterion) else type(value).__name__}"
        )


def _inside(node: Criterion, rank: int) -> str:
    return f"({node})" if node.rank < rank else str(node)


@dataclass(frozen=True)
class Not(Criterion):
    """The opposite."""

    arg: Criterion
    rank: ClassVar[int] = 5
    op: ClassVar[str] = "not"

    @property
    def is_point(self) -> bool:
        return self.arg.is_point

    @property
    def children(self) -> Sequence[Criterion]:
        return (self.arg,)

    def __str__(self) -> str:
        return "!" + _inside(self.arg, self.rank)

    def to_json(self) -> dict[str, Any]:
        return {"op": self.op, "args": [self.arg.to_json()]}


@dataclass(frozen=True)
class _Nary(Criterion):
    """An associative operator; nested ones of the same kind are merged."""

    args: tuple[Criterion, ...]
    symbol: ClassVar[str] = ""
    op: ClassVar[str] = ""

    def __post_init__(self) -> None:
        flat: list[Criterion] = []
        for arg in self.args:
            joinable(arg, self.symbol)
            flat.extend(arg.args if type(arg) is type(self) else (arg,))
        if len(flat) < 2:
            raise CriterionError(f"{self.symbol} joins two or more criteria")
        object.__setattr__(self, "args", tuple(flat))

    @property
    def is_point(self) -> bool:
        return all(arg.is_point for arg in self.args)

    @property
    def children(self) -> Sequence[Criterion]:
        return self.args

    def __str__(self) -> str:
        # Nested operators of one kind are merged, so an equal rank needs no brackets
        return f" {self.symbol} ".join(_inside(arg, self.rank) for arg in self.args)

    def to_json(self) -> dict[str, Any]:
        return {"op": self.op, "args": [arg.to_json() for arg in self.args]}


@dataclass(frozen=True)
class Or(_Nary):
    """At least one of them."""

    symbol: ClassVar[str] = "|"
    op: ClassVar[str] = "or"
    rank: ClassVar[int] = 1


@dataclass(frozen=True)
class Xor(_Nary):
    """An odd number of them."""

    symbol: ClassVar[str] = "^"
    op: ClassVar[str] = "xor"
    rank: ClassVar[int] = 2


@dataclass(frozen=True)
class And(_Nary):
    """All of them."""

    symbol: ClassVar[str] = "&"
    op: ClassVar[str] = "and"
    rank: ClassVar[int] = 3


@dataclass(frozen=True)
class Then(_Nary):
    """One after the other along the ray: points i < j < k, detectors between two points."""

    symbol: ClassVar[str] = "->"
    op: ClassVar[str] = "then"
    rank: ClassVar[int] = 4

    def __post_init__(self) -> None:
        super().__post_init__()
        for arg in self.args:
            if not arg.is_crossing:
                check_point(arg, "->")

    @property
    def is_point(self) -> bool:
        return False


OPERATORS: dict[str, type[_Nary]] = {kind.op: kind for kind in (And, Or, Xor, Then)}
"""Operators that join two or more criteria, by their word in JSON."""

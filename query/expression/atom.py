"""What an atom of the criteria language is: a condition, or a number of a ray to be compared.

An atom is a frozen dataclass in a file of its own (`query.atoms`, or a distribution that registers
it under the entry-point group ``raymap.atoms``). It says its word, its arguments and its help;
text, JSON, proposals and tables follow from these. `bind` turns it into a `BoundNode` that answers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from query.expression.arguments import COMPARISONS, Argument, Names, Text
from query.expression.criterion import Criterion
from query.expression.words import finite, measure, measure_text
from raymap.model.errors import CriterionError
from raymap.model.unfinished import Unfinished

__all__ = ["Atom", "Compare", "Comparison", "Condition", "Quantity"]


class Atom:
    """What conditions and quantities have in common.

    Attributes
    ----------
    word : by which criteria ask for it
    title : what it says, in a few words, for proposals and tables
    arguments : in the order in which they are printed
    place : in lists, from the lowest
    alone : the word may stand without brackets
    """

    word: ClassVar[str] = ""
    title: ClassVar[str] = ""
    arguments: ClassVar[tuple[Argument, ...]] = ()
    place: ClassVar[float] = 1000.0
    alone: ClassVar[bool] = False

    if TYPE_CHECKING:

        def __init__(self, **values: Any) -> None: ...

    @classmethod
    def read_call(cls, reader: Any, call: Any, parts: Sequence[Any]) -> Any:
        """The atom from a parsed call of its word with these parts in the brackets."""
        if parts and not cls.arguments:
            raise reader.fail(f"{cls.word} takes nothing in brackets", call)
        shares: dict[str, list[Any]] = {argument.name: [] for argument in cls.arguments}
        for part in parts:
            fitting = (argument for argument in cls.arguments if argument.takes(part))
            # What fits nowhere is refused by the first argument, which says what it takes
            shares[next(fitting, cls.arguments[0]).name].append(part)
        values = {
            argument.name: argument.read(reader, cls.word, call, shares[argument.name])
            for argument in cls.arguments
        }
        return cls(**values)

    @classmethod
    def read_json(cls, reader: Any) -> Any:
        """The atom from its object in JSON."""
        values = {argument.name: argument.from_json(reader, cls.word) for argument in cls.arguments}
        return cls(**values)

    @classmethod
    def spelling(cls) -> str:
        """How it is written, for tables."""
        if not cls.arguments:
            return cls.word
        shown = [
            f"[{argument.spelling}]" if argument.optional and not cls.stands_alone()
            else argument.spelling
            for argument in cls.arguments
        ]  # fmt: skip
        inside = ", ".join(shown)
        return (
            f"{cls.word} or {cls.word}({inside})" if cls.stands_alone() else f"{cls.word}({inside})"
        )

    @classmethod
    def stands_alone(cls) -> bool:
        """Whether the word may stand without brackets."""
        return cls.alone or not cls.arguments

    @classmethod
    def opening(cls) -> tuple[str, int]:
        """What a proposal inserts, and how far the cursor goes back from its end."""
        if cls.stands_alone():
            return cls.word, 0
        if isinstance(cls.arguments[0], Names | Text):
            return f'{cls.word}("")', 2
        return f"{cls.word}()", 1

    @property
    def children(self) -> Sequence[Criterion]:
        """Criteria among the arguments."""
        return [
            criterion
            for argument in self.arguments
            for criterion in argument.criteria(getattr(self, argument.name))
        ]

    def __str__(self) -> str:
        shown = [
            text
            for argument in self.arguments
            for text in argument.show(getattr(self, argument.name))
        ]
        if not shown and self.stands_alone():
            return self.word
        return f"{self.word}({', '.join(shown)})"

    def argument_json(self) -> dict[str, Any]:
        """The arguments as keys of an object."""
        out: dict[str, Any] = {}
        for argument in self.arguments:
            out |= argument.to_json(getattr(self, argument.name))
        return out


class Condition(Atom, Criterion):
    """An atom that is true or false of a ray.

    Attributes
    ----------
    phrase : how a condition built with the mouse begins ("met"); empty: it is not built so
    """

    phrase: ClassVar[str] = ""

    def to_json(self) -> dict[str, Any]:
        return {"op": self.word} | self.argument_json()

    def bind(self, binder: Any, text: str) -> Any:
        """The `query.engine.bound.BoundNode` that answers on the map of a `Binder`."""
        raise Unfinished(self, "bind")


@dataclass(frozen=True)
class Comparison:
    """``operator`` and ``value``, in the unit of the map."""

    operator: str
    value: float


class Quantity(Atom):
    """An atom that is a number of a ray; compare it with a number to get a criterion.

    Comparison builds a `Compare` node: ``wavelength < 500``, ``length >= "12 cm"``.

    Attributes
    ----------
    dimension : "length", "wavelength", "angle", "time", "flux", or "" for a plain number
    measured : what the dimension is of, for messages ("an angle of incidence")
    """

    dimension: ClassVar[str] = ""
    measured: ClassVar[str] = ""

    def bind(self, binder: Any, comparison: Comparison, text: str) -> Any:
        """The `query.engine.bound.BoundNode` of a comparison on the map of a `Binder`."""
        raise Unfinished(self, "bind")

    def __lt__(self, other: object) -> Compare:
        return Compare(self, "<", *measure(other))

    def __le__(self, other: object) -> Compare:
        return Compare(self, "<=", *measure(other))

    def __gt__(self, other: object) -> Compare:
        return Compare(self, ">", *measure(other))

    def __ge__(self, other: object) -> Compare:
        return Compare(self, ">=", *measure(other))

    def __eq__(self, other: object) -> Any:
        if isinstance(other, Quantity):
            return type(self) is type(other) and self._key() == other._key()
        return Compare(self, "==", *measure(other))

    def __ne__(self, other: object) -> Any:
        if isinstance(other, Quantity):
            return not (type(self) is type(other) and self._key() == other._key())
        return Compare(self, "!=", *measure(other))

    def __hash__(self) -> int:
        return hash((type(self).__name__, self._key()))

    def __bool__(self) -> bool:
        raise TypeError(
            f"{self.word} has no truth value; compare it with a number: {self.word} > 1"
        )

    def _key(self) -> object:
        return tuple(getattr(self, argument.name) for argument in self.arguments)


@dataclass(frozen=True)
class Compare(Criterion):
    """A quantity compared with a number."""

    quantity: Quantity
    operator: str
    value: float
    unit: str = ""

    def __post_init__(self) -> None:
        if self.operator not in COMPARISONS:
            raise CriterionError(
                f"{self.operator!r} is not a comparison; write one of == != < <= > >="
            )
        object.__setattr__(self, "value", finite(self.value))

    @property
    def children(self) -> Sequence[Criterion]:
        return self.quantity.children

    def __str__(self) -> str:
        return f"{self.quantity} {self.operator} {measure_text(self.value, self.unit)}"

    def to_json(self) -> dict[str, Any]:
        out: dict[str, Any] = {"op": "compare", "quantity": self.quantity.word}
        out |= self.quantity.argument_json()
        out |= {"compare": self.operator, "value": self.value}
        return out | ({"unit": self.unit} if self.unit else {})

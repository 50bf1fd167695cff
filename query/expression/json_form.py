"""JSON to tree; the schema stands in ``docs/criteria.md``. Trees write themselves."""

from __future__ import annotations

from typing import Any

from query.expression.atom import Compare, Quantity
from query.expression.criterion import OPERATORS, Criterion, Not
from query.expression.registry import ATOMS
from raymap.model.errors import CriterionError

__all__ = ["from_json"]

MAX_DEPTH = 100


class _Reader:
    """One dictionary of the tree, with the way to it for messages."""

    def __init__(self, value: object, where: str, depth: int) -> None:
        if not isinstance(value, dict):
            raise CriterionError(f"{where} must be an object with a key 'op', not {value!r:.60}")
        if depth > MAX_DEPTH:
            raise CriterionError(f"the criterion nests deeper than {MAX_DEPTH}")
        self.value, self.where, self.depth = value, where, depth
        self.used: set[str] = {"op"}

    def get(self, key: str, kind: type | tuple[type, ...], default: Any = ...) -> Any:
        self.used.add(key)
        if key not in self.value and default is not ...:
            return default
        found = self.value.get(key)
        if not isinstance(found, kind) or (isinstance(found, bool) and kind is not bool):
            raise CriterionError(f"{self.where}.{key} is missing or of a wrong type: {found!r:.40}")
        return found

    def texts(self, key: str, default: Any = ...) -> tuple[str, ...]:
        found = self.get(key, list, default)
        if not all(isinstance(item, str) for item in found):
            raise CriterionError(f"{self.where}.{key} must be a list of texts")
        return tuple(found)

    def child(self, key: str, value: object) -> Criterion:
        return _build(value, f"{self.where}.{key}", self.depth + 1)

    def children(self) -> list[Criterion]:
        args = self.get("args", list)
        return [self.child(f"args[{number}]", value) for number, value in enumerate(args)]

    def inner(self, key: str, value: object) -> _Reader:
        return _Reader(value, f"{self.where}.{key}", self.depth + 1)

    def finish(self) -> None:
        if extra := sorted(set(self.value) - self.used):
            raise CriterionError(f"{self.where} has unknown keys: {', '.join(map(str, extra))}")


def from_json(tree: object) -> Criterion:
    """Read a criterion from its JSON tree.

    Raises
    ------
    CriterionError
        naming the place in the tree.
    """
    return _build(tree, "criterion", 0)


def _build(value: object, where: str, depth: int) -> Criterion:
    reader = _Reader(value, where, depth)
    op = reader.get("op", str)
    try:
        node = _node(reader, op)
    except CriterionError as error:
        message = str(error)
        raise CriterionError(
            message if message.startswith("criterion") else f"{where}: {message}"
        ) from None
    reader.finish()
    return node


def _node(reader: _Reader, op: str) -> Criterion:
    if op in OPERATORS:
        return OPERATORS[op](tuple(reader.children()))
    if op == "not":
        args = reader.children()
        if len(args) != 1:
            raise CriterionError(f"not takes one argument, found {len(args)}")
        return Not(args[0])
    if op == "compare":
        return _compare(reader)
    kind = ATOMS.get(op)
    if kind is None or issubclass(kind, Quantity):
        conditions = [atom.word for atom in ATOMS.kinds() if not issubclass(atom, Quantity)]
        known = ", ".join((*OPERATORS, "not", *conditions, "compare"))
        raise CriterionError(f"{reader.where}.op is {op!r}; known: {known}")
    found: Criterion = kind.read_json(reader)
    return found


def _compare(reader: _Reader) -> Criterion:
    word = reader.get("quantity", str)
    kind = ATOMS.get(word)
    if kind is None or not issubclass(kind, Quantity):
        raise CriterionError(f"{reader.where}.quantity is {word!r}")
    quantity: Quantity = kind.read_json(reader)
    number = reader.get("value", (int, float))
    return Compare(quantity, reader.get("compare", str), number, reader.get("unit", str, ""))

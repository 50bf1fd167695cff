"""Tree to JSON and back; the schema stands in ``docs/criteria.md``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from query.expression import criteria as c
from raymap.model.errors import CriterionError

__all__ = ["from_json", "to_json"]

MAX_DEPTH = 100

_NARY: dict[str, type[c.And] | type[c.Or] | type[c.Xor] | type[c.Then]] = {
    "and": c.And,
    "or": c.Or,
    "xor": c.Xor,
    "then": c.Then,
}
_QUANTITIES: dict[str, type[c.Quantity]] = {
    kind.word: kind for kind in (c.Wavelength, c.Length, c.OpticalLength, c.Bounces, c.Flux)
}
_RECORDED: dict[str, type[c.Recorded]] = {
    kind.word: kind for kind in (c.DegreeOfPolarisation, c.AngleOfPolarisation, c.OpticalPath)
}


def to_json(node: c.Criterion) -> dict[str, Any]:
    """The criterion as dictionaries, lists, texts and numbers."""
    if isinstance(node, c.Not):
        return {"op": "not", "args": [to_json(node.arg)]}
    for word, kind in _NARY.items():
        if type(node) is kind:
            return {"op": word, "args": [to_json(arg) for arg in node.args]}
    if isinstance(node, c.Source | c.Medium):
        return {"op": type(node).__name__.lower(), "names": list(node.names)}
    if isinstance(node, c.Hit):
        return _hit_json(node)
    if isinstance(node, c.EventAt):
        return {"op": "event", "events": _events_json(node.events)}
    if isinstance(node, c.All):
        return {"op": "all", "args": [to_json(arg) for arg in node.args]}
    if isinstance(node, c.Detected):
        out: dict[str, Any] = {"op": node.word, "names": list(node.names)}
        if node.regions:
            out["regions"] = [_region_json(region) for region in node.regions]
        return out
    if isinstance(node, c.Last):
        return {"op": "last", "args": [to_json(node.point)]}
    if isinstance(node, c.Path):
        return {"op": "path", "text": node.text} | ({"exact": True} if node.exact else {})
    if isinstance(node, c.Compare):
        return _compare_json(node)
    raise TypeError(f"no JSON for {type(node).__name__}")


def _events_json(events: tuple[c.EventSet, ...]) -> list[Any]:
    return [words[0] if len(words) == 1 else {"all": list(words)} for words in events]


def _hit_json(node: c.Hit) -> dict[str, Any]:
    out: dict[str, Any] = {"op": "hit"}
    if node.names:
        out["names"] = list(node.names)
    if node.surface:
        out["surface"] = [
            {"parameter": test.parameter, "compare": test.operator, "value": test.value}
            for test in node.surface
        ]
    if node.events:
        out["events"] = _events_json(node.events)
    return out


def _region_json(region: c.Region) -> dict[str, Any]:
    out: dict[str, Any] = {region.shape: list(region.numbers)}
    return out | ({"unit": region.unit} if region.unit else {})


def _compare_json(node: c.Compare) -> dict[str, Any]:
    out: dict[str, Any] = {"op": "compare", "quantity": node.quantity.word}
    point = getattr(node.quantity, "point", None)
    if point is not None:
        out["of"] = to_json(point)
    out |= {"compare": node.operator, "value": node.value}
    return out | ({"unit": node.unit} if node.unit else {})


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

    def child(self, key: str, value: object) -> c.Criterion:
        return _build(value, f"{self.where}.{key}", self.depth + 1)

    def children(self) -> list[c.Criterion]:
        args = self.get("args", list)
        return [self.child(f"args[{number}]", value) for number, value in enumerate(args)]

    def finish(self) -> None:
        if extra := sorted(set(self.value) - self.used):
            raise CriterionError(f"{self.where} has unknown keys: {', '.join(map(str, extra))}")


def from_json(tree: object) -> c.Criterion:
    """Read a criterion from its JSON tree.

    Raises
    ------
    CriterionError
        naming the place in the tree.
    """
    return _build(tree, "criterion", 0)


def _build(value: object, where: str, depth: int) -> c.Criterion:
    reader = _Reader(value, where, depth)
    op = reader.get("op", str)
    if op not in _BUILDERS:
        raise CriterionError(f"{where}.op is {op!r}; known: {', '.join(_BUILDERS)}")
    try:
        node = _BUILDERS[op](reader, op)
    except CriterionError as error:
        message = str(error)
        raise CriterionError(
            message if message.startswith("criterion") else f"{where}: {message}"
        ) from None
    reader.finish()
    return node


def _nary(reader: _Reader, op: str) -> c.Criterion:
    return _NARY[op](tuple(reader.children()))


def _single(reader: _Reader, op: str) -> c.Criterion:
    args = reader.children()
    if len(args) != 1:
        raise CriterionError(f"{op} takes one argument, found {len(args)}")
    return c.Not(args[0]) if op == "not" else c.Last(args[0])


def _events(reader: _Reader, default: Any = ...) -> tuple[c.EventSet, ...]:
    sets: list[c.EventSet] = []
    for item in reader.get("events", list, default):
        words = item.get("all") if isinstance(item, dict) and set(item) == {"all"} else [item]
        if not isinstance(words, list) or not words or not all(isinstance(w, str) for w in words):
            raise CriterionError(f"{reader.where}.events holds {item!r:.60}, no event word")
        sets.append(tuple(words))
    return tuple(sets)


def _hit(reader: _Reader, op: str) -> c.Criterion:
    tests = []
    for item in reader.get("surface", list, []):
        test = _Reader(item, f"{reader.where}.surface", reader.depth + 1)
        operator = test.get("compare", str)
        if operator not in c.OPERATORS:
            raise CriterionError(f"{test.where}.compare is {operator!r}")
        parameter, number = test.get("parameter", str), test.get("value", (int, float))
        test.finish()
        tests.append(c.SurfaceTest(parameter, operator, number))
    return c.Hit(reader.texts("names", []), tuple(tests), _events(reader, []))


def _detected(reader: _Reader, op: str) -> c.Criterion:
    regions = []
    for item in reader.get("regions", list, []):
        region = _Reader(item, f"{reader.where}.regions", reader.depth + 1)
        shape = "ellipse" if "ellipse" in region.value else "rect"
        numbers, unit = region.get(shape, list), region.get("unit", str, "")
        region.finish()
        regions.append(c.Region(shape, tuple(numbers), unit))
    kind = c.Detected if op == "detected" else c.Crossed
    return kind(reader.texts("names"), tuple(regions))


def _compare(reader: _Reader, op: str) -> c.Criterion:
    word = reader.get("quantity", str)
    if word in ("count", "incidence"):
        point = reader.child("of", reader.get("of", dict))
        quantity: c.Quantity = c.Count(point) if word == "count" else c.Incidence(point)
    elif word in _RECORDED:
        of = reader.get("of", dict, None)
        quantity = _RECORDED[word](None if of is None else reader.child("of", of))
    elif word in _QUANTITIES:
        quantity = _QUANTITIES[word]()
    else:
        raise CriterionError(f"{reader.where}.quantity is {word!r}")
    number = reader.get("value", (int, float))
    return c.Compare(quantity, reader.get("compare", str), number, reader.get("unit", str, ""))


_BUILDERS: dict[str, Callable[[_Reader, str], c.Criterion]] = {
    **dict.fromkeys(_NARY, _nary),
    "not": _single,
    "last": _single,
    "source": lambda reader, op: c.Source(reader.texts("names")),
    "medium": lambda reader, op: c.Medium(reader.texts("names")),
    "hit": _hit,
    "event": lambda reader, op: c.EventAt(_events(reader)),
    "all": lambda reader, op: c.All(tuple(reader.children())),
    "detected": _detected,
    "crossed": _detected,
    "path": lambda reader, op: c.Path(reader.get("text", str), reader.get("exact", bool, False)),
    "compare": _compare,
}

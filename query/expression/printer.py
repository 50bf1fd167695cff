"""Tree to text, so that parsing the text gives the same tree again."""

from __future__ import annotations

from collections.abc import Iterable

from query.expression import criteria as c

__all__ = ["number_text", "quoted", "to_text"]

_PRECEDENCE: dict[type[c.Criterion], int] = {c.Or: 1, c.Xor: 2, c.And: 3, c.Then: 4, c.Not: 5}
_ATOM = 6


def quoted(pattern: str) -> str:
    """A pattern in quotation marks; its own marks get a backslash."""
    return '"' + pattern.replace('"', '\\"') + '"'


def number_text(value: float) -> str:
    """Shortest text of a number that reads back the same."""
    return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)


def to_text(node: c.Criterion) -> str:
    """The criterion in the language of `parse`."""
    if isinstance(node, c.Not):
        return "!" + _inside(node.arg, _PRECEDENCE[c.Not])
    if isinstance(node, c.Or | c.Xor | c.And | c.Then):
        # Nested operators of one kind are merged, so an equal rank needs no brackets.
        own = _PRECEDENCE[type(node)]
        return f" {node.symbol} ".join(_inside(arg, own) for arg in node.args)
    return _atom(node)


def _inside(node: c.Criterion, rank: int) -> str:
    text = to_text(node)
    return f"({text})" if _PRECEDENCE.get(type(node), _ATOM) < rank else text


def _names(names: Iterable[str]) -> list[str]:
    return [quoted(name) for name in names]


def _event_set(words: c.EventSet) -> str:
    return words[0] if len(words) == 1 else f"all({', '.join(words)})"


def _measure(value: float, unit: str) -> str:
    return f"{number_text(value)} {unit}" if unit else number_text(value)


def _region(region: c.Region) -> str:
    numbers = ", ".join(_measure(number, region.unit) for number in region.numbers)
    return f"{region.shape}({numbers})"


def _quantity(quantity: c.Quantity) -> str:
    point = getattr(quantity, "point", None)
    return quantity.word if point is None else f"{quantity.word}({to_text(point)})"


def _atom(node: c.Criterion) -> str:
    if isinstance(node, c.Source):
        return f"source({', '.join(_names(node.names))})"
    if isinstance(node, c.Medium):
        return f"medium({', '.join(_names(node.names))})"
    if isinstance(node, c.Hit):
        tests = [f"{t.parameter} {t.operator} {number_text(t.value)}" for t in node.surface]
        events = [_event_set(words) for words in node.events]
        return f"hit({', '.join(_names(node.names) + tests + events)})"
    if isinstance(node, c.EventAt):
        return f"event({', '.join(_event_set(words) for words in node.events)})"
    if isinstance(node, c.All):
        return f"all({', '.join(to_text(arg) for arg in node.args)})" if node.args else "all"
    if isinstance(node, c.Detected):
        regions = [_region(region) for region in node.regions]
        return f"{node.word}({', '.join(_names(node.names) + regions)})"
    if isinstance(node, c.Last):
        return f"last({to_text(node.point)})"
    if isinstance(node, c.Path):
        text = quoted(node.text)
        return f"path({text}, exact)" if node.exact else f"path({text})"
    if isinstance(node, c.Compare):
        measure = _measure(node.value, node.unit)
        return f"{_quantity(node.quantity)} {node.operator} {measure}"
    raise TypeError(f"no text for {type(node).__name__}")

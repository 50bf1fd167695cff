"""Optical parameters of surfaces as criteria compare them.

A parameter may stand for both sides of a surface, or in a table of its own for each side. One that
varies with wavelength satisfies a comparison if it does so in some channel. Nested parameters also
go by their full name, such as ``scatter.roughness``.
"""

from __future__ import annotations

import operator as op
from collections.abc import Callable, Sequence
from typing import Any

from query.expression.arguments import SurfaceTest

__all__ = ["COMPARISONS", "passes", "sides_of"]

COMPARISONS: dict[str, Callable[[Any, Any], Any]] = {
    "==": op.eq,
    "!=": op.ne,
    "<": op.lt,
    "<=": op.le,
    ">": op.gt,
    ">=": op.ge,
}

Side = dict[str, tuple[float, ...]]
"""Values of each parameter, one per channel where it varies."""


def sides_of(parameters: dict[str, Any]) -> list[Side]:
    """The parameters of a surface, per side."""
    common: Side = {}
    sides: list[Side] = []
    for name, value in parameters.items():
        numbers = _numbers(value)
        if numbers:
            common[name] = numbers
            continue
        nested = [value] if isinstance(value, dict) else value
        if not isinstance(nested, list | tuple):
            continue
        for table in nested:
            if isinstance(table, dict):
                inner = sides_of(table)
                common |= {f"{name}.{key}": found for key, found in inner[0].items()}
                sides += inner
    return [common, *(common | side for side in sides)]


def passes(side: Side, tests: Sequence[SurfaceTest]) -> bool:
    """Whether one side satisfies all comparisons."""
    return all(
        any(COMPARISONS[test.operator](x, test.value) for x in side.get(test.parameter, ()))
        for test in tests
    )


def _numbers(value: Any) -> tuple[float, ...]:
    """A number, or the values of something that varies with wavelength; else nothing."""
    if isinstance(value, dict):
        if "rgb" in value:
            return _numbers(value["rgb"])
        return _numbers(value["value"]) if {"wavelength_nm", "value"} <= set(value) else ()
    items = value if isinstance(value, list | tuple) else [value]
    if not items or not all(isinstance(x, int | float) and not isinstance(x, bool) for x in items):
        return ()
    return tuple(float(x) for x in items)

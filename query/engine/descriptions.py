"""Things placed after the trace, as people write them: ``plane(z=120, size=[36, 24])``."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.expression.names import nearest_names
from raymap.model.errors import RayMapError

__all__ = ["LARGEST", "across", "described", "flat_place", "number", "pair", "three", "vector"]

F64 = NDArray[np.float64]
LARGEST = 1e15
"""Largest coordinate."""


def described(
    text: str, kind: str, keys: Mapping[str, tuple[str, ...]], examples: Mapping[str, str]
) -> tuple[str, dict[str, Any]]:
    """The word before the brackets, and the values between them by key.

    Parameters
    ----------
    kind : what is described, for messages
    keys, examples : by word

    Raises
    ------
    RayMapError
    """
    match = re.fullmatch(rf"\s*({'|'.join(keys)})\s*\((.*)\)\s*", text, re.DOTALL)
    if match is None:
        example = next(iter(examples.values()))
        raise RayMapError(f"{text!r} describes no {kind} ({', '.join(keys)}); write {example}")
    word, inside = match.groups()
    try:
        values: dict[str, Any] = tomllib.loads(f"v = {{{inside}}}")["v"]
    except (ValueError, RecursionError):
        raise RayMapError(
            f"{text!r} cannot be read; write NAME=VALUE between commas, as {examples[word]}"
        ) from None
    for key in values:
        if key not in keys[word]:
            near = nearest_names(key, keys[word])
            hint = f"; nearest: {', '.join(near)}" if near else ""
            raise RayMapError(
                f"{text}: a {word} has no {key}{hint}; it takes {', '.join(keys[word])}"
            )
    return word, values


def flat_place(text: str, values: dict[str, Any], facing: str) -> tuple[F64, F64, F64 | None]:
    """Center, normal and stated direction of what lies at x, y or z, or about a center.

    Parameters
    ----------
    facing : the key that states the direction, None in the answer where it is left out
    """
    axes = [key for key in "xyz" if key in values]
    if len(axes) + ("center" in values) != 1:
        raise RayMapError(f"{text}: say where it is by one of x, y, z or center")
    looks = None if facing not in values else vector(text, facing, values[facing], unit=True)
    if not axes:
        center = vector(text, "center", values["center"])
        if looks is None:
            raise RayMapError(f"{text}: {facing} is missing, the direction that it faces")
        return center, looks, looks
    axis = "xyz".index(axes[0])
    center = np.zeros(3)
    center[axis] = number(text, axes[0], values[axes[0]], -LARGEST, LARGEST)
    normal = np.zeros(3)
    normal[axis] = 1.0
    if looks is not None and abs(looks[axis]) < 1.0 - 1e-9:
        raise RayMapError(f"{text}: it looks along {axes[0]}; give center for other directions")
    return center, normal if looks is None else looks, looks


def vector(text: str, key: str, value: Any, *, unit: bool = False) -> F64:
    sound = (
        isinstance(value, list)
        and len(value) == 3
        and all(isinstance(x, int | float) and not isinstance(x, bool) for x in value)
        and all(abs(x) <= LARGEST for x in value)
    )
    if not sound:
        raise RayMapError(f"{text}: {key} is three numbers, [x, y, z]")
    vector = np.asarray(value, np.float64)
    if not unit:
        return vector
    length = float(np.linalg.norm(vector))
    if not length > 0.0:
        raise RayMapError(f"{text}: {key} has no direction")
    return np.asarray(vector / length)


def three(vector: F64) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z


def number(text: str, key: str, value: Any, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise RayMapError(f"{text}: {key} is a number, not {value!r:.40}")
    if not low <= value <= high:
        raise RayMapError(f"{text}: {key} lies from {low:g} to {high:g}")
    return float(value)


def pair(text: str, key: str, value: Any, low: float, high: float) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2:
        raise RayMapError(f"{text}: {key} is two numbers, as [36, 24]")
    first, second = (number(text, key, each, low, high) for each in value)
    return first, second


def across(axis: F64, up: F64 | None, text: str) -> tuple[F64, F64]:
    """Unit vectors u and v across an axis, v along ``up`` (+y, or +z where the axis is along y)."""
    if up is None:
        up = np.array([0.0, 1.0, 0.0])
        if abs(axis[1]) > 1.0 - 1e-12:
            up = np.array([0.0, 0.0, 1.0])
    v = up - (up @ axis) * axis
    length = float(np.linalg.norm(v))
    if length < 1e-9:
        raise RayMapError(f"{text}: up lies along the direction that it looks")
    v = v / length
    return np.cross(v, axis), v

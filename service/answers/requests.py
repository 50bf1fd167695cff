"""One request: a JSON object whose keys are known, typed and bounded."""

from __future__ import annotations

import math
from typing import Any

from raymap.model.errors import CriterionError, RayMapError
from raymap.model.giventext import json_value
from service.limits import Limits

__all__ = ["BadRequest", "Request"]


class BadRequest(RayMapError, ValueError):
    """A request that the service does not understand."""


class Request:
    """The fields of a request, taken out one by one; `finish` refuses what is left.

    Raises
    ------
    BadRequest
        It is too large, no JSON object, or holds what cannot be.
    """

    def __init__(self, body: bytes, limits: Limits, what: str) -> None:
        self.limits, self.what = limits, what
        if len(body) > limits.request_bytes:
            raise BadRequest(
                f"{what}: the request has {len(body)} bytes, at most {limits.request_bytes} are "
                "taken"
            )
        try:
            fields = json_value(body) if body else {}
        except ValueError as error:
            raise BadRequest(f"{what}: the request is no JSON: {error}") from None
        if not isinstance(fields, dict):
            raise BadRequest(f"{what}: a request is a JSON object, not {type(fields).__name__}")
        self._fields: dict[str, Any] = fields

    def fields(self) -> dict[str, Any]:
        """What was sent, not yet checked."""
        return dict(self._fields)

    def _take(self, key: str, kind: type | tuple[type, ...], expected: str, default: Any) -> Any:
        value = self._fields.pop(key, None)
        if value is None:
            if default is ...:
                raise BadRequest(f"{self.what}: {key!r} is missing: {expected}")
            return default
        if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
            raise BadRequest(f"{self.what}: {key!r} must be {expected}, not {_short(value)}")
        return value

    def text(self, key: str, default: Any = ...) -> Any:
        """A text."""
        return self._take(key, str, "a text", default)

    def flag(self, key: str) -> bool:
        """true or false; false where it is missing."""
        return bool(self._take(key, bool, "true or false", False))

    def whole(self, key: str, least: int, most: int, default: Any = ...) -> Any:
        """A whole number within bounds."""
        value = self._take(key, int, "a whole number", default)
        if value is not default and not least <= value <= most:
            raise BadRequest(f"{self.what}: {key!r} must be {least} to {most}, not {_short(value)}")
        return value

    def number(self, key: str, least: float, most: float, default: Any = ...) -> Any:
        """A number within bounds."""
        value = self._take(key, (int, float), "a number", default)
        if value is not default and not (math.isfinite(value) and least <= value <= most):
            raise BadRequest(f"{self.what}: {key!r} must be {least:g} to {most:g}, not {value}")
        return value if value is default else float(value)

    def texts(self, key: str) -> list[str]:
        """A list of texts; empty where it is missing."""
        values = self._take(key, list, "a list of texts", [])
        if len(values) > 1000 or not all(isinstance(value, str) for value in values):
            raise BadRequest(f"{self.what}: {key!r} must be a list of texts")
        return list(values)

    def choice(self, key: str, choices: tuple[str, ...], default: Any = ...) -> str:
        """One of some words."""
        value = self.text(key, default)
        if value not in choices:
            raise BadRequest(
                f"{self.what}: {key!r} must be one of {', '.join(choices)}, not {_short(value)}"
            )
        return str(value)

    def criterion(self, key: str = "criterion") -> Any:
        """A criterion as text or JSON, None for every ray; read, and bounded before.

        Raises
        ------
        CriterionError
        """
        value = self._take(key, (str, dict), "a criterion: text or JSON", None)
        if value is None or value == "":
            return None
        most = self.limits.criterion_characters
        if isinstance(value, str) and len(value) > most:
            raise CriterionError(
                f"the criterion has {len(value)} characters, this service takes at most {most}"
            )
        if isinstance(value, dict) and _nodes(value, most // 10) > most // 10:
            raise CriterionError(
                f"the criterion has more than the {most // 10} nodes that this service takes"
            )
        from query import as_criterion

        try:
            return as_criterion(value)
        except RecursionError:
            raise CriterionError("the criterion nests too deeply") from None

    def finish(self) -> None:
        """Refuse keys that nobody asked for."""
        if self._fields:
            unknown = ", ".join(repr(str(key)[:40]) for key in list(self._fields)[:5])
            raise BadRequest(f"{self.what}: unknown keys: {unknown}")


def _nodes(value: Any, most: int) -> int:
    """Values of a JSON tree, counted without recursion, up to a little more than ``most``."""
    count, waiting = 0, [value]
    while waiting and count <= most:
        item = waiting.pop()
        count += 1
        if isinstance(item, dict):
            waiting.extend(item.values())
        elif isinstance(item, list):
            waiting.extend(item)
    return count


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else text[:40] + "…"

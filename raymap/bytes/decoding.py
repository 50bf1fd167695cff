"""Whatever fails while the bytes of a portion are decoded is damage of that portion."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, TypeVar, cast

from raymap.model.errors import RayMapError

__all__ = ["FOREIGN", "decodes"]

FOREIGN = (
    ArithmeticError,
    AttributeError,
    BufferError,
    LookupError,
    MemoryError,
    RecursionError,
    TypeError,
    ValueError,
)
"""What Python, NumPy, compiled loops and decoders raise at values that nobody foresaw."""

F = TypeVar("F", bound=Callable[..., Any])


def decodes(method: F) -> F:
    """A method of a stored portion from which only the project's own errors come."""

    @functools.wraps(method)
    def decoded(portion: Any, *args: Any, **kwargs: Any) -> Any:
        try:
            return method(portion, *args, **kwargs)
        except RayMapError:
            raise
        except FOREIGN as error:
            what = str(error) or type(error).__name__
            raise portion.map.report_damage(
                portion.index, f"its values cannot be decoded ({type(error).__name__}: {what})"
            ) from error

    return cast(F, decoded)

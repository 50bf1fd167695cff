"""Ask once more, of the portions alone, where the footer turns out to contradict them."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar, cast

from raymap.file.agreement import FalseFooter

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["asked_again"]

F = TypeVar("F", bound=Callable[..., Any])


def asked_again(function: F) -> F:
    """A question to a map, its first argument, that survives a false footer.

    A large map's merged dictionary is compared with each portion when that one is read. At the
    first difference the map drops the dictionary; the question starts anew without it.
    """

    @functools.wraps(function)
    def asked(map: RayMap, *args: Any, **kwargs: Any) -> Any:
        # Every file of several can have a false footer, and drops it once
        for _ in map.shards:
            try:
                return function(map, *args, **kwargs)
            except FalseFooter:
                continue
        return function(map, *args, **kwargs)

    return cast(F, asked)

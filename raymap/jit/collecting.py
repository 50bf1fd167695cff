"""Work that makes millions of objects and no garbage: none is looked for among them meanwhile."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["no_collecting"]


@contextmanager
def no_collecting() -> Iterator[None]:
    """Stop the search for cycles of garbage, and go on with it afterwards if it went on before.

    Python looks through all objects each time that their number has grown by a quarter: compilers
    and readers of large scenes spend a third of their time so, and find nothing.
    """
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()

"""Ask a kind of another distribution: what it gets wrong is an error of its own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from raymap.model.errors import RayMapError, SceneError
from raymap.rooms import ROOMS

__all__ = ["asking"]

_MOST = 200
"""Characters of a message that is handed on."""


@contextmanager
def asking(kind: Any, place: str) -> Iterator[None]:
    """What a kind of another distribution raises, or answers in a wrong form, in one line.

    Parameters
    ----------
    kind : an instance of it, or a function of its module; of our own kinds nothing is changed
    place : in the scene, for messages

    Raises
    ------
    SceneError
        naming place, module and what was wrong
    """
    module = str(kind.__module__)
    try:
        yield
    except RayMapError:
        raise
    except Exception as error:
        if module.partition(".")[0] in ROOMS:
            raise
        said = " ".join(str(error).split())
        said = said if len(said) <= _MOST else said[: _MOST - 1] + "…"
        raise SceneError(
            f"{place}: {module} answers what cannot be taken ({type(error).__name__}: {said}); "
            "mend that module, or upgrade or uninstall its distribution"
        ) from error

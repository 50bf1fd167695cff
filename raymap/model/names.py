"""What a user may have meant by a name that is not known."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

__all__ = ["meant", "nearest_names"]


def meant(name: str, known: Iterable[str]) -> str:
    """'; did you mean …', empty where nothing is near."""
    close = difflib.get_close_matches(name, list(known), n=2, cutoff=0.6)
    return f"; did you mean {' or '.join(repr(item) for item in close)}?" if close else ""


def nearest_names(name: str, known: Iterable[str]) -> str:
    """'; did you mean …', or the list of what there is."""
    names = list(known)
    if close := meant(name, names):
        return close
    return f"; known are {', '.join(names)}" if names else "; there are none"

"""STEP files as text, looked at before OpenCASCADE reads them.

OpenCASCADE goes down lists within lists, entities that refer to entities, and assemblies by calling
itself: a small file that nests them deeply enough ends the process, and one whose assemblies double
at each level never ends. Both are seen here in time proportional to the file.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import SceneError

__all__ = ["check_step_text"]

Ints = NDArray[np.int64]

_DEEPEST_LIST = 64
_LONGEST_CHAIN = 256
"""Entities of which each refers to the next. Files of CAD programs have a few tens."""
_PARTS_FLOOR, _BYTES_PER_PART = 4096, 256
"""Parts that a file places: each takes milliseconds to read."""
_BLOCK = 2**24

_WORDS = re.compile(rb"'[^']*(?:'|\Z)|/\*(?:.*?\*/|.*)", re.DOTALL)
"""Texts and comments; what is not closed goes to the end, so that no place is looked at twice."""
_NAMED = re.compile(rb"#([0-9]{1,18})\s*(=?)")
_PLACED = re.compile(
    rb"NEXT_ASSEMBLY_USAGE_OCCURRENCE\s*\([^#;()]*#([0-9]{1,18})[^#;()]*#([0-9]{1,18})",
    re.IGNORECASE,
)


def check_step_text(origin: str, content: bytes) -> None:
    """Refuse a file that is nested deeper, or places more parts, than a reader can take.

    Raises
    ------
    SceneError
    """
    plain = _WORDS.sub(b"", content)
    if _deepest_list(plain) > _DEEPEST_LIST:
        raise SceneError(
            f"{origin}: nests lists more than {_DEEPEST_LIST} deep: it is damaged; export it again"
        )
    placed = np.array(_PLACED.findall(plain), np.bytes_).astype(np.int64).reshape(-1, 2)
    levels = _levels(np.concatenate((_references(plain), placed)))
    if levels is None:
        raise SceneError(f"{origin}: entities refer to each other in a ring; export it again")
    if levels > _LONGEST_CHAIN:
        raise SceneError(
            f"{origin}: entities refer to each other more than {_LONGEST_CHAIN} deep; export it "
            "again, with fewer levels of assemblies"
        )
    most = max(_PARTS_FLOOR, len(content) // _BYTES_PER_PART)
    parts = _parts(placed)
    if parts > most:
        raise SceneError(
            f"{origin}: its assemblies place {parts:.4g} parts; a file of {len(content):,} bytes "
            f"may place {most:,}: export fewer copies, and place them by copies in the scene"
        )


def _deepest_list(plain: bytes) -> int:
    """The most parentheses that are open at a time."""
    letters = np.frombuffer(plain, np.uint8)
    depth = deepest = 0
    for first in range(0, len(letters), _BLOCK):
        part = letters[first : first + _BLOCK]
        steps = (part == ord("(")).astype(np.int8) - (part == ord(")"))
        depths = depth + np.cumsum(steps, dtype=np.int32)
        deepest, depth = max(deepest, int(depths.max())), int(depths[-1])
    return deepest


def _references(plain: bytes) -> Ints:
    """(n, 2) numbers of an entity and of one that it refers to."""
    found = _NAMED.findall(plain)
    if not found:
        return np.zeros((0, 2), np.int64)
    numbers = np.array([number for number, _ in found], np.bytes_).astype(np.int64)
    owns = np.array([bool(sign) for _, sign in found])
    # What stands before the first entity belongs to none
    owner = np.maximum.accumulate(np.where(owns, np.arange(len(owns)), -1))
    refers = ~owns & (owner >= 0)
    return np.stack((numbers[owner[refers]], numbers[refers]), axis=1)


def _numbered(edges: Ints) -> tuple[NDArray[Any], NDArray[Any], int]:
    """Ends of edges as places in a list of all that they name, and its length."""
    names, places = np.unique(edges, return_inverse=True)
    ends = places.reshape(edges.shape)
    return ends[:, 0], ends[:, 1], len(names)


def _levels(edges: Ints) -> int | None:
    """Length of the longest chain, not looked for beyond `_LONGEST_CHAIN`; None: a ring."""
    above, below, n = _numbered(edges)
    level = 0
    while len(above) and level <= _LONGEST_CHAIN:
        # Whatever nobody refers to any more is done
        waits = np.zeros(n, np.bool_)
        waits[below] = True
        keeps = waits[above]
        if keeps.all():
            return None
        above, below = above[keeps], below[keeps]
        level += 1
    return level


def _parts(placed: Ints) -> float:
    """Leaves of the tree that assemblies without rings unfold to."""
    if not len(placed):
        return 0.0
    above, below, n = _numbered(placed)
    times = np.ones(n)
    inner = np.zeros(n, np.bool_)
    inner[above] = True
    times[inner] = 0.0
    roots = ~np.isin(np.arange(n), below)
    # Leaves below each, from those below its parts, level by level
    for _ in range(_LONGEST_CHAIN + 1):
        times = np.where(inner, np.bincount(above, times[below], n), 1.0).clip(max=1e18)
    return float(times[roots].sum())

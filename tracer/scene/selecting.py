"""Which bodies, sources and detectors of a scene take part in a simulation.

``use`` and ``leave_out`` are lists of names with ``*`` and ``?``. A kind (bodies, sources,
detectors) of which no pattern of ``use`` speaks stays whole.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any

from raymap.model.errors import SceneError
from raymap.model.wildcards import Wildcard
from tracer.description.fields import Node

__all__ = ["KINDS", "Selecting", "SimulationModel", "select_parts"]

KINDS = ("bodies", "sources", "detectors")


class Selecting(Node):
    """What a map remembers: the simulation's name, its patterns, and what did not take part."""

    simulation: str = ""
    use: tuple[str, ...] = ()
    leave_out: tuple[str, ...] = ()
    left_out: dict[str, tuple[str, ...]] = {}


class SimulationModel(Node):
    """``[simulations.NAME]``: what takes part, and which variants are laid over the scene."""

    use: tuple[str, ...] | None = None
    leave_out: tuple[str, ...] = ()
    variants: tuple[str, ...] = ()


def select_parts(
    tree: dict[str, Any],
    use: Iterable[str] | None,
    leave_out: Iterable[str],
    *,
    simulation: str,
    origin: str,
) -> Selecting:
    """Drop from the tables of a scene what does not take part.

    Raises
    ------
    SceneError
        for a pattern that matches nothing, with the nearest names
    """
    names = {kind: list(tree.get(kind, {})) for kind in KINDS}
    where = f"simulations.{simulation}." if simulation else ""
    taken = {kind: set(known) for kind, known in names.items()}
    patterns = tuple(use or ())
    spoken: dict[str, set[str]] = {}
    for pattern in patterns:
        for kind, matched in _matches(pattern, names, f"{origin}: {where}use").items():
            spoken.setdefault(kind, set()).update(matched)
    taken |= spoken
    leave_out = tuple(leave_out)
    for pattern in leave_out:
        for kind, matched in _matches(pattern, names, f"{origin}: {where}leave_out").items():
            taken[kind] = taken[kind] - matched
    left_out = {}
    for kind, known in names.items():
        gone = tuple(name for name in known if name not in taken[kind])
        if gone:
            left_out[kind] = gone
            tree[kind] = {name: tree[kind][name] for name in known if name in taken[kind]}
    return Selecting(simulation=simulation, use=patterns, leave_out=leave_out, left_out=left_out)


def _matches(pattern: str, names: Mapping[str, list[str]], where: str) -> dict[str, set[str]]:
    """Names of each kind that a pattern means; kinds of which it means none are left away."""
    wanted = Wildcard(pattern, escapes=False)
    found = {
        kind: {name for name in known if wanted.matches(name)} for kind, known in names.items()
    }
    found = {kind: matched for kind, matched in found.items() if matched}
    if not found:
        every = [name for known in names.values() for name in known]
        near = difflib.get_close_matches(pattern, every, n=2, cutoff=0.5)
        hint = f"; did you mean {' or '.join(map(repr, near))}?" if near else ""
        raise SceneError(
            f"{where}: no body, source or detector is called {pattern!r}{hint or '; there are '}"
            + ("" if hint else ", ".join(every))
        )
    return found

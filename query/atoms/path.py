"""``path("lamp .* @sensor")``: a regular expression over the whole itinerary."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from query.engine.bind import Binder, Misfit
from query.engine.bound import BoundNode
from query.engine.context import Context
from query.engine.kleene import Bools, Pair, exactly
from query.engine.path_machine import PRINCIPAL, PathMachine, bind_path
from query.engine.path_matching import match_path
from query.expression.arguments import Flag, Text
from query.expression.atom import Condition
from query.expression.automaton import canonical_path, parse_path
from raymap.model.errors import UnknownName

__all__ = ["KINDS", "Path", "path"]


@dataclass(frozen=True)
class Path(Condition):
    """A regular expression over the whole itinerary.

    ``exact``: the events of each point and the registrations between points are exactly the ones
    written, as the rows of path tables write them.
    """

    text: str
    exact: bool = False

    word = "path"
    title = "the whole itinerary"
    arguments = (
        Text(example="lamp .* @eye", help="regular expression over the itinerary"),
        Flag(name="exact", help="events and registrations are exactly those written"),
    )
    place = 90

    def __post_init__(self) -> None:
        object.__setattr__(self, "text", canonical_path(self.text))
        parse_path(self.text)

    def bind(self, binder: Binder, text: str) -> BoundNode:
        try:
            machine = bind_path(self.text, self.exact, binder.directory, binder.names)
        except UnknownName as error:
            name = str(error).split('"')[1] if '"' in str(error) else self.text
            raise Misfit(error, name) from None
        return BoundPath(text=text, machine=machine)


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundPath(BoundNode):
    """``machine`` : the automaton; monotone in what fits, so each side of a pair is one run."""

    machine: PathMachine

    def own_streams(self) -> tuple[str, ...]:
        return ("triangle",) if self.machine.needs_triangles else ()

    def on_rays(self, context: Context) -> Pair:
        machine = self.machine
        triangle = context.triangle if machine.needs_triangles else None
        columns = context.columns(
            face=machine.needs_faces, event=machine.needs_events, crossings=machine.needs_detectors
        )
        known = np.empty(0, np.int32) if triangle is None else triangle

        def run(triangle_mode: int) -> Bools:
            return match_path(columns, known, triangle_mode, machine, PRINCIPAL)

        if not machine.needs_triangles:
            return exactly(run(0))
        if triangle is not None:
            return exactly(run(2))
        return Pair(run(0), run(1))


def path(expression: str, exact: bool = False) -> Path:
    """Regular expression over the whole itinerary."""
    return Path(expression, exact)


KINDS = (Path,)

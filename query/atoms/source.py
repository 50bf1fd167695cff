"""``source("lamp")``: emitted by one of the named sources."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from query.engine.bind import Binder
from query.engine.bound import BoundNode
from query.engine.context import Context
from query.engine.kleene import Bools, Pair, exactly
from query.engine.scans import look_up
from query.expression.arguments import Names
from query.expression.atom import Condition
from query.expression.words import canonical_names

__all__ = ["KINDS", "Source", "source"]


@dataclass(frozen=True)
class Source(Condition):
    """Emitted by one of the named sources."""

    names: tuple[str, ...]

    word = "source"
    title = "emitted by a source"
    phrase = "emitted by"
    arguments = (Names(of="source", help="names of sources"),)
    place = 40

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", canonical_names(self.names, self.word))

    def bind(self, binder: Binder, text: str) -> BoundNode:
        names = [source.name for source in binder.directory.sources]
        return BoundSource(text=text, table=binder.table(self.names, names, "source")[:-1])


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundSource(BoundNode):
    """``table`` : (n_sources,) bool."""

    table: Bools

    def on_rays(self, context: Context) -> Pair:
        return exactly(look_up(self.table, context.source))

    def never(self, map: Any) -> str | None:
        if map.emitted[self.table].any():
            return None
        return f"{self.text}: this source emitted no ray in this map"


def source(*names: str) -> Source:
    """Emitted by one of these sources."""
    return Source(names)


KINDS = (Source,)

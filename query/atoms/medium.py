"""``medium("glass")``: travelled in one of the named media."""

from __future__ import annotations

from dataclasses import dataclass

from query.engine.bind import Binder
from query.engine.bound import BoundNode
from query.engine.context import Context
from query.engine.kleene import Bools, Pair, exactly
from query.engine.scans import look_up
from query.expression.arguments import Names
from query.expression.atom import Condition
from query.expression.words import canonical_names

__all__ = ["KINDS", "Medium", "medium"]


@dataclass(frozen=True)
class Medium(Condition):
    """Travelled in one of the named media."""

    names: tuple[str, ...]

    word = "medium"
    title = "travelled in a medium"
    phrase = "travelled in"
    arguments = (Names(of="medium", help="names of media"),)
    place = 60

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", canonical_names(self.names, self.word))

    def bind(self, binder: Binder, text: str) -> BoundNode:
        names = [medium.name for medium in binder.directory.media]
        return BoundMedium(text=text, table=binder.table(self.names, names, "medium"))


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundMedium(BoundNode):
    """``table`` : (n_media + 1,) bool."""

    table: Bools

    def on_rays(self, context: Context) -> Pair:
        # No segment starts at the last point
        return exactly(context.points.any_before_last(look_up(self.table, context.medium)))


def medium(*names: str) -> Medium:
    """Travelled in one of these media."""
    return Medium(names)


KINDS = (Medium,)

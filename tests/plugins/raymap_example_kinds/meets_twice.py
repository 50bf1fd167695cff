"""``meets_twice("L*")``: some object of these names is met at two points or more."""

from __future__ import annotations

from dataclasses import dataclass

from query.engine.bind import Binder
from query.engine.bound import BoundNode
from query.engine.context import Context
from query.engine.kleene import Bools, Pair, exactly
from query.expression.arguments import Names
from query.expression.atom import Condition
from query.expression.words import canonical_names

__all__ = ["KINDS", "MeetsTwice"]


@dataclass(frozen=True)
class MeetsTwice(Condition):
    """One and the same object is met at two points or more."""

    names: tuple[str, ...]

    word = "meets_twice"
    title = "one object met at two points or more"
    phrase = "met twice"
    arguments = (Names(of="place", help="names of objects"),)

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", canonical_names(self.names, self.word))

    def bind(self, binder: Binder, text: str) -> BoundNode:
        objects = [item.name for item in binder.directory.objects]
        return BoundMeetsTwice(text=text, table=binder.table(self.names, objects, "object"))


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundMeetsTwice(BoundNode):
    """The path knows; ``table`` : (n_objects + 1,) bool."""

    table: Bools

    def on_rays(self, context: Context) -> Pair:
        found = None
        for number in self.table[:-1].nonzero()[0].tolist():
            twice = context.points.count(context.object == number) >= 2
            found = twice if found is None else found | twice
        assert found is not None
        return exactly(found)


KINDS = (MeetsTwice,)

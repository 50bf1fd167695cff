"""Examples that Hypothesis draws: few and the same each time, or under `wide` many by chance.

A test that has reason to draw fewer or more than others says so with `examples`, a share of what
the profile draws: a number of its own would undo the profile.
"""

from __future__ import annotations

from hypothesis import settings

__all__ = ["examples", "register_profiles"]

DEFAULT = 100
WIDE = 2_000


def register_profiles() -> None:
    """`default` gives the same verdict to everybody; `wide` looks for what it does not meet.

    No example has a deadline: times belong to the machine.
    """
    settings.register_profile("default", derandomize=True, deadline=None, max_examples=DEFAULT)
    settings.register_profile("wide", derandomize=False, deadline=None, max_examples=WIDE)
    settings.load_profile("default")


def examples(number: int) -> int:
    """What `number` of the hundred examples of the default run are under the profile in use."""
    return max(1, number * settings.default.max_examples // DEFAULT)

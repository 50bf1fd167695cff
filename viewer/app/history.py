"""What was shown before: steps back and forth over criterion, paths, camera and visibility."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from viewer.drawn.state import ViewState

__all__ = ["MOST_STEPS", "History"]

FIELDS = ("criterion", "paths", "camera", "up", "hidden", "opacities", "section", "clip")
"""What a step takes back; colours, panels and the like stay as they are."""

MOST_STEPS = 200

TOGETHER_SECONDS = 1.0
"""Changes of the same field that follow one another so soon are one step: typing, the wheel."""


@dataclass(frozen=True, kw_only=True)
class _Step:
    values: dict[str, Any]
    changed: frozenset[str]
    at: float


class History:
    """Steps of one session.

    Parameters
    ----------
    state : where it begins
    """

    def __init__(self, state: ViewState) -> None:
        self._steps = [_Step(values=_values(state), changed=frozenset(), at=float("-inf"))]
        self._place = 0

    @property
    def can_undo(self) -> bool:
        return self._place > 0

    @property
    def can_redo(self) -> bool:
        return self._place + 1 < len(self._steps)

    def note(self, state: ViewState, now: float) -> None:
        """A state is shown; what had been undone is lost where it is a new one.

        Parameters
        ----------
        now : seconds of a clock that only rises
        """
        last, values = self._steps[self._place], _values(state)
        changed = frozenset(name for name in FIELDS if values[name] != last.values[name])
        if not changed:
            return
        del self._steps[self._place + 1 :]
        if changed == last.changed and now - last.at < TOGETHER_SECONDS:
            self._steps.pop()
        self._steps.append(_Step(values=values, changed=changed, at=now))
        del self._steps[: max(0, len(self._steps) - MOST_STEPS)]
        self._place = len(self._steps) - 1

    def undo(self, state: ViewState) -> ViewState:
        """The state one step back; the same where there is none."""
        return self._go(state, -1)

    def redo(self, state: ViewState) -> ViewState:
        """The state that the last step back left; the same where there is none."""
        return self._go(state, 1)

    def _go(self, state: ViewState, step: int) -> ViewState:
        self._place = min(max(self._place + step, 0), len(self._steps) - 1)
        return replace(state, **self._steps[self._place].values)


def _values(state: ViewState) -> dict[str, Any]:
    return {name: getattr(state, name) for name in FIELDS}

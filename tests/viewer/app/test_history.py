"""Steps back and forth, without a page."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from viewer.app.history import FIELDS, MOST_STEPS, History
from viewer.drawn.state import Camera, ViewState

CHANGES = st.lists(
    st.tuples(st.sampled_from(["criterion", "hidden", "up", "width", "color"]), st.integers(0, 3)),
    max_size=12,
)
VALUES = {
    "criterion": ["", 'hit("a")', 'hit("b")', 'hit("c")'],
    "hidden": [(), ("a",), ("b",), ("a", "b")],
    "up": ["y", "z", "x", "y"],
    "width": [1.0, 2.0, 3.0, 4.0],
    "color": ["natural", "path", "source", "ending"],
}


@given(CHANGES)
def test_going_all_the_way_back_and_forth_shows_every_state_again(
    changes: list[tuple[str, int]],
) -> None:
    state = ViewState()
    history, shown = History(state), [state]
    for number, (name, which) in enumerate(changes):
        state = replace(state, **{name: VALUES[name][which]})
        history.note(state, 10.0 * number)
        if any(getattr(state, field) != getattr(shown[-1], field) for field in FIELDS):
            shown.append(state)
    now = state
    for before in shown[-2::-1]:
        assert history.can_undo
        now = history.undo(now)
        assert all(getattr(now, field) == getattr(before, field) for field in FIELDS)
        # What is shown after a step back is no step of its own
        history.note(now, 1e3)
    assert not history.can_undo
    assert history.undo(now) == now
    for after in shown[1:]:
        assert history.can_redo
        now = history.redo(now)
        assert all(getattr(now, field) == getattr(after, field) for field in FIELDS)
    assert not history.can_redo
    # Width and colour stay as they were last
    assert (now.width, now.color) == (state.width, state.color)


def test_what_was_undone_is_lost_when_something_else_is_shown() -> None:
    history = History(ViewState())
    history.note(ViewState(criterion="a"), 0)
    history.note(ViewState(criterion="b"), 10)
    assert history.undo(ViewState(criterion="b")).criterion == "a"
    history.note(ViewState(criterion="c"), 20)
    assert not history.can_redo
    assert history.undo(ViewState(criterion="c")).criterion == "a"


def test_typing_and_the_wheel_are_one_step() -> None:
    history = History(ViewState())
    for number, text in enumerate(("h", "hi", "hit")):
        history.note(ViewState(criterion=text), 0.2 * number)
    assert history.undo(ViewState(criterion="hit")).criterion == ""
    assert not history.can_undo


def test_steps_are_bounded() -> None:
    history, state = History(ViewState()), ViewState()
    for number in range(2 * MOST_STEPS):
        camera = Camera(position=(1, 0, 0), focal_point=(0, 0, 0), view_up=(0, 1, 0),
                        height=number + 1.0)  # fmt: skip
        state = ViewState(camera=camera)
        history.note(state, 10.0 * number)
    steps = 0
    while history.can_undo:
        state = history.undo(state)
        steps += 1
    assert steps == MOST_STEPS - 1

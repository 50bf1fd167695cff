"""The session as plain values: what is written reads back, what is wrong is named."""

from __future__ import annotations

import contextlib
import json
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from viewer.drawn.state import (
    COLOR_RULES,
    Camera,
    Clip,
    Section,
    StateError,
    ViewState,
    load_state,
    save_state,
    state_from_address,
    state_from_json,
    state_to_address,
    state_to_json,
)

numbers = st.floats(-1e6, 1e6, allow_nan=False)
vectors = st.tuples(numbers, numbers, numbers)
cameras = st.builds(
    Camera,
    position=st.just((1.0, 2.0, 3.0)),
    focal_point=st.just((0.0, 0.0, 0.5)),
    view_up=st.just((0.0, 1.0, 0.0)),
    height=st.floats(0.01, 1e6),
    parallel=st.booleans(),
)
states = st.builds(
    ViewState,
    criterion=st.text(max_size=60),
    rays=st.integers(1, 10**6),
    color=st.sampled_from(COLOR_RULES),
    width=st.floats(0.1, 10),
    opacity=st.floats(0, 1),
    fade=st.booleans(),
    opacities=st.dictionaries(st.text(max_size=8), st.floats(0, 1), max_size=4),
    hidden=st.lists(st.text(max_size=8), max_size=4).map(tuple),
    camera=st.none() | cameras,
    section=st.builds(Section, on=st.booleans(), normal=vectors, offset=numbers),
    clip=st.builds(Clip, after=st.integers(0, 99), until=st.integers(0, 99)),
    paths=st.lists(st.text(max_size=30), max_size=3).map(tuple),
    ray=st.none() | st.integers(0, 2**62),
    point=st.none() | st.integers(0, 1000),
)


@given(states)
def test_json_restores_the_session(state: ViewState) -> None:
    assert state_from_json(json.loads(json.dumps(state_to_json(state)))) == state


@given(states)
def test_the_address_restores_the_session(state: ViewState) -> None:
    text = state_to_address(state)
    assert state_from_address(text) == state
    assert text.isascii()
    assert not set(text) & set("#?&= +/")


def test_a_fresh_session_is_written_as_nothing() -> None:
    assert state_to_json(ViewState()) == {}


def test_files_restore_the_session(tmp_path: Path) -> None:
    state = ViewState(criterion='hit("L1")', hidden=("tube",), section=Section(on=True))
    save_state(state, tmp_path / "session.json")
    assert load_state(tmp_path / "session.json") == state


def test_keys_of_newer_versions_are_ignored() -> None:
    assert state_from_json({"criterion": "x", "hologram": 3}) == ViewState(criterion="x")


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ([], "a table"),
        ({"criterion": 3}, "criterion must be a text"),
        ({"rays": 0}, "rays"),
        ({"rays": 2.5}, "rays must be a whole number"),
        ({"rays": True}, "rays must be a number"),
        ({"width": float("nan")}, "width must be a finite number"),
        ({"width": 10**400}, "width must be a finite number"),
        ({"color": "plaid"}, "color must be one of natural"),
        ({"hidden": "tube"}, "hidden must be a list"),
        ({"hidden": [1]}, r"hidden\[0\]"),
        ({"opacities": {"L1": "dim"}}, "opacities.L1"),
        ({"section": {"normal": [0, 1]}}, "section.normal must be a list of 3"),
        ({"camera": {"height": 1}}, "camera lacks focal_point"),
        (
            {
                "camera": {
                    "position": [0, 0, 0], "focal_point": [0, 0, 0], "view_up": [0, 1, 0],
                    "height": 1,
                }
            },
            "camera",
        ),
    ],
)  # fmt: skip
def test_wrong_values_are_named(values: object, named: str) -> None:
    with pytest.raises(StateError, match=named):
        state_from_json(values)


@given(st.text(max_size=80))
def test_any_address_is_read_or_refused(text: str) -> None:
    with contextlib.suppress(StateError):
        assert isinstance(state_from_address(text), ViewState)


def test_a_cut_address_is_refused() -> None:
    text = state_to_address(ViewState(criterion='detected("sensor")'))
    with pytest.raises(StateError, match="copy the whole address"):
        state_from_address(text[: len(text) // 2])


def test_missing_and_broken_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(StateError, match="there is no saved session"):
        load_state(tmp_path / "none.json")
    (tmp_path / "broken.json").write_text("{", encoding="utf-8")
    with pytest.raises(StateError, match="is not JSON"):
        load_state(tmp_path / "broken.json")


def test_states_are_values() -> None:
    state = ViewState()
    assert replace(state, rays=5) != state
    assert replace(state, rays=state.rays) == state

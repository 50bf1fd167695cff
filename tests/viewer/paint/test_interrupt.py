"""Pictures that are given up: soon, and without a trace in those that are not."""

from __future__ import annotations

import numpy as np
import pytest

import raymap
from viewer.app.session import Session
from viewer.drawn.answers import draw_rays
from viewer.drawn.state import ViewState
from viewer.paint import fill, paint
from viewer.paint.interrupt import Interrupted, pieces

SIZE = (200, 150, 1.0)


@pytest.fixture
def session(small_map: raymap.RayMap, monkeypatch: pytest.MonkeyPatch) -> Session:
    monkeypatch.setattr(paint, "SEGMENTS_AT_ONCE", 100)
    monkeypatch.setattr(fill, "TRIANGLES_AT_ONCE", 50)
    made = Session(small_map, ViewState(rays=500, opacities={"sensor": 1.0}))
    made.drawing = draw_rays(small_map, "", 500)
    return made


def test_pieces_are_all_of_it_in_order() -> None:
    for count in (0, 1, 9, 10, 11, 35):
        found = [n for part in pieces(count, 10, lambda: False) for n in range(count)[part]]
        assert found == list(range(count))
    assert list(pieces(35, 10, None)) == [slice(0, 35)]


def test_looking_in_between_changes_no_pixel(session: Session) -> None:
    shown, camera = session.shown(), session.camera(200, 150)
    whole = session.painter.paint(session.state, shown, camera, 200, 150)
    other = Session(session.map, session.state)
    pieced = other.painter.paint(session.state, shown, camera, 200, 150, cancel=lambda: False)
    np.testing.assert_array_equal(whole, pieced)


def test_a_picture_is_given_up_at_the_next_look(session: Session) -> None:
    looks = 0

    def count() -> bool:
        nonlocal looks
        looks += 1
        return False

    session.frame(*SIZE, coarse=False, cancel=count)
    # Bodies and rays of this picture have more than these pieces
    segments = len(session.shown().lines)
    assert looks >= segments // 100 + 3
    for wanted in (1, 2, looks // 2, looks):
        session.painter._layers.clear()
        seen = 0

        def cancel(at: int = wanted) -> bool:
            nonlocal seen
            seen += 1
            return seen >= at

        with pytest.raises(Interrupted):
            session.frame(*SIZE, coarse=False, cancel=cancel)
        assert seen == wanted


def test_what_was_given_up_is_not_remembered(session: Session) -> None:
    before = session.frame(*SIZE, coarse=False)
    session.painter._layers.clear()
    with pytest.raises(Interrupted):
        session.frame(*SIZE, coarse=False, cancel=lambda: True)
    assert session.frame(*SIZE, coarse=False) == before

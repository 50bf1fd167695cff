"""The scene's parts: what is sent, how much of it, and what is too late."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import raymap
from viewer.app.session import Session
from viewer.drawn.answers import draw_rays, read_one
from viewer.drawn.rays import DrawnRays
from viewer.drawn.state import Clip, Section, ViewState
from viewer.shown import live as live_module
from viewer.shown.live import LiveScene, pack
from viewer.shown.parts import PARTS, ray_points

W, H = 640, 480


class Client:
    """What a page does with messages, in Python: holds parts, gets chunks, drops what is late."""

    def __init__(self) -> None:
        self.have: dict[str, int] = {}
        self.parts: dict[str, dict[str, Any]] = {}
        self.received = 0

    def pull(self, scene: LiveScene) -> list[str]:
        message = scene.message(self.have)
        for part in message["parts"]:
            data = part["data"]
            if data is None:
                data = b""
                while len(data) < part["bytes"]:
                    more = scene.chunk(part["name"], part["revision"], len(data))
                    assert more
                    data += more
            self.received += len(data)
            self.have[part["name"]] = part["revision"]
            arrays = {
                each["name"]: np.frombuffer(
                    data, f"<{each['kind']}", int(np.prod(each["shape"])), each["offset"]
                ).reshape(each["shape"])
                for each in part["arrays"]
            }
            self.parts[part["name"]] = {"header": part["header"], **arrays}
        return [part["name"] for part in message["parts"]]


@pytest.fixture
def session(small_map: raymap.RayMap) -> Session:
    made = Session(small_map, ViewState(rays=200))
    made.drawing = draw_rays(small_map, "", 200)
    return made


def test_the_first_message_holds_the_whole_scene(session: Session) -> None:
    client = Client()
    assert client.pull(session.scene(W, H)) == list(PARTS)
    rays, center = session.drawing.rays, session.live.center
    np.testing.assert_allclose(client.parts["rays"]["position"] + center, rays.position, atol=1e-5)
    first, count = (client.parts["bodies"]["header"][key] for key in ("first", "count"))
    for number, body in enumerate(session.painter.bodies):
        rows = slice(first[number], first[number] + count[number])
        found = client.parts["bodies"]["position"][rows].reshape(-1, 3, 3) + center
        np.testing.assert_allclose(found, body.corners, atol=1e-5)
        assert set(client.parts["bodies"]["body"][rows].tolist()) == {number}
    assert client.pull(session.scene(W, H)) == []


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"color": "path"}, {"colors"}),
        ({"opacity": 0.2}, {"colors"}),
        ({"clip": Clip(after=1)}, {"colors"}),
        ({"hidden": ("L1",)}, {"looks"}),
        ({"opacities": {"tube": 0.5}}, {"looks"}),
        ({"body_opacity": 2.0}, {"looks"}),
        ({"section": Section(on=True)}, {"section", "cut"}),
        ({"width": 3.0}, {"style"}),
        ({"names": True}, {"style"}),
        ({"panel": "report", "detector": "sensor", "log_scale": False}, set()),
    ],
)
def test_a_change_sends_what_it_changes(
    session: Session, change: dict[str, Any], expected: set[str]
) -> None:
    client = Client()
    client.pull(session.scene(W, H))
    session.update(**change)
    before = client.received
    assert set(client.pull(session.scene(W, H))) == expected
    n_records, n_bodies = session.drawing.rays.n_records, len(session.painter.bodies)
    most = {"colors": 4 * n_records, "looks": 4 * n_bodies}
    if expected <= set(most):
        assert client.received - before <= sum(most[name] for name in expected)


def test_colours_follow_the_session(session: Session) -> None:
    client = Client()
    client.pull(session.scene(W, H))
    session.update(color="source", clip=Clip(after=1), hidden=("tube",))
    client.pull(session.scene(W, H))
    shown, rays = session.shown(), session.drawing.rays
    drawn = client.parts["colors"]["rgba"]
    np.testing.assert_array_equal(drawn[shown.lines.record], shown.rgba)
    others = np.setdiff1d(np.arange(rays.n_records), shown.lines.record)
    assert (drawn[others] == 0).all()
    alpha = dict(zip((b.name for b in session.painter.bodies),
                     client.parts["looks"]["rgba"][:, 3].tolist(), strict=True))  # fmt: skip
    assert alpha["tube"] == 0 < alpha["L1"]


@pytest.mark.parametrize("points", [2, 3, 11])
def test_a_segment_costs_at_most_24_bytes(points: int) -> None:
    n = 1000
    rng = np.random.default_rng(1)
    empty = DrawnRays.join([])
    rays = replace(
        empty,
        ray_ids=np.arange(n),
        offsets=np.arange(n + 1) * points,
        position=rng.normal(size=(n * points, 3)).astype(np.float32),
        event=np.zeros(n * points, np.int32),
    )
    part = ray_points(rays, np.zeros(3))
    assert len(pack(part)[1]) <= 24 * n * (points - 1)


def test_places_far_from_the_origin_keep_their_digits(session: Session) -> None:
    """float32 has steps of 0.06 at 10⁶; what is sent is relative to the centre."""
    rays = session.drawing.rays
    center = np.array([1e6, -1e6, 2e6])
    far = replace(rays, position=(rays.position[:2] + center).astype(np.float32))
    sent = ray_points(far, center).arrays["position"].astype(np.float64) + center
    np.testing.assert_array_equal(sent, far.position.astype(np.float64))


def test_large_parts_come_in_chunks_and_late_ones_not_at_all(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_module, "CHUNK_BYTES", 1000)
    client = Client()
    client.pull(session.scene(W, H))
    np.testing.assert_allclose(
        client.parts["rays"]["position"] + session.live.center,
        session.drawing.rays.position, atol=1e-5,
    )  # fmt: skip
    held = client.have["rays"]
    assert session.live.chunk("rays", held, 0)
    session.drawing = draw_rays(session.map, "", 50)
    scene = session.scene(W, H)
    assert scene.chunk("rays", held, 1000) is None
    assert client.pull(scene) == ["rays", "colors"]
    assert len(client.parts["rays"]["position"]) == session.drawing.rays.n_records


def test_what_a_page_cannot_mean_gets_nothing(session: Session) -> None:
    scene = session.scene(W, H)
    revision = scene.changed({})["rays"]
    assert scene.chunk("no such part", revision, 0) is None
    assert scene.chunk("rays", revision, -1) is None
    assert scene.chunk("rays", revision, 10**9) == b""
    assert set(scene.changed({"rays": 10**9})) == set(PARTS)


def test_who_moved_the_camera_is_not_told(session: Session) -> None:
    one, other = Client(), Client()
    one.pull(session.scene(W, H))
    seen = dict(one.parts["camera"]["header"], height=7.0)
    session.take_camera(seen)
    assert session.state.camera is not None
    assert session.state.camera.height == 7.0
    assert one.pull(session.scene(W, H)) == []
    other.pull(session.scene(W, H))
    assert other.parts["camera"]["header"]["height"] == 7.0
    session.look("front", W, H)
    assert one.pull(session.scene(W, H)) == ["camera"]


def test_the_chosen_ray_and_its_point(session: Session) -> None:
    client = Client()
    client.pull(session.scene(W, H))
    ray = int(session.drawing.rays.ray_ids[3])
    session.chosen = read_one(session.map, ray)
    session.update(ray=ray, point=1)
    assert client.pull(session.scene(W, H)) == ["chosen"]
    part = client.parts["chosen"]
    assert part["header"]["point"] == 1
    np.testing.assert_allclose(
        part["position"] + session.live.center, session.chosen.position, atol=1e-5
    )

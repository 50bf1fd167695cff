"""A client gets what the local functions give."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest

import query
import raymap
import viewer
from query.answers.paths.tables import path_table
from raymap.remote.client import Service
from service import RaymapService
from tests.service.conftest import TOKEN

GHOST = 'count(hit("*", reflected)) >= 2'


@pytest.fixture
def local(folder: Path):
    with raymap.open(folder / "small.raymap") as opened:
        yield opened


def test_files_and_names(client: Service, local: raymap.RayMap) -> None:
    kinds = {row["name"]: row["kind"] for row in client.files()}
    assert kinds == {"small.raymap": "map", "scene.toml": "scene"}
    there = client.open("small.raymap")
    assert (there.rays, there.records, there.finished) == (local.rays, local.records, True)
    assert there.sources == [item.name for item in local.directory.sources]
    assert there.objects == [item.name for item in local.directory.objects]
    assert there.faces == list(local.directory.faces.names)
    assert there.detectors == [item.name for item in local.directory.detectors]
    assert there.units == {"length": "mm", "flux": "W"}
    assert there.about["detector_grids"]["sensor"]["cells"] == [36, 24]
    assert client.about["protocol"] == 1


@pytest.mark.parametrize("spelling", ["text", "tree", "json"])
def test_selection(client: Service, local: raymap.RayMap, spelling: str) -> None:
    tree = query.parse(GHOST)
    asked = {"text": GHOST, "tree": tree, "json": tree.to_json()}[spelling]
    mine, there = query.select(local, GHOST), client.open("small.raymap").query(asked)
    assert there.matched == len(there) == mine.matched > 0
    assert there.flux == mine.flux
    assert there.flux_se == mine.flux_se
    assert np.array_equal(there.ray_ids, mine.ray_ids)
    assert there.to_arrow("segments").equals(mine.to_arrow("segments"))
    assert there.to_arrow("rays").equals(mine.to_arrow("rays"))
    assert sum(batch.num_rows for batch in there.batches()) == mine.to_arrow().num_rows
    few = client.open("small.raymap").query(asked, limit=3)
    assert few.ray_ids.tolist() == mine.ray_ids[:3].tolist()
    nothing = client.open("small.raymap").query('hit("L1.rim") & event(left) & !event(left)')
    assert not nothing
    assert nothing.flux_bound_95 > 0
    assert nothing.reason


def test_path_table(client: Service, local: raymap.RayMap) -> None:
    mine = path_table(local, GHOST)
    there = client.open("small.raymap").path_table(GHOST)
    assert there.n_paths == mine.n_paths
    assert there.total == pytest.approx(mine.total)
    assert there.to_json() == mine.to_json(1000)
    peaks = client.open("small.raymap").path_table(by="object", sort="peak", peak="sensor", top=2)
    rows = path_table(local, by="object", sort="peak", peak="sensor").to_json(2)
    assert [row["peak"] for row in peaks.to_json()[:2]] == [list(row["peak"]) for row in rows[:2]]


def test_report_and_image(client: Service, local: raymap.RayMap) -> None:
    there = client.open("small.raymap")
    ray = int(query.select(local, GHOST).ray_ids[0])
    report = query.report(local, ray)
    assert there.report(ray)["ray_id"] == ray
    assert len(there.report(ray)["points"]) == len(report["points"])
    mine, image = query.detector_image(local, "sensor", GHOST), there.image("sensor", GHOST)
    assert np.array_equal(image.channels, mine.channels)
    assert np.array_equal(image.rays, mine.rays)
    assert np.array_equal(image.variance, mine.variance)
    assert image.total == pytest.approx(mine.total)
    assert image.detector["name"] == "sensor"


def test_lines_follow_the_rays(client: Service, local: raymap.RayMap) -> None:
    lines = client.open("small.raymap").lines(GHOST, limit=20)
    ids = query.select(local, GHOST).ray_ids[:20]
    assert lines.column("ray_id").to_pylist() == ids.tolist()
    whole = query.select(local, GHOST).to_arrow("rays").slice(0, 20).column("segments").to_pylist()
    for points, records in zip(lines.column("points").to_pylist(), whole, strict=True):
        assert points == [[record["x"], record["y"], record["z"]] for record in records]
    assert all(max(rgb) == 255 for rgb in lines.column("rgb").to_pylist())


def test_picture_is_the_local_one(client: Service, local: raymap.RayMap, tmp_path: Path) -> None:
    there = client.open("small.raymap")
    data = there.picture(GHOST, rays=30, size=(200, 120), out=tmp_path / "there.png")
    viewer.picture(local, GHOST, rays=30, size=(200, 120), out=tmp_path / "here.png")
    assert (tmp_path / "there.png").read_bytes() == data == (tmp_path / "here.png").read_bytes()


def test_scene_and_recording(client: Service, folder: Path) -> None:
    scene = client.scene("scene.toml")
    assert (scene.sources, scene.objects, scene.detectors) == (["lamp"], ["ball"], ["screen"])
    assert scene.faces == ["ball.surface"]
    chosen = (folder / "scene.toml").read_text() + '[simulations.dark]\nleave_out = ["screen"]\n'
    assert client.scene(text=chosen, simulation="dark").detectors == []
    seen = []
    result = client.record(
        "scene.toml", "made.raymap", rays=3_000, seed=4, progress=lambda p: seen.append(p.rays)
    )
    assert result.rays == seen[-1] == 3_000
    assert sum(result.audit["lamp"].values()) == 2 * 3_000
    made = client.open("made.raymap")
    assert made.rays == 3_000
    assert made.query('detected("screen")').matched > 0
    # Text of a scene; a map that goes on is seen at once
    text = (folder / "scene.toml").read_text()
    client.record(None, "made.raymap", text=text, rays=1_000, append=True)
    made.refresh()
    assert made.rays == 4_000
    with raymap.open(folder / "made.raymap") as here:
        assert here.runs[0]["seed"] == here.runs[1]["seed"] == 4


def test_a_client_that_goes_ends_its_recording(client: Service, folder: Path) -> None:
    class Enough(Exception):
        pass

    def leave(progress: object) -> None:
        raise Enough

    with pytest.raises(Enough):
        client.record("scene.toml", "made.raymap", seconds=30, progress=leave)
    # The gate is free again, and the map is valid
    result = client.record("scene.toml", "made.raymap", rays=10, append=True)
    assert result.rays == 10
    with raymap.open(folder / "made.raymap") as made:
        assert made.finished
        assert made.rays > 10


def test_uploaded_scene(client: Service, folder: Path, tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text((folder / "scene.toml").read_text())
    assert client.upload(tmp_path / "own.toml", "new/own.toml") == "new/own.toml"
    assert client.scene("new/own.toml").objects == ["ball"]
    with pytest.raises(raymap.MapExists, match="'force' replaces it"):
        client.upload(tmp_path / "own.toml", "new/own.toml")
    client.upload_text("# nothing", "new/own.toml", force=True)
    assert (folder / "new" / "own.toml").read_text() == "# nothing"


def test_application_gives_back_what_is_drawn(client: Service) -> None:
    there = client.open("small.raymap")
    with there.view('hit("L1")', detector="sensor") as view:
        assert view.url.startswith("http://localhost:")
        assert (view.drawn["criterion"], view.drawn["region"]) == ('hit("L1")', None)
        assert view.drawn["detector"] == "sensor"
        assert not view.wait(0.2)
        # The mouse draws a rectangle on the detector
        waiting = threading.Thread(target=_draw, args=(client, view))
        waiting.start()
        assert view.wait(20)
        waiting.join()
        assert view.drawn["region"] == {"shape": "rect", "values": [3.0, 4.0, 9.0, 8.0]}
        assert there.query(view.drawn["criterion"]).matched > 0
        assert 'detected("sensor", rect(3, 4, 9, 8))' in view.drawn["criterion"]
    with pytest.raises(raymap.RayMapError, match="no application"):
        view.look()


def _draw(client: Service, view: object) -> None:
    """What the page would send."""
    opened = next(iter(SERVICES[-1].applications._opened.values()))
    application = opened.server.application
    application.session.update(
        criterion='hit("L1") & detected("sensor", rect(3, 4, 9, 8))', detector="sensor"
    )


SERVICES: list[RaymapService] = []


@pytest.fixture(autouse=True)
def remember(service: RaymapService):
    SERVICES.append(service)
    yield
    SERVICES.clear()


def test_many_clients_at_once(service: RaymapService, local: raymap.RayMap) -> None:
    expected = query.select(local, GHOST).matched
    answers: list[int] = []

    def ask() -> None:
        with raymap.connect(service.address, token=TOKEN) as own:
            there = own.open("small.raymap")
            answers.extend(there.query(GHOST).matched for _ in range(4))
            answers.append(there.query(GHOST).to_arrow("rays").num_rows)

    threads = [threading.Thread(target=ask) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert answers == [expected] * 40


def test_any_flight_client_can_speak_it(service: RaymapService) -> None:
    """Without the client of this package, as a plug-in in another language would."""
    import json

    import pyarrow.flight as flight

    plain = flight.connect(service.address)
    options = flight.FlightCallOptions(headers=[(b"authorization", f"Bearer {TOKEN}".encode())])
    assert {action.type for action in plain.list_actions(options)} >= {"record", "drawn", "count"}
    flights = list(plain.list_flights(b"", options))
    assert [json.loads(f.descriptor.command)["map"] for f in flights] == ["small.raymap"]
    command = json.dumps({"get": "lines", "map": "small.raymap", "limit": 5}).encode()
    info = plain.get_flight_info(flight.FlightDescriptor.for_command(command), options)
    table = plain.do_get(info.endpoints[0].ticket, options).read_all()
    assert table.schema.equals(info.schema)
    assert table.num_rows == 5
    [answer] = plain.do_action(flight.Action("count", b'{"map": "small.raymap"}'), options)
    assert (
        json.loads(answer.body.to_pybytes())["matched"]
        == json.loads(answer.body.to_pybytes())["rays"]
    )
    plain.close()

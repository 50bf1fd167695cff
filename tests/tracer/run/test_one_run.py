"""Every way of following light is recorded by the one run, with all that it offers."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import raymap
import tracer.cli
from tests.tracer.scene.test_obeyed import CRYSTAL, LENS, plate
from tracer import parse_scene
from tracer.polarized.record import record_polarized
from tracer.run.natural import NaturalTrace
from tracer.run.recording import record
from tracer.run.results import Progress
from tracer.run.shard_tasks import pack, unpack
from tracer.run.traces import trace_of

pytestmark = pytest.mark.filterwarnings("ignore::tracer.run.results.StoppedLight")

POLARISED = '[trace]\nlight = "polarised"\nstates = "natural"\nphases = true\n'
SPLIT = '[trace]\nmode = "weighted"\nsplit_depth = 2\n'
SCENES = {
    "natural": plate(),
    "split": plate(more=SPLIT),
    "polarised": plate(more=POLARISED),
    "lens_trees": LENS + "[trace]\nlens_trees = 5\nmin_flux = 1e-4\n",
    "crystals": CRYSTAL,
}
RAYS = 700


@pytest.fixture(params=SCENES)
def scene(request: pytest.FixtureRequest) -> Any:
    return parse_scene(SCENES[request.param])


def rows(path: Path) -> Iterator[tuple[str, Any]]:
    """All columns of a map, portions joined."""
    with raymap.open(path) as ray_map:
        whole = raymap.join_portions([portion.read() for portion in ray_map.portions])
        ids = np.concatenate([portion.ray_ids() for portion in ray_map.portions])
        yield "ray_ids", ids
        for name in ("source", "records_per_ray", "position", "normal", "object", "triangle", "event", "medium", "weight", "emission", "descriptor_count"):  # fmt: skip # noqa: E501
            yield name, getattr(whole, name)
        yield from sorted(whole.extra.items())
        yield "cells", whole.descriptors.cell
        for detector in ray_map.directory.detectors:
            found = ray_map.detector_result(detector.name)
            assert found is not None
            # Sums of weights depend on the order of portions in the last bit
            yield detector.name, np.float32(found[0])


def same(one: Path, other: Path) -> None:
    a, b = dict(rows(one)), dict(rows(other))
    assert a.keys() == b.keys()
    for name in a:
        if a[name] is None:
            assert b[name] is None
        else:
            np.testing.assert_array_equal(a[name], b[name], err_msg=name)


def test_threads_and_portions_change_nothing(scene: Any, tmp_path: Path) -> None:
    record(scene, tmp_path / "one.raymap", rays=RAYS, seed=3, threads=1, portion_rays=RAYS)
    record(scene, tmp_path / "two.raymap", rays=RAYS, seed=3, threads=2, portion_rays=64)
    same(tmp_path / "one.raymap", tmp_path / "two.raymap")


def test_a_continued_map_is_that_of_one_run(scene: Any, tmp_path: Path) -> None:
    record(scene, tmp_path / "one.raymap", rays=RAYS, seed=3)
    record(scene, tmp_path / "two.raymap", rays=RAYS // 2, seed=3)
    record(scene, tmp_path / "two.raymap", rays=RAYS - RAYS // 2, append=True)
    same(tmp_path / "one.raymap", tmp_path / "two.raymap")


def test_detectors_count_the_same_without_rays(scene: Any, tmp_path: Path) -> None:
    with_rays = record(scene, tmp_path / "one.raymap", rays=RAYS, seed=3)
    without = record(scene, None, rays=RAYS, seed=3, no_rays=True)
    assert without.rays == with_rays.rays
    assert without.records == with_rays.records
    assert without.audit == with_rays.audit
    assert without.fluxes == with_rays.fluxes


def test_cancelled_and_timed_traces_end_as_sound_maps(scene: Any, tmp_path: Path) -> None:
    path = tmp_path / "a.raymap"
    asked = iter([False, False, True])
    stopped = record(
        scene, path, rays=10**9, seed=3, portion_rays=64, threads=1,
        cancel=lambda: next(asked, True),
    )  # fmt: skip
    assert stopped.interrupted
    timed = record(scene, path, seconds=0.0, rays=10**9, append=True)
    assert not timed.interrupted
    with raymap.open(path) as ray_map:
        assert ray_map.finished
        assert ray_map.rays == stopped.rays + timed.rays > 0


def test_raw_maps_hold_the_same(scene: Any, tmp_path: Path) -> None:
    record(scene, tmp_path / "plain.raymap", rays=RAYS, seed=3)
    record(scene, tmp_path / "raw.raymap", rays=RAYS, seed=3, raw=True)
    same(tmp_path / "plain.raymap", tmp_path / "raw.raymap")


def test_a_trace_reaches_workers_whole(scene: Any) -> None:
    trace = trace_of(scene)
    again = unpack(pack(trace))
    assert type(again) is type(trace)
    one, other = trace.engine(3).trace(5, 40), again.engine(3).trace(5, 40)
    np.testing.assert_array_equal(one.position, other.position)
    np.testing.assert_array_equal(one.event, other.event)


def test_the_scene_says_how_its_light_is_followed(tmp_path: Path) -> None:
    by_scene, by_call = tmp_path / "a.raymap", tmp_path / "b.raymap"
    record(parse_scene(SCENES["polarised"]), by_scene, rays=RAYS)
    record_polarized(parse_scene(SCENES["polarised"]), by_call, rays=RAYS)
    same(by_scene, by_call)
    with raymap.open(by_scene) as ray_map:
        assert {"stokes", "optical_path", "phase"} <= set(ray_map.portions[0].column_names)


def test_natural_light_is_followed_where_nothing_is_said() -> None:
    assert isinstance(trace_of(parse_scene(plate())), NaturalTrace)


def test_sigterm_ends_a_recording_as_ctrl_c_does(
    run: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """130 is 128 + SIGINT, what a shell says after Ctrl-C."""
    scene, path = tmp_path / "scene.toml", tmp_path / "a.raymap"
    scene.write_text(plate())
    shown = tracer.cli._Display.show

    def show_and_stop(self: Any, progress: Progress) -> None:
        shown(self, progress)
        os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr(tracer.cli._Display, "show", show_and_stop)
    code, out, _ = run("record", scene, "-o", path, "--rays", 10**9)
    assert code == 130
    assert "interrupted; the map holds the rays traced so far" in out
    with raymap.open(path) as ray_map:
        assert ray_map.finished
        assert ray_map.rays > 0


def test_sigterm_within_a_finaliser_is_not_lost(capsys: Any) -> None:
    """From there Python prints the exception and goes on."""
    import gc

    from tracer.cli import _stopped_by_sigterm

    class Finalised:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGTERM)
            # The handler runs before the next line
            self.reached = True

    def block() -> None:
        with _stopped_by_sigterm():
            Finalised()
            gc.collect()
            time.sleep(60)

    with pytest.raises(KeyboardInterrupt):
        block()
    assert capsys.readouterr().err == ""


SLANTED = """
length_unit = "mm"
[media.glass]
index = 1.5
[surfaces.clear]
kind = "dielectric"
[bodies.slab]
kind = "box"
size = [400, 400, 4]
position = [0, 0, 10]
axis = [0.3, 0.1, 0.95]
medium = "glass"
surface = "clear"
[sources.lamp]
kind = "point"
cone_deg = 20
"""


MORE = {
    "natural": "",
    "split": SPLIT,
    "weighted": '[trace]\nmode = "weighted"\nmin_reflection = 0.3\n',
    "polarised": POLARISED,
}


@pytest.mark.parametrize("more", MORE.values(), ids=MORE)
def test_records_lie_where_light_meets_faces(more: str, tmp_path: Path) -> None:
    record(parse_scene(SLANTED + more), tmp_path / "a.raymap", rays=200, seed=3)
    found = dict(rows(tmp_path / "a.raymap"))
    normal = np.array([0.3, 0.1, 0.95]) / np.linalg.norm([0.3, 0.1, 0.95])
    height = (found["position"].astype(float) - [0.0, 0.0, 10.0]) @ normal
    on_slab = found["object"] == 0
    assert on_slab.sum() >= 300
    np.testing.assert_allclose(np.abs(height[on_slab]), 2.0, atol=1e-4)
    # Light starts at the lamp, and leaves to either side
    starts = np.cumsum(found["records_per_ray"]) - found["records_per_ray"]
    np.testing.assert_array_equal(found["position"][starts], 0.0)

"""Recording: the same map whatever the threads, continued maps, limits, interruption."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import raymap
from raymap.cli import application
from raymap.model.errors import MapExists, RayMapError, SceneMismatch
from raymap.model.schema import PORTION_RECORDS
from tracer.run.pieces import split_portion
from tracer.run.recording import OtherChannels, StoppedLight, record
from tracer.run.results import Progress
from tracer.scene.compile import Compilation, compile_scene
from tracer.scene.load import load_scene, parse_scene
from tracer.transport.wavefront import Wavefront

SAMPLE = Path(__file__).parents[3] / "samples" / "double_gauss.toml"

CAVITY = """
length_unit = "mm"
[limits]
depth = {depth}
[surfaces.wall]
kind = "lambertian"
reflectance = {reflectance}
[bodies.cavity]
kind = "sphere"
radius = 1
surface = "wall"
[sources.lamp]
kind = "point"
"""


@pytest.fixture(scope="module")
def lens() -> Compilation:
    return compile_scene(load_scene(SAMPLE))


def columns(path: Path) -> dict[str, np.ndarray]:
    with raymap.open(path) as stored:
        portions = [portion.read() for portion in stored.portions]
    names = ("position", "normal", "object", "triangle", "event", "medium", "descriptor_count")
    found = {name: np.concatenate([getattr(p, name) for p in portions]) for name in names}
    found["rays"] = np.concatenate([p.records_per_ray for p in portions])
    found["uv"] = np.concatenate([p.descriptors.uv for p in portions])
    return found


def test_same_map_however_it_is_stored(lens: Compilation, tmp_path: Path) -> None:
    found = {}
    for name in ("usual", "raw"):
        record(lens, tmp_path / name, rays=2_000, raw=name == "raw")
        found[name] = columns(tmp_path / name)
    assert (tmp_path / "usual").stat().st_size < (tmp_path / "raw").stat().st_size
    for column, values in found["usual"].items():
        np.testing.assert_array_equal(found["raw"][column], values, err_msg=column)
    # Normals follow from the stored positions, to whose rounding they agree with the engine's
    traced = Wavefront(lens.arrays, 1).trace(0, 2_000).normal.astype(int)
    assert np.abs(found["usual"]["normal"] - traced).max() <= 1


def test_same_map_for_any_threads_and_portions(lens: Compilation, tmp_path: Path) -> None:
    reference = None
    for threads, portion_rays in ((1, 5_000), (2, 700), (3, 1_024)):
        path = tmp_path / f"{threads}.raymap"
        result = record(lens, path, rays=5_000, threads=threads, portion_rays=portion_rays)
        assert result.rays == 5_000
        found = columns(path)
        if reference is None:
            reference = found
        for name, values in found.items():
            assert np.array_equal(values, reference[name]), name


def test_audit_closes_and_detector_result_counts_what_registered(
    lens: Compilation, tmp_path: Path
) -> None:
    path = tmp_path / "a.raymap"
    result = record(lens, path, rays=20_000, threads=2)
    beam = result.audit["beam"]
    assert sum(beam[k] for k in beam if k != "emitted") == beam["emitted"] == 20_000
    assert result.audit["flood"]["emitted"] == 0
    absorbed = sum(result.absorbed_by["objects"].values())
    assert absorbed == beam["absorbed"] + beam["detected"]
    with raymap.open(path) as stored:
        assert stored.finished
        assert stored.rays == 20_000
        assert stored.records == result.records
        sums, sums2 = stored.detector_result("sensor")
    assert sums.shape == (480, 720, 3)
    assert sums.sum() == pytest.approx(beam["detected"], rel=1e-12)
    # Behind the lens every ray has one channel, so c² = c
    assert sums2.sum() == pytest.approx(beam["detected"], rel=1e-12)
    alone = record(lens, None, rays=20_000, threads=1, no_rays=True)
    assert np.array_equal(alone.detectors["sensor"].sums, sums)
    assert alone.audit == result.audit


def test_a_continued_map_is_the_longer_one(lens: Compilation, tmp_path: Path) -> None:
    long, short = tmp_path / "long.raymap", tmp_path / "short.raymap"
    record(lens, long, rays=4_000, seed=5)
    record(lens, short, rays=1_500, seed=5)
    second = record(lens, short, rays=2_500, append=True)
    assert second.seed == 5
    a, b = columns(long), columns(short)
    assert all(np.array_equal(a[name], b[name]) for name in a)


def test_existing_maps_are_kept_and_other_scenes_refused(
    lens: Compilation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.raymap"
    record(lens, path, rays=100)
    before = path.read_bytes()
    # Neither is anything compiled for a map that cannot be written
    for target in (path, tmp_path / "nowhere" / "a.raymap"):
        with monkeypatch.context() as patched:
            patched.setattr("tracer.run.natural.compile_trace", None)
            with pytest.raises(RayMapError, match=r"--append|no folder"):
                record(lens, target, rays=100)
    with pytest.raises(MapExists, match="--append"):
        record(lens, path, rays=100)
    other = compile_scene(load_scene(SAMPLE, variants=["coated"]))
    with pytest.raises(SceneMismatch):
        record(other, path, rays=100, append=True)
    assert path.read_bytes() == before
    spectral = compile_scene(load_scene(SAMPLE, variants=["spectral"]))
    with pytest.warns(OtherChannels, match="R, G, B"):
        record(spectral, path, rays=100, append=True)
    with raymap.open(path) as stored:
        assert stored.rays == 200
        assert [s.n_channels for s in stored.channel_sets] == [3, 11]
        assert stored.portions[-1].channel_set == 1
    record(lens, path, rays=50, force=True)
    with raymap.open(path) as stored:
        assert stored.rays == 50


def test_interruption_leaves_a_valid_prefix(lens: Compilation, tmp_path: Path) -> None:
    calls = 0

    def interrupt(progress: Progress) -> None:
        nonlocal calls
        calls += 1
        if calls == 2:
            raise KeyboardInterrupt

    path, whole = tmp_path / "a.raymap", tmp_path / "whole.raymap"
    result = record(lens, path, rays=100_000, threads=2, portion_rays=500, progress=interrupt)
    assert result.interrupted
    assert 1_000 <= result.rays < 100_000
    record(lens, whole, rays=result.rays)
    a, b = columns(path), columns(whole)
    assert all(np.array_equal(a[name], b[name]) for name in a)


def test_time_limit_stops_the_trace(lens: Compilation, tmp_path: Path) -> None:
    result = record(lens, None, seconds=0.3, no_rays=True, portion_rays=2_000)
    assert result.rays > 0
    assert result.seconds < 10.0


def test_long_rays_close_portions_early(tmp_path: Path) -> None:
    scene = parse_scene(CAVITY.format(depth=2_000, reflectance=1.0))
    path = tmp_path / "a.raymap"
    with pytest.warns(StoppedLight, match="raise limits.depth"):
        result = record(scene, path, rays=700, portion_rays=600, threads=1)
    assert result.records == 700 * 2_001
    with raymap.open(path) as stored:
        sizes = [portion.n_records for portion in stored.portions]
        assert max(sizes) <= PORTION_RECORDS
        assert sum(portion.n_rays for portion in stored.portions) == 700
        numbers = [portion.number for portion in stored.portions]
    assert numbers == list(range(len(sizes)))


def test_split_keeps_single_rays_whole(lens: Compilation) -> None:
    from tracer.transport.wavefront import Wavefront

    portion = Wavefront(lens.arrays, 1).trace(0, 100)
    assert [piece.n_rays for piece in split_portion(portion)] == [100]


def test_command_prints_json_and_nothing_else(tmp_path: Path) -> None:
    out = tmp_path / "a.raymap"
    result = CliRunner().invoke(
        application(),
        ["record", str(SAMPLE), "-o", str(out), "--rays", "2000", "--json", "--variant", "coated"],
    )
    assert result.exit_code == 0
    values = json.loads(result.stdout)
    assert {
        "rays", "records", "seconds", "rays_per_second", "bytes", "threads", "seed", "audit",
    } <= set(values)  # fmt: skip
    assert values["rays"] == 2_000
    assert values["bytes"] <= out.stat().st_size
    again = CliRunner().invoke(application(), ["record", str(SAMPLE), "-o", str(out)])
    assert isinstance(again.exception, MapExists)


def test_check_command(tmp_path: Path) -> None:
    drawing = tmp_path / "section.svg"
    result = CliRunner().invoke(application(), ["check", str(SAMPLE), "--json", "-o", str(drawing)])
    assert result.exit_code == 0
    assert json.loads(result.stdout)["efl"] == pytest.approx(100.0037, abs=5e-5)
    assert drawing.read_text().count("<text") == 15

"""Squares of lumens per path: what a dictionary keeps of them against sums over its rays.

The right values are loops over rays by the formula of the format page: Σ (w Y(c) / Y(c₀))², per
emission first.
"""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import query
import raymap
from query.answers.selections.selector import bind_all
from query.engine.scan import Scan
from raymap.file.repair import repair
from raymap.file.selection import copy_selection
from raymap.file.verify import verify
from tests.examples import examples
from tests.fuzz.fuzz_values import Seed, put_together
from tests.raymap.maps import COLORED, RGB, small_directory, write_small

QUESTIONS = (None, 'hit("lens")', 'source("sun") & !hit("box")', 'hit("*", reflected)')
LUMENS = small_directory(flux_unit="lm")


def lumens(path: Path, **options: Any) -> Path:
    write_small(path, directory=LUMENS, channels=COLORED, **options)
    return path


def as_stored(color: tuple[float, ...]) -> np.ndarray:
    """In units of 1/65535, rounded down, the rest to the largest remainders."""
    exact = np.array(color) / sum(color) * 65535
    whole = np.floor(exact)
    order = np.argsort(whole - exact, kind="stable")
    whole[order[: int(65535 - whole.sum())]] += 1
    return whole / 65535


def squares_by_hand(portion: Any) -> np.ndarray:
    """(n_paths,) sums over the rays of a stored portion, ray by ray."""
    y_of = np.array(COLORED.luminous)
    numbers, weight = portion.path_numbers(), portion.column("weight").astype(float)
    emission = portion.column("emission") if portion.grouped else np.arange(portion.n_rays)
    source, ends = portion.column("source"), portion.record_offsets()[1:] - 1
    codes, table = portion.column("color_code")[ends], portion.color_table() / 65535
    groups: dict[tuple[int, int], float] = defaultdict(float)
    for ray in range(portion.n_rays):
        color = np.eye(3)[codes[ray]] if codes[ray] < 3 else table[codes[ray] - 3]
        worth = color @ y_of / (as_stored(COLORED.source_colors[source[ray]]) @ y_of)
        groups[numbers[ray], emission[ray]] += weight[ray] * worth
    squares = np.zeros(portion.index.meta.n_paths)
    for (path, _), value in groups.items():
        squares[path] += value**2
    return squares


@settings(max_examples=examples(25), suppress_health_check=[HealthCheck.too_slow])
@given(
    seed=st.integers(0, 10**6),
    n_paths=st.sampled_from([1, 4, None]),
    weighted=st.booleans(),
    grouped=st.booleans(),
)
def test_squares_are_those_of_the_rays(
    tmp_path_factory: pytest.TempPathFactory,
    seed: int,
    n_paths: int | None,
    weighted: bool,
    grouped: bool,
) -> None:
    path = lumens(
        tmp_path_factory.mktemp("squares") / "a.raymap",
        n_portions=2,
        seed=seed,
        n_paths=n_paths,
        weighted=weighted,
        grouped=grouped,
    )
    with raymap.open(path) as ray_map:
        total = np.zeros(0)
        for index, portion in enumerate(ray_map.portions):
            expected = squares_by_hand(portion)
            np.testing.assert_allclose(portion.paths().sum_wy2, expected, rtol=1e-12)
            local = ray_map.merged.local_to_global[index]
            if local is not None:
                total = np.pad(total, (0, max(0, local.max() + 1 - len(total))))
                np.add.at(total, local, expected)
        if len(total):
            np.testing.assert_allclose(ray_map.merged.paths.sum_wy2, total, rtol=1e-12)
        assert not verify(ray_map).damage


def answers(ray_map: raymap.RayMap) -> list[tuple[float, ...]]:
    found = [query.select(ray_map, text).summary() for text in QUESTIONS]
    return [(each["matched"], each["flux"], each["flux_se"]) for each in found]


def by_rays(ray_map: raymap.RayMap) -> list[tuple[float, ...]]:
    """The same, of every ray for itself."""
    found = []
    for text in QUESTIONS:
        [totals] = Scan(ray_map, bind_all(ray_map, [text]), use_merged=False).run()
        tally, sent = totals.by_source, ray_map.emitted
        factor = np.array([source.flux for source in LUMENS.sources]) / sent
        spread = (tally.sum_w2 - tally.sum_w**2 / sent) @ factor**2
        found.append((tally.rays.sum(), tally.sum_w @ factor, np.sqrt(spread)))
    return found


def asked_of_paths(ray_map: raymap.RayMap, *questions: str | None) -> bool:
    """Whether no portion stays open for questions about paths alone."""
    nodes = bind_all(ray_map, list(questions or QUESTIONS))
    return not Scan(ray_map, nodes).open_portions


def test_questions_about_paths_read_no_rays(tmp_path: Path) -> None:
    with raymap.open(lumens(tmp_path / "a.raymap", weighted=True)) as ray_map:
        assert asked_of_paths(ray_map)
        np.testing.assert_allclose(answers(ray_map), by_rays(ray_map), rtol=1e-12)
        rows = query.path_table(ray_map).rows()
        assert sum(row.flux for row in rows) == pytest.approx(answers(ray_map)[0][1])


def without(path: Path, name: str, target: Path, portions: tuple[int, ...] | None = None) -> Path:
    """The map as a writer makes it that does not know a column."""
    seed = Seed("lumens", path)
    number = 0
    for part in seed.parts:
        is_portion = part.tag == raymap.bytes.layout.PORTION
        if portions is None or (is_portion and number in portions):
            part.streams = [stream for stream in part.streams if stream.name != name]
        number += is_portion
    target.write_bytes(put_together(seed.parts))
    return target


def test_maps_without_the_squares_are_asked_ray_by_ray(tmp_path: Path) -> None:
    path = lumens(tmp_path / "a.raymap", weighted=True)
    old = without(path, "path.sum_wy2", tmp_path / "old.raymap")
    with raymap.open(old) as ray_map, raymap.open(path) as new:
        assert ray_map.merged.paths.sum_wy2 is None
        assert not asked_of_paths(ray_map)
        assert not verify(ray_map).damage
        np.testing.assert_allclose(answers(ray_map), answers(new), rtol=1e-12)
    # Portions that say more do not help where the others are silent
    with raymap.RayMapWriter.append_to(old) as writer:
        writer.start_run(seed=2)
        for stored in _portions(path):
            writer.append(stored)
    with raymap.open(old) as ray_map:
        assert len(ray_map.portions) == 8
        assert ray_map.merged.paths.sum_wy2 is None
        assert not verify(ray_map).damage
        np.testing.assert_allclose(answers(ray_map), by_rays(ray_map), rtol=1e-12)


def _portions(path: Path) -> list[raymap.Portion]:
    with raymap.open(path) as ray_map:
        return [dataclasses.replace(each.read(), ray_ids=None) for each in ray_map.portions]


def test_continued_repaired_selected_and_sharded_maps_keep_them(tmp_path: Path) -> None:
    (tmp_path / "shards").mkdir()
    path = lumens(tmp_path / "shards" / "a.raymap", weighted=True)
    whole = tmp_path / "whole.raymap"
    whole.write_bytes(path.read_bytes())
    with raymap.RayMapWriter.append_to(whole) as writer:
        writer.start_run(seed=2)
        for portion in _portions(path):
            writer.append(portion)
    with raymap.open(whole) as ray_map:
        repair(ray_map, tmp_path / "repaired.raymap")
        some = np.concatenate([each.ray_ids()[::2] for each in ray_map.portions])
        copy_selection(ray_map, some, tmp_path / "selected.raymap")
    lumens(tmp_path / "shards" / "b.raymap", weighted=True, seed=5)
    for name in ("whole.raymap", "repaired.raymap", "selected.raymap", "shards"):
        with raymap.open(tmp_path / name) as ray_map:
            assert asked_of_paths(ray_map), name
            np.testing.assert_allclose(answers(ray_map), by_rays(ray_map), rtol=1e-12)
            assert not verify(ray_map).damage


@pytest.mark.parametrize("place", [raymap.bytes.layout.PORTION, None])
def test_false_squares_are_found(tmp_path: Path, place: bytes | None) -> None:
    seed = Seed("lumens", lumens(tmp_path / "a.raymap", weighted=True))
    chosen = [
        stream
        for part in seed.parts
        if (part.tag == place) == (place is not None)
        for stream in part.streams
        if stream.name == "path.sum_wy2"
    ]
    chosen[0].values[0] *= 1.001
    path = tmp_path / "false.raymap"
    path.write_bytes(put_together(seed.parts))
    with raymap.open(path, on_damage="skip") as ray_map:
        damage = verify(ray_map).damage
        assert {each.portion for each in damage} >= {None if place is None else 0}
    with raymap.open(tmp_path / "a.raymap") as honest, raymap.open(path, on_damage="skip") as found:
        repair(found, tmp_path / "repaired.raymap")
        with raymap.open(tmp_path / "repaired.raymap") as mended:
            assert not verify(mended).damage
            np.testing.assert_allclose(answers(mended), answers(honest), rtol=1e-12)


@pytest.mark.parametrize("large", [False, True], ids=["small", "large"])
def test_squares_that_portions_lack_are_not_believed(
    tmp_path: Path, large: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if large:
        monkeypatch.setattr(raymap.file.reader, "COMPARED_RAYS", 0)
    path = lumens(tmp_path / "a.raymap", weighted=True)
    false = without(path, "path.sum_wy2", tmp_path / "false.raymap", (1,))
    # Another portion is lost, so that those left are counted one by one
    content = bytearray(false.read_bytes())
    with raymap.open(false, on_damage="skip") as ray_map:
        last = ray_map.portions[3]
        [start] = [each.offset for each in last.stream_table() if each.name == "position.x"]
        at = last.offset + start
    content[at] ^= 0xFF
    false.write_bytes(content)
    with raymap.open(false, on_damage="skip") as ray_map:
        text = 'hit("lens") | length > 1e9 mm'
        found = query.select(ray_map, text).summary()
        [totals] = Scan(ray_map, bind_all(ray_map, [text]), use_merged=False).run()
        assert found["matched"] == totals.by_source.rays.sum()
        assert any("squares of lumens" in each.reason for each in ray_map.damage)


def test_maps_in_watt_and_of_one_channel_store_nothing_more(tmp_path: Path) -> None:
    write_small(tmp_path / "watt.raymap", channels=COLORED, weighted=True)
    one = raymap.ChannelSet(
        kind="spectral", wavelengths_nm=(550.0,), source_colors=((1.0,), (1.0,))
    )
    write_small(tmp_path / "one.raymap", directory=LUMENS, channels=one, weighted=True)
    write_small(tmp_path / "unknown.raymap", directory=LUMENS, channels=RGB, weighted=True)
    for name in ("watt", "one", "unknown"):
        with raymap.open(tmp_path / f"{name}.raymap") as ray_map:
            for portion in ray_map.portions:
                names = {entry.name for entry in portion.stream_table()}
                assert "path.sum_wy2" not in names
            assert not verify(ray_map).damage
            squares = ray_map.merged.paths.sum_wy2
            assert (squares is None) == (name == "watt")
            if squares is not None:
                np.testing.assert_array_equal(squares, ray_map.merged.paths.sum_w2)

"""Damaged portions: answered with what can be read, and said."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import query
import raymap
from query import select
from raymap.model.errors import DamagedPortion
from tests.query.random_maps import write_random_map


def position_bytes(portion: Any) -> list[int]:
    """Where a byte of each stream of positions lies in the file."""
    entries = [e for e in portion.stream_table() if e.name.startswith("position") and e.stored_size]
    return [portion.offset + entry.offset for entry in entries]


@pytest.fixture
def damaged(tmp_path: Path) -> tuple[Path, Any]:
    """A map of four portions; the positions of the second are damaged."""
    path = write_random_map(tmp_path / "a.raymap", 5, portions=4, rays=100, paths=30)
    with raymap.open(path) as whole:
        portion = whole.portions[1]
        kept = [i for k, p in enumerate(whole.portions) if k != 1 for i in p.ray_ids().tolist()]
        places = position_bytes(portion)
        lengths = {c: select(whole, c).ray_ids for c in ("length > 5", "event(reflected)")}
    data = bytearray(path.read_bytes())
    for place in places:
        data[place] ^= 0x55
    path.write_bytes(data)
    return path, (set(kept), lengths)


def test_the_sound_portions_answer(damaged: tuple[Path, Any]) -> None:
    path, (kept, whole) = damaged
    with raymap.open(path, on_damage="skip") as map:
        found = select(map, "length > 5")
        assert set(found.ray_ids.tolist()) == set(whole["length > 5"].tolist()) & kept
        assert found.damaged_portions == [1]
        assert [entry["portion"] for entry in found.damaged] == [1]
        # The lost portion's emitted rays do not count.
        served = sum(p.emitted for k, p in enumerate(map.portions) if k != 1)
        np.testing.assert_array_equal(found.emitted, served)
        alone = select(map, "length > 5", use_merged=False)
        assert alone.flux == pytest.approx(found.flux)
        assert alone.flux_se == pytest.approx(found.flux_se)
        mixed = select(map, "length > 5 | event(reflected)")
        again = select(map, "length > 5 | event(reflected)", use_merged=False)
        assert mixed.matched == again.matched == len(mixed.ray_ids)
        assert mixed.flux == pytest.approx(again.flux)
        picture = query.detector_image(map, "screen", "length > 5")
        assert picture.total >= 0


def test_strict_maps_raise(damaged: tuple[Path, Any]) -> None:
    path, _ = damaged
    with raymap.open(path) as map, pytest.raises(DamagedPortion, match="portion 1"):
        select(map, "length > 5")

"""Detector results of few lit cells: stored by cell, read back whole, refused where they lie."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

import raymap
from raymap.bytes.chunks import MapFile
from raymap.encoding import results
from raymap.encoding.results import DetectorResult, pack_result, read_result
from raymap.jit.scratch import lazy_zeros
from raymap.model.errors import FormatError
from tests.raymap.maps import small_directory

CELLS = (300, 200)


def stored(tmp_path: Path, cells: list[int], value: float = 2.5) -> tuple[DetectorResult, bytes]:
    """A result in which only some cells were lit, and its chunk."""
    sums = np.zeros((CELLS[1] * CELLS[0], 3))
    sums[cells, 1] = value
    result = DetectorResult(
        detector=0,
        channel_set=0,
        first_portion=0,
        end_portion=4,
        sums=sums.reshape(CELLS[1], CELLS[0], 3),
        sums2=(sums * sums).reshape(CELLS[1], CELLS[0], 3),
    )
    return result, b"".join(bytes(buffer) for buffer in pack_result(result))


@pytest.mark.parametrize("lit", [0, 1, 7_000, 8_000, 60_000])
def test_results_come_back_whole_however_many_cells_were_lit(lit: int, tmp_path: Path) -> None:
    detector = raymap.Detector(name="screen", cells=CELLS)
    directory = small_directory(detectors=(detector,))
    chosen = np.random.default_rng(lit).permutation(CELLS[0] * CELLS[1])[:lit]
    result, chunk = stored(tmp_path, chosen.tolist())
    path = tmp_path / "map.raymap"
    raymap.RayMapWriter.create(path, directory).close()
    with path.open("ab") as file:
        at = file.tell()
        file.write(chunk)
    with closing(MapFile(path)) as found:
        read = read_result(found, found.chunk_at(at, found.size), directory, [3])
    assert np.array_equal(read.sums, result.sums)
    assert np.array_equal(read.sums2, result.sums2)
    # What is stored grows with the cells that were lit, not with those that there are
    if lit <= 1:
        assert len(chunk) < 1_500


def test_lazy_zeros_are_zeros_that_can_be_written() -> None:
    large = lazy_zeros((3, 2**22))
    assert large.shape == (3, 2**22)
    large[1, 5] = 2.0
    assert large[1, 5] == 2.0
    assert not large[2].any()
    with pytest.raises(MemoryError):
        lazy_zeros((2**60, 2**10))


@pytest.mark.parametrize("cells", [[60_000], [5, 5], [9, 3]])
def test_cells_that_do_not_exist_or_are_out_of_order_are_damage(
    cells: list[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    detector = raymap.Detector(name="screen", cells=CELLS)
    directory = small_directory(detectors=(detector,))
    monkeypatch.setattr(results, "_lit_cells", lambda sums: np.array(cells))
    monkeypatch.setattr(results, "_rows", lambda array, lit: np.ones((len(lit), 3)))
    _, chunk = stored(tmp_path, [1])
    path = tmp_path / "map.raymap"
    raymap.RayMapWriter.create(path, directory).close()
    with path.open("ab") as file:
        at = file.tell()
        file.write(chunk)
    with closing(MapFile(path)) as found, pytest.raises(FormatError, match="cells"):
        read_result(found, found.chunk_at(at, found.size), directory, [3])

"""Sums that no rays have are one clear error, never an infinite or undefined flux."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

import query
import raymap
from query.engine.tally import Tally, estimate, source_factors
from raymap import Directory, RayMapError, Source
from tests.query.random_maps import write_random_map


@pytest.mark.parametrize("bad", [np.inf, np.nan, 1e200, -np.inf])
@pytest.mark.parametrize("which", ["sum_w", "sum_w2"])
def test_sums_of_weights(bad: float, which: str) -> None:
    sums = {"sum_w": np.ones(2), "sum_w2": np.ones(2)}
    sums[which][1] = bad
    with pytest.raises(RayMapError, match="do not add up to a number"):
        Tally(np.ones(2, np.int64), **sums)


@pytest.mark.parametrize("emission", [None, np.array([0, 0])])
def test_worths_whose_squares_no_number_holds(emission: np.ndarray | None) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(RayMapError, match="do not add up to a number"):
            Tally.of_rays(np.zeros(2, np.int64), np.array([1e200, 1.0]), emission, 1)


def test_the_largest_weights_add_up() -> None:
    # float32 holds 3.4e38; 2^63 rays of it are 3.1e57, their squares 1e115
    most = float(np.finfo(np.float32).max) * 2.0**63
    directory = Directory(sources=(Source(name="lamp", flux=1e40),))
    tally = Tally(np.array([2**62]), np.array([most]), np.array([most**2]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = estimate(tally + tally - tally, directory, np.array([2]))
    assert found.flux == pytest.approx(most * 5e39)
    assert np.isfinite(found.se)


def test_sources_without_a_sum() -> None:
    with pytest.raises(ValidationError, match="flux"):
        Source(name="lamp", flux=1e300)
    lamp = Source(name="lamp").model_copy(update={"flux": 1e300})
    with pytest.raises(RayMapError, match="'lamp' is said to emit"):
        source_factors(Directory(sources=(lamp,)), np.array([1]))


def test_maps_of_such_sources(tmp_path: Path) -> None:
    path = write_random_map(tmp_path / "a.raymap", 3, rays=40, paths=10)
    with raymap.open(path) as map:
        sources = map.directory.sources
        huge = sources[0].model_copy(update={"flux": 1e300})
        object.__setattr__(map.directory, "sources", (huge, *sources[1:]))
        for ask in (lambda m: query.select(m).flux, query.path_table, query.audit):
            with pytest.raises(RayMapError, match="no sum can hold"):
                ask(map)

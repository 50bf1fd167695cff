"""Pictures that a small map claims: refused in one line, or made in little memory."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

import raymap
from query import detector_image
from query.answers.images.image_files import write_image
from query.answers.images.narrow import narrow
from query.answers.images.plane_blocks import MOST_BLOCKS, blocks_of_rays
from query.answers.images.readings import readings
from raymap.model.errors import RayMapError
from raymap.model.limits import PICTURE_FLOOR
from raymap.optics.cells import cell_measure
from tests.examples import examples
from tests.raymap.maps import small_directory, write_small

_SKY = raymap.Detector(name="sky", kind="far_field", cells=(3, 4))
_CAMERA = {"half_field": [0.5, 0.4], "lens": "thin", "aperture_diameter": 2.0}


def _detector(**options):
    return raymap.Detector(**{"name": "sensor", "cells": (7, 5), "size": (40.0, 40.0), **options})


def test_a_picture_has_no_more_cells_than_its_map_pays_for(tmp_path):
    side = 8192
    assert side * side > PICTURE_FLOOR
    detector = _detector(cells=(side, side))
    write_small(tmp_path / "a.raymap", directory=small_directory(detectors=(detector, _SKY)))
    with raymap.open(tmp_path / "a.raymap") as ray_map:
        tracemalloc.start()
        with pytest.raises(RayMapError, match=r"8192 x 8192 cells are more than .*--bin") as found:
            detector_image(ray_map, "sensor")
        assert tracemalloc.get_traced_memory()[1] < 10 * 2**20
        tracemalloc.stop()
        assert "\n" not in str(found.value)
        image = detector_image(ray_map, "sensor", bin=8)
    assert image.flux.shape == (1024, 1024)


@pytest.mark.parametrize(
    ("options", "most"),
    [
        ({}, 100),
        ({"kind": "surface", "parameters": {"cell_area": 0.25}}, 100),
        # A beam of single cells: fitted in as many as a far field ever is
        ({"kind": "far_field", "parameters": {"gamma_deg": [0.0, 180.0]}}, 1000),
    ],
)
def test_what_is_read_of_many_cells_costs_what_its_rays_cost(tmp_path, options, most):
    """Of 4,000² cells one array takes 128 MB, and 13 windows of 5 shares of each cell 8 GB."""
    detector = _detector(cells=(4000, 4000), **options)
    write_small(tmp_path / "a.raymap", directory=small_directory(detectors=(detector, _SKY)))
    with raymap.open(tmp_path / "a.raymap") as ray_map:
        tracemalloc.start()
        image = detector_image(ray_map, "sensor")
        numbers = readings(image)
        image.calmer()
        # Four bytes a cell say where its sums stand
        assert tracemalloc.get_traced_memory()[1] < most * 2**20
        tracemalloc.stop()
    assert numbers["flux"] == pytest.approx(image.channels.sum())
    assert numbers["registrations"] == image.rays.sum() > 0


def test_a_table_of_many_cells_is_written_row_by_row(tmp_path):
    detector = _detector(cells=(1000, 1000))
    write_small(tmp_path / "a.raymap", directory=small_directory(detectors=(detector, _SKY)))
    with raymap.open(tmp_path / "a.raymap") as ray_map:
        image = detector_image(ray_map, "sensor")
    tracemalloc.start()
    write_image(image, tmp_path / "a.csv")
    # Every number of every cell as a text of its own would be half a gigabyte
    assert tracemalloc.get_traced_memory()[1] < 20 * 2**20
    tracemalloc.stop()
    table = np.loadtxt(tmp_path / "a.csv", delimiter=",", skiprows=1)
    assert np.array_equal(table[:, :2], np.argwhere(np.ones((1000, 1000)))[:, ::-1])
    assert np.allclose(table[:, 4], image.flux.ravel(), rtol=1e-8)


@settings(max_examples=examples(60))
@given(data=st.data())
def test_each_cell_lies_in_one_block(data):
    """Whatever the light; and no more blocks than allowed, however many rays there are."""
    shape = data.draw(st.tuples(st.integers(1, 70), st.integers(1, 70)))
    n = data.draw(st.integers(0, 200))
    random = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    cell = np.unique(random.integers(0, shape[0] * shape[1], n))
    rays = random.exponential(data.draw(st.sampled_from([0.5, 8.0, 100.0])), len(cell))
    covered = np.zeros(shape, int)
    for blocks in blocks_of_rays(cell // shape[1], cell % shape[1], rays, shape):
        for row, column in zip(blocks.row * blocks.side, blocks.column * blocks.side, strict=True):
            assert row < shape[0]
            assert column < shape[1]
            covered[row : row + blocks.side, column : column + blocks.side] += 1
    assert (covered == 1).all()


def test_there_are_at_most_so_many_blocks():
    row, column = (place.ravel() for place in np.indices((1000, 1000)))
    blocks = blocks_of_rays(row, column, np.full(10**6, 1e6), (1000, 1000))
    assert MOST_BLOCKS / 8 < sum(len(part.row) for part in blocks) <= MOST_BLOCKS


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"kind": "far_field", "parameters": {"gamma_deg": [0.0, 180.0]}},
        {"kind": "surface", "parameters": {"cell_area": 0.25}},
    ],
)
def test_cells_that_are_alike_are_measured_once(options):
    tracemalloc.start()
    measure = cell_measure(_detector(cells=(65535, 65535), **options), "mm")
    assert tracemalloc.get_traced_memory()[1] < 10 * 2**20
    tracemalloc.stop()
    assert measure is not None
    assert measure.values.shape == (65535, 65535)
    if options.get("kind") == "far_field":
        # All directions
        total = float(measure.values[:, 0].sum()) * 65535
        assert total == pytest.approx(4.0 * np.pi, rel=1e-9)


def test_pixels_are_measured_band_by_band():
    detector = _detector(kind="camera", cells=(2000, 1000), parameters=_CAMERA)
    tracemalloc.start()
    measure = cell_measure(detector, "mm")
    # The values take 16 MB, all nine Gauss points of all pixels 144 MB and more
    assert tracemalloc.get_traced_memory()[1] < 100 * 2**20
    tracemalloc.stop()
    assert measure is not None
    coarse = cell_measure(_detector(kind="camera", cells=(200, 100), parameters=_CAMERA), "mm")
    joined = measure.values.reshape(100, 10, 200, 10).sum(axis=(1, 3))
    assert np.allclose(joined, coarse.values, rtol=1e-9)


@pytest.mark.parametrize("ratio", [1e-3, 1.0, 1e2, 1e6, 1e15])
def test_a_lens_takes_what_its_solid_angle_says(ratio):
    """On the axis the configuration factor of a disc is R² / (R² + h²), exactly."""
    parameters = {
        "half_field": [1e-7, 1e-7],
        "aperture_diameter": 2.0 * ratio,
        "focus_distance": 1.0,
    }
    measure = cell_measure(_detector(kind="camera", cells=(1, 1), parameters=parameters), "m")
    factor = ratio**2 / (1.0 + ratio**2)
    assert measure.values.item() == pytest.approx(np.pi * factor * 4e-14, rel=1e-9)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"parameters": {"gamma_deg": "0 to 180"}}, "gamma_deg"),
        ({"parameters": {"gamma_deg": [90.0, 0.0]}}, "gamma_deg"),
        ({"parameters": {"gamma_deg": [0.0, 1e308]}}, "gamma_deg"),
        ({"parameters": {"half_field": [0.0, 1.0]}}, "half_field"),
        ({"parameters": {"half_field": 3}}, "half_field"),
        ({"parameters": {"aperture_diameter": {}}}, "aperture_diameter"),
        ({"parameters": {"focus_distance": 10**400}}, "focus_distance"),
        ({"parameters": {"cell_area": [1.0, 2.0]}}, "cell_area"),
        ({"parameters": {"cell_area": [True] * 35}}, "cell_area"),
        ({"parameters": {"size_unit": []}}, "size_unit"),
        ({"size": (0.0, 1.0)}, "size"),
        ({"size": (1e200, 1.0)}, "size"),
    ],
)
def test_parameters_that_are_no_numbers_are_refused(changes, words):
    with pytest.raises(ValidationError, match=words):
        _detector(**changes)


def test_parameters_that_nobody_computes_from_are_carried_along():
    assert _detector(parameters={"mine": [{"x": None}]}).parameters == {"mine": [{"x": None}]}


def test_numbers_that_float32_does_not_hold_are_refused():
    assert narrow(np.array([1.0, -3e38])).dtype == np.float32
    with pytest.raises(RayMapError, match=r"3\.4e38"):
        narrow(np.array([1.0, 1e39]))


def test_cells_without_size_have_no_readings(tmp_path):
    detector = _detector(kind="surface", parameters={"cell_area": 0.0})
    write_small(tmp_path / "a.raymap", directory=small_directory(detectors=(detector, _SKY)))
    with raymap.open(tmp_path / "a.raymap") as ray_map:
        image = detector_image(ray_map, "sensor")
        with pytest.raises(RayMapError, match="no cell of detector 'sensor' has a size"):
            readings(image)

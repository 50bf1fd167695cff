"""The detector panel's numbers: how coarse a picture has to be."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from raymap.optics.cellsizes import bin_cells
from viewer.panels.detector import calm_binning


def _even(rays_per_cell: float, seed: int = 1) -> NDArray[np.float64]:
    return 0.003 * np.random.default_rng(seed).poisson(rays_per_cell, (240, 320)).astype(float)


@pytest.mark.parametrize(
    ("rays_per_cell", "binning"), [(40.0, 1), (4.0, 1), (0.9, 2), (0.2, 4), (0.04, 8), (0.005, 16)]
)
def test_even_light_is_binned_until_it_is_more_than_single_rays(
    rays_per_cell: float, binning: int
) -> None:
    for seed in range(5):
        image = _even(rays_per_cell, seed)
        assert calm_binning(image) == binning
        # Blocks that hold one and a half rays on average are mostly lit
        blocks = bin_cells(image, binning)
        assert binning == 16 or np.mean(blocks > 0.0) > 0.75


def test_a_focus_stays_as_fine_as_it_is_among_stray_rays() -> None:
    image = _even(0.005)
    image[100:102, 200:203] += 0.003 * 2000.0
    assert calm_binning(image) == 1


def test_pictures_without_light_or_of_one_row_have_a_binning() -> None:
    assert calm_binning(np.zeros((4, 5))) == 1
    assert calm_binning(np.ones((1, 50))) == 1
    assert calm_binning(np.ones((1, 1))) == 1

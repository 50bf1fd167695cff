"""Luminous openings that are bodies: outlines, and luminance by intensity over the outline."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.tracer.chi2 import SIGNIFICANCE, chi2_counts
from tests.tracer.sources.emission import directions, emitted, starts, with_source
from tracer.light import IntensityGrid, Opening, OpeningShape
from tracer.sources.intensity import IntensitySource

Array = NDArray[np.float64]

# A narrow pencil at gamma 50, C 30: one direction to all purposes
GAMMA, C = 50.0, 30.0
BEAM = np.array(
    [
        math.sin(math.radians(GAMMA)) * math.cos(math.radians(C)),
        -math.sin(math.radians(GAMMA)) * math.sin(math.radians(C)),
        math.cos(math.radians(GAMMA)),
    ]
)


def pencil(opening: float | tuple[float, float] | Opening) -> IntensityGrid:
    gamma = [GAMMA - 0.01, GAMMA, GAMMA + 0.01]
    planes = np.array([C - 0.01, C, C + 0.01, C + 0.02, C + 359.98])
    values = np.zeros((3, 5))
    values[1, 1] = 1.0
    return IntensityGrid(
        gamma_deg=gamma, c_deg=planes, intensity=values, opening=opening, length_unit="mm"
    )


def rays_of(grid: IntensityGrid, n: int) -> tuple[Array, Array]:
    """Places and directions of n rays, the axis along z."""
    portion = emitted(with_source(IntensitySource(light=grid)), n)
    return portion.position[starts(portion)].astype(float), directions(portion)


@pytest.mark.parametrize(
    ("shape", "size", "area"),
    [
        # Outline from b: pi sqrt(sum of squares of cofactor times b), Cauchy for an ellipsoid
        ("ellipsoid", (4.0, 4.0, 4.0), math.pi * 4.0),
        ("ellipsoid", (4.0, 2.0, 1.0), None),
        ("box", (4.0, 2.0, 1.0), 2.0 * abs(BEAM[0]) + 4.0 * abs(BEAM[1]) + 8.0 * abs(BEAM[2])),
        (
            "cylinder along C0",
            (12.0, 0.3, 0.3),
            12.0 * 0.3 * math.sqrt(1 - BEAM[0] ** 2) + math.pi * 0.15**2 * abs(BEAM[0]),
        ),
        (
            "cylinder along C90",
            (0.3, 12.0, 0.3),
            12.0 * 0.3 * math.sqrt(1 - BEAM[1] ** 2) + math.pi * 0.15**2 * abs(BEAM[1]),
        ),
        (
            "upright cylinder",
            (3.0, 3.0, 5.0),
            15.0 * math.sqrt(1 - BEAM[2] ** 2) + math.pi * 1.5**2 * abs(BEAM[2]),
        ),
        ("ellipse", (12.0, 3.0, 0.0), math.pi * 9.0 * BEAM[2]),
        ("cylinder along C0", (0.0, 3.0, 2.0), math.pi * 1.5 * abs(BEAM[0])),
    ],
)
def test_light_is_even_over_the_outline(
    shape: OpeningShape, size: tuple[float, float, float], area: float | None
) -> None:
    """Rays of one direction are uniform over the outline, whose area geometry gives."""
    if area is None:
        a, b, c = (0.5 * side for side in size)
        cofactors = np.array([b * c, a * c, a * b])
        area = math.pi * float(np.linalg.norm(cofactors * BEAM))
    n = 200_000
    places, ways = rays_of(pencil(Opening(shape=shape, size=size)), n)
    assert np.abs(ways - BEAM).max() < 1e-3
    assert (np.abs(places) <= np.array(size) / 2 + 1e-6).all()
    # Look from the direction of the beam, along the longest way of the outline
    across = np.linalg.svd(places - np.outer(places @ BEAM, BEAM), full_matrices=False)[2][:2]
    flat = places @ across.T
    reach = np.abs(flat).max(axis=0) * 1.0001
    counts, _, _ = np.histogram2d(flat[:, 0], flat[:, 1], bins=24, range=[(-r, r) for r in reach])
    # Compare cells whose neighbours are full: they lie inside whatever the outline is
    padded = np.pad(counts > 0, 1)
    inside = np.ones_like(counts, bool)
    for i in range(3):
        for j in range(3):
            inside &= padded[i : i + 24, j : j + 24]
    cell = (2 * reach[0] / 24) * (2 * reach[1] / 24)
    found = counts[inside]
    wanted = np.full(found.size, n * cell / area)
    assert found.size > 40
    rest = n - found.sum()
    assert chi2_counts(np.append(found, rest), np.append(wanted, n - wanted.sum())) > SIGNIFICANCE


def test_a_luminous_body_hangs_below_its_ceiling() -> None:
    ceiling = """
[bodies.ceiling]
kind = "rectangle"
position = [0, 0, 100]
size = [500, 500]
surface = "absorber"
"""
    grid = IntensityGrid(
        gamma_deg=[0, 180],
        c_deg=[0],
        intensity=[[1], [1]],
        opening=Opening(shape="box", size=(20.0, 10.0, 6.0)),
        length_unit="mm",
    )
    lamp = IntensitySource(light=grid, position=(0, 0, 100), axis=(0, 0, -1))
    portion = emitted(with_source(lamp, ceiling), 2000)
    height = portion.position[starts(portion), 2]
    assert 93.9 < height.min() < 94.1
    assert 99.9 < height.max() <= 100.0

"""The engine that a scene needs traces the same rays as the whole one, which most tests run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.whole_engine import own_compile, whole
from tracer.scene.load import load_scene
from tracer.transport.wavefront import Wavefront

SAMPLES = Path(__file__).parents[3] / "samples"
OTHERS = [
    "room",
    "prism_spectrometer",
    "integrating_sphere",
    "keyboard/keyboard",
    "led_lens/led_lens",
]


@pytest.mark.parametrize(
    "name",
    ["double_gauss", *(pytest.param(name, marks=pytest.mark.slow) for name in OTHERS)],
)
def test_own_engine_traces_what_the_whole_one_traces(name: str) -> None:
    own = own_compile(load_scene(SAMPLES / f"{name}.toml"))
    filled = whole(own.arrays)
    assert filled is not own.arrays
    portions = [
        Wavefront(arrays, 7, meshes=own.solids, exact=True).trace(0, 3_000)
        for arrays in (own.arrays, filled)
    ]
    first, second = portions
    for column in (
        *("records_per_ray", "object", "triangle", "event", "medium", "descriptor_count"),
        *("position", "normal", "color_code", "color_table"),
    ):
        np.testing.assert_array_equal(getattr(first, column), getattr(second, column), column)
    np.testing.assert_array_equal(first.extra["exact"], second.extra["exact"])
    for column in ("detector", "cell", "cosine", "uv", "registered"):
        np.testing.assert_array_equal(
            getattr(first.descriptors, column), getattr(second.descriptors, column), column
        )

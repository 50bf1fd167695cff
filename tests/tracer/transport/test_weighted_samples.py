"""Every sample scene traced with weights: detectors register what they do in the analog mode."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import t

from tracer.scene.compile import compile_scene
from tracer.scene.load import load_scene
from tracer.scene.model import Scene
from tracer.scene.variance_reduction import TraceModel
from tracer.transport.counts import Counts
from tracer.transport.tally import Tally
from tracer.transport.wavefront import Wavefront

SAMPLES = Path(__file__).parents[3] / "samples"
BATCHES = 24
LEAST_P = 1e-4
"""Of all comparisons of a scene together."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """A sample, its variance reduction, and rays in thousands: analog, weighted."""

    file: str
    trace: dict[str, object]
    short: tuple[float, float] | None
    long: tuple[float, float]
    variants: tuple[str, ...] = ()


CASES = {
    "double_gauss": Case(
        "double_gauss.toml",
        {"split_depth": 2, "min_reflection": 0.1, "roulette_weight": 1e-4},
        (60, 2),
        (2_000, 60),
    ),
    "double_gauss, whole front": Case(
        "double_gauss.toml",
        {"aim": ("sensor",), "min_reflection": 0.2},
        None,
        (1_000, 1_000),
        ("flood",),
    ),
    "prism_spectrometer": Case(
        "prism_spectrometer.toml", {"split_depth": 1, "min_reflection": 0.2}, None, (500, 100)
    ),
    "integrating_sphere": Case(
        "integrating_sphere.toml",
        {"aim": ("port.face",), "min_reflection": 0.1},
        (20, 20),
        (400, 400),
    ),
    "room": Case(
        "room.toml",
        {"aim": ("desk", "short_block"), "min_reflection": 0.3},
        (40, 40),
        (2_000, 2_000),
    ),
    "keyboard": Case(
        "keyboard/keyboard.toml",
        {"aim": ("key_B3.face", "top_A*"), "aim_share": 0.3, "min_reflection": 0.05},
        None,
        (600, 600),
    ),
    "led_lens": Case(
        "led_lens/led_lens.toml",
        {"split_depth": 2, "aim": ("lens",), "min_reflection": 0.2},
        None,
        (1_000, 200),
    ),
    "opal": Case("opal/backlight.toml", {"aim": ("luminance",), "aim_share": 0.3}, None, (60, 60)),
}  # fmt: skip


def traced(scene: Scene, rays: int, *, weighted: bool, seed: int) -> tuple[list[str], Array]:
    """Names of fluxes, and (batches, n) what independent batches of rays find for them."""
    compilation = compile_scene(scene)
    engine = Wavefront(compilation.arrays, seed, meshes=compilation.solids, weighted=weighted)
    names: list[str] = []
    rows = []
    size = rays // BATCHES
    step = max(16, 16_384 // engine.max_branches)
    for batch in range(BATCHES):
        tally = Tally(compilation.directory, compilation.channel_set)
        for first in range(batch * size, (batch + 1) * size, step):
            n = min(step, (batch + 1) * size - first)
            tally.add(engine.trace(first, n, reuse=True))
        names, row = measured(tally.counts())
        rows.append(row)
    return names, np.array(rows)


def measured(counts: Counts) -> tuple[list[str], list[float]]:
    """Fluxes by name: detectors, fields of them by channel, absorbers, light that left."""
    found: dict[str, float] = {}
    for name, detector in counts.detectors.items():
        found[name] = detector.total
        if len(counts.detectors) < 6:
            channels = detector.channels
            for i, row in enumerate(np.array_split(channels, min(3, len(channels)))):
                for j, part in enumerate(np.array_split(row, min(3, row.shape[1]), axis=1)):
                    for k, flux in enumerate(part.sum(axis=(0, 1))):
                        found[f"{name} {i} {j} {k}"] = float(flux)
    taken = counts.taken.flux
    for name, flux in zip((*counts.objects, *counts.media), taken, strict=True):
        found[f"absorbed by {name}"] = float(flux)
    left = counts.endings.factors * counts.endings.sums[:, counts.classes.index("left")]
    for name, flux in zip(counts.sources, left, strict=True):
        found[f"{name} left"] = float(flux)
    return list(found), list(found.values())


def compare(case: Case, analog_rays: int, emissions: int) -> None:
    """Welch's test of every flux; the smallest p of all, after Bonferroni, decides."""
    scene = load_scene(SAMPLES / case.file, variants=case.variants)
    weighted_scene = scene.model_copy(update={"trace": TraceModel(mode="weighted", **case.trace)})  # type: ignore[arg-type]
    names, one = traced(scene, analog_rays, weighted=False, seed=11)
    _, two = traced(weighted_scene, emissions, weighted=True, seed=12)
    mean = np.array([one.mean(axis=0), two.mean(axis=0)])
    se = np.array([rows.std(axis=0, ddof=1) / np.sqrt(BATCHES) for rows in (one, two)])
    # Batches must hold enough rays that their means are normal
    known = (mean > 0.0).all(axis=0) & (se < 0.1 * mean).all(axis=0)
    assert known.any()
    spread = np.hypot(*se)[known]
    deviations = np.diff(mean[:, known], axis=0)[0] / np.where(spread > 0.0, spread, 1.0)
    assert np.all(np.abs(deviations[spread == 0.0]) < 1e-9)
    worst = int(np.argmax(np.abs(deviations)))
    p = min(1.0, 2.0 * t.sf(np.abs(deviations[worst]), BATCHES - 1) * len(deviations))
    name = np.array(names)[known][worst]
    print(f"{len(deviations)} fluxes, p = {p:.3g}, worst {name}: t = {deviations[worst]:.2f}")
    assert p > LEAST_P, (name, deviations[worst])
    assert (deviations**2).mean() < 2.5, (deviations**2).mean()


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.short])
def test_weights_bring_the_same_light(name: str) -> None:
    case = CASES[name]
    assert case.short
    compare(case, *(int(1000 * count) for count in case.short))


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_weights_bring_the_same_light_to_every_sample(name: str) -> None:
    compare(CASES[name], *(int(1000 * count) for count in CASES[name].long))

"""Three features at once, drawn by chance: ways of following light check each other."""

from __future__ import annotations

import pytest

from tests.composition.combinations import (
    DETECTORS,
    ELEMENTS,
    SOURCES,
    Combination,
    drawn,
    judged,
)


@pytest.mark.parametrize(
    "combination",
    [
        Combination(("polariser", "dispersion"), "collimated", "plane ahead"),
        Combination(("dispersion", "tilted rough metal"), "collimated", "far field"),
        Combination(("tilted metal",), "polarised beam", "map of a surface"),
    ],
    ids=lambda item: " ".join((*item.elements, item.source, item.detector)),
)
def test_ways_of_following_light_agree(combination: Combination) -> None:
    decided, wrong = judged(combination, 2_000)
    assert not wrong
    assert decided == 3 + 10


def test_a_wrong_way_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """The filter is forgotten in split light: what the others see tells."""
    from tests.composition import combinations

    counted = combinations.counted

    def forgets(
        text: str, detector: str, *, mode: str, seed: int, rays: int
    ) -> tuple[float, float]:
        if mode == "splitting":
            text = text.replace("transmittance = 0.5", "transmittance = 0.9")
        return counted(text, detector, mode=mode, seed=seed, rays=rays)

    monkeypatch.setattr(combinations, "counted", forgets)
    _, wrong = judged(Combination(("filter",), "collimated", "plane ahead"), 1_000)
    assert len(wrong) == 2
    assert all("splitting" in line for line in wrong)


def test_everything_is_drawn() -> None:
    """60 seeds name each element, source and detector."""
    found = [drawn(seed) for seed in range(60)]
    assert {name for item in found for name in item.elements} == set(ELEMENTS)
    assert {item.source for item in found} == set(SOURCES)
    assert {item.detector for item in found} == set(DETECTORS)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(60))
def test_drawn_combinations(seed: int) -> None:
    """Few pairs decide nothing, for want of light on the detector."""
    combination = drawn(seed)
    decided, wrong = judged(combination, 6_000)
    assert not wrong
    if decided < 2:
        # What is dark in one way is dark in all: more rays make sure of it
        decided, wrong = judged(combination, 60_000)
        assert not wrong

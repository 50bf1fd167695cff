"""Colours of rays by every rule."""

from __future__ import annotations

import numpy as np
import pytest

import raymap
from raymap.model.events import ENDINGS, FAMILIES
from viewer.drawn.colors import _by_category, _by_count, color_lines, optical_length
from viewer.drawn.falsecolor import PALETTE
from viewer.drawn.gather import read_rays
from viewer.drawn.lines import build_lines
from viewer.drawn.rays import DrawnRays, no_rays
from viewer.drawn.state import COLOR_RULES


@pytest.fixture(scope="module")
def rays(small_map: raymap.RayMap) -> DrawnRays:
    return read_rays(small_map, 0, np.arange(200))


def key_of(rays: DrawnRays, rule: str, ray: int) -> object:
    """What a rule tells apart, ray by ray."""
    mine = slice(rays.offsets[ray], rays.offsets[ray + 1])
    if rule == "source":
        return int(rays.source[ray])
    if rule == "path":
        return int(rays.path[ray])
    if rule == "reflections":
        return sum(bool(bits & int(FAMILIES["reflected"])) for bits in rays.event[mine])
    return int(rays.event[mine][-1] & int(ENDINGS))


@pytest.mark.parametrize("rule", ["source", "path", "reflections", "ending"])
def test_categories_get_one_colour_each(
    rays: DrawnRays, small_map: raymap.RayMap, rule: str
) -> None:
    lines = build_lines(rays)
    rgba, legend = color_lines(rays, lines, rule, small_map.directory)
    colors: dict[object, set] = {}
    for segment in range(len(lines)):
        key = key_of(rays, rule, int(lines.ray[segment]))
        colors.setdefault(key, set()).add(tuple(rgba[segment, :3]))
    assert all(len(found) == 1 for found in colors.values())
    assert len({next(iter(found)) for found in colors.values()}) == len(colors)
    assert len(legend.entries) == len(colors)
    shown = {entry.rgb for entry in legend.entries}
    assert shown == {tuple(int(x) for x in next(iter(found))) for found in colors.values()}


def test_reflections_are_listed_in_rising_order(small_map: raymap.RayMap) -> None:
    rays = read_rays(small_map, 0, np.arange(200))
    # The commonest number of reflections is not the smallest
    reflected = [key_of(rays, "reflections", ray) for ray in range(rays.n_rays)]
    kept = np.flatnonzero([count != min(reflected) for count in reflected])[:20]
    kept = np.sort(np.append(kept, int(np.argmin(reflected))))
    few = read_rays(small_map, 0, kept)
    _, legend = color_lines(few, build_lines(few), "reflections", small_map.directory)
    labels = [int(entry.label) for entry in legend.entries]
    assert len(labels) > 1
    assert labels == sorted(labels)


@pytest.mark.parametrize("rule", COLOR_RULES)
@pytest.mark.parametrize("dark", [True, False])
def test_every_rule_colours_every_segment(
    rays: DrawnRays, small_map: raymap.RayMap, rule: str, dark: bool
) -> None:
    lines = build_lines(rays)
    rgba, _ = color_lines(rays, lines, rule, small_map.directory, dark=dark, opacity=0.4)
    assert rgba.shape == (len(lines), 4)
    assert (rgba[:, 3] == 102).all()
    empty, _ = color_lines(no_rays(), build_lines(no_rays()), rule, small_map.directory)
    assert len(empty) == 0


def test_natural_colours_are_those_of_the_light(rays: DrawnRays, small_map: raymap.RayMap) -> None:
    lines = build_lines(rays)
    rgba, _ = color_lines(rays, lines, "natural", small_map.directory)
    pure = rays.rgb[lines.record].max(axis=1) > 0.99
    np.testing.assert_array_equal(
        rgba[pure, :3].argmax(axis=1), rays.rgb[lines.record][pure].argmax(axis=1)
    )
    white = ~pure
    assert (rgba[white, :3] > 250).all()
    on_white, _ = color_lines(rays, lines, "natural", small_map.directory, dark=False)
    assert (on_white[white, :3] < 170).all()


def test_fading_follows_the_flux(rays: DrawnRays, small_map: raymap.RayMap) -> None:
    lines = build_lines(rays)
    rgba, _ = color_lines(rays, lines, "natural", small_map.directory, opacity=1.0, fade=True)
    expected = 255 * rays.flux[lines.ray] / rays.flux.max()
    assert np.abs(rgba[:, 3] - expected).max() <= 1
    assert rgba[:, 3].min() >= 1


def test_optical_lengths_are_summed_without_the_way_out(rays: DrawnRays) -> None:
    found = optical_length(rays)
    for ray in range(rays.n_rays):
        first, last = int(rays.offsets[ray]), int(rays.offsets[ray + 1]) - 1
        left = rays.event[last] & int(FAMILIES["left"])
        stop = last - 1 if left else last
        total = sum(
            float(np.linalg.norm(rays.position[k + 1].astype(float) - rays.position[k]))
            * float(rays.index[k])
            for k in range(first, stop)
        )
        assert found[ray] == pytest.approx(total, rel=1e-6)


def test_many_numbers_of_reflections_never_share_a_colour() -> None:
    """Palettes end: with more numbers than colours a scale takes their place."""
    for most in (11, 12, 20, 300):
        values = np.repeat(np.arange(most + 1), 2)
        colors, legend = _by_count(values, "reflections")
        shown = {entry.label: entry.rgb for entry in legend.entries}
        assert len(set(shown.values())) == len(shown)
        of = {number: tuple(colors[2 * number].tolist()) for number in range(most + 1)}
        for number, rgb in of.items():
            label = str(number) if most < 12 or number < 20 else "20 and more"
            assert shown[label] == rgb


def test_categories_beyond_the_palette_are_said_to_be_others() -> None:
    values = np.repeat(np.arange(30), np.arange(30, 0, -1))
    colors, legend = _by_category(values, {}, "path")
    assert legend.entries[-1].label == "18 others"
    assert len({entry.rgb for entry in legend.entries}) == len(PALETTE) + 1
    assert {tuple(row) for row in colors[values >= 12].tolist()} == {legend.entries[-1].rgb}

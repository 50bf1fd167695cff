"""Physics as laws: closed formulas that a Monte Carlo trace must meet within its own error."""

from __future__ import annotations

import math

import numpy as np
import pytest

from raymap.model.events import Event
from tests.naive.fresnel import fresnel_reflectance
from tests.tracer.transport.tracing import assert_share, compiled, trace

BEAM = """
[sources.beam]
kind = "collimated"
position = [0, 0, -10]
direction = [{dx}, 0, {dz}]
diameter = 0.5
"""


def plate(angle_deg: float, *, index: float = 1.5, absorption: float = 0.0) -> str:
    a = math.radians(angle_deg)
    return (
        BEAM.format(dx=math.sin(a), dz=math.cos(a))
        + f"""
[media.glass]
index = {index}
absorption = {absorption}
[bodies.plate]
kind = "box"
size = [4000, 4000, 1]
medium = "glass"
"""
    )


@pytest.mark.parametrize("angle_deg", [0.0, 45.0, 70.0])
def test_plate_reflects_and_transmits_as_the_sum_over_all_reflections_says(
    angle_deg: float,
) -> None:
    found = trace(plate(angle_deg), 200_000)
    r = fresnel_reflectance(1.0, 1.5, math.cos(math.radians(angle_deg)))
    going_up = found.portion.normal[found.last, 2] > 0
    assert found.endings(Event.LEFT_SCENE) == 200_000
    assert_share(int(going_up.sum()), 200_000, (1.0 - r) / (1.0 + r))


def test_absorbing_plate_follows_beer_and_lambert() -> None:
    found = trace(plate(0.0, index=1.0, absorption=0.7), 200_000)
    assert_share(found.endings(Event.VOLUME_ABSORPTION), 200_000, 1.0 - math.exp(-0.7))
    depth = found.portion.position[found.last][
        found.portion.event[found.last] & int(Event.VOLUME_ABSORPTION) != 0, 2
    ]
    # The depth of absorption is a truncated exponential
    expected = 1.0 / 0.7 - math.exp(-0.7) / (1.0 - math.exp(-0.7))
    assert abs(depth.mean() + 0.5 - expected) < 4.5 * depth.std() / math.sqrt(len(depth))


def test_refraction_obeys_snell() -> None:
    found = trace(plate(30.0), 2_000)
    inside = np.flatnonzero(found.portion.event & int(Event.SPECULAR_REFRACTION))
    first = found.portion.position[inside]
    step = found.portion.position[inside + 1] - first
    entering = found.portion.medium[inside] == 2
    sine = np.hypot(step[entering, 0], step[entering, 1]) / np.linalg.norm(step[entering], axis=1)
    assert np.allclose(sine, math.sin(math.radians(30.0)) / 1.5, atol=2e-6)


def test_prism_deviates_by_the_minimum_and_selects_channels_evenly() -> None:
    apex, indices = math.radians(60.0), (1.52, 1.60, 1.70)
    centre = math.asin(indices[1] * math.sin(apex / 2.0))
    height = 10.0 * math.cos(apex / 2.0)
    tilt = centre - apex / 2.0
    text = f"""
[media.flint]
index = {{ rgb = [{indices[0]}, {indices[1]}, {indices[2]}] }}
[bodies.prism]
kind = "prism"
medium = "flint"
outline = [[-5, 0], [5, 0], [0, {height}]]
length = 40
[sources.beam]
kind = "collimated"
direction = [{math.cos(tilt)}, {math.sin(tilt)}, 0]
aim = [-2.5, {height / 2}, 0]
distance = 20
diameter = 0.01
"""
    found = trace(text, 30_000)
    ended = found.portion.event[found.last] & int(Event.LEFT_SCENE) != 0
    selected = found.portion.color_code[found.last]
    direct = ended & (found.portion.records_per_ray == 4) & (selected < 3)
    for channel, index in enumerate(indices):
        mine = direct & (selected == channel)
        out = found.portion.normal[found.last[mine]] / 32767.0
        deviation = tilt - np.arctan2(out[:, 1], out[:, 0])
        inner = math.asin(math.sin(centre) / index)
        leaving = math.asin(index * math.sin(apex - inner))
        expected = centre + leaving - apex
        deviation = deviation[np.abs(deviation - expected) < 0.05]
        assert np.allclose(deviation, expected, atol=1e-4)
        through = 1.0 - fresnel_reflectance(1.0, index, math.cos(centre))
        through *= 1.0 - fresnel_reflectance(index, 1.0, math.cos(apex - inner))
        assert_share(len(deviation), 30_000, through / 3.0)
    assert found.count(Event.DISPERSIVE_SELECT) <= 30_000


@pytest.mark.parametrize("reflectance", [0.5, 0.9])
def test_closed_cavity_is_met_as_often_as_its_reflectance_says(reflectance: float) -> None:
    found = trace(
        f"""
[surfaces.wall]
kind = "lambertian"
reflectance = {reflectance}
[bodies.cavity]
kind = "box"
size = [3, 4, 5]
surface = "wall"
[sources.lamp]
kind = "point"
position = [0.3, -0.2, 0.1]
""",
        40_000,
    )
    assert found.endings(Event.SURFACE_ABSORPTION) == 40_000
    hits = found.portion.records_per_ray - 1
    mean = 1.0 / (1.0 - reflectance)
    spread = math.sqrt(reflectance) / (1.0 - reflectance)
    assert abs(hits.mean() - mean) < 4.5 * spread / math.sqrt(40_000)


def test_view_factor_of_coaxial_equal_discs() -> None:
    found = trace(
        """
[sources.disc]
kind = "lambertian"
position = [0, 0, 0]
diameter = 2
[bodies.target]
kind = "disc"
position = [0, 0, 1]
outer = 1
surface = "absorber"
""",
        400_000,
    )
    assert_share(found.ended_on("target"), 400_000, (3.0 - math.sqrt(5.0)) / 2.0)


def test_view_factor_of_perpendicular_squares_with_a_common_edge() -> None:
    found = trace(
        """
[sources.floor]
kind = "lambertian"
position = [0.5, 0.5, 0]
size = [1, 1]
[bodies.wall]
kind = "rectangle"
position = [0, 0.5, 0.5]
rotation = [0, 90, 0]
size = [1, 1]
surface = "absorber"
""",
        400_000,
    )
    # J. R. Howell, A catalog of radiation heat transfer configuration factors, C-14
    assert_share(found.ended_on("wall"), 400_000, 0.20004378)


def test_integrating_sphere_lights_its_port_evenly() -> None:
    reflectance, cap = 0.9, 0.1
    share = (1.0 - math.cos(cap)) / 2.0
    found = trace(
        f"""
[surfaces.white]
kind = "lambertian"
reflectance = {reflectance}
[bodies.wall]
kind = "sphere"
radius = 10
surface = "white"
[bodies.port]
kind = "disc"
position = [0, 0, {10.0 * math.cos(cap)}]
outer = {10.0 * math.sin(cap)}
surface = "absorber"
[sources.lamp]
kind = "lambertian"
position = [0, 0, -9.99]
diameter = 0.02
cone_deg = 40
""",
        200_000,
    )
    # A point of the wall sends the share of its solid angle to the port at every reflection
    direct = math.sin(math.atan(math.sin(cap) / (0.999 + math.cos(cap)))) ** 2
    direct /= math.sin(math.radians(40.0)) ** 2
    multiplier = reflectance / (1.0 - reflectance * (1.0 - share))
    expected = direct + (1.0 - direct) * share * multiplier
    assert_share(found.ended_on("port"), 200_000, expected, sigmas=6.0)


def test_total_reflection_keeps_light_in_a_guide() -> None:
    found = trace(
        """
[media.plastic]
index = 1.49
[bodies.guide]
kind = "box"
size = [200, 5, 5]
medium = "plastic"
faces = { x_max = "absorber", x_min = "absorber" }
[sources.inside]
kind = "point"
axis = [1, 0, 0]
cone_deg = 30
inside = "guide"
""",
        20_000,
    )
    assert found.ended_on("guide") == 20_000
    assert found.count(Event.SPECULAR_REFRACTION) == 0
    assert found.count(Event.TIR) > 20_000


def test_a_black_body_inside_glass_takes_what_reaches_it() -> None:
    found = trace(
        """
[media.glass]
index = 1.5
[bodies.ball]
kind = "sphere"
radius = 5
medium = "glass"
[bodies.core]
kind = "sphere"
radius = 1
medium = "glass"
surface = "absorber"
[sources.beam]
kind = "collimated"
position = [0, 0, -10]
direction = [0, 0, 1]
diameter = 0.5
""",
        20_000,
    )
    assert_share(found.ended_on("core"), 20_000, 0.96)


def test_matched_index_is_invisible_and_keeps_the_direction() -> None:
    found = trace(plate(20.0, index=1.0), 1_000)
    assert found.count(Event.SPECULAR_REFLECTION) == 0
    assert found.endings(Event.LEFT_SCENE) == 1_000
    out = found.portion.normal[found.last] / 32767.0
    assert np.allclose(out, [math.sin(math.radians(20)), 0, math.cos(math.radians(20))], atol=3e-5)


def test_colours_keep_their_expectation_when_reflection_depends_on_them() -> None:
    found = trace(
        """
[surfaces.red]
kind = "lambertian"
reflectance = { rgb = [0.9, 0.3, 0.1] }
[bodies.sheet]
kind = "rectangle"
size = [10, 10]
surface = "red"
[sources.beam]
kind = "collimated"
position = [0, 0, -5]
direction = [0, 0, 1]
diameter = 1
""",
        100_000,
    )
    left = found.portion.event[found.last] & int(Event.LEFT_SCENE) != 0
    codes = found.portion.color_code[found.last[left]]
    colors = found.portion.color_table[codes - 3] / 65535.0
    flux = colors.sum(axis=0) / 100_000
    assert np.allclose(flux, np.array([0.9, 0.3, 0.1]) / 3.0, atol=0.005)


def test_liquid_in_a_vessel_is_told_by_priority() -> None:
    text = """
[media.glass]
index = 1.5
[media.water]
index = 1.33
[bodies.water]
kind = "box"
size = [4000, 4000, {size}]
medium = "water"
priority = {water}
[bodies.vessel]
kind = "box"
size = [4000, 4000, 2]
medium = "glass"
priority = {glass}
[sources.beam]
kind = "collimated"
position = [0, 0, -10]
direction = [0, 0, 1]
diameter = 1
"""
    # Water counts inside the vessel: four interfaces; else it is not there: two
    inner = trace(compiled(text.format(size=1, water=1, glass=0)), 20_000)
    hidden = trace(compiled(text.format(size=1, water=0, glass=1)), 20_000)
    assert inner.endings(Event.GEOMETRY_ERROR) == hidden.endings(Event.GEOMETRY_ERROR) == 0
    assert set(inner.portion.medium.tolist()) == {0, 2, 3}
    assert set(hidden.portion.medium.tolist()) == {0, 2}

"""Surfaces in the engine: where their light goes, by colour, and that none is lost or made."""

from __future__ import annotations

import math

import numpy as np
import pytest

from raymap.model.events import Event
from tests.naive.fresnel import fresnel_conductor, fresnel_reflectance
from tests.tracer.transport.tracing import Trace, assert_share, trace

SHEET = """
[surfaces.probe]
{surface}
[media.glass]
index = {index}
[bodies.sheet]
kind = "{body}"
size = {size}
position = [0, 0, {z}]
surface = "probe"
{medium}
[sources.beam]
kind = "collimated"
position = [{x}, 0, -10]
direction = [{dx}, 0, {dz}]
diameter = 0.01
"""


def meet(surface: str, n_rays: int, *, angle_deg: float = 30.0, solid: bool = False, index: str = "1.5") -> Trace:  # fmt: skip # noqa: E501
    """Rays that meet one surface at the origin, a sheet or the front of a thick block."""
    a = math.radians(angle_deg)
    return trace(
        SHEET.format(
            surface=surface,
            index=index,
            body="box" if solid else "rectangle",
            size="[4000, 4000, 20]" if solid else "[4000, 4000]",
            medium='medium = "glass"\nfaces = { z_max = "absorber", x_min = "absorber", '
            'x_max = "absorber", y_min = "absorber", y_max = "absorber" }' if solid else "",
            x=0.0,
            z=10 if solid else 0,
            dx=math.sin(a),
            dz=math.cos(a),
        ),
        n_rays,
    )  # fmt: skip


def first_event(found: Trace) -> np.ndarray:
    """Event bits at the first hit of every ray."""
    return found.portion.event[found.offsets[:-1] + 1]


def share(found: Trace, event: Event) -> int:
    return int(np.count_nonzero(first_event(found) & int(event)))


def test_metal_mirror_reflects_by_fresnel() -> None:
    found = meet('kind = "mirror"\nmetal = { n = 0.2, k = 3.4 }', 100_000, angle_deg=60)
    expected = fresnel_conductor(1.0, 0.2, 3.4, 0.5)
    assert_share(share(found, Event.SPECULAR_REFLECTION), 100_000, expected)


def test_constant_coating_holds_at_every_angle_and_total_reflection_stays() -> None:
    for angle in (0.0, 60.0):
        found = meet('kind = "dielectric"\nreflectance = 0.07', 50_000, angle_deg=angle, solid=True)
        assert_share(share(found, Event.SPECULAR_REFLECTION), 50_000, 0.07)


def test_quarter_wave_layer_reflects_as_its_formula_says() -> None:
    text = """kind = "dielectric"
[surfaces.probe.coating]
between = ["air", "glass"]
layers = [{ index = 1.38, thickness_nm = 99.4565 }]
"""
    found = meet(text, 200_000, angle_deg=0.0, solid=True)
    events = first_event(found)
    assert set((events & int(Event.SURFACE_ABSORPTION)).tolist()) == {0}
    # Each channel has its own phase: r = (r1 + r2 e^{2 i delta}) / (1 + r1 r2 e^{2 i delta})
    expected = 0.0
    for wavelength in (611.0, 549.0, 464.0):
        phase = np.exp(4j * math.pi * 1.38 * 99.4565 / wavelength)
        r1, r2 = (1.0 - 1.38) / 2.38, (1.38 - 1.5) / 2.88
        expected += abs((r1 + r2 * phase) / (1.0 + r1 * r2 * phase)) ** 2 / 3.0
    assert_share(share(found, Event.SPECULAR_REFLECTION), 200_000, expected)


@pytest.mark.parametrize("roughness", [0.05, 0.5])
def test_rough_glass_loses_no_light_and_tends_to_fresnel(roughness: float) -> None:
    found = meet(
        f'kind = "rough_dielectric"\nroughness = {roughness}', 50_000, angle_deg=20, solid=True
    )
    back = share(found, Event.GLOSSY_REFLECTION)
    assert back + share(found, Event.GLOSSY_TRANSMISSION) == 50_000
    if roughness < 0.1:
        smooth = fresnel_reflectance(1.0, 1.5, math.cos(math.radians(20)))
        assert back / 50_000 == pytest.approx(smooth, abs=0.006)


def test_rough_mirror_of_reflectance_one_keeps_all_light() -> None:
    found = meet('kind = "rough_mirror"\nroughness = 0.7\nreflectance = 1.0', 20_000, angle_deg=70)
    assert share(found, Event.GLOSSY_REFLECTION) == 20_000
    assert found.endings(Event.LEFT_SCENE) == 20_000
    assert np.all(found.portion.normal[found.last, 2] <= 0)


def test_abg_scatters_its_share_about_the_specular_direction() -> None:
    from raymap.laws.radial import abg, radial_table, scatter_share

    table = radial_table(abg(0.01, 0.01, 2.0))
    expected = scatter_share(table, 0, math.sin(math.radians(30)))
    found = meet(
        'kind = "mirror"\nreflectance = 1.0\nscatter = { abg = [0.01, 0.01, 2.0] }', 100_000
    )
    assert_share(share(found, Event.GLOSSY_REFLECTION), 100_000, expected)
    out = found.portion.normal[found.last] / 32767.0
    glossy = first_event(found) & int(Event.GLOSSY_REFLECTION) != 0
    assert np.allclose(out[~glossy], [0.5, 0, -math.cos(math.radians(30))], atol=4e-5)
    assert np.median(np.hypot(out[glossy, 0] - 0.5, out[glossy, 1])) < 0.5


def test_filter_passes_straight_and_colours_the_light() -> None:
    found = meet('kind = "filter"\ntransmittance = { rgb = [0.8, 0.4, 0.1] }', 60_000, angle_deg=0)
    passed = found.portion.event[found.last] & int(Event.LEFT_SCENE) != 0
    assert_share(int(passed.sum()), 60_000, 1.3 / 3.0)
    codes = found.portion.color_code[found.last[passed]]
    color = found.portion.color_table[codes - 3].astype(float).mean(axis=0) / 65535.0
    assert np.allclose(color, np.array([0.8, 0.4, 0.1]) / 1.3, atol=1e-4)
    assert np.all(found.portion.normal[found.last[passed], 2] == 32767)


def test_retroreflector_sends_light_back() -> None:
    found = meet('kind = "retroreflector"\nreflectance = 0.6', 50_000, angle_deg=50)
    assert_share(share(found, Event.GLOSSY_REFLECTION), 50_000, 0.6)
    back = found.portion.event[found.last] & int(Event.LEFT_SCENE) != 0
    out = found.portion.normal[found.last[back]] / 32767.0
    a = math.radians(50)
    assert np.allclose(out, [-math.sin(a), 0.0, -math.cos(a)], atol=4e-5)


def test_measured_lambertian_equals_the_ideal_one() -> None:
    value = 0.5 / math.pi
    rows = [[[value] * 3] * 10] * 2
    found = meet(
        f"""kind = "tabulated"
[surfaces.probe.reflected]
theta_i_deg = [0, 85]
theta_o_deg = [0, 10, 20, 30, 40, 50, 60, 70, 80, 90]
phi_deg = [0, 90, 180]
values = {rows}
""",
        50_000,
    )
    back = first_event(found) & int(Event.GLOSSY_REFLECTION) != 0
    assert_share(int(back.sum()), 50_000, 0.5)
    cosine = -found.portion.normal[found.last[back], 2] / 32767.0
    assert abs(cosine.mean() - 2.0 / 3.0) < 4.5 * cosine.std() / math.sqrt(len(cosine))


def test_dispersive_reflection_keeps_the_expectation_of_each_channel() -> None:
    index = "{ rgb = [1.3, 1.6, 2.2] }"
    found = meet('kind = "dielectric"', 200_000, angle_deg=0, solid=True, index=index)
    back = first_event(found) & int(Event.SPECULAR_REFLECTION) != 0
    codes = found.portion.color_code[found.offsets[:-1] + 1][back]
    flux = found.portion.color_table[codes - 3].astype(float).sum(axis=0) / 65535.0 / 200_000
    expected = [((n - 1.0) / (n + 1.0)) ** 2 / 3.0 for n in (1.3, 1.6, 2.2)]
    assert np.allclose(flux, expected, rtol=0.03)
    selected = first_event(found) & int(Event.DISPERSIVE_SELECT) != 0
    assert np.array_equal(selected, ~back)


def test_catalogue_glass_is_found_by_name() -> None:
    found = meet('kind = "dielectric"', 100, solid=True)
    assert found.compilation.directory.media[2].name == "glass"
    text = """
[media.bk7]
glass = "N-BK7"
[sources.lamp]
kind = "point"
"""
    index = trace(text, 10).compilation.channel_set.refractive_index[2]
    assert index[1] == pytest.approx(1.5185, abs=2e-4)

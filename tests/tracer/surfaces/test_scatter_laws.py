"""A law of scatter is the BSDF itself: its share against integrals, whatever the surface reflects.

Right values: the closed integral of ABg with g = 2 at normal incidence, π A ln(1 + 1 / B), and
plain quadrature of ∫ BSDF cos θ dΩ over the disc of direction cosines elsewhere.
"""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest

from raymap.model.errors import SceneError
from raymap.model.events import Event
from tests.naive.fresnel import fresnel_reflectance
from tests.tracer.transport.tracing import Trace, compiled
from tracer.transport.wavefront import Wavefront

SCENE = """
[surfaces.probe]
{surface}
[media.glass]
index = {index}
[bodies.probe]
{body}
surface = "probe"
[sources.beam]
kind = "collimated"
position = [0, 0, -10]
direction = [{dx}, 0, {dz}]
diameter = 0.01
{more}
"""
SHEET = 'kind = "rectangle"\nsize = [4000, 4000]'
BLOCK = (
    'kind = "box"\nsize = [4000, 4000, 20]\nposition = [0, 0, 10]\nmedium = "glass"\n'
    'faces = { z_max = "absorber", x_min = "absorber", x_max = "absorber", y_min = "absorber", '
    'y_max = "absorber" }'
)
MODES = {
    "analog": "",
    "weighted": '[trace]\nmode = "weighted"\nmin_reflection = 0.2',
    "split": '[trace]\nmode = "weighted"\nsplit_depth = 1\nmin_reflection = 0.1',
}
KINDS = {
    "mirrored": Event.SPECULAR_REFLECTION,
    "scattered back": Event.GLOSSY_REFLECTION,
    "refracted": Event.SPECULAR_REFRACTION,
    "scattered through": Event.GLOSSY_TRANSMISSION,
    "absorbed": Event.SURFACE_ABSORPTION,
}


def tis(law: tuple[float, float, float], angle_deg: float) -> float:
    """∫ A / (B + ρ^g) over the unit disc of direction cosines, in rings about the specular one."""
    a, b, g = law
    beta = math.sin(math.radians(angle_deg))
    edges = np.concatenate(([0.0], np.geomspace(1e-7, 1.0 + beta, 40_001)))
    rho = 0.5 * (edges[1:] + edges[:-1])
    # Half the angle over which a ring lies in the disc
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        cosine = (rho**2 + beta**2 - 1.0) / (2.0 * rho * beta)
    arc = np.arccos(np.clip(np.nan_to_num(cosine, nan=-1.0), -1.0, 1.0))
    return float(np.sum(2.0 * arc * rho * np.diff(edges) * a / (b + rho**g)))


def text(
    surface: str, *, angle_deg: float, body: str = SHEET, index: str = "1.5", more: str = ""
) -> str:
    a = math.radians(angle_deg)
    return SCENE.format(
        surface=surface, body=body, index=index, dx=math.sin(a), dz=math.cos(a), more=more
    )


def shares(scene: str, n: int) -> dict[str, tuple[float, float]]:
    """What becomes of the light at its first hit, with standard errors."""
    compilation = compiled(scene)
    found = Trace(compilation, Wavefront(compilation.arrays, 3, weighted=True).trace(0, n))
    portion = found.portion
    weight = np.ones(portion.n_rays) if portion.weight is None else portion.weight.astype(float)
    event = portion.event[found.offsets[:-1] + 1]
    answer = {}
    for name, kind in KINDS.items():
        hit = event & int(kind) != 0
        mean = float(weight[hit].sum()) / n
        answer[name] = mean, math.sqrt(max(float((weight[hit] ** 2).sum()), 1.0)) / n
    return answer


@pytest.mark.parametrize("reflectance", [0.05, 0.4, 1.0])
def test_a_mirror_scatters_the_closed_integral_whatever_it_reflects(reflectance: float) -> None:
    expected = math.pi * 0.004 * math.log(1.0 + 1.0 / 0.05)
    surface = (
        f'kind = "mirror"\nreflectance = {reflectance}\nscatter = {{ abg = [0.004, 0.05, 2] }}'
    )
    assert tis((0.004, 0.05, 2.0), 0.0) == pytest.approx(expected, rel=1e-5)
    found = shares(text(surface, angle_deg=0.0), 200_000)
    scattered, error = found["scattered back"]
    assert abs(scattered - expected) < 4.5 * error
    mirrored, error = found["mirrored"]
    assert abs(mirrored - (reflectance - expected)) < 4.5 * error + 1e-12


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("angle_deg", [0.0, 45.0, 70.0])
def test_an_interface_scatters_the_integral_to_either_side(mode: str, angle_deg: float) -> None:
    law = (0.003, 0.02, 1.7)
    surface = f'kind = "dielectric"\nscatter = {{ abg = {list(law)} }}'
    refracted = math.degrees(math.asin(math.sin(math.radians(angle_deg)) / 1.5))
    reflected = fresnel_reflectance(1.0, 1.5, math.cos(math.radians(angle_deg)))
    back, through = tis(law, angle_deg), tis(law, refracted)
    scene = text(surface, angle_deg=angle_deg, body=BLOCK, more=MODES[mode])
    found = shares(scene, 60_000)
    expected = {
        "mirrored": reflected - back,
        "scattered back": back,
        "refracted": 1.0 - reflected - through,
        "scattered through": through,
        "absorbed": 0.0,
    }
    for name, share in expected.items():
        mean, error = found[name]
        assert abs(mean - share) < 4.5 * error + 2e-4 * share, (name, mean, share)
    total = sum(mean for mean, _ in found.values())
    assert total == pytest.approx(1.0, abs=4.5 * sum(error for _, error in found.values()))


@pytest.mark.parametrize("mode", ["analog", "weighted"])
def test_every_channel_of_a_coloured_mirror_scatters_alike(mode: str) -> None:
    law = (0.01, 0.03, 2.2)
    mirror = (0.9, 0.5, 0.2)
    surface = (
        f'kind = "mirror"\nreflectance = {{ rgb = {list(mirror)} }}\n'
        f"scatter = {{ abg = {list(law)} }}"
    )
    compilation = compiled(text(surface, angle_deg=30.0, more=MODES[mode]))
    portion = Wavefront(compilation.arrays, 3, weighted=True).trace(0, 100_000)
    first = np.cumsum(portion.records_per_ray) - portion.records_per_ray + 1
    code = portion.color_code[first].astype(int)
    table = np.vstack([np.eye(3), portion.color_table / 65535.0])
    weight = 1.0 if portion.weight is None else portion.weight[:, None].astype(float)
    light = weight * table[code]
    event = portion.event[first]
    for kind, expected in (
        (Event.GLOSSY_REFLECTION, [tis(law, 30.0) / 3.0] * 3),
        (Event.SPECULAR_REFLECTION, [(r - tis(law, 30.0)) / 3.0 for r in mirror]),
    ):
        hit = event & int(kind) != 0
        got = light[hit].sum(axis=0) / 100_000
        error = np.sqrt((light[hit] ** 2).sum(axis=0)) / 100_000
        assert (np.abs(got - expected) < 4.5 * error + 1e-4 * np.array(expected)).all()


REFUSED = {
    "a dim mirror": (
        'kind = "mirror"\nreflectance = 0.01\nscatter = { abg = [0.004, 0.05, 2.2] }',
        SHEET,
        "surfaces.probe.scatter: its law scatters 0.0421[0-9]* of the light in reflection at 0 "
        "degrees in channel R, where the surface reflects 0.01 in all",
    ),
    "one channel of a mirror": (
        'kind = "mirror"\nreflectance = { rgb = [0.5, 0.5, 0.02] }\n'
        "scatter = { abg = [0.004, 0.05, 2.2] }",
        SHEET,
        "in channel B, where the surface reflects 0.02",
    ),
    "glass": (
        'kind = "dielectric"\nscatter = { abg = [0.005, 0.05, 2] }',
        BLOCK,
        "in reflection at 0 degrees in channel R, where the surface reflects 0.04 in all",
    ),
    "what passes a mirror coating": (
        'kind = "dielectric"\nreflectance = 0.99\nscatter = { harvey_shack = [0.3, 0.1, -1.8] }',
        BLOCK,
        "in transmission at 0 degrees in channel R, where the surface transmits 0.01 in all",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_law_that_asks_for_more_than_there_is_is_refused_with_angle_and_channel(
    case: str,
) -> None:
    surface, body, message = REFUSED[case]
    with pytest.raises(SceneError, match=message):
        compiled(text(surface, angle_deg=0.0, body=body))

"""The sample scenes, each held to a law of physics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from raymap.model.events import Event
from tests.naive.fresnel import fresnel_reflectance
from tests.tracer.transport.tracing import Trace, assert_share
from tracer.optics.glasses import find_glass
from tracer.scene.compile import compile_scene
from tracer.scene.load import load_scene
from tracer.transport.wavefront import Wavefront

SAMPLES = Path(__file__).parents[2] / "samples"


def traced(scene: str, rays: int, *variants: str, seed: int = 2) -> Trace:
    compilation = compile_scene(load_scene(SAMPLES / scene, variants=variants))
    engine = Wavefront(compilation.arrays, seed, meshes=compilation.solids)
    return Trace(compilation, engine.trace(0, rays))


def assert_all_rays_end(found: Trace) -> None:
    """Absorbed, gone or stopped: nothing else, and nothing twice."""
    n = found.portion.n_rays
    ended = (
        found.endings(Event.SURFACE_ABSORPTION)
        + found.endings(Event.VOLUME_ABSORPTION)
        + found.endings(Event.LEFT_SCENE)
        + found.endings(Event.DEPTH_LIMIT)
    )
    assert ended == n == found.portion.emitted.sum()
    assert found.count(Event.GEOMETRY_ERROR) == 0


def test_prism_deviates_as_snell_says() -> None:
    found = traced("prism_spectrometer.toml", 6_000)
    assert_all_rays_end(found)
    p, offsets = found.portion, found.offsets
    # Rays that cross the prism and the lens without any reflection end on the sensor as record 5
    whole = (p.records_per_ray == 6) & (p.object[found.last] == found.object("sensor"))
    first = offsets[:-1][whole]
    channel = p.color_code[found.last[whole]]
    wavelengths = np.array(found.compilation.channel_set.wavelengths_nm)
    n = find_glass("N-SF11").index(wavelengths)
    incoming = np.array([0.83308845, 0.55313979])
    beam, slope = np.arctan2(incoming[1], incoming[0]), np.radians(30.0)
    incidence = beam + slope
    refracted = np.arcsin(np.sin(incidence) / n)
    leaving = np.arcsin(n * np.sin(np.radians(60.0) - refracted))
    deviation = incidence + leaving - np.radians(60.0)
    step = p.position[first + 3].astype(float) - p.position[first + 2]
    angle = beam - np.arctan2(step[:, 1], step[:, 0])
    assert len(np.unique(channel)) == 11
    assert np.abs(angle - deviation[channel]).max() < 2e-6
    # Minimum deviation is that of 550 nm: there the light runs parallel to the base
    inner = p.position[first + 2].astype(float) - p.position[first + 1]
    middle = channel == 5
    assert np.abs(inner[middle, 1]).max() < 1e-5


@pytest.mark.parametrize(("variant", "rho"), [((), 0.97), (("aged",), 0.95)])
def test_sphere_multiplies_light(variant: tuple[str, ...], rho: float) -> None:
    found = traced("integrating_sphere.toml", 20_000, *variant)
    assert_all_rays_end(found)
    # The port stands before a cap; seen from any place on the wall it covers one and the same share
    port = 0.5 * (1.0 - np.sqrt(1.0 - 0.2**2))
    assert_share(found.ended_on("port"), 20_000, port / (1.0 - rho * (1.0 - port)))
    # Reflections of a ray: a geometric series
    survival = rho * (1.0 - port)
    count = found.portion.records_per_ray - 2
    spread = np.sqrt(survival) / (1.0 - survival) / np.sqrt(20_000)
    assert abs(count.mean() - survival / (1.0 - survival)) < 4.5 * spread


def test_room_keeps_account_of_its_light() -> None:
    found = traced("room.toml", 20_000)
    assert_all_rays_end(found)
    p = found.portion
    assert p.records_per_ray.max() <= 13
    # A wall takes from each colour what it does not send back
    table = np.concatenate((np.eye(3), p.color_table / 65535.0))
    at = np.flatnonzero(p.object == found.object("red_wall"))
    arriving = table[p.color_code[at - 1]]
    back = arriving @ [0.57, 0.04, 0.04]
    reflected = p.event[at] & int(Event.DIFFUSE_REFLECTION) != 0
    stopped = p.event[at] & int(Event.DEPTH_LIMIT) != 0
    spread = np.sqrt((back * (1.0 - back))[~stopped].sum())
    assert abs(reflected.sum() - back[~stopped].sum()) < 4.5 * spread


def test_keyboard_is_as_symmetric_as_it_is_built() -> None:
    found = traced("keyboard/keyboard.toml", 12_000)
    assert_all_rays_end(found)
    p = found.portion
    ray = np.repeat(np.arange(p.n_rays), p.records_per_ray)
    record = np.repeat(np.arange(p.n_records), p.descriptor_count)
    names = [item.name for item in found.compilation.directory.detectors]
    source = p.source[ray[record]]

    def count(led: int, row: str) -> int:
        keys = [names.index(f"top_{row}{k}") for k in range(1, 6)]
        seen = np.isin(p.descriptors.detector, keys) & p.descriptors.registered & (source == led)
        return int(seen.sum())

    for one, other in (((0, "A"), (2, "C")), ((0, "C"), (2, "A")), ((1, "A"), (1, "C"))):
        a, b = count(*one), count(*other)
        assert a + b > 300
        assert abs(a - b) < 4.5 * np.sqrt(a + b)
    assert count(0, "C") > 1.5 * count(0, "A")


def test_lens_over_the_led_reflects_as_fresnel_says() -> None:
    found = traced("led_lens/led_lens.toml", 20_000)
    assert_all_rays_end(found)
    p, first = found.portion, found.offsets[:-1]
    faces = found.compilation.directory.objects[found.object("lens")].faces
    bottom = next(face for face in faces if face.name == "bottom")
    low, count = bottom.first_primitive, bottom.primitive_count
    met = (p.object[first + 1] == found.object("lens")) & (p.triangle[first + 1] >= low)
    met &= p.triangle[first + 1] < low + count
    step = p.position[first + 1].astype(float) - p.position[first]
    cosine = np.abs(step[:, 2]) / np.linalg.norm(step, axis=1)
    expected = np.array([fresnel_reflectance(1.0, 1.493, c) for c in cosine[met]])
    reflected = p.event[first[met] + 1] & int(Event.SPECULAR_REFLECTION) != 0
    assert met.mean() > 0.95
    spread = np.sqrt((expected * (1.0 - expected)).sum())
    assert abs(reflected.sum() - expected.sum()) < 4.5 * spread


WRITTEN = {
    "keyboard/make_scene.py": "keyboard/dots.obj",
    "led_lens/make_mesh.py": "led_lens/lens.obj",
}


@pytest.mark.parametrize("script", WRITTEN)
def test_meshes_are_what_their_scripts_write(script: str) -> None:
    import runpy

    module = runpy.run_path(str(SAMPLES / script))
    text = module["dots"]() if "dots" in module else module["obj"]()
    assert text == (SAMPLES / WRITTEN[script]).read_text(encoding="utf-8")

"""The engine's promises: nothing is lost, nothing depends on threads, portions or blocks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from raymap.model.events import ENDINGS, Event
from raymap.model.portion import Portion
from tests.examples import examples
from tests.tracer.transport.tracing import Trace, compiled, trace
from tracer.scene.compile import Compilation, compile_scene
from tracer.scene.load import load_scene

SAMPLE = Path(__file__).parents[3] / "samples" / "double_gauss.toml"

COLUMNS = (
    "source", "records_per_ray", "position", "normal", "object", "triangle", "event", "medium",
    "descriptor_count",
)  # fmt: skip


@pytest.fixture(scope="module")
def lens() -> Compilation:
    return compile_scene(load_scene(SAMPLE))


def assert_same(portions: list[Portion], whole: Portion) -> None:
    for name in COLUMNS:
        joined = np.concatenate([getattr(portion, name) for portion in portions])
        assert np.array_equal(joined, getattr(whole, name)), name
    for name in ("detector", "cell", "cosine", "uv", "registered"):
        joined = np.concatenate([getattr(portion.descriptors, name) for portion in portions])
        assert np.array_equal(joined, getattr(whole.descriptors, name)), name
    shown = [_colors(portion) for portion in portions]
    assert np.array_equal(np.concatenate(shown), _colors(whole))


def _colors(portion: Portion) -> np.ndarray:
    n_channels = portion.color_table.shape[1]
    table = np.concatenate([65535 * np.eye(n_channels, dtype=np.int64), portion.color_table])
    return table[portion.color_code]


def test_blocks_and_portions_do_not_change_a_ray(lens: Compilation) -> None:
    whole = trace(lens, 3_000).portion
    pieces = [
        trace(lens, n, first=first, block=block).portion
        for first, n, block in ((0, 1, 7), (1, 999, 64), (1_000, 2_000, 333))
    ]
    assert_same(pieces, whole)


def test_a_ray_traced_alone_equals_its_record(lens: Compilation) -> None:
    whole = trace(lens, 300).portion
    offsets = np.concatenate(([0], np.cumsum(whole.records_per_ray)))
    for ray in (0, 17, 299):
        alone = trace(lens, 1, first=ray).portion
        part = slice(offsets[ray], offsets[ray + 1])
        assert np.array_equal(alone.position, whole.position[part])
        assert np.array_equal(alone.event, whole.event[part])


def test_other_seeds_give_other_rays(lens: Compilation) -> None:
    a, b = trace(lens, 100, seed=1).portion, trace(lens, 100, seed=2).portion
    assert not np.array_equal(a.records_per_ray, b.records_per_ray)


def test_every_ray_begins_and_ends_as_it_must(lens: Compilation) -> None:
    found = trace(lens, 20_000)
    event = found.portion.event
    first = found.offsets[:-1]
    assert np.all(event[first] & int(Event.EMITTED))
    assert found.count(Event.EMITTED) == 20_000
    ending = event & int(ENDINGS)
    assert np.all(ending[found.last] & (ending[found.last] - 1) == 0)
    assert np.count_nonzero(ending) == 20_000
    assert found.endings(Event.GEOMETRY_ERROR) == 0
    leaving = found.last[event[found.last] & int(Event.LEFT_SCENE) != 0]
    sphere = found.compilation.directory.bounding_sphere
    away = np.linalg.norm(found.portion.position[leaving] - sphere.center, axis=1)
    assert np.allclose(away, sphere.radius, rtol=1e-6)


@pytest.mark.parametrize("variant", [(), ("spectral",), ("coated",), ("flood",)])
def test_no_light_reaches_the_sensor_but_through_the_front(variant: tuple[str, ...]) -> None:
    found = trace(compile_scene(load_scene(SAMPLE, variants=variant)), 60_000)
    ray = np.repeat(np.arange(60_000), found.portion.records_per_ray)
    front = found.portion.object == found.object("L1")
    front &= found.portion.triangle == 0
    through = np.zeros(60_000, bool)
    through[ray[front]] = True
    detected = found.portion.object[found.last] == found.object("sensor")
    assert detected.any()
    assert not np.any(detected & ~through)
    assert found.endings(Event.GEOMETRY_ERROR) == 0


def test_cemented_interface_is_one_face_with_both_media(lens: Compilation) -> None:
    names = [medium.name for medium in lens.directory.media]
    found = trace(lens, 2_000)
    at = (found.portion.object == found.object("L2")) & (found.portion.triangle == 1)
    crossed = at & (found.portion.event & int(Event.SPECULAR_REFRACTION) != 0)
    assert {names[k] for k in found.portion.medium[crossed]} <= {"F5", "N-SK2"}
    assert "F5" in {names[k] for k in found.portion.medium[crossed]}
    back = lens.directory.objects[found.object("L2")].faces[1]
    assert back.name == "back"
    assert back.aliases == ("L3.front",)
    assert "front" not in [f.name for f in lens.directory.objects[found.object("L3")].faces]
    steps = np.diff(found.portion.position, axis=0)
    within = np.ones(len(steps), bool)
    within[found.offsets[1:-1] - 1] = False
    assert np.linalg.norm(steps[within], axis=1).min() > 1e-6


def test_normals_point_out_of_the_bodies(lens: Compilation) -> None:
    found = trace(lens, 5_000)
    normal = found.portion.normal / 32767.0
    p = found.portion
    at_front = (p.object == found.object("L1")) & (p.triangle == 0)
    assert np.all(normal[at_front, 2] < 0)
    centre = np.array([0.0, 0.0, 56.20238])
    outward = p.position[at_front] - centre
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    assert np.allclose(normal[at_front], outward, atol=4e-5)
    at_back = (p.object == found.object("L6")) & (p.triangle == 1)
    assert np.all(normal[at_back, 2] > 0)


def test_descriptors_agree_with_the_points(lens: Compilation) -> None:
    found = trace(lens, 5_000)
    d = found.portion.descriptors
    detected = found.portion.object[found.last] == found.object("sensor")
    assert len(d.detector) == np.count_nonzero(detected) == found.portion.descriptor_count.sum()
    at = found.portion.position[found.last[detected]].astype(float)
    u = (-at[:, 0] / 36.0 + 0.5) * 65535.0
    v = (at[:, 1] / 24.0 + 0.5) * 65535.0
    assert np.abs(d.uv[:, 0] - u).max() < 1.0
    assert np.abs(d.uv[:, 1] - v).max() < 1.0
    assert np.all(d.registered)
    before = found.portion.event[found.last[detected] - 1]
    assert np.all(before & int(Event.DETECTOR_REGISTERED))
    assert np.all(found.portion.event[found.last[detected]] & int(Event.DETECTOR_REGISTERED))


CLOSED = {
    "box": 'kind = "box"\nsize = [3, 4, 5]',
    "sphere": 'kind = "sphere"\nradius = 3',
    "cylinder": 'kind = "cylinder"\nposition = [0, 0, -2]\nradius = 2\nlength = 4',
    "cone": 'kind = "cone"\nposition = [0, 0, -2]\nradius = 3\nend_radius = 1\nlength = 4',
    "prism": 'kind = "prism"\noutline = [[-3, -2], [3, -2], [0, 4]]\nlength = 4',
    "lens": 'kind = "lens"\nposition = [0, 0, -2]\nthickness = 4\nrim = "wall"\n'
    "front = { radius = 8, semi_diameter = 2.5 }\nback = { radius = -6, semi_diameter = 3 }",
    "asphere": 'kind = "lens"\nposition = [0, 0, -2]\nthickness = 4\nrim = "wall"\n'
    "front = { radius = 8, semi_diameter = 3, conic = -1, aspheric = [1e-4, -1e-6] }\n"
    "back = { radius = -6, semi_diameter = 3, conic = 0.5 }",
}


def closed_shape(shape: str, n_rays: int) -> Trace:
    medium = 'medium = "air"' if "lens" in CLOSED[shape] else ""
    turned = "" if "position" in CLOSED[shape] else "rotation = [13, 29, -41]"
    return trace(
        f"""
[surfaces.wall]
kind = "lambertian"
reflectance = 0.95
[bodies.shape]
{CLOSED[shape]}
surface = "wall"
{medium}
{turned}
[sources.lamp]
kind = "point"
position = [0.1, 0.2, 0.3]
{'inside = "shape"' if medium else ""}
""",
        n_rays,
    )


@pytest.mark.parametrize("shape", CLOSED)
def test_no_ray_gets_out_of_a_closed_shape(shape: str) -> None:
    found = closed_shape(shape, 20_000)
    assert found.endings(Event.SURFACE_ABSORPTION) == 20_000


@pytest.mark.slow
@pytest.mark.parametrize("shape", CLOSED)
def test_no_ray_of_millions_gets_out_of_a_closed_shape(shape: str) -> None:
    found = closed_shape(shape, 500_000)
    assert found.endings(Event.SURFACE_ABSORPTION) == 500_000


def test_glass_bodies_lose_no_ray() -> None:
    for shape in ("box", "sphere", "cylinder", "cone", "prism"):
        found = trace(
            f"""
[media.glass]
index = 1.5
[bodies.shape]
{CLOSED[shape]}
medium = "glass"
[sources.sky]
kind = "lambertian"
position = [0, 0, -9]
diameter = 12
""",
            20_000,
        )
        stopped = found.endings(Event.DEPTH_LIMIT)
        assert found.endings(Event.LEFT_SCENE) + stopped == 20_000
        assert stopped < 200
        assert found.count(Event.GEOMETRY_ERROR) == 0


def test_depth_limit_ends_a_ray_there() -> None:
    found = trace(
        """
[limits]
depth = 12
[surfaces.wall]
kind = "mirror"
reflectance = 1.0
[bodies.box]
kind = "box"
size = [1, 1, 1]
surface = "wall"
[sources.lamp]
kind = "point"
""",
        1_000,
    )
    assert found.endings(Event.DEPTH_LIMIT) == 1_000
    assert np.all(found.portion.records_per_ray == 13)


@settings(max_examples=examples(20))
@given(st.lists(st.floats(0.01, 5.0), min_size=1, max_size=6), st.integers(0, 10_000))
def test_rays_are_dealt_in_proportion_everywhere(shares: list[float], first: int) -> None:
    from tracer.sources.emission import PATTERN, deal_rays, emitted_counts

    values = np.array(shares)
    pattern = deal_rays(values)
    assert len(pattern) == PATTERN
    counts = emitted_counts(pattern, len(values), first, 10_000)
    assert counts.sum() == 10_000
    expected = 10_000 * values / values.sum()
    assert np.all(np.abs(counts - expected) <= 12.0)
    places = (first + np.arange(10_000)) % PATTERN
    assert np.array_equal(np.bincount(pattern[places], minlength=len(values)), counts)


def test_a_source_that_is_off_emits_nothing() -> None:
    found = trace(
        compiled(
            """
[sources.one]
kind = "point"
[sources.two]
kind = "point"
on = false
"""
        ),
        100,
    )
    assert found.portion.emitted.tolist() == [100, 0]

"""What is written is read back bit for bit, whatever a tracer hands in."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import raymap
from tests.examples import examples
from tests.raymap.compact import write_compactly
from tests.strategies import (
    assert_same_portion,
    channel_sets,
    directories,
    make_portion,
    portions,
)

_SETTINGS = settings(max_examples=examples(60), suppress_health_check=[HealthCheck.too_slow])


@st.composite
def _maps(draw):
    directory = draw(directories())
    channels = draw(channel_sets())
    return directory, channels, draw(portions(directory, channels))


@_SETTINGS
@given(drawn=_maps(), form=st.sampled_from(["usual", "raw", "compact"]))
def test_any_portion_round_trips(tmp_path_factory, drawn, form):
    directory, channels, portion = drawn
    path = tmp_path_factory.mktemp("trip") / "a.raymap"
    with raymap.RayMapWriter.create(path, directory, raw=form == "raw") as writer:
        if form == "compact":
            write_compactly(writer)
        writer.add_channel_set(channels)
        writer.append(portion)
    with raymap.open(path) as ray_map:
        assert ray_map.finished
        assert ray_map.directory == directory
        assert ray_map.channel_sets == [channels]
        assert_same_portion(portion, ray_map.portions[0].read())


@pytest.mark.parametrize("n_paths", [2, None])
def test_single_columns_agree_with_the_whole(tmp_path, n_paths):
    directory = _directory()
    channels = raymap.ChannelSet(kind="rgb", wavelengths_nm=(610.0, 550.0, 465.0))
    portion = make_portion(
        directory, channels, n_rays=300, n_paths=n_paths, weighted=True, extra=True
    )
    path = tmp_path / "a.raymap"
    with raymap.RayMapWriter.create(path, directory) as writer:
        writer.add_channel_set(channels)
        writer.append(portion)
    with raymap.open(path) as ray_map:
        stored = ray_map.portions[0]
        assert stored.has_paths == (n_paths is not None)
        for name in ("object", "triangle", "position", "normal", "event", "medium", "weight"):
            np.testing.assert_array_equal(stored.column(name), getattr(portion, name))
        np.testing.assert_array_equal(stored.column("phase"), portion.extra["phase"])
        colors = stored.column("color")
        assert (colors.sum(axis=1, dtype=int) == 65535).all()
        segments = stored.segments()
        np.testing.assert_array_equal(segments["position"], portion.position)
        first = segments["first_descriptor"][portion.descriptor_count > 0]
        counts = portion.descriptor_count[portion.descriptor_count > 0]
        np.testing.assert_array_equal(first, np.cumsum(counts) - counts)
        with pytest.raises(KeyError):
            stored.column("no such column")


def _directory():
    sphere = raymap.Quadric(coefficients=(1, 1, 1, 0, 0, 0, 0, 0, 0, -2500.0), solve_axis=2)
    return raymap.Directory(
        sources=(raymap.Source(name="lamp"), raymap.Source(name="sun")),
        objects=(
            raymap.SceneObject(
                name="lens",
                faces=(
                    raymap.Face(name="front", quadrics=(sphere,)),
                    raymap.Face(name="mesh", first_primitive=1, primitive_count=9),
                ),
            ),
        ),
        media=(raymap.Medium(name="air"),),
        detectors=(raymap.Detector(name="sensor", cells=(7, 5), size=(40.0, 40.0)),),
        bounding_sphere=raymap.BoundingSphere(radius=60.0),
    )

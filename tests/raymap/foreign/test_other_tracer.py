"""The worked sample: Mitsuba's paths in a ray map, against solid angles and Fresnel's equations."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import raymap
from raymap.file.verify import verify
from raymap.model.events import Event

_SAMPLE = Path(__file__).resolve().parents[3] / "samples" / "other_tracer.py"


def _load():
    spec = importlib.util.spec_from_file_location("other_tracer", _SAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_sample_records_what_it_is_told(tmp_path):
    """Without Mitsuba: two rays spelled out go through the sample's columns into a map."""
    sample = _load()
    names = ["ball", "floor"]
    columns = sample.Columns(0)
    up, white = np.array([0.0, 0.0, 1.0]), np.ones(3)
    top = (np.array([0.0, 0.0, 2.5]), up, 0, Event.SPECULAR_REFLECTION, 0, white)
    start = (np.array([0.0, 0.0, 6.0]), 0 * up, -1, Event.EMITTED, 0, white)
    end = (np.array([0.0, 0.0, 10.0]), up, -1, Event.LEFT_SCENE, 0, white / 2)
    columns.ray([start, top, end])
    columns.ray([start, (0 * up, up, 1, Event.SURFACE_ABSORPTION, 0, white)])
    with raymap.RayMapWriter.create(tmp_path / "a.raymap", sample.make_directory(names)) as writer:
        writer.add_channel_set(raymap.ChannelSet(kind="rgb", wavelengths_nm=(610, 550, 465)))
        writer.append(columns.portion())
    with raymap.open(tmp_path / "a.raymap") as ray_map:
        assert ray_map.portions[0].column("object").tolist() == [-1, 0, -1, -1, 1]
        assert not verify(ray_map).damage


@pytest.mark.peers
def test_mitsuba_agrees_with_solid_angles_and_fresnel(tmp_path):
    pytest.importorskip("mitsuba")
    path = tmp_path / "ball.raymap"
    rays = 3000
    _load().record(path, rays)
    with raymap.open(path) as ray_map:
        assert ray_map.rays == rays
        assert not verify(ray_map).damage
        ball = [item.name for item in ray_map.directory.objects].index("ball")
        first_on_ball = reflected = 0
        for stored in ray_map.portions:
            second = stored.record_offsets()[:-1] + 1
            hits = stored.column("object")[second] == ball
            events = stored.column("event")[second][hits]
            first_on_ball += int(hits.sum())
            reflected += int(((events & int(Event.SPECULAR_REFLECTION)) != 0).sum())
            # The face implies the normals that Mitsuba gave
            assert stored.stream_bytes("normal") < 0.3 * 6 * stored.n_records
    # The ball covers the disc of slopes up to 1 / sqrt(4.5² - 1) of those up to 0.5
    share = 1 / (4.5**2 - 1) / 0.5**2
    assert abs(first_on_ball - rays * share) < 5 * np.sqrt(rays * share * (1 - share))
    expected = first_on_ball * _mean_reflectance(4.5, 1.5)
    assert abs(reflected - expected) < 5 * np.sqrt(expected)


def _mean_reflectance(distance, n):
    """Fresnel reflectance of a unit ball, over slopes that are even on a disc."""
    slope = np.sqrt(np.linspace(0, 1, 20001)[1:-1]) / np.sqrt(distance**2 - 1)
    sin_i = distance * slope / np.sqrt(1 + slope**2)
    cos_i, cos_t = np.sqrt(1 - sin_i**2), np.sqrt(1 - (sin_i / n) ** 2)
    r_s = (cos_i - n * cos_t) / (cos_i + n * cos_t)
    r_p = (n * cos_i - cos_t) / (n * cos_i + cos_t)
    return float(((r_s**2 + r_p**2) / 2).mean())

"""Rays to segments: every one, in order, clipped and cut as said."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import raymap
from raymap.model.events import FAMILIES
from viewer.drawn.gather import read_rays, thin
from viewer.drawn.lines import build_lines, cut_lines, visible_records
from viewer.drawn.rays import DrawnRays, no_rays
from viewer.drawn.state import Clip, Section, StateError


@pytest.fixture(scope="module")
def rays(small_map: raymap.RayMap) -> DrawnRays:
    return read_rays(small_map, 0, np.arange(120))


def test_segments_join_following_records(rays: DrawnRays) -> None:
    lines = build_lines(rays)
    expected, owners, starts = [], [], []
    for ray in range(rays.n_rays):
        for record in range(rays.offsets[ray], rays.offsets[ray + 1] - 1):
            expected.append([rays.position[record], rays.position[record + 1]])
            owners.append(ray)
            starts.append(record)
    np.testing.assert_array_equal(lines.segments, np.array(expected))
    np.testing.assert_array_equal(lines.ray, owners)
    np.testing.assert_array_equal(lines.record, starts)


@pytest.mark.parametrize("after", [0, 1, 2])
@pytest.mark.parametrize("until", [0, 1, 2])
@pytest.mark.parametrize("event", ["reflected", "refracted", "absorbed"])
def test_clips_count_events(rays: DrawnRays, event: str, after: int, until: int) -> None:
    shown = visible_records(rays, Clip(event=event, after=after, until=until))
    bits = int(FAMILIES[event])
    for ray in range(rays.n_rays):
        count = 0
        for record in range(rays.offsets[ray], rays.offsets[ray + 1]):
            count += bool(rays.event[record] & bits)
            last = record == rays.offsets[ray + 1] - 1
            expected = not last and count >= after and (until == 0 or count < until)
            assert shown[record] == expected


def test_an_unknown_event_is_named(rays: DrawnRays) -> None:
    with pytest.raises(StateError, match="'melted'"):
        visible_records(rays, Clip(event="melted", after=1))


normals = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1)


@given(normals, st.floats(-20, 60))
def test_a_cut_keeps_one_side(rays: DrawnRays, normal: tuple, offset: float) -> None:
    lines = build_lines(rays)
    section = Section(on=True, normal=normal, offset=offset)
    kept = cut_lines(lines, section)
    unit = np.array(normal) / np.linalg.norm(normal)
    assert (kept.segments.astype(float) @ unit <= offset + 1e-3).all()
    # What the two sides keep is as long as the whole
    back = Section(on=True, normal=tuple(-unit), offset=-offset)
    other = cut_lines(lines, back)

    def total(segments: np.ndarray) -> float:
        return float(np.linalg.norm(np.diff(segments.astype(float), axis=1)[:, 0], axis=1).sum())

    assert total(kept.segments) + total(other.segments) == pytest.approx(
        total(lines.segments), rel=1e-4
    )


def test_sections_may_leave_the_rays(rays: DrawnRays) -> None:
    lines = build_lines(rays)
    assert cut_lines(lines, Section(on=True, rays=False)) is lines
    assert cut_lines(lines, Section(on=False)) is lines
    with pytest.raises(StateError, match="normal"):
        cut_lines(lines, Section(on=True, normal=(0, 0, 0)))


def test_no_rays_make_no_lines() -> None:
    lines = build_lines(no_rays())
    assert len(lines) == 0
    assert len(cut_lines(lines, Section(on=True))) == 0


@given(st.integers(1, 400), st.integers(1, 400), st.integers(0, 10**12))
def test_thinning_is_nested_and_reproducible(one: int, two: int, first: int) -> None:
    ids = np.arange(first, first + 400)
    small, large = sorted((one, two))
    fewer, more = set(thin(ids, small)), set(thin(ids, large))
    assert len(fewer) == small
    assert fewer <= more
    assert list(thin(ids, small)) == sorted(fewer)


def test_thinning_is_uniform() -> None:
    chosen = thin(np.arange(40_000), 4_000)
    counts = np.bincount(chosen // 4_000, minlength=10)
    assert abs(counts - 400).max() < 5 * 20


def test_rays_are_read_as_they_are_stored(small_map: raymap.RayMap) -> None:
    rows = np.array([3, 4, 10, 399])
    rays = read_rays(small_map, 1, rows)
    portion = small_map.portions[1].read()
    offsets = np.concatenate(([0], np.cumsum(portion.records_per_ray)))
    channels = small_map.channel_sets[0]
    for place, row in enumerate(rows):
        mine = slice(rays.offsets[place], rays.offsets[place + 1])
        theirs = slice(offsets[row], offsets[row + 1])
        np.testing.assert_array_equal(rays.position[mine], portion.position[theirs])
        np.testing.assert_array_equal(rays.event[mine], portion.event[theirs])
        assert rays.ray_ids[place] == portion.first_ray + row
        source = portion.source[row]
        assert rays.source[place] == source
        flux = small_map.directory.sources[source].flux / small_map.emitted[source]
        assert rays.flux[place] == pytest.approx(flux)
        for record in range(theirs.start, theirs.stop):
            code, medium = portion.color_code[record], portion.medium[record]
            shares = (
                np.eye(3)[code] if code < 3 else portion.color_table[code - 3].astype(float) / 65535
            )
            local = rays.offsets[place] + record - theirs.start
            np.testing.assert_allclose(rays.rgb[local], shares, atol=1e-6)
            expected = shares @ np.array(channels.refractive_index)[medium]
            assert rays.index[local] == pytest.approx(expected, rel=1e-6)
        last = portion.color_code[theirs.stop - 1]
        wavelength = channels.wavelengths_nm[last] if last < 3 else np.nan
        assert rays.wavelength[place] == pytest.approx(wavelength, nan_ok=True)


def test_parts_join_and_rays_are_taken_in_any_number(small_map: raymap.RayMap) -> None:
    one = read_rays(small_map, 0, np.arange(0, 50))
    two = read_rays(small_map, 0, np.arange(50, 90))
    both = read_rays(small_map, 0, np.arange(90))
    joined = DrawnRays.join([one, two])
    np.testing.assert_array_equal(joined.position, both.position)
    np.testing.assert_array_equal(joined.offsets, both.offsets)
    some = both.take(np.array([5, 60, 7]))
    np.testing.assert_array_equal(
        some.position[: some.offsets[1]], both.position[both.offsets[5] : both.offsets[6]]
    )
    np.testing.assert_array_equal(some.ray_ids, both.ray_ids[[5, 60, 7]])
    assert DrawnRays.join([]).n_rays == 0

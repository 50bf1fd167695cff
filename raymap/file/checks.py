"""Checks of portions that any tracer hands in: shapes, indices, events, limits."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.bytes.streams import is_known_type
from raymap.model.directory import ChannelSet, Directory
from raymap.model.errors import InvalidPortion, LimitExceeded
from raymap.model.events import ENDINGS, Event
from raymap.model.limits import MAX_DESCRIPTORS, MAX_EXTRA_NAME, MAX_RAY, MAX_RECORDS
from raymap.model.portion import Portion
from raymap.model.schema import COLOR_SCALE

__all__ = ["check_portion"]


def check_portion(portion: Portion, directory: Directory, channel_set: ChannelSet) -> None:
    """Refuse a portion whose arrays contradict each other or the directory.

    Raises
    ------
    InvalidPortion
        The message names the column and the first bad row.
    LimitExceeded
        More records than a portion may hold.
    """
    _check_shapes(portion, directory, channel_set)
    _check_indices(portion, directory)
    _check_events(portion)
    _check_colors(portion, channel_set)
    _check_rays(portion)


def _check_shapes(portion: Portion, directory: Directory, channel_set: ChannelSet) -> None:
    n, m, k = portion.n_rays, portion.n_records, len(portion.descriptors.detector)
    if m > MAX_RECORDS:
        raise LimitExceeded(f"a portion holds at most {MAX_RECORDS} records, got {m}")
    if k > MAX_DESCRIPTORS:
        raise LimitExceeded(f"a portion holds at most {MAX_DESCRIPTORS} descriptors, got {k}")
    descriptors = portion.descriptors
    expected: list[tuple[str, NDArray[Any] | None, tuple[int, ...], Any]] = [
        ("emitted", portion.emitted, (len(directory.sources),), np.int64),
        ("source", portion.source, (n,), np.int16),
        ("records_per_ray", portion.records_per_ray, (n,), np.int32),
        ("position", portion.position, (m, 3), np.float32),
        ("normal", portion.normal, (m, 3), np.int16),
        ("object", portion.object, (m,), np.int16),
        ("triangle", portion.triangle, (m,), np.int32),
        ("event", portion.event, (m,), np.int32),
        ("medium", portion.medium, (m,), np.int16),
        ("color_code", portion.color_code, (m,), np.int32),
        (
            "color_table",
            portion.color_table,
            (len(portion.color_table), channel_set.n_channels),
            np.uint16,
        ),
        ("descriptor_count", portion.descriptor_count, (m,), np.uint16),
        ("descriptors.detector", descriptors.detector, (k,), np.int16),
        ("descriptors.cell", descriptors.cell, (k, 2), np.uint16),
        ("descriptors.cosine", descriptors.cosine, (k,), np.int16),
        ("descriptors.uv", descriptors.uv, (k, 2), np.uint16),
        ("descriptors.registered", descriptors.registered, (k,), np.bool_),
        ("ray_ids", portion.ray_ids, (n,), np.int64),
        ("weight", portion.weight, (n,), np.float32),
        ("emission", portion.emission, (n,), np.int64),
    ]
    for name, column, shape, dtype in expected:
        if column is None:
            continue
        if column.shape != shape or column.dtype != dtype:
            raise InvalidPortion(
                f"{name} is {column.dtype}{list(column.shape)}, "
                f"expected {np.dtype(dtype)}{list(shape)}"
            )
    if n and int(portion.records_per_ray.min()) < 1:
        raise InvalidPortion(f"ray {int(portion.records_per_ray.argmin())} has no record")
    if int(portion.records_per_ray.sum(dtype=np.int64)) != m:
        raise InvalidPortion(f"records_per_ray adds up to another number than {m} records")
    if int(portion.descriptor_count.sum(dtype=np.int64)) != k:
        raise InvalidPortion(f"descriptor_count adds up to another number than {k} descriptors")
    for name, column in portion.extra.items():
        if column.ndim not in (1, 2) or len(column) not in (n, m):
            raise InvalidPortion(
                f"extra column {name!r} has the shape {column.shape}: it needs {n} or {m} rows, of "
                "one element each or of several"
            )
        if column.ndim == 2 and not 0 < column.shape[1] < 2**32:
            raise InvalidPortion(f"extra column {name!r} has rows of no elements")
        if not is_known_type(column.dtype):
            raise InvalidPortion(f"extra column {name!r}: the format has no {column.dtype}")
        if not 0 < len(name.encode()) <= MAX_EXTRA_NAME or "\0" in name:
            raise InvalidPortion(f"extra column {name!r}: names have 1 to {MAX_EXTRA_NAME} bytes")


def _check_indices(portion: Portion, directory: Directory) -> None:
    for name, column, least, count in (
        ("source", portion.source, 0, len(directory.sources)),
        ("object", portion.object, -1, len(directory.objects)),
        ("medium", portion.medium, -1, len(directory.media)),
        ("descriptors.detector", portion.descriptors.detector, 0, len(directory.detectors)),
    ):
        bad = (column < least) | (column >= count)
        if bad.any():
            row = int(bad.argmax())
            raise InvalidPortion(
                f"{name}[{row}] is {int(column[row])}, the directory has {count} of them"
            )
    cells = np.array([detector.cells for detector in directory.detectors], np.int64).reshape(-1, 2)
    outside = (portion.descriptors.cell >= cells[portion.descriptors.detector]).any(axis=1)
    if outside.any():
        row = int(outside.argmax())
        raise InvalidPortion(f"descriptor {row} names a cell that its detector does not have")
    if (portion.emitted < 0).any():
        raise InvalidPortion("emitted counts are negative")
    if (portion.emitted >= MAX_RAY).any():
        raise LimitExceeded(f"emitted counts stay below {MAX_RAY}")


def _check_events(portion: Portion) -> None:
    if not portion.n_rays:
        return
    ends = np.cumsum(portion.records_per_ray) - 1
    starts = np.concatenate(([0], ends[:-1] + 1))
    event = portion.event
    missing = (event[starts] & int(Event.EMITTED)) == 0
    if missing.any():
        raise InvalidPortion(f"the first record of ray {int(missing.argmax())} is not EMITTED")
    endings = event & int(ENDINGS)
    single = (endings[ends] != 0) & ((endings[ends] & (endings[ends] - 1)) == 0)
    if not single.all():
        raise InvalidPortion(
            f"the last record of ray {int((~single).argmax())} carries no single ending event"
        )
    endings = endings.copy()
    endings[ends] = 0
    if endings.any():
        raise InvalidPortion(f"record {int((endings != 0).argmax())} ends a ray before its end")
    if portion.descriptor_count[ends].any():
        raise InvalidPortion("the last record of a ray starts no segment, yet has descriptors")


def _check_colors(portion: Portion, channel_set: ChannelSet) -> None:
    top = channel_set.n_channels + len(portion.color_table)
    bad = (portion.color_code < 0) | (portion.color_code >= top)
    if bad.any():
        raise InvalidPortion(f"color_code[{int(bad.argmax())}] is not in the colour table")
    sums = portion.color_table.sum(axis=1, dtype=np.int64)
    if (sums != COLOR_SCALE).any():
        row = int((sums != COLOR_SCALE).argmax())
        raise InvalidPortion(f"color_table[{row}] sums to {int(sums[row])}, not {COLOR_SCALE}")


def _check_rays(portion: Portion) -> None:
    ids = portion.ray_ids
    if portion.first_ray < 0 or (ids is not None and len(ids) and int(ids[0]) < 0):
        raise InvalidPortion("ray numbers are negative")
    if ids is not None and (np.diff(ids) <= 0).any():
        raise InvalidPortion("ray_ids do not increase strictly")
    last = portion.first_ray + portion.n_rays if ids is None or not len(ids) else int(ids[-1])
    if last >= MAX_RAY:
        raise LimitExceeded(f"ray numbers stay below {MAX_RAY}, got {last}")
    weight = portion.weight
    if weight is not None and not (np.isfinite(weight) & (weight >= 0)).all():
        raise InvalidPortion("weights are negative or not finite")
    if not np.isfinite(portion.position).all():
        raise InvalidPortion("positions are not finite")

"""Take rays out of portions and join portions: plain NumPy on columns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.portion import Descriptors, Portion

__all__ = [
    "can_join",
    "join_portions",
    "offsets_of",
    "rows_of_rays",
    "squares_by_emission",
    "take_rays",
]

_RECORDS = ("position", "normal", "object", "triangle", "event", "medium")


def offsets_of(counts: NDArray[np.integer]) -> NDArray[np.int64]:
    """(n + 1,) running sum of counts: item i has the rows offsets[i]:offsets[i + 1]."""
    offsets = np.zeros(len(counts) + 1, np.int64)
    np.cumsum(counts, out=offsets[1:])
    return offsets


def squares_by_emission(
    labels: NDArray[np.integer],
    weight: NDArray[np.float64],
    emission: NDArray[np.integer] | None,
    size: int,
) -> NDArray[np.float64]:
    """Σ over emissions of (Σw)² by label, (size,).

    Parameters
    ----------
    labels, weight : (n,) of rays
    emission : (n,) equal for rays of one emission, which are added up first; None: all differ
    """
    if emission is not None and len(labels):
        order = np.lexsort((emission, labels))
        changes = (np.diff(labels[order]) != 0) | (np.diff(emission[order]) != 0)
        first = np.concatenate(([0], np.flatnonzero(changes) + 1))
        labels, weight = labels[order][first], np.add.reduceat(weight[order], first)
    # What a made-up file states may be beyond all numbers; who adds further refuses it
    with np.errstate(over="ignore"):
        squares = weight**2
    return np.bincount(labels, squares, size).astype(np.float64, copy=False)


def rows_of_rays(offsets: NDArray[np.int64], rays: NDArray[np.int64]) -> NDArray[np.int64]:
    """Rows offsets[r]:offsets[r + 1] of the given rays, one after the other."""
    counts = np.diff(offsets)[rays]
    ends = np.cumsum(counts)
    starts = offsets[:-1][rays]
    total = int(ends[-1]) if len(ends) else 0
    rows: NDArray[np.int64] = np.arange(total) + np.repeat(starts - (ends - counts), counts)
    return rows


def take_rays(portion: Portion, rays: NDArray[np.int64], ids: NDArray[np.int64]) -> Portion:
    """Some rays of a portion with their numbers; the emitted counts stay those of the whole.

    Parameters
    ----------
    rays : increasing places in the portion
    ids : (len(rays),) their ray numbers
    """
    offsets = offsets_of(portion.records_per_ray)
    records = rows_of_rays(offsets, rays)
    crossing_offsets = offsets_of(portion.descriptor_count)
    crossings = rows_of_rays(crossing_offsets, records)
    d = portion.descriptors
    table, codes = _used_colors(portion, records)
    return Portion(
        emitted=portion.emitted,
        source=portion.source[rays],
        records_per_ray=portion.records_per_ray[rays],
        **{name: getattr(portion, name)[records] for name in _RECORDS},
        color_code=codes,
        color_table=table,
        descriptor_count=portion.descriptor_count[records],
        descriptors=Descriptors(
            detector=d.detector[crossings],
            cell=d.cell[crossings],
            cosine=d.cosine[crossings],
            uv=d.uv[crossings],
            registered=d.registered[crossings],
        ),
        first_ray=int(ids[0]) if len(ids) else portion.first_ray,
        ray_ids=ids,
        channel_set=portion.channel_set,
        weight=None if portion.weight is None else portion.weight[rays],
        emission=None if portion.emission is None else portion.emission[rays],
        extra={
            name: column[records if len(column) == portion.n_records else rays]
            for name, column in portion.extra.items()
        },
    )


def _used_colors(
    portion: Portion, records: NDArray[np.int64]
) -> tuple[NDArray[np.uint16], NDArray[np.int32]]:
    """The rows of the colour table that the records use, and their codes for these."""
    channels = portion.color_table.shape[1]
    codes = portion.color_code[records]
    mixed = codes >= channels
    used, numbers = np.unique(codes[mixed] - channels, return_inverse=True)
    codes[mixed] = numbers.astype(np.int32) + channels
    return portion.color_table[used], codes


def can_join(a: Portion, b: Portion) -> bool:
    """Whether two portions can stand in one."""
    return (
        a.channel_set == b.channel_set
        and (a.emission is None) == (b.emission is None)
        and {name: (c.dtype, c.shape[1:], len(c) == a.n_records) for name, c in a.extra.items()}
        == {name: (c.dtype, c.shape[1:], len(c) == b.n_records) for name, c in b.extra.items()}
    )


def join_portions(portions: Sequence[Portion]) -> Portion:
    """One portion of several that `can_join`, with their ray numbers and emitted counts added."""
    first = portions[0]
    channels = first.color_table.shape[1]
    codes = []
    rows = 0
    for portion in portions:
        shift = np.where(portion.color_code >= channels, rows, 0).astype(np.int32)
        codes.append(portion.color_code + shift)
        rows += len(portion.color_table)

    def joined(name: str) -> Any:
        return np.concatenate([getattr(portion, name) for portion in portions])

    weighted = any(portion.weight is not None for portion in portions)
    weights = [
        np.ones(portion.n_rays, np.float32) if portion.weight is None else portion.weight
        for portion in portions
    ]
    d = [portion.descriptors for portion in portions]
    return Portion(
        emitted=np.sum([portion.emitted for portion in portions], axis=0),
        source=joined("source"),
        records_per_ray=joined("records_per_ray"),
        **{name: joined(name) for name in _RECORDS},
        color_code=np.concatenate(codes),
        color_table=joined("color_table"),
        descriptor_count=joined("descriptor_count"),
        descriptors=Descriptors(
            detector=np.concatenate([part.detector for part in d]),
            cell=np.concatenate([part.cell for part in d]),
            cosine=np.concatenate([part.cosine for part in d]),
            uv=np.concatenate([part.uv for part in d]),
            registered=np.concatenate([part.registered for part in d]),
        ),
        first_ray=first.first_ray,
        ray_ids=np.concatenate([_ids(portion) for portion in portions]),
        channel_set=first.channel_set,
        weight=np.concatenate(weights) if weighted else None,
        emission=None if first.emission is None else joined("emission"),
        extra={
            name: np.concatenate([portion.extra[name] for portion in portions])
            for name in first.extra
        },
    )


def _ids(portion: Portion) -> NDArray[np.int64]:
    if portion.ray_ids is not None:
        return portion.ray_ids
    return np.arange(portion.first_ray, portion.first_ray + portion.n_rays, dtype=np.int64)

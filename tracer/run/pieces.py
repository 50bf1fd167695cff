"""Portions of more records than a file allows, and such as outlive the buffers they lie in."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from raymap.model.portion import Descriptors, Portion
from raymap.model.schema import PORTION_RECORDS

__all__ = ["copied", "split_portion"]


def split_portion(portion: Portion) -> list[Portion]:
    """Cut a portion where it would pass the limit of records; one emission is never cut."""
    offsets = np.concatenate(([0], np.cumsum(portion.records_per_ray)))
    crossings = np.concatenate(([0], np.cumsum(portion.descriptor_count, dtype=np.int64)))
    cuts = np.arange(portion.n_rays + 1)
    if portion.emission is not None:
        begins = np.diff(portion.emission, prepend=portion.emission[0] - 1) != 0
        cuts = np.append(np.flatnonzero(begins), portion.n_rays)
    pieces = []
    at = 0
    while at < len(cuts) - 1:
        limit = offsets[cuts[at]] + PORTION_RECORDS
        end = max(at + 1, int(np.searchsorted(offsets[cuts], limit, side="right")) - 1)
        pieces.append(_piece(portion, offsets, crossings, int(cuts[at]), int(cuts[end])))
        at = end
    return pieces


def _piece(portion: Portion, offsets: Any, crossings: Any, start: int, stop: int) -> Portion:
    """Rays ``start`` to ``stop`` of a portion."""
    records = slice(int(offsets[start]), int(offsets[stop]))
    found = slice(int(crossings[records.start]), int(crossings[records.stop]))
    d = portion.descriptors
    source = portion.source[start:stop]
    rays = {
        name: getattr(portion, name)[start:stop]
        for name in ("weight", "emission", "ray_ids")
        if getattr(portion, name) is not None
    }
    emitters = source
    if portion.emission is not None:
        emitters = source[np.unique(rays["emission"], return_index=True)[1]]
    return replace(
        portion,
        emitted=np.bincount(emitters, minlength=len(portion.emitted)).astype(np.int64),
        source=source,
        **rays,
        records_per_ray=portion.records_per_ray[start:stop],
        **{
            name: getattr(portion, name)[records]
            for name in (
                "position", "normal", "object", "triangle", "event", "medium", "color_code",
                "descriptor_count",
            )
        },
        descriptors=Descriptors(
            detector=d.detector[found],
            cell=d.cell[found],
            cosine=d.cosine[found],
            uv=d.uv[found],
            registered=d.registered[found],
        ),
        first_ray=portion.first_ray + start,
    )  # fmt: skip


def copied(portion: Portion) -> Portion:
    """A portion that owns its columns."""
    columns = (
        "position", "normal", "object", "triangle", "event", "medium", "color_code",
        "color_table", "descriptor_count", "records_per_ray", "source",
    )  # fmt: skip
    d = portion.descriptors
    return replace(
        portion,
        **{name: getattr(portion, name).copy() for name in columns},
        descriptors=Descriptors(
            detector=d.detector.copy(),
            cell=d.cell.copy(),
            cosine=d.cosine.copy(),
            uv=d.uv.copy(),
            registered=d.registered.copy(),
        ),
    )

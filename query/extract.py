"""Chosen rays of a portion as a portion of their own."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.context import offsets_of
from query.scans import expand_rows
from raymap.portion import Descriptors, Portion

__all__ = ["take_rays"]

Ints = NDArray[np.integer]


def take_rays(portion: Any, rays: Ints) -> Portion:
    """Chosen rays of a stored portion with everything that is recorded of them.

    Parameters
    ----------
    rays : increasing indices in the portion

    Returns
    -------
    Portion
        keeps the ray numbers, and the emitted counts of the portion it comes from
    """
    whole: Portion = portion.read()
    offsets = offsets_of(whole.records_per_ray)
    counts = whole.records_per_ray[rays]
    rows = expand_rows(offsets[:-1][rays], offsets_of(counts))
    # Descriptors stand in record order, so those of a ray are one run.
    first = offsets_of(whole.descriptor_count)
    begins, ends = first[offsets[:-1][rays]], first[offsets[1:][rays]]
    meetings = expand_rows(begins, offsets_of(ends - begins))
    found = whole.descriptors
    ids = portion.ray_ids()[rays]
    n_records = whole.n_records
    return Portion(
        emitted=whole.emitted,
        source=whole.source[rays],
        records_per_ray=counts,
        position=whole.position[rows],
        normal=whole.normal[rows],
        object=whole.object[rows],
        triangle=whole.triangle[rows],
        event=whole.event[rows],
        medium=whole.medium[rows],
        color_code=whole.color_code[rows],
        color_table=whole.color_table,
        descriptor_count=whole.descriptor_count[rows],
        descriptors=Descriptors(
            detector=found.detector[meetings],
            cell=found.cell[meetings],
            cosine=found.cosine[meetings],
            uv=found.uv[meetings],
            registered=found.registered[meetings],
        ),
        first_ray=int(ids[0]) if len(ids) else whole.first_ray,
        ray_ids=ids,
        channel_set=whole.channel_set,
        weight=None if whole.weight is None else whole.weight[rays],
        emission=None if whole.emission is None else whole.emission[rays],
        extra={
            name: column[rows if len(column) == n_records else rays]
            for name, column in whole.extra.items()
        },
    )

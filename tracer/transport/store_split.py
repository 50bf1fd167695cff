"""Blocks of emissions that have split: every ray with all its records, also those it inherits."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from raymap.jit.kernels import lean_kernel
from raymap.jit.types import I32, I64
from tracer.rays.colors import COLORS
from tracer.transport.buffers import COUNT, DESCRIPTORS, N_RECORDS, RAYS, Buffers
from tracer.transport.splitting import SplitRays, find_ray_order
from tracer.transport.store import Columns, copy_records

__all__ = ["SplitBlock", "order_split_block", "store_split_block"]


class SplitBlock(NamedTuple):
    """Order of a finished block: per ray in the order of the portion its number in the block and
    its records; per record the one of the block; and how many descriptors all that takes."""

    ray: I64
    records_per_ray: I32
    order: I32
    n_descriptors: int


def order_split_block(b: Buffers, split: SplitRays, n: int) -> SplitBlock:
    """Rays of a block of ``n`` emissions, emission after emission, with inherited records."""
    counts = b.ray_i[N_RECORDS, : int(b.counters[RAYS])].copy()
    ray = np.empty(len(counts), np.int64)
    order = np.empty(int(counts.sum()), np.int32)
    find_ray_order(b, split, n, np.empty(n + 1, np.int64), np.empty_like(ray), ray, order)
    described = int(b.words[order, COUNT].sum()) if b.counters[DESCRIPTORS] else 0
    return SplitBlock(ray, counts[ray], order, described)


def store_split_block(
    block: SplitBlock, b: Buffers, n_sources: int, columns: Columns, filled: I64
) -> None:
    """Append a block to the columns; ``filled`` as in `tracer.transport.store.store_block`."""
    first, last = int(filled[0]), int(filled[0]) + len(block.ray)
    columns.records_per_ray[first:last] = block.records_per_ray
    columns.weight[first:last] = b.ray_f[block.ray]
    color_map = np.empty(int(b.counters[COLORS]), np.int32)
    _copy(len(block.order), n_sources, b, columns, filled, color_map, block.order)
    filled[0] = last


@lean_kernel
def _copy(
    total: int, n_sources: int, b: Buffers, columns: Columns, filled: I64, color_map: I32,
    order: I32,
) -> None:  # fmt: skip
    copy_records(total, n_sources, b, columns, filled, color_map, order)

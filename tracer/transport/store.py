"""From the records of a block in the order of time to the columns of a portion in ray order."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inner_kernel, lean_kernel, number, unsigned
from raymap.jit.types import F64, I32, I64
from tracer.geometry.prefetch import prefetch
from tracer.rays.colors import COLORS
from tracer.transport.buffers import (
    CHAIN,
    COUNT,
    COUNTED,
    D_CELL,
    D_COSINE,
    D_DETECTOR,
    D_PREVIOUS,
    D_RECORD,
    D_REGISTERED,
    D_UV,
    DESCRIPTORS,
    EVENT,
    N_RECORDS,
    NORMAL_XY,
    NORMAL_Z,
    R_CODE,
    R_MEDIUM,
    RECORDS,
    TRIANGLE,
    Buffers,
    X,
    Y,
    Z,
)

__all__ = ["Columns", "copy_records", "store_block"]

I16 = NDArray[np.int16]
U16 = NDArray[np.uint16]


_AHEAD = 12
"""Records that are fetched before their turn."""


class Columns(NamedTuple):
    """Columns of a portion under construction, with room to spare (see `raymap.Portion`)."""

    records_per_ray: I32
    weight: F64
    position: NDArray[np.float32]
    normal: I16
    object: I16
    triangle: I32
    event: I32
    medium: I16
    color_code: I32
    descriptor_count: U16
    detector: I16
    cell: U16
    cosine: I16
    uv: U16
    registered: NDArray[np.bool_]
    color_table: U16
    exact: F64


@lean_kernel
def store_block(
    n: int,
    n_sources: int,
    b: Buffers,
    columns: Columns,
    filled: I64,
    color_map: I32,
    order: I32,
    counted: bool,
) -> None:
    """Append the ``n`` rays of a finished block to the columns.

    ``filled`` counts rays, records, descriptors and mixed colours in the columns and is brought up
    to date. The first ``n_sources`` rows of the colour table are the sources' colours. With
    ``counted`` only those records are kept at which rays end or that have descriptors.
    """
    if counted:
        _keep_counted(n, b)
    owners, ray_i, n_rays = b.owners, b.ray_i, filled[0]
    # Find the place of every record: rays in order, records of a ray as they happened
    total = number(0)
    for ray in range(n):
        count = ray_i[N_RECORDS, ray]
        columns.records_per_ray[n_rays + ray] = count
        columns.weight[n_rays + ray] = b.ray_f[ray]
        ray_i[N_RECORDS, ray] = total
        total += count
    for r in range(b.counters[RECORDS]):
        owner = unsigned(owners[r] & (COUNTED - 1))
        index = ray_i[N_RECORDS, owner]
        order[unsigned(index)] = r
        ray_i[N_RECORDS, owner] = index + 1
    copy_records(total, n_sources, b, columns, filled, color_map, order)
    filled[0] = n_rays + n


@inner_kernel
def _keep_counted(n: int, b: Buffers) -> None:
    """Pack the records that the tally of a trace needs to the front of the block."""
    words, owners, ray_i = b.words, b.owners, b.ray_i
    for ray in range(n):
        ray_i[N_RECORDS, ray] = 0
    kept = number(0)
    for d in range(b.counters[DESCRIPTORS]):
        owners[unsigned(b.crossings[d, D_RECORD])] |= COUNTED
    for r in range(b.counters[RECORDS]):
        owner = owners[r]
        if owner & COUNTED != 0:
            to = unsigned(kept)
            for k in range(words.shape[1]):
                words[to, k] = words[r, k]
            owners[to] = owner
            ray_i[N_RECORDS, unsigned(owner & (COUNTED - 1))] += 1
            kept += 1
    b.counters[RECORDS] = kept


@inner_kernel
def copy_records(
    total: int,
    n_sources: int,
    b: Buffers,
    columns: Columns,
    filled: I64,
    color_map: I32,
    order: I32,
) -> None:
    """Append the ``total`` records of a block, record ``order[k]`` as the k-th of them."""
    words, real, exact = b.words, b.real, b.exact
    crossings, crossing_t, colors = b.crossings, b.crossing_t, b.colors
    n_channels = colors.shape[1]
    n_records, n_descriptors, n_colors = filled[1], filled[2], filled[3]
    for k in range(b.counters[COLORS]):
        color_map[k] = k if k < n_sources else -1
    if n_colors == 0:
        for k in range(n_sources):
            _quantise(colors, k, columns.color_table, k)
        n_colors = n_sources
    for k in range(total):
        # The records of a ray lie scattered in memory
        prefetch(words, order[unsigned(min(k + _AHEAD, total - 1))])
        r = unsigned(order[k])
        index = unsigned(n_records + k)
        columns.position[index, 0] = real[r, X]
        columns.position[index, 1] = real[r, Y]
        columns.position[index, 2] = real[r, Z]
        xy, z = words[r, NORMAL_XY], words[r, NORMAL_Z]
        columns.normal[index, 0] = xy
        columns.normal[index, 1] = xy >> 16
        columns.normal[index, 2] = z
        columns.object[index] = z >> 16
        columns.triangle[index] = words[r, TRIANGLE]
        columns.event[index] = words[r, EVENT]
        columns.medium[index] = words[r, R_MEDIUM]
        described = words[r, COUNT]
        columns.descriptor_count[index] = described
        if described > 0:
            _place_descriptors(words, r, crossings, crossing_t, columns, n_descriptors)
            n_descriptors += described
        # Number mixed colours as they turn up
        code = np.int64(words[r, R_CODE])
        if code >= n_channels + n_sources:
            row = code - n_channels
            if color_map[row] < 0:
                color_map[row] = n_colors
                _quantise(colors, row, columns.color_table, n_colors)
                n_colors += 1
            code = n_channels + color_map[row]
        columns.color_code[index] = code
        if len(exact) > 0:
            for axis in range(3):
                columns.exact[index, axis] = exact[r, axis]
    filled[1] = n_records + total
    filled[2] = n_descriptors
    filled[3] = n_colors


@inner_kernel
def _place_descriptors(
    words: I32, r: int, crossings: I32, crossing_t: F64, columns: Columns, index: int
) -> None:
    """Write the descriptors of one segment by rising distance."""
    count = words[r, COUNT]
    d = int(words[r, CHAIN])
    for _ in range(count):
        # Rank among the descriptors of the segment; equal distances keep the order of detectors
        rank = 0
        other = np.int64(words[r, CHAIN])
        for _ in range(count):
            before = crossing_t[other] < crossing_t[d]
            tie = crossing_t[other] == crossing_t[d] and other < d
            rank += 1 if before or tie else 0
            other = np.int64(crossings[other, D_PREVIOUS])
        k = index + rank
        w = crossings[d]
        columns.detector[k] = w[D_DETECTOR]
        columns.cell[k, 0] = w[D_CELL]
        columns.cell[k, 1] = w[D_CELL] >> 16
        columns.uv[k, 0] = w[D_UV]
        columns.uv[k, 1] = w[D_UV] >> 16
        columns.cosine[k] = w[D_COSINE]
        columns.registered[k] = w[D_REGISTERED] != 0
        d = int(w[D_PREVIOUS])


@inner_kernel
def _quantise(colors: F64, row: int, table: U16, index: int) -> None:
    """Shares as 16-bit numbers that sum to 65535: rounded down, the rest by largest remainder."""
    n_channels = colors.shape[1]
    rest = 65535
    for k in range(n_channels):
        value = int(colors[row, k] * 65535.0)
        table[index, k] = value
        rest -= value
    for _ in range(rest):
        best, share = 0, -1.0
        for k in range(n_channels):
            remainder = colors[row, k] * 65535.0 - table[index, k]
            if remainder > share:
                best, share = k, remainder
        table[index, best] += 1

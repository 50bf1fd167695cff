"""Splitting: one emission becomes several rays, each with a share of its light.

Where a ray splits, the part that turns off is noted (`SplitRays.direction`, ``outcome``) by the
surface and becomes a ray of its own once the record of the point is written: it inherits the
records of the ray before that point and writes its own from there. Rays of a block are numbered as
they come to be, so a ray stands behind the one that it stems from; their order within an emission
does not depend on the other emissions of the block.
"""

from __future__ import annotations

from typing import Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inline_kernel, inner_kernel, lean_kernel
from raymap.jit.types import F64, I32, I64
from raymap.model.events import Event
from raymap.optics.frames import unit_factor
from tracer.compiled import R_RAYS, R_SPLITS, VarianceReduction
from tracer.rays.colors import COLORS
from tracer.rays.random import stream_state
from tracer.transport.buffers import (
    CODE,
    COUNTED,
    DESCRIPTORS,
    KEY,
    LAST,
    LIVE,
    MEDIUM,
    N_RECORDS,
    OWN,
    OWN_BODY,
    OWN_TRIANGLE,
    RAY,
    RAYS,
    RECORDS,
    RNG,
    STACK,
    WEIGHT,
    Buffers,
    Workspace,
    grown,
    with_more_records,
)

__all__ = [
    "Fork",
    "SplitRays",
    "find_ray_order",
    "gather_split_rays",
    "has_room",
    "may_split",
    "make_split_rays",
    "release_split_ray",
    "start_emissions",
    "split_code",
    "split_event",
    "widen",
]

# Entries of SplitRays.outcome
T_PENDING, T_EVENT, T_CODE = range(3)

# Rows of SplitRays.rays: reflections that have split the ray off, its emission in the block, the
# ray that it stems from (-1 none), records that it has from that one
LEVEL, EMISSION, PARENT, INHERITED = range(4)

_CHOICE = int(
    Event.SPECULAR_REFLECTION
    | Event.SPECULAR_REFRACTION
    | Event.TIR
    | Event.GLOSSY_REFLECTION
    | Event.GLOSSY_TRANSMISSION
    | Event.DISPERSIVE_SELECT
    | Event.MEDIUM_CHANGED
    | Event.SURFACE_ABSORPTION
    | Event.ROULETTE_KILL
)


Array = TypeVar("Array", bound=NDArray[np.generic])


class SplitRays(NamedTuple):
    """What splitting keeps beside the buffers of a block.

    direction (4,), outcome (4,) : the part that turns off here, direction and weight, and T_…
    rays (4, n) : per ray of the block, LEVEL …
    emitted (block,) : rays of each emission
    spawned (1,) : rays that came to be in this step, behind the live ones
    """

    direction: F64
    outcome: I64
    rays: I32
    emitted: I32
    spawned: I64


class Fork(NamedTuple):
    """Where a ray splits: the point, the outward normal there, the cosine of the ray with it, the
    face and its main axis, mesh and triangle (-1 where there is none)."""

    x: float
    y: float
    z: float
    nx: float
    ny: float
    nz: float
    cosine: float
    face: int
    axis: int
    body: int
    triangle: int


def make_split_rays(block: int, rays: int) -> SplitRays:
    """Room for blocks of ``block`` emissions, and ``rays`` rays at first."""
    return SplitRays(
        direction=np.zeros(4),
        outcome=np.zeros(4, np.int64),
        rays=np.zeros((4, rays), np.int32),
        emitted=np.zeros(block, np.int32),
        spawned=np.zeros(1, np.int64),
    )


@lean_kernel
def start_emissions(split: SplitRays, n: int, counters: I64) -> None:
    """Each of the ``n`` rays just emitted is an emission of its own."""
    for i in range(n):
        split.rays[LEVEL, i] = 0
        split.rays[EMISSION, i] = i
        split.rays[PARENT, i] = -1
        split.rays[INHERITED, i] = 0
        split.emitted[i] = 1
    split.spawned[0] = 0
    split.outcome[T_PENDING] = 0
    counters[RAYS] = n


@inline_kernel
def may_split(reduction: VarianceReduction, split: SplitRays | None, ray: int) -> bool:
    """Whether a ray may split: not too often yet, and its emission has not too many rays."""
    if split is None:
        return False
    if split.rays[LEVEL, ray] >= reduction.settings[R_SPLITS]:
        return False
    return bool(split.emitted[split.rays[EMISSION, ray]] < reduction.settings[R_RAYS])


@inline_kernel
def has_room(split: SplitRays | None, b: Buffers, n: int, crossings: int) -> bool:
    """Whether no buffer can overflow in the next step of ``n`` rays."""
    if split is None:
        return bool(
            b.counters[RECORDS] + n <= len(b.words)
            and b.counters[DESCRIPTORS] + n * crossings <= len(b.crossing_t)
            and b.counters[COLORS] + 4 * n <= len(b.colors)
        )
    return bool(
        b.counters[RECORDS] + 2 * n <= len(b.words)
        and b.counters[DESCRIPTORS] + n * crossings <= len(b.crossing_t)
        and b.counters[COLORS] + 8 * n <= len(b.colors)
        and 2 * n <= b.live_f.shape[1]
        and b.counters[RAYS] + n <= split.rays.shape[1]
    )


@inline_kernel
def split_event(split: SplitRays | None, event: int) -> int:
    """Event of the part that turned off at a point where the ray has ``event``; 0 none."""
    if split is None:
        return 0
    if split.outcome[T_PENDING] == 0:
        return 0
    return int((event & ~_CHOICE) | split.outcome[T_EVENT])


@inline_kernel
def split_code(split: SplitRays | None) -> int:
    """Colour code of that part."""
    return 0 if split is None else int(split.outcome[T_CODE])


@inline_kernel
def release_split_ray(
    split: SplitRays | None, b: Buffers, ray: int, r: int, at: Fork, stack: int, medium: int,
    state: np.uint64,
) -> int:  # fmt: skip
    """Put the part that turned off behind the live rays; its number in the block."""
    if split is None:
        return 0
    return _release(split, b, ray, r, at, stack, medium, state)


@inner_kernel
def _release(
    split: SplitRays, b: Buffers, ray: int, r: int, at: Fork, stack: int, medium: int,
    state: np.uint64,
) -> int:  # fmt: skip
    live_f, live_i = b.live_f, b.live_i
    i = b.counters[LIVE] + split.spawned[0]
    split.spawned[0] += 1
    number = b.counters[RAYS]
    b.counters[RAYS] = number + 1
    emission = split.rays[EMISSION, ray]
    split.rays[LEVEL, number] = split.rays[LEVEL, ray] + 1
    split.rays[EMISSION, number] = emission
    split.rays[PARENT, number] = ray
    split.rays[INHERITED, number] = b.ray_i[N_RECORDS, ray] - 1
    split.outcome[T_PENDING] = 0
    live_f[0, i], live_f[1, i], live_f[2, i] = at.x, at.y, at.z
    d = split.direction
    along = d[0] * at.nx + d[1] * at.ny + d[2] * at.nz
    if along * at.cosine > 0.0:
        # Keep to the side of the triangle from which the light came
        d[0] -= 2.0 * along * at.nx
        d[1] -= 2.0 * along * at.ny
        d[2] -= 2.0 * along * at.nz
    scale = unit_factor(d[0], d[1], d[2])
    for k in range(3):
        live_f[3 + k, i] = scale * d[k]
    live_f[WEIGHT, i] = d[3]
    live_i[OWN, i], live_i[KEY, i] = at.face, 2 * at.face + (1 if d[at.axis] >= 0.0 else 0)
    if len(live_i) > OWN_BODY:
        live_i[OWN_BODY, i], live_i[OWN_TRIANGLE, i] = at.body, at.triangle
    live_i[STACK, i], live_i[MEDIUM, i] = stack, medium
    live_i[CODE, i] = split.outcome[T_CODE]
    # A stream of its own, keyed by that of the ray and by its number in the emission
    live_i[RNG, i] = np.int64(stream_state(np.int64(state), split.emitted[emission]))
    split.emitted[emission] += 1
    live_i[RAY, i], live_i[LAST, i] = number, r
    b.ray_i[N_RECORDS, number] = b.ray_i[N_RECORDS, ray]
    return int(number)


@inline_kernel
def gather_split_rays(split: SplitRays | None, b: Buffers, kept: int) -> int:
    """Move the rays that came to be in this step behind those that go on."""
    if split is None:
        return kept
    return _gather(split, b, kept)


@inner_kernel
def _gather(split: SplitRays, b: Buffers, kept: int) -> int:
    first = b.counters[LIVE]
    for j in range(split.spawned[0]):
        for k in range(len(b.live_f)):
            b.live_f[k, kept] = b.live_f[k, first + j]
        for k in range(len(b.live_i)):
            b.live_i[k, kept] = b.live_i[k, first + j]
        kept += 1
    split.spawned[0] = 0
    return kept


@lean_kernel
def find_ray_order(
    b: Buffers, split: SplitRays, n: int, index: I64, start: I64, ray_of: I64, order: I32
) -> None:
    """Where the rays and records of a finished block of ``n`` emissions go.

    Parameters
    ----------
    index : (n + 1,) set to the first ray of every emission
    start : (n_rays + 1,) set to the first record of every ray, in the order of the portion
    ray_of : (n_rays,) set to the ray of the block at each place
    order : (n_records,) set to the record of the block at each place
    """
    n_rays = b.counters[RAYS]
    index[0] = 0
    for e in range(n):
        index[e + 1] = index[e] + split.emitted[e]
    # Rays of an emission stand as they came to be; the oldest ones first
    for ray in range(n_rays):
        e = split.rays[EMISSION, ray]
        ray_of[index[e]] = ray
        index[e] += 1
    for e in range(n, 0, -1):
        index[e] = index[e - 1]
    index[0] = 0
    total = 0
    for k in range(n_rays):
        start[ray_of[k]] = total
        total += b.ray_i[N_RECORDS, ray_of[k]]
    # Own records of every ray, in the order of time, behind those that it inherits
    for ray in range(n_rays):
        b.ray_i[N_RECORDS, ray] = split.rays[INHERITED, ray]
    for r in range(b.counters[RECORDS]):
        ray = b.owners[r] & (COUNTED - 1)
        order[start[ray] + b.ray_i[N_RECORDS, ray]] = r
        b.ray_i[N_RECORDS, ray] += 1
    # An older ray is complete when a younger one inherits from it
    for ray in range(n_rays):
        parent = split.rays[PARENT, ray]
        for k in range(split.rays[INHERITED, ray]):
            order[start[ray] + k] = order[start[parent] + k]


def widen(workspace: Workspace, split: SplitRays) -> SplitRays:
    """Grow what a step of a splitting block could overfill, beyond `Workspace.make_room`."""
    b = workspace.buffers
    n, rays = int(b.counters[LIVE]), int(b.counters[RAYS])
    while b.counters[RECORDS] + 2 * n > len(b.words):
        b = with_more_records(b)
    while b.counters[COLORS] + 8 * n > len(b.colors):
        b = b._replace(colors=grown(b.colors))
    while 2 * n > b.live_f.shape[1]:
        b = b._replace(live_f=_wider(b.live_f), live_i=_wider(b.live_i), order=grown(b.order))
    while rays + n > split.rays.shape[1]:
        split = split._replace(rays=_wider(split.rays))
    if split.rays.shape[1] > b.ray_i.shape[1]:
        more = split.rays.shape[1] - b.ray_i.shape[1]
        b = b._replace(ray_i=np.pad(b.ray_i, ((0, 0), (0, more))), ray_f=np.pad(b.ray_f, (0, more)))
    workspace.buffers = b
    return split


def _wider(array: Array) -> Array:
    # Compiled code knows one layout of each array
    layout: Literal["C", "F"] = "C" if array.flags.c_contiguous else "F"
    larger: Array = np.empty(  # type: ignore[assignment]
        (array.shape[0], 2 * array.shape[1]), array.dtype, order=layout
    )
    larger[:, : array.shape[1]] = array
    return larger

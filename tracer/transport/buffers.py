"""Buffers of one worker: the rays alive, the records of a block in the order of time.

A *block* is a few thousand rays traced in step. Records are written as they happen (one row of
eleven words, so that a record is one cache line at most); `tracer.transport.store` puts them in ray
order.

Columns are rows of a few two-dimensional arrays: compiled functions take few arguments. Rays on
their way are looked up in any order, so all of a ray stands together in memory; bundles are worked
on column by column, so there the rays of a column do. Their rows are padded by an odd number of
cache lines, or equal places of all rows would share a set of the cache.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from raymap.jit.types import F64, I32, I64
from tracer.compiled import F_KIND, CompiledScene
from tracer.geometry.kinds import MESH
from tracer.optics.crystals.interface import WAVE, InterfaceScratch, interface_scratch
from tracer.rays.colors import COLORS

__all__ = ["BUNDLE", "Buffers", "Workspace", "grown", "with_more_records"]

BUNDLE = 512
"""Rays intersected together; their columns stay in the first-level cache."""

_PADDING = 40

# Entries of counters beside `tracer.rays.colors.COLORS`. Rays of the block are counted where they
# split. Where COUNTING is set, records that no sum of a trace needs may be left out; LEFT_OUT
# counts them.
LIVE, RECORDS, DESCRIPTORS = range(3)
IGNORED, RAYS, COUNTING, LEFT_OUT = range(4, 8)

# Rows of live_f: origin 0-2, direction 3-5, distance of the face met next, weight
T, WEIGHT = 6, 7
# Further rows where there are meshes: the place on the triangle met, the triangle's normal, the
# normal interpolated there
MESH_POINT, MESH_NORMAL, MESH_SHADING, MESH_ROWS = 8, 11, 14, 17

# Rows of live_i: face met next, face on which the ray stands (-1 none), start bin (list of
# candidates), stack, medium, colour code, random state (bits), ray in the block,
# its last record
HIT, OWN, KEY, STACK, MEDIUM, CODE, RNG, RAY, LAST = range(9)
# Further rows where there are meshes: mesh and triangle met, those on which the ray stands
MESH_BODY, MESH_TRIANGLE, OWN_BODY, OWN_TRIANGLE = range(9, 13)

# Rows of bundle_i: face on which each ray stands, faces met (two rows), slot
BUNDLE_OWN, BUNDLE_CODE, BUNDLE_SLOT = 0, 1, 3

# Words of a record
X, Y, Z, NORMAL_XY, NORMAL_Z, TRIANGLE, EVENT, R_MEDIUM, R_CODE, COUNT, CHAIN = range(11)

COUNTED = 1 << 30
"""Bit of ``owners`` of records that count in the sums of a trace."""

# Words of a descriptor
D_DETECTOR, D_CELL, D_UV, D_COSINE, D_REGISTERED, D_PREVIOUS, D_RECORD = range(7)

# Rows of ray_i: number of records of each ray of the block
N_RECORDS = 0

Array = TypeVar("Array", bound=NDArray[np.generic])


class CarriedRays(NamedTuple):
    """States of rays on their way, where they carry them, and scratch of one thread.

    states (9, block) : per slot the refraction vector in a crystal, real and imaginary field
    waves (2, 6), copy (2, 6) : the field of the ray at hand (`raymap.optics.waves`; one wave)
    refraction (3,), field (3,) : the same as vectors
    out (4, WAVE), at_interface : of `tracer.optics.crystals.interface`
    """

    states: F64
    waves: F64
    copy: F64
    refraction: F64
    field: NDArray[np.complex128]
    out: F64
    at_interface: InterfaceScratch

    @classmethod
    def create(cls, block: int) -> CarriedRays:
        """Arrays for a block of rays."""
        scratch: Any = interface_scratch
        return cls(
            states=np.zeros((block, 9)).T,
            waves=np.zeros((2, 6)),
            copy=np.zeros((2, 6)),
            refraction=np.zeros(3),
            field=np.zeros(3, np.complex128),
            out=np.zeros((4, WAVE)),
            at_interface=scratch.py_func(),
        )


class Buffers(NamedTuple):
    """All arrays that change while a block is traced.

    live_f (8, block), live_i (9, block) : rays on their way, packed to the front
    order (block,) : their slots by start bin
    ray_i (1, block), ray_f (block,) : per ray its records and its final weight
    words (n, 11), real : records as they happen, and the same memory as float32
    owners (n,) : of every record the ray of the block, with `COUNTED` where the ray ends
    exact : empty, or (n, 3) positions in float64
    crossings (n, 7), crossing_t : descriptors as they happen, chained per record
    colors (n, C) : mixed colours
    counters : see above
    bundle_f (8, BUNDLE), bundle_i (4, BUNDLE), bins : scratch of the intersection
    stream_f (26, BUNDLE), stream_i (8, BUNDLE) : scratch of `tracer.transport.streams`
    carried : states of rays; None where they carry none
    """

    live_f: F64
    live_i: I64
    order: I64
    ray_i: I32
    ray_f: F64
    words: I32
    real: NDArray[np.float32]
    owners: I32
    exact: F64
    crossings: I32
    crossing_t: F64
    colors: F64
    counters: I64
    bundle_f: F64
    bundle_i: I64
    bins: I64
    stream_f: F64
    stream_i: I64
    carried: CarriedRays | None


@dataclass
class Workspace:
    """The buffers of one worker; they grow and are used again for the next block."""

    block: int
    buffers: Buffers

    @classmethod
    def create(cls, scene: CompiledScene, block: int, *, exact: bool = False) -> Workspace:
        words = np.empty((24 * block, 11), np.int32)
        meshed = bool(np.any(scene.face_i[:, F_KIND] == MESH))
        return cls(
            block,
            Buffers(
                live_f=np.empty((block, MESH_ROWS if meshed else 8)).T,
                live_i=np.empty((block, 13 if meshed else 9), np.int64).T,
                order=np.empty(block, np.int64),
                ray_i=np.empty((1, block), np.int32),
                ray_f=np.empty(block),
                words=words,
                real=words.view(np.float32),
                owners=np.empty(len(words), np.int32),
                exact=np.empty((len(words) if exact else 0, 3)),
                crossings=np.empty((4 * block, 7), np.int32),
                crossing_t=np.empty(4 * block),
                colors=np.empty((len(scene.source_i) + 8 * block, scene.n_channels)),
                counters=np.zeros(8, np.int64),
                bundle_f=np.empty((8, BUNDLE + _PADDING)),
                bundle_i=np.empty((4, BUNDLE + _PADDING), np.int64),
                bins=np.empty(len(scene.first), np.int64),
                stream_f=np.empty((26, BUNDLE + _PADDING)),
                stream_i=np.empty((8, BUNDLE + _PADDING), np.int64),
                carried=None if scene.carried is None else CarriedRays.create(block),
            ),
        )

    def make_room(self, scene: CompiledScene) -> None:
        """Grow what the next step could overfill."""
        b = self.buffers
        n = int(b.counters[LIVE])
        if b.counters[RECORDS] + n > len(b.words):
            b = with_more_records(b)
        while b.counters[DESCRIPTORS] + n * (len(scene.detector_i) + 1) > len(b.crossing_t):
            b = b._replace(crossings=grown(b.crossings), crossing_t=grown(b.crossing_t))
        if b.counters[COLORS] + 4 * n > len(b.colors):
            b = b._replace(colors=grown(b.colors))
        self.buffers = b


def with_more_records(b: Buffers) -> Buffers:
    """The buffers with room for twice as many records."""
    words = grown(b.words)
    exact = grown(b.exact) if len(b.exact) else b.exact
    return b._replace(words=words, real=words.view(np.float32), owners=grown(b.owners), exact=exact)


def grown(array: Array) -> Array:
    """The array with room for twice as many rows."""
    larger = np.empty((2 * len(array), *array.shape[1:]), array.dtype)
    larger[: len(array)] = array
    return larger  # type: ignore[return-value]

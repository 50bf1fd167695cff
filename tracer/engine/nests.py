"""The nest of a ray: which bodies it is in, and so in which medium.

A nest is three 16-bit words of body index + 1 in one integer, the one that counts in the lowest
word. Where solids overlap, the body of higher priority counts; of equal ones, the one entered
last (so a body inside another needs no priority). After C. M. Schmidt, B. Budge, "Simple nested
dielectrics in ray traced images", Journal of Graphics Tools 7(2), 1 (2002).
"""

from __future__ import annotations

from raymap.kernels import inner_kernel
from tracer.geometry.kinds import I64
from tracer.scene.arrays import B_PRIORITY

__all__ = ["enter_body", "leave_body", "top_body"]

_FULL = 0xFFFF << 32


@inner_kernel
def top_body(nest: int) -> int:
    """The body that counts, -1 in the world."""
    return (nest & 0xFFFF) - 1


@inner_kernel
def enter_body(nest: int, body: int, body_i: I64) -> int:
    """Nest after entering ``body``; -1 if it was in already, or the nest is full."""
    if nest == 0:
        return body + 1
    if nest & _FULL != 0:
        return -1
    # Find the first body of no higher priority
    place = -1
    shift = 0
    while nest >> shift != 0:
        other = ((nest >> shift) & 0xFFFF) - 1
        if other == body:
            return -1
        if place < 0 and body_i[other, B_PRIORITY] <= body_i[body, B_PRIORITY]:
            place = shift
        shift += 16
    if place < 0:
        place = shift
    low = nest & ((1 << place) - 1)
    return low | ((body + 1) << place) | ((nest >> place) << (place + 16))


@inner_kernel
def leave_body(nest: int, body: int) -> int:
    """Nest after leaving ``body``; -1 if it was not in."""
    if nest == body + 1:
        return 0
    shift = 0
    while nest >> shift != 0:
        if (nest >> shift) & 0xFFFF == body + 1:
            low = nest & ((1 << shift) - 1)
            return low | ((nest >> (shift + 16)) << shift)
        shift += 16
    return -1

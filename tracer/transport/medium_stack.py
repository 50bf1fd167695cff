"""The medium stack of a ray: which bodies it is in, and so in which medium.

It is a row of body indices + 1 in one integer of 63 bits, the one that counts in the lowest word:
seven words of 9 bits where a scene has at most 510 solids, else four of 15. Where solids overlap,
the body of higher priority counts; of equal ones, the one entered last (so a body inside another
needs no priority). After C. M. Schmidt, B. Budge, "Simple nested dielectrics in ray traced
images", Journal of Graphics Tools 7(2), 1 (2002).
"""

from __future__ import annotations

from raymap.jit.kernels import inner_kernel
from raymap.jit.types import I64
from tracer.compiled import B_PRIORITY, FEW_SOLIDS, STACK_BITS, WORD_FEW, WORD_MANY

__all__ = ["enter_body", "leave_body", "top_body"]


@inner_kernel
def _word_bits(n_solids: int) -> int:
    """Bits of a word of the stacks of a scene."""
    return WORD_FEW if n_solids <= FEW_SOLIDS else WORD_MANY


@inner_kernel
def top_body(stack: int, body_i: I64) -> int:
    """The body that counts, -1 in the world."""
    return (stack & ((1 << _word_bits(len(body_i))) - 1)) - 1


@inner_kernel
def enter_body(stack: int, body: int, body_i: I64) -> int:
    """Medium stack after entering ``body``; -1 if it was in already, or the stack is full."""
    if stack == 0:
        return body + 1
    bits = _word_bits(len(body_i))
    word = (1 << bits) - 1
    # Find the first body of no higher priority
    index = -1
    shift = 0
    while shift < STACK_BITS and stack >> shift != 0:
        other = ((stack >> shift) & word) - 1
        if other == body:
            return -1
        if index < 0 and body_i[other, B_PRIORITY] <= body_i[body, B_PRIORITY]:
            index = shift
        shift += bits
    if shift + bits > STACK_BITS:
        return -1
    if index < 0:
        index = shift
    low = stack & ((1 << index) - 1)
    return low | ((body + 1) << index) | ((stack >> index) << (index + bits))


@inner_kernel
def leave_body(stack: int, body: int, body_i: I64) -> int:
    """Medium stack after leaving ``body``; -1 if it was not in."""
    if stack == body + 1:
        return 0
    bits = _word_bits(len(body_i))
    word = (1 << bits) - 1
    shift = 0
    while shift < STACK_BITS and stack >> shift != 0:
        if (stack >> shift) & word == body + 1:
            low = stack & ((1 << shift) - 1)
            above = stack >> shift >> bits
            return low | (above << shift)
        shift += bits
    return -1

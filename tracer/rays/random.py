"""Random numbers from a stream keyed by (seed, ray number).

A ray draws the same numbers whatever the threads, the portion or the machine, so a map is
reproducible and any ray can be traced again alone. The generator is SplitMix64: a counter that
advances by an odd constant, and a bijective mix of it; a stream starts at a mixed key.

References
----------
G. L. Steele, D. Lea, C. H. Flood, Fast splittable pseudorandom number generators, OOPSLA 2014.
"""

from __future__ import annotations

import numpy as np

from raymap.jit.kernels import inner_kernel, kernel

__all__ = ["advance", "five_uniform", "stream_state", "uniform"]

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_SHIFT_30 = np.uint64(30)
_SHIFT_27 = np.uint64(27)
_SHIFT_31 = np.uint64(31)
_SHIFT_11 = np.uint64(11)
_UNIT = 1.0 / 9007199254740992.0  # 2**-53


@kernel
def _mix(word: np.uint64) -> np.uint64:
    word = (word ^ (word >> _SHIFT_30)) * _MIX_1
    word = (word ^ (word >> _SHIFT_27)) * _MIX_2
    return word ^ (word >> _SHIFT_31)


@kernel
def stream_state(seed: int | np.integer, ray_id: int | np.integer) -> np.uint64:
    """State from which ray ``ray_id`` of a trace with ``seed`` draws its numbers."""
    key = _mix(np.uint64(seed) + _GOLDEN)
    return _mix(key ^ (np.uint64(ray_id) * _MIX_2 + _GOLDEN))


@kernel
def advance(state: np.uint64) -> np.uint64:
    """The next state of a stream."""
    return state + _GOLDEN


@kernel
def uniform(state: np.uint64) -> float:
    """The number of a state, uniform on [0, 1) with 53 bits."""
    return (_mix(state) >> _SHIFT_11) * _UNIT


@inner_kernel
def five_uniform(
    state: np.uint64,
) -> tuple[tuple[float, float, float, float, float], np.uint64]:
    """Five uniform numbers, and the state after them."""
    a = advance(state)
    b = advance(a)
    c = advance(b)
    d = advance(c)
    e = advance(d)
    return (uniform(a), uniform(b), uniform(c), uniform(d), uniform(e)), e

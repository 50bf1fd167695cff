"""Parts of compiled code are no functions of Python, and say so."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from raymap.jit.kernels import inline_kernel, inner_kernel, lean_kernel, stage_kernel


@inner_kernel
def twice(x: float) -> float:
    return 2.0 * x


@inline_kernel
def thrice(x: float) -> float:
    return 3.0 * x


@stage_kernel
def nothing(x: float) -> None:
    pass


@lean_kernel
def five_times(x: float) -> float:
    return twice(x) + thrice(x)


@pytest.mark.parametrize("part", [twice, thrice, nothing])
def test_calls_from_python_are_one_error(part: Callable[..., Any]) -> None:
    # Before and after a caller was compiled: the second would find what is compiled
    for _ in range(2):
        with pytest.raises(TypeError, match=r"\.py_func"):
            part(1.5)
        assert five_times(1.5) == 7.5
    assert part.py_func(1.5) in (3.0, 4.5, None)  # type: ignore[attr-defined]

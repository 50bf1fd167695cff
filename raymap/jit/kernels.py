"""The decorators of all compiled functions, and their flags.

``error_model="numpy"``: division by zero gives inf or nan, as in the columns around it.
``nogil=True``: portions run on a thread pool. No ``fastmath`` (it turns ``isnan(nan)`` false), no
``parallel`` (its threading layer aborts under a thread pool).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np

from raymap.jit.compilecache import keep_compiled
from raymap.jit.parts import PartCompiler

__all__ = [
    "inline_kernel",
    "inner_kernel",
    "kernel",
    "lean_kernel",
    "number",
    "stage_kernel",
    "unsigned",
]

F = TypeVar("F", bound=Callable[..., Any])


def _compiled(function: F, **options: bool) -> F:
    def decorate(cache: bool) -> Any:
        # No entry for C: nothing calls it, and it takes a tenth of the time to compile
        return numba.njit(
            nogil=True, cache=cache, error_model="numpy", no_cfunc_wrapper=True, **options
        )(function)

    return cast(F, keep_compiled(decorate))


def kernel(function: F) -> F:
    """Compile a function of numbers and arrays on its first call; the machine code is cached."""
    return _compiled(function)


def lean_kernel(function: F) -> F:
    """As `kernel`, without reference counts: for inner loops that only use what they are handed.

    The function must not allocate. Helpers that take arrays cost about 30 ns a call otherwise
    (counts are atomic), and compile slowly.
    """
    return _compiled(function, _nrt=False)


def stage_kernel(function: F) -> F:
    """As `lean_kernel`, to be called by its address only (`raymap.jit.compiling.call_at`).

    Without the code that unpacks Python's arguments, which takes longest to compile where these are
    tuples of many arrays.
    """
    return cast(F, _Stage(_compiled(function, _nrt=False, no_cpython_wrapper=True)))


class _Stage:
    """A compiled function that Python cannot call."""

    def __init__(self, compiled: Any) -> None:
        self._compiled = compiled

    def __call__(self, *arguments: Any, **named: Any) -> None:
        name = self._compiled.py_func.__qualname__
        raise TypeError(
            f"{name} is called by its address from compiled code alone; from Python call its plain "
            f"source {name}.py_func"
        )

    def __getattr__(self, name: str) -> Any:
        return getattr(self._compiled, name)


def inner_kernel(function: F) -> F:
    """As `lean_kernel`, to be called from compiled code only: compiled as a part of its callers.

    Called from Python it raises TypeError.
    """
    return _part(function, forceinline=False)


def inline_kernel(function: F) -> F:
    """As `inner_kernel`, always made part of its caller: for the steps of an inner loop.

    A call that hands over arrays copies their descriptions, which costs more than a short step.
    """
    return _part(function, forceinline=True)


def _part(function: F, *, forceinline: bool) -> F:
    compiled = numba.njit(
        nogil=True,
        error_model="numpy",
        pipeline_class=PartCompiler,
        forceinline=forceinline,
        _nrt=False,
        no_cpython_wrapper=True,
        no_cfunc_wrapper=True,
    )(function)
    _keep_from_python(compiled, function.__qualname__)
    return cast(F, compiled)


def _keep_from_python(compiled: Any, name: str) -> None:
    """Let a part raise where Python calls it: it has no entry, and the interpreter would crash.

    What Numba compiles of it is kept for callers, and not entered where Python's calls look.
    """

    def keep(result: Any) -> None:
        compiled.overloads[tuple(result.signature.args)] = result

    def refuse(*arguments: Any, **named: Any) -> None:
        raise TypeError(
            f"{name} is a part of compiled code, which alone can call it; from Python call a "
            f"function that is made by kernel or lean_kernel, or the plain source {name}.py_func"
        )

    compiled.add_overload = keep
    compiled._compile_for_args = refuse


@inline_kernel
def unsigned(value: int) -> int:
    """A number that is not negative, as an index that compiled code need not wrap around.

    Python's negative indices cost a test and an addition at every use of a signed index.
    """
    return np.uint32(value)  # type: ignore[return-value]


@inline_kernel
def number(value: int) -> int:
    """A number of the usual type: functions that are handed literals are compiled for each."""
    return np.int64(value)  # type: ignore[return-value]

"""Compile large functions once and apart: call them by address, compile several at a time.

Numba makes everything that a function calls part of it, for every caller anew, and compiles one
function at a time. Stages that work on whole blocks of rays are therefore compiled by themselves
and called by their address, which costs nothing beside their work; and on the first start, when
nothing is in the cache of compiled code yet, another process compiles half of them.
"""

from __future__ import annotations

import gc
import hashlib
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numba
from numba import types
from numba.core.errors import TypingError
from numba.extending import intrinsic

from raymap.jit.collecting import no_collecting
from raymap.rooms import trusted_path

__all__ = ["Door", "Task", "address_of", "call_at", "compile_ahead", "task"]


class Task(NamedTuple):
    """Something to be compiled.

    module, name : of a compiled function
    arguments : types of its arguments; or values, for a Python function that is to be run
    key : what the task depends on, for functions to be run; empty for compiled ones
    """

    module: str
    name: str
    arguments: tuple[Any, ...]
    key: str = ""

    @property
    def function(self) -> Any:
        """The function, from the module that defines it."""
        return getattr(import_module(self.module), self.name)

    def compile(self) -> None:
        """Compile, or read from the cache of compiled code."""
        if self.key:
            self.function(*self.arguments)
        else:
            self.function.compile(self.arguments)

    @property
    def mark(self) -> str:
        """Name of the file which says that the task was done before."""
        text = repr((self.module, self.name, self.key or self.arguments))
        return hashlib.sha256(text.encode()).hexdigest()[:24] + ".done"


def task(function: Any, *arguments: Any) -> Task:
    """What is to be compiled before ``function`` can be called with such arguments."""
    python = function.py_func
    return Task(python.__module__, python.__qualname__, tuple(map(numba.typeof, arguments)))


def address_of(compiled: Task) -> int:
    """Address of the machine code of a compiled function, for `call_at`."""
    function = compiled.function
    function.compile(compiled.arguments)
    result = function.overloads[compiled.arguments]
    return int(result.library.get_pointer_to_function(result.fndesc.llvm_func_name))


def _caller(result: Any, wanted: tuple[Any, ...] | None = None) -> Any:
    """An intrinsic that calls the function at an address with a tuple of arguments."""

    @intrinsic  # type: ignore[untyped-decorator]
    def call(typingctx: Any, address: Any, arguments: Any) -> Any:
        if wanted is not None and tuple(arguments) != wanted:
            raise TypingError(f"called with {tuple(arguments)}, made for {wanted}")

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            place, packed = values
            kinds = list(signature.args[1])
            items = [builder.extract_value(packed, k) for k in range(len(kinds))]
            kind = context.call_conv.get_function_type(result, kinds)
            pointer = builder.inttoptr(place, kind.as_pointer())
            _, value = context.call_conv.call_function(builder, pointer, result, kinds, items)
            return context.get_dummy_value() if result == types.none else value

        return result(types.int64, arguments), generate

    return call


call_at = _caller(types.none)
"""Call the function at an address, from compiled code, with a tuple of arguments.

They must have just the types for which the address was asked; the function returns nothing.
"""


class Door:
    """A signature by which compiled code calls functions that it does not know, by address.

    What is called is compiled alone: a new one makes no other code compile again.

    Parameters
    ----------
    result, arguments : example values, of the types that the functions return and take

    Attributes
    ----------
    call : for compiled code; takes an address and a tuple of the arguments
    """

    def __init__(self, result: Any, arguments: tuple[Any, ...]) -> None:
        self.arguments = tuple(numba.typeof(item) for item in arguments)
        self.call = _caller(numba.typeof(result), self.arguments)

    def task(self, function: Any) -> Task:
        """To compile a function for this door."""
        compiled = function.py_func
        return Task(compiled.__module__, compiled.__name__, self.arguments)


def compile_ahead(tasks: Sequence[Task], *, processes: int) -> None:
    """Do tasks that are not in the cache of compiled code, with the help of another process.

    Both processes take the next one that is left, so the longest should come first. What the other
    process cannot do is done here.

    Parameters
    ----------
    tasks : the first one must be a compiled function
    processes : with less than two, no other process helps
    """
    kept = tasks[0].function.stats.cache_path
    if kept is None:
        # Nothing can be kept, nor handed over by another process
        return
    folder = Path(kept)
    left = [item for item in tasks if not (folder / item.mark).exists()]
    with no_collecting():
        if len(left) > 1 and min(processes, os.cpu_count() or 1) > 1 and _is_python():
            with tempfile.TemporaryDirectory() as claims:
                _share(left, claims)
        for item in left:
            item.compile()
            with suppress(OSError):
                (folder / item.mark).touch()


def _is_python() -> bool:
    """Whether this is Python itself, of which another process can be started."""
    return Path(sys.executable or "").stem.lower().startswith(("python", "pypy"))


_HELP = (
    "import sys; sys.path[:] = sys.argv[1:]; from raymap.jit.compiling import help_out; help_out()"
)


def _share(tasks: Sequence[Task], claims: str) -> None:
    """Compile what another process leaves to this one, and wait for it."""
    # Neither the current folder nor the environment adds to where that process imports from
    command = [sys.executable, "-I", "-c", _HELP, *trusted_path()]
    try:
        helper = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
    except OSError:
        return
    with helper:
        with suppress(OSError):
            assert helper.stdin is not None
            pickle.dump((claims, tasks), helper.stdin)
            helper.stdin.close()
        try:
            for item in tasks:
                if _claim(claims, item):
                    item.compile()
        except BaseException:
            helper.kill()
            raise


def help_out() -> None:
    """What the other process does: compile tasks that it reads from its standard input."""
    gc.disable()
    claims, tasks = pickle.load(sys.stdin.buffer)
    for item in tasks:
        if _claim(claims, item):
            item.compile()
    # The first process waits for the end of this one: look for no garbage then, either
    gc.freeze()


def _claim(claims: str, item: Task) -> bool:
    """Whether no other process has begun this task."""
    try:
        Path(claims, item.name).touch(exist_ok=False)
    except OSError:
        return False
    return True

"""Executors of many machines: a Dask scheduler by its address, and how many workers there are."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    ThreadPoolExecutor,
    wait,
)
from contextlib import contextmanager
from typing import Any

from raymap.model.errors import MissingExtra, RayMapError

__all__ = ["TRIES", "gather", "scheduler_executor", "shares_memory", "worker_count"]

CONNECT_SECONDS = 15

TRIES = 4
"""How often a task is begun before its workers are given up."""


@contextmanager
def scheduler_executor(address: str) -> Iterator[Executor]:
    """The workers of a Dask scheduler as an executor.

    Parameters
    ----------
    address : ``tcp://host:8786``, or what ``dask scheduler`` prints

    Raises
    ------
    MissingExtra
        Dask distributed is not installed.
    RayMapError
        No scheduler answers at the address, or it has no workers.
    """
    try:
        from distributed import Client
    except ImportError:
        raise MissingExtra(
            "a trace on many machines needs Dask distributed: pip install 'raymap[cluster]' here "
            "and on every worker"
        ) from None
    try:
        client = Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        line = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RayMapError(
            f"no Dask scheduler answers at {address!r} ({line}); start one with `dask scheduler`, "
            "and workers with `dask worker ADDRESS`"
        ) from None
    try:
        if not client.nthreads():
            raise RayMapError(
                f"the scheduler at {address!r} has no workers; start some with `dask worker "
                f"{address}`"
            )
        executor = client.get_executor()
        try:
            yield executor
        finally:
            executor.shutdown(wait=False)
    finally:
        client.close()


def worker_count(executor: Executor) -> int:
    """How many tasks an executor runs at a time, as far as it says."""
    client: Any = getattr(executor, "_client", None)
    if client is not None and hasattr(client, "nthreads"):
        return max(1, sum(int(threads) for threads in client.nthreads().values()))
    return int(getattr(executor, "_max_workers", None) or os.cpu_count() or 1)


def shares_memory(executor: Executor) -> bool:
    """Whether tasks run in this process."""
    return isinstance(executor, ThreadPoolExecutor)


def gather(
    executor: Executor,
    function: Callable[[Any], Any],
    tasks: Sequence[Any],
    cancel: Callable[[], bool] | None = None,
) -> Iterator[tuple[int, Any]]:
    """(number of a task, its result) as they come; a task whose worker is lost is begun again.

    Once ``cancel`` is true no more results come.

    Raises
    ------
    RayMapError
        What a task raised, or that the executor failed.
    """
    pending = {executor.submit(function, task): (number, 1) for number, task in enumerate(tasks)}
    try:
        while pending:
            if cancel is not None and cancel():
                return
            finished, _ = wait(pending, timeout=0.25, return_when=FIRST_COMPLETED)
            for future in finished:
                if cancel is not None and cancel():
                    return
                number, tries = pending.pop(future)
                try:
                    result = future.result()
                except RayMapError:
                    raise
                except Exception as error:  # every kind of executor loses workers in its own way
                    if tries >= TRIES or isinstance(error, BrokenExecutor):
                        raise _failed(error) from None
                    pending[executor.submit(function, tasks[number])] = number, tries + 1
                    continue
                yield number, result
    finally:
        for future in pending:
            future.cancel()


def _failed(error: BaseException) -> RayMapError:
    line = " ".join(str(error).split()) or "no reason given"
    return RayMapError(
        f"the executor failed ({type(error).__name__}: {line[:300]}); see that its workers have "
        "Raymap and memory enough"
    )

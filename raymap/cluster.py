"""Executors of many machines: a Dask scheduler by its address, and how many workers there are."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

from raymap.errors import MissingExtra, RayMapError

__all__ = ["scheduler_executor", "shares_memory", "worker_count"]

CONNECT_SECONDS = 15


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

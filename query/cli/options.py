"""What the commands of this package share: options, workers, criteria, progress."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = [
    "Criterion",
    "Filter",
    "Scheduler",
    "Threads",
    "progress_line",
    "read_criterion",
    "workers",
]

Criterion = Annotated[
    str | None,
    typer.Argument(
        help="Which rays; all of them if there is no criterion. raymap kinds atoms lists the words."
    ),
]
Threads = Annotated[
    int | None, typer.Option(min=1, help="Worker threads; by default one per core.")
]
Scheduler = Annotated[
    str | None,
    typer.Option(help="Search shards on the workers of the Dask scheduler at this address."),
]
Filter = Annotated[
    bool, typer.Option("--filter-string", help="The criterion is a filter string: H3 & !R4.")
]


def workers(scheduler: str | None) -> AbstractContextManager[Any]:
    """The executor of a scheduler; none where no address is given."""
    if scheduler is None:
        return nullcontext()
    from raymap.remote.cluster import scheduler_executor

    return scheduler_executor(scheduler)


def read_criterion(text: str | None, map: RayMap, is_filter: bool) -> Any:
    """The criterion of a command line; a filter string is translated with the map's names."""
    if text is None or not is_filter:
        return text
    from query.answers.filter_strings import translate

    return translate(text, map)


def progress_line(json: bool) -> Any:
    """A progress line on stderr for searches that take longer than a moment."""
    import sys
    import time

    from raymap.cli.terminal import live_line

    if json or not sys.stderr.isatty():
        return None
    state = {"start": time.monotonic(), "last": 0.0}

    def show(progress: Any) -> None:
        now = time.monotonic()
        if now - state["start"] < 0.5 or now - state["last"] < 0.1:
            return
        state["last"] = now
        done = progress.portions_done == progress.portions
        text = f"{progress.fraction:4.0%}  {progress.matched:,} rays"
        live_line("" if done else text)

    return show

"""What the commands of this package share: options, opening a map, progress."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Annotated, Any

import typer

__all__ = [
    "Criterion",
    "Filter",
    "Json",
    "MapPath",
    "Opened",
    "Scheduler",
    "Strict",
    "Threads",
    "progress_line",
    "read_criterion",
    "workers",
]

MapPath = Annotated[Path, typer.Argument(help="A ray map, or a folder of them.")]
Criterion = Annotated[str | None, typer.Argument(help="Which rays; all without it.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON and nothing else.")]
Strict = Annotated[bool, typer.Option("--strict", help="Fail at damage instead of skipping it.")]
Threads = Annotated[int | None, typer.Option(min=1, help="Default: the cores there are.")]
Scheduler = Annotated[
    str | None,
    typer.Option(help="Search shards on the workers of the Dask scheduler at this address."),
]
Filter = Annotated[
    bool, typer.Option("--filter-string", help="The criterion is a filter string: H3 & !R4.")
]


class Opened:
    """A map for one command: damage is skipped with a warning unless strict."""

    def __init__(self, path: Path, strict: bool) -> None:
        from raymap.cli import open_map

        self.map = open_map(path, strict)
        self._known = len(self.map.damage)

    def __enter__(self) -> Any:
        return self.map

    def __exit__(self, *error: object) -> None:
        from raymap.cli import warn_of_damage

        # Damage that was met on the way, too, is said on stderr.
        warn_of_damage(self.map, self._known)
        self.map.close()


def workers(scheduler: str | None) -> AbstractContextManager[Any]:
    """The executor of a scheduler; none where no address is given."""
    if scheduler is None:
        return nullcontext()
    from raymap.cluster import scheduler_executor

    return scheduler_executor(scheduler)


def read_criterion(text: str | None, map: Any, is_filter: bool) -> Any:
    if text is None or not is_filter:
        return text
    from query.filter_strings import translate

    return translate(text, map)


def progress_line(json: bool) -> Any:
    """A progress line on stderr for searches that take longer than a moment."""
    import sys
    import time

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
        sys.stderr.write(f"\r\x1b[K{'' if done else text}")
        sys.stderr.flush()

    return show

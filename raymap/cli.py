"""The command ``raymap``: gathers the packages' sub-commands; info, verify, repair, export.

Here are also the options that commands of all packages share, and how they open maps.
"""

from __future__ import annotations

import atexit
import contextlib
import enum
import errno
import gc
import json
import os
import re
import sys
import warnings
from collections.abc import Iterator
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from typer.core import TyperCommand

from raymap.errors import CriterionError, DamagedPortion, DamageWarning, RayMapError
from raymap.plaintext import plain_text
from raymap.rooms import check_room

if TYPE_CHECKING:
    from raymap.reader import RayMap

__all__ = [
    "Force",
    "Json",
    "MapPath",
    "Panel",
    "Strict",
    "application",
    "emit_json",
    "main",
    "opened_map",
    "register",
    "warnings_on_stderr",
]


class Panel(enum.StrEnum):
    """Parts of the list of commands, in the order in which they are shown."""

    RECORD = "Record"
    ASK = "Ask a map"
    PICTURES = "Pictures"
    FILES = "Files and other programs"
    STUDIES = "Studies"


MapPath = Annotated[Path, typer.Argument(help="A ray map, or a folder of them.")]
Force = Annotated[bool, typer.Option("--force", help="Replace an existing file.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON and nothing else.")]
Strict = Annotated[bool, typer.Option("--strict", help="Fail at damage instead of skipping it.")]


def emit_json(value: Any) -> None:
    """Print a value as JSON, and nothing else, on stdout."""
    json.dump(value, sys.stdout, ensure_ascii=False, default=_plain)
    sys.stdout.write("\n")


def _plain(value: Any) -> Any:
    """NumPy numbers and arrays, paths and sets as JSON has them."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, set | frozenset):
        return sorted(value)
    return str(value)


@contextlib.contextmanager
def opened_map(path: Path, strict: bool = False) -> Iterator[RayMap]:
    """A map, or a folder of maps, for one command.

    Unless ``strict``, damage is skipped; it is reported on stderr, at once where it is found at
    opening, else at the end.
    """
    from raymap.opening import open

    if strict:
        # The error says it
        warnings.simplefilter("ignore", DamageWarning)
    with open(path, on_damage="raise" if strict else "skip") as ray_map:
        if strict:
            _refuse_damage(ray_map)
            yield ray_map
            _refuse_damage(ray_map)
            return
        known = len(ray_map.damage)
        _warn_of_damage(ray_map)
        try:
            yield ray_map
        finally:
            _warn_of_damage(ray_map, known)


@contextlib.contextmanager
def warnings_on_stderr() -> Iterator[list[str]]:
    """Print each different warning of the block once on stderr, when it ends normally.

    Yields the list that their texts are put into.
    """
    said: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield said
    said += dict.fromkeys(str(item.message) for item in caught)
    for text in said:
        typer.echo(f"warning: {plain_text(text)}", err=True)


def _refuse_damage(ray_map: RayMap) -> None:
    """Fail at damage that cost no rays, such as that of a footer."""
    for damage in ray_map.damage:
        raise DamagedPortion(
            f"{ray_map.path}: bytes {damage.offset}–{damage.offset + damage.length - 1}: "
            f"{damage.reason}"
        )


def _warn_of_damage(ray_map: RayMap, known: int = 0) -> None:
    """Report damage on stderr, from entry ``known`` of the map's list on."""
    for damage in ray_map.damage[known:]:
        what = "bytes" if damage.portion is None else f"portion {damage.portion}, bytes"
        typer.echo(
            f"warning: {ray_map.path}: {what} {damage.offset}–{damage.offset + damage.length - 1} "
            f"cannot be read ({damage.reason})",
            err=True,
        )


def register(app: typer.Typer) -> None:
    """Hang the commands of this package on the application."""
    from raymap.foreign.cli import import_
    from raymap.rayfiles.cli import check_rays

    app.command("import", rich_help_panel=Panel.FILES)(import_)
    app.command("info", rich_help_panel=Panel.FILES)(info)
    app.command("verify", rich_help_panel=Panel.FILES)(verify)
    app.command("repair", rich_help_panel=Panel.FILES)(repair)
    app.command("export", rich_help_panel=Panel.FILES)(export)
    app.command("check-rays", rich_help_panel=Panel.FILES)(check_rays)


def info(
    map: MapPath,
    streams: Annotated[
        bool, typer.Option("--streams", help="Show what each stream costs.")
    ] = False,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Show what a map holds."""
    with opened_map(map, strict) as ray_map:
        summary = ray_map.describe()
        if streams:
            summary["streams"] = stream_costs(ray_map)
        if json:
            emit_json(summary)
            return
        _print_summary(summary)


def verify(
    map: MapPath,
    json: Json = False,
) -> None:
    """Read a whole map and check every byte; exit 1 if anything is damaged."""
    from raymap.opening import open
    from raymap.verify import verify as check

    with open(map, on_damage="skip") as ray_map:
        result = check(ray_map)
    if json:
        emit_json(result.as_json())
    else:
        _print_verification(map, result.as_json())
    if result.damage:
        raise typer.Exit(1)


def repair(
    map: Annotated[Path, typer.Argument(help="A damaged or unfinished ray map.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The new map.")],
    force: Force = False,
) -> None:
    """Write the sound portions of a damaged map as a new, finished map."""
    from raymap.repair import repair as write
    from raymap.shards import ShardedMap

    with opened_map(map) as ray_map:
        if isinstance(ray_map, ShardedMap):
            raise RayMapError(f"{map} is a folder: repair its maps one by one")
        portions = write(ray_map, output, force=force)
    typer.echo(f"{output}: {portions} sound portions written")


def export(
    map: MapPath,
    output: Annotated[
        str,
        typer.Option(
            "--output",
            "-o",
            help="*.parquet, *.arrow, *.csv, or a folder (DIR/); an existing table is replaced.",
        ),
    ],
    rows: Annotated[
        Literal["segments", "rays"], typer.Option(help="One row per segment record, or per ray.")
    ] = "segments",
    form: Annotated[
        Literal["parquet", "arrow", "csv", "folder"] | None,
        typer.Option("--format", help="Format of the table, whatever the file's name."),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", hidden=True, help="Replace an existing map, too.")
    ] = False,
    strict: Strict = False,
) -> None:
    """Write a map as a table for DuckDB, Polars, pandas, Spark."""
    from raymap.arrow import export as write

    with opened_map(map, strict) as ray_map:
        n = write(
            ray_map,
            output,
            rows=rows,
            # A table can be made again; a map may be somebody's original
            force=force or Path(output).suffix.lower() != ".raymap",
            form=form,
        )
    typer.echo(f"{output}: {n} rows written")


def _print_verification(path: Path, result: dict[str, Any]) -> None:
    state = "finished" if result["finished"] else "unfinished"
    typer.echo(
        f"{path}: {result['good']} of {result['portions']} portions sound, "
        f"{result['rays_readable']} rays readable, {state}"
    )
    if result["torn_bytes"]:
        typer.echo(f"{result['torn_bytes']} bytes at the end belong to an incomplete portion")
    for damage in result["damaged"]:
        what = "bytes" if damage["portion"] is None else f"portion {damage['portion']}, bytes"
        end = damage["offset"] + damage["length"] - 1
        typer.echo(f"damaged: {what} {damage['offset']}–{end}: {damage['reason']}")


def stream_costs(ray_map: RayMap) -> list[dict[str, Any]]:
    """Stored bytes per stream name, largest first."""
    costs: dict[str, list[int]] = {}
    for portion in ray_map.portions:
        for entry in portion.stream_table():
            cost = costs.setdefault(entry.name, [0, 0])
            cost[0] += entry.stored_size
            cost[1] += entry.raw_size
    records = max(ray_map.records, 1)
    rows = [
        {"stream": name, "bytes": stored, "raw_bytes": raw, "bytes_per_record": stored / records}
        for name, (stored, raw) in costs.items()
    ]
    rest = ray_map.bytes - sum(stored for stored, _ in costs.values())
    rows.append(
        {
            "stream": "(headers, directory, footer)",
            "bytes": rest,
            "raw_bytes": rest,
            "bytes_per_record": rest / records,
        }
    )
    return sorted(rows, key=lambda row: -row["bytes"])


def _print_summary(summary: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console(soft_wrap=True, highlight=False)
    per_record = summary["bytes_per_record"]
    state = "finished" if summary["finished"] else "unfinished (still written, or interrupted)"
    console.print(
        f"{summary['rays']:,} rays, {summary['records']:,} records in {summary['portions']} "
        f"portions, {summary['bytes']:,} bytes"
        + (f" ({per_record:.2f} per record)" if per_record else "")
        + f", {state}"
    )
    if summary["without_rays"]:
        emitted = sum(summary["emitted"].values())
        console.print(f"recorded with --no-rays: what detectors counted of {emitted:,.0f} rays")
    for kind in ("sources", "objects", "faces", "detectors", "media"):
        names = summary[kind]
        shown = ", ".join(names[:12]) + (f", … ({len(names)})" if len(names) > 12 else "")
        console.print(f"{kind}: {shown or 'none'}", markup=False)
    for labels in summary["channels"]:
        console.print(f"channels: {', '.join(labels)}", markup=False)
    if "streams" in summary:
        table = Table("stream", "bytes", "raw", "bytes per record")
        for row in summary["streams"]:
            table.add_row(
                Text(plain_text(row["stream"])),
                f"{row['bytes']:,}",
                f"{row['raw_bytes']:,}",
                f"{row['bytes_per_record']:.4f}",
            )
        console.print(table)


def application(asked: str = "") -> typer.Typer:
    """The application with the sub-commands of all installed packages.

    Parameters
    ----------
    asked : name of a command; if there is such a one, the others are left out, because what the
        command line says of all of them takes a tenth of a second to find out
    """
    app = typer.Typer(
        name="raymap",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        help="Record every light path of a Monte Carlo trace; ask which of them matter.",
    )
    app.callback()(_group)
    for point in sorted(entry_points(group="raymap.commands"), key=lambda point: point.name):
        check_room(point.module.split(".")[0])
        try:
            point.load()(app)
        except ModuleNotFoundError as error:
            # A package that is not installed takes its commands with it, not the others
            if error.name not in (point.module, point.module.split(".")[0]):
                raise
    only = [command for command in app.registered_commands if command.name == asked]
    app.registered_commands = only or sorted(app.registered_commands, key=_place_in_list)
    for command in app.registered_commands:
        command.cls = _Command
    return app


def _place_in_list(command: Any) -> int:
    """Panels in their order; commands of other packages, which may have none, at the end."""
    panels: list[object] = list(Panel)
    own = command.rich_help_panel
    return panels.index(own) if own in panels else len(panels)


class _Command(TyperCommand):
    """A command whose help keeps what stands in square brackets, such as units."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        from rich.markup import escape

        for parameter in self.params:
            text = getattr(parameter, "help", None)
            if text:
                parameter.help = escape(text)  # type: ignore[attr-defined]
        super().format_help(ctx, formatter)


def _print_version(asked: bool) -> None:
    if asked:
        from raymap import __version__

        typer.echo(f"raymap {__version__}")
        raise typer.Exit


def _group(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Record every light path of a Monte Carlo trace; ask which of them matter."""


def _told(error: RayMapError) -> str:
    """The line on stderr; a short criterion stands in it, with carets below."""
    head = "error: "
    lines = [plain_text(line) for line in str(error).split("\n")]
    if not isinstance(error, CriterionError) or len(lines) != 3:
        return head + "\n".join(lines)
    message, shown, carets = lines[0], lines[1][2:].rstrip(), lines[2]
    if len(head) + len(shown) > 72:
        return head + "\n".join(lines)
    message = re.sub(r" \(column \d+\)$", "", message)
    return f"{head}{shown}: {message}\n{' ' * len(head)}{carets[2:]}"


def main() -> None:
    """Run the command line: 0 good, 1 a refused request, 2 usage, 130 after Ctrl-C."""
    # The process ends soon after: search no garbage among all that was imported and compiled
    atexit.register(gc.freeze)
    try:
        _run(application(*sys.argv[1:2]))
    except RayMapError as error:
        typer.echo(_told(error), err=True)
        raise SystemExit(1) from None
    except ImportError as error:
        from raymap.extras import missing_extra

        told = missing_extra(error)
        if told is None:
            raise
        typer.echo(_told(told), err=True)
        raise SystemExit(1) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    except BrokenPipeError:
        # The reader of our output went away (head, less): nothing is wrong
        raise SystemExit(_quiet_end()) from None
    except (MemoryError, RecursionError) as error:
        typer.echo(
            f"error: what is asked does not fit in memory ({type(error).__name__})", err=True
        )
        raise SystemExit(1) from None
    except OSError as error:
        # A full disk, a missing folder, no permission: the file's name and the system's reason
        place = f"{error.filename}: " if error.filename else ""
        typer.echo(f"error: {place}{error.strerror or error}", err=True)
        raise SystemExit(1) from None


def _run(app: typer.Typer) -> None:
    """Run a command; what it has printed is on its way when this ends."""
    try:
        app()
    except SystemExit as end:
        # Click says 1 for a broken pipe
        if isinstance(end.__context__, OSError) and end.__context__.errno == errno.EPIPE:
            raise BrokenPipeError from None
        sys.stdout.flush()
        raise


def _quiet_end() -> int:
    """Let nothing more be written on the way out; returns the exit status."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            os.dup2(nowhere, stream.fileno())
    return 0

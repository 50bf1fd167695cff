"""Commands for maps as files: info, verify, repair, export."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from raymap.cli.options import Force, Json, MapPath, Strict, emit_json, opened_map
from raymap.model.errors import RayMapError
from raymap.model.plaintext import plain_text

if TYPE_CHECKING:
    from raymap.file.reader import RayMap
    from raymap.model.directory import Directory

__all__ = ["export", "info", "repair", "stream_costs", "verify"]


def info(
    map: MapPath,
    streams: Annotated[
        bool, typer.Option("--streams", help="Show what each stream costs.")
    ] = False,
    scene: Annotated[
        bool, typer.Option("--scene", help="Print the scene's text, as it was recorded.")
    ] = False,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Show what a map holds."""
    with opened_map(map, strict) as ray_map:
        if scene:
            _print_scene(ray_map.directory, json)
            return
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
    from raymap.file.opening import open
    from raymap.file.verify import verify as check

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
    from raymap.file.mixed import MixedMap
    from raymap.file.repair import repair as write
    from raymap.file.shards import ShardedMap

    with opened_map(map) as ray_map:
        if isinstance(ray_map, ShardedMap):
            raise RayMapError(f"{map} is a folder: repair its maps one by one")
        if isinstance(ray_map, MixedMap):
            raise RayMapError(f"{map} is a mix: repair its maps one by one")
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
    from raymap.tables.arrow import export as write

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


def _print_scene(directory: Directory, json: bool) -> None:
    if json:
        emit_json(
            {
                "text": directory.scene_text,
                "parameters": directory.parameters,
                "inputs": [entry.model_dump() for entry in directory.inputs],
            }
        )
        return
    if not directory.scene_text:
        raise RayMapError("the map does not hold the text of its scene: it was recorded elsewhere")
    variants = directory.parameters.get("variants")
    if isinstance(variants, list | tuple) and variants:
        typer.echo(f"# recorded with --variant {', '.join(map(str, variants))}", err=True)
    for line in directory.scene_text.rstrip().splitlines():
        typer.echo("\t".join(map(plain_text, line.split("\t"))))


def _print_summary(summary: dict[str, Any]) -> None:
    from rich.table import Table
    from rich.text import Text

    from raymap.cli.terminal import console as make_console

    console = make_console(soft_wrap=True)
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
    for each in summary["inputs"]:
        console.print(f"read: {each['name']} ({each['bytes']:,} bytes)", markup=False)
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

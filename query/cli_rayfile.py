"""The command ``raymap rayfile``: selected rays at a place, as a ray file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, cast

import typer

from query.cli_options import (
    Criterion,
    Filter,
    Json,
    MapPath,
    Opened,
    Strict,
    Threads,
    progress_line,
    read_criterion,
)

__all__ = ["rayfile"]


def rayfile(
    map: MapPath,
    at: Annotated[str, typer.Argument(help="A face, an object or a detector: key.top")],
    criterion: Criterion = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help=".tm25ray, .sdf or .dat")
    ] = None,
    leaving: Annotated[
        bool, typer.Option("--leaving", help="Rays as they leave it, not as they arrive.")
    ] = False,
    meetings: Annotated[
        str, typer.Option(help="all, or only the first or last one of each ray.")
    ] = "all",
    before: Annotated[
        float, typer.Option(min=0, help="Start so far before the surface [unit of the map].")
    ] = 0.0,
    color: Annotated[
        str, typer.Option(help="auto, wavelength (one per ray), xyz (tristimulus) or none.")
    ] = "auto",
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    filter_string: Filter = False,
    threads: Threads = None,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Write the light that reaches a face or detector as a ray file: a source elsewhere."""
    from query.rays_at import Coloring, Meetings, write_ray_file
    from query.selector import select
    from raymap.cli import emit_json

    if output is None:
        raise typer.BadParameter("give the file to write: -o light.tm25ray")
    if meetings not in ("all", "first", "last"):
        raise typer.BadParameter("--meetings is all, first or last")
    if color not in ("auto", "wavelength", "xyz", "none"):
        raise typer.BadParameter("--color is auto, wavelength, xyz or none")
    with Opened(map, strict) as ray_map:
        asked = read_criterion(criterion, ray_map, filter_string)
        selection = select(ray_map, asked, threads=threads, progress=progress_line(json))
        written = write_ray_file(
            selection,
            output,
            at,
            force=force,
            color=cast(Coloring, color),
            leaving=leaving,
            meetings=cast(Meetings, meetings),
            before=before,
        )
        if json:
            emit_json({"output": str(output)} | written)
            return
        typer.echo(
            f"wrote {output}: {written['rays']:,} rays, {written['flux']:.6g} "
            f"{written['flux_unit']} at {at}"
        )

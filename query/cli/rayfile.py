"""The command ``raymap rayfile``: selected rays at a place, as a ray file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from query.cli.options import (
    Criterion,
    Filter,
    Threads,
    progress_line,
    read_criterion,
)
from raymap.cli.options import Force, Json, MapPath, Strict, emit_json, opened_map

__all__ = ["rayfile"]


def rayfile(
    map: MapPath,
    at: Annotated[str, typer.Argument(help="A face (key.top), an object or a detector.")],
    output: Annotated[Path, typer.Option("-o", "--output", help=".tm25ray, .sdf or .dat file.")],
    criterion: Criterion = None,
    leaving: Annotated[
        bool, typer.Option("--leaving", help="Rays as they leave the place, not as they arrive.")
    ] = False,
    crossings: Annotated[
        Literal["all", "first", "last"],
        typer.Option(
            "--crossings", "--meetings", help="Which crossings of the place by a ray count."
        ),
    ] = "all",
    before: Annotated[
        float,
        typer.Option(min=0, help="Start this far before the surface [length unit of the map]."),
    ] = 0.0,
    color: Annotated[
        Literal["auto", "wavelength", "xyz", "none"],
        typer.Option(help="One wavelength per ray, tristimulus values, or none."),
    ] = "auto",
    force: Force = False,
    filter_string: Filter = False,
    threads: Threads = None,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Write the light that reaches a face or detector as a ray file, to be a source elsewhere."""
    from query.answers.reports.rays_at_place import write_ray_file
    from query.answers.selections.selector import select
    from query.engine.places import seen_by

    with opened_map(map, strict) as ray_map:
        asked = read_criterion(criterion, ray_map, filter_string)
        selection = select(
            seen_by(ray_map, at), asked, threads=threads, progress=progress_line(json)
        )
        written = write_ray_file(
            selection,
            output,
            at,
            force=force,
            color=color,
            leaving=leaving,
            crossings=crossings,
            before=before,
        )
        if json:
            emit_json({"output": str(output)} | written)
            return
        typer.echo(
            f"wrote {output}: {written['rays']:,} rays, {written['flux']:.6g} "
            f"{written['flux_unit']} at {at}"
        )

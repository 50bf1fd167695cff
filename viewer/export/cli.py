"""The command ``raymap export-3d``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from raymap.cli.options import Force, Json, MapPath, Strict, emit_json, opened_map

__all__ = ["export_3d"]


def export_3d(
    map: MapPath,
    output: Annotated[
        Path, typer.Option("--output", "-o", help=".glb, .gltf, .vtp, .dxf or .step file.")
    ],
    criterion: Annotated[
        str | None, typer.Argument(help="Which rays; all of them if there is no criterion.")
    ] = None,
    rays: Annotated[int, typer.Option(min=1, help="Write at most this many rays.")] = 500,
    color: Annotated[
        str,
        typer.Option(
            help="natural, path, source, reflections, ending, flux, wavelength or optical_length."
        ),
    ] = "path",
    group: Annotated[
        Literal["source", "path", "none"], typer.Option(help="What makes a layer or part of rays.")
    ] = "source",
    tail: Annotated[
        float | None, typer.Option(min=0, help="Cut rays that leave the scene to this length.")
    ] = None,
    scene: Annotated[bool, typer.Option(help="Write the bodies and detectors, too.")] = True,
    force: Force = False,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Write rays and scene for CAD and 3D programs: glTF, VTK, DXF, STEP."""
    from viewer.export.files import export_3d as write

    with opened_map(map, strict) as ray_map:
        written = write(
            ray_map,
            output,
            criterion,
            rays=rays,
            color=color,
            group=group,
            tail=tail,
            scene=scene,
            force=force,
        )
    if json:
        emit_json({"output": str(output)} | written)
        return
    left_out = written["selected"] - written["rays"]
    many = f"{written['rays']:,} of {written['selected']:,}" if left_out else f"{written['rays']:,}"
    typer.echo(
        f"wrote {output}: {many} rays ({written['segments']:,} segments) in "
        f"{len(written['groups'])} group{'s' * (len(written['groups']) != 1)}, "
        f"{len(written['objects'])} bodies"
    )
    if left_out:
        typer.echo(f"{left_out:,} rays are left out; --rays N writes more")

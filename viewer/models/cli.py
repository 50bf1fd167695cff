"""The command ``raymap export-3d``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["export_3d"]


def export_3d(
    map: Annotated[Path, typer.Argument(help="A ray map, or a folder of them.")],
    criterion: Annotated[str | None, typer.Argument(help="Which rays; all if left out.")] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help=".glb, .gltf, .vtp, .dxf or .step"),
    ] = None,
    rays: Annotated[int, typer.Option(min=1, help="Write at most so many rays.")] = 500,
    color: Annotated[
        str, typer.Option(help="path, natural, source, reflections, ending, flux, wavelength …")
    ] = "path",
    group: Annotated[
        str, typer.Option(help="Layers or parts of rays: by source, by path, or none.")
    ] = "source",
    tail: Annotated[
        float | None, typer.Option(min=0, help="Cut rays that leave the scene to this length.")
    ] = None,
    scene: Annotated[bool, typer.Option(help="Write the bodies and detectors, too.")] = True,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print JSON and nothing else.")] = False,
    strict: Annotated[
        bool, typer.Option("--strict", help="Fail at damage instead of skipping it.")
    ] = False,
) -> None:
    """Write rays and scene for CAD and 3D programs: glTF, VTK, DXF, STEP."""
    from raymap.cli import emit_json, open_map, warn_of_damage
    from viewer.models.files import export_3d as write

    if output is None:
        raise typer.BadParameter("give the file to write: -o rays.glb")
    with open_map(map, strict) as ray_map:
        known = len(ray_map.damage)
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
        warn_of_damage(ray_map, known)
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

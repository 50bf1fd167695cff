"""``raymap mix``: maps of one scene with other sources, as one map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from raymap.cli.options import Json, emit_json

__all__ = ["mix"]


def mix(
    maps: Annotated[
        list[str],
        typer.Argument(metavar="MAP[:FACTOR]...", help="Maps, and by what their light counts."),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="The mix, a .raymix file.")],
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    json: Json = False,
) -> None:
    """Mix maps of one scene that differ in their sources: a file that every command takes."""
    from raymap.file.mixed import opened_mix, write_mix

    write_mix(output, [_with_factor(text) for text in maps], force=force)
    with opened_mix(output, "skip") as mixed:
        unit = mixed.directory.flux_unit
        flux = {source.name: source.flux for source in mixed.directory.sources}
        rows = [
            {
                "map": str(map.path),
                "factor": factor,
                "sources": {name: flux[name] for name in names},
            }
            for map, factor, names in mixed.parts
        ]
        shared = mixed.shared_seeds
        told = {"rays": mixed.rays, "flux_unit": unit, "maps": rows, "shared_seeds": shared}
    if json:
        emit_json(told)
        return
    from raymap.cli.terminal import console as make_console

    console = make_console(soft_wrap=True)
    for map, factor, names in mixed.parts:
        said = ", ".join(f"{name} {flux[name]:.6g} {unit}" for name in names)
        console.print(f"{factor:g} x {map.path}: {said}", markup=False)
    if shared:
        console.print(
            f"seed {', '.join(str(seed) for seed in shared)}: maps share their random numbers, and "
            "errors are those of maps that do not; record them with other seeds"
        )


def _with_factor(text: str) -> tuple[str, float]:
    place, colon, factor = text.rpartition(":")
    if colon and place:
        try:
            return place, float(factor)
        except ValueError:
            pass
    return text, 1.0

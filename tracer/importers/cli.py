"""The command of this package: faces."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from raymap.cli.options import Json, Panel, emit_json, warnings_on_stderr

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Hang the command on the application."""
    app.command("faces", rich_help_panel=Panel.RECORD)(faces)


def faces(
    file: Annotated[
        Path,
        typer.Argument(
            help="CAD, mesh or lens file (raymap kinds), or a scene (TOML).", show_default=False
        ),
    ],
    json: Json = False,
) -> None:
    """List the bodies and faces of a file, with kind and area, so that they can be named."""
    from tracer.importers.face_list import list_faces

    with warnings_on_stderr():
        listed = list_faces(file)
    if json:
        emit_json(listed)
    else:
        _print(listed)


def _print(listed: dict[str, Any]) -> None:
    from rich.table import Table

    from raymap.cli.terminal import console as make_console

    unit = f"{listed['length_unit']}²" if listed["length_unit"] else "file unit²"
    table = Table("body", "face", "kind", f"area [{unit}]", "notes")
    for body in listed["bodies"]:
        for face in body["faces"]:
            notes = [face.get("color") or body.get("color") or ""]
            if face.get("triangles"):
                notes.append(f"{face['triangles']:,} triangles")
            if face.get("same_as"):
                notes.append(f"same as {face['same_as']}")
            table.add_row(
                body["name"],
                face["name"],
                face["kind"],
                f"{face['area']:.6g}",
                ", ".join(note for note in notes if note),
            )
    console = make_console(soft_wrap=True)
    console.print(table)
    count = sum(len(body["faces"]) for body in listed["bodies"])
    console.print(f"{len(listed['bodies'])} bodies, {count} faces")

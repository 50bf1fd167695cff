"""The command ``raymap doctor``: what this installation is, and what is wrong with it."""

from __future__ import annotations

from typing import Annotated

import typer

from raymap.cli.options import Json, emit_json

__all__ = ["doctor"]


def doctor(
    quick: Annotated[bool, typer.Option(help="Compile nothing.")] = False,
    json: Json = False,
) -> None:
    """Say what this installation is and what is wrong with it; status 1 if something is."""
    from raymap.examination import examine

    findings = examine(compiling=not quick)
    problems = [finding for finding in findings if finding.problem]
    if json:
        emit_json(
            {
                "well": not problems,
                "findings": [
                    {"part": item.part, "found": item.found}
                    | ({"problem": item.problem, "remedy": item.remedy} if item.problem else {})
                    for item in findings
                ],
            }
        )
    else:
        part = ""
        for item in findings:
            if item.part != part:
                part = item.part
                typer.echo(part)
            typer.echo(f"  {'! ' if item.problem else ''}{item.found}")
        typer.echo("")
        for item in problems:
            typer.echo(f"problem: {item.problem}\n remedy: {item.remedy}")
        typer.echo(f"{len(problems)} problem{'s' * (len(problems) != 1)} found")
    if problems:
        raise typer.Exit(1)

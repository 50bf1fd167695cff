"""The command ``raymap kinds``: what can be asked for, read and shown, and where it comes from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import typer

from raymap.cli.options import Json, emit_json
from raymap.model.errors import RayMapError
from raymap.model.parts import OURS
from raymap.model.registry import Entry
from raymap.rooms import registries

__all__ = ["kinds", "markdown_table"]


def kinds(
    sort: Annotated[
        str | None, typer.Argument(help="One sort of kinds; without it, all.", show_default=False)
    ] = None,
    markdown: Annotated[bool, typer.Option(help="Print tables in Markdown.")] = False,
    json: Json = False,
) -> None:
    """List the words of criteria, panels and file formats, with those of installed plug-ins."""
    known = registries()
    if sort is not None and sort not in known:
        raise RayMapError(f"no sort of kinds is called {sort!r}; there are {', '.join(known)}")
    chosen = {name: known[name].entries() for name in known if sort in (None, name)}
    if json:
        emit_json({name: [_facts(entry) for entry in found] for name, found in chosen.items()})
        return
    for name, entries in chosen.items():
        typer.echo(f"{'## ' if markdown else ''}{name}: {known[name].sort}")
        typer.echo(markdown_table(entries) if markdown else _plain_table(entries))
        typer.echo("")


def _facts(entry: Entry) -> dict[str, Any]:
    return {
        "word": entry.word,
        "spelling": entry.spelling,
        "title": entry.title,
        "origin": entry.origin,
        "distribution": entry.distribution or OURS,
    }


def _whose(entry: Entry) -> str:
    return "" if entry.distribution in ("", OURS) else entry.distribution


def markdown_table(entries: Sequence[Entry]) -> str:
    """The table of pages: how a kind is written, and what it is."""
    rows = ["| written | what it is |", "|---|---|"]
    for entry in entries:
        note = f" ({_whose(entry)})" if _whose(entry) else ""
        # As docstrings write code, and what ends a cell
        title = entry.title.replace("``", "`").replace("|", "\\|")
        rows.append(f"| `{entry.spelling}` | {title}{note} |")
    return "\n".join(rows)


def _plain_table(entries: Sequence[Entry]) -> str:
    width = max((len(entry.spelling) for entry in entries), default=0)
    lines = []
    for entry in entries:
        note = f"   [{_whose(entry)}]" if _whose(entry) else ""
        lines.append(f"  {entry.spelling:<{width}}  {entry.title}{note}")
    return "\n".join(lines)

"""The command ``raymap kinds``: what can be asked for, read and shown, and where it comes from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import typer

from raymap.cli.options import Json, emit_json
from raymap.model.errors import RayMapError

__all__ = ["kinds", "markdown_table"]


def kinds(
    sort: Annotated[
        str | None, typer.Argument(help="One sort of kinds; without it, all.", show_default=False)
    ] = None,
    markdown: Annotated[bool, typer.Option(help="Print tables in Markdown.")] = False,
    json: Json = False,
) -> None:
    """List the words of criteria, panels and file formats, with those of installed plug-ins."""
    from raymap.registry import registries

    known = registries()
    if sort is not None and sort not in known:
        raise RayMapError(f"no sort of kinds is called {sort!r}; there are {', '.join(known)}")
    chosen = {name: known[name].entries for name in known if sort in (None, name)}
    if json:
        emit_json({name: [_facts(entry) for entry in found] for name, found in chosen.items()})
        return
    for name, entries in chosen.items():
        typer.echo(f"{'## ' if markdown else ''}{name}: {known[name].sort}")
        typer.echo(markdown_table(entries) if markdown else _plain_table(entries))
        typer.echo("")


def _facts(entry: Any) -> dict[str, Any]:
    kind = entry.kind
    spelled = getattr(kind, "spelling", None)
    return {
        "word": kind.word,
        "spelling": kind.word if spelled is None else spelled(),
        "title": kind.title,
        "origin": entry.origin,
        "distribution": entry.distribution or "raymap",
    }


def markdown_table(entries: Sequence[Any]) -> str:
    """The table of pages: how a kind is written, and what it is."""
    rows = ["| written | what it is |", "|---|---|"]
    for facts in map(_facts, entries):
        own = facts["distribution"] == "raymap"
        note = "" if own else f" ({facts['distribution']})"
        rows.append(f"| `{facts['spelling']}` | {facts['title']}{note} |")
    return "\n".join(rows)


def _plain_table(entries: Sequence[Any]) -> str:
    rows = [_facts(entry) for entry in entries]
    width = max((len(row["spelling"]) for row in rows), default=0)
    lines = []
    for row in rows:
        note = "" if row["distribution"] == "raymap" else f"   [{row['distribution']}]"
        lines.append(f"  {row['spelling']:<{width}}  {row['title']}{note}")
    return "\n".join(lines)

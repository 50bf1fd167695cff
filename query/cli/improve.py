"""``raymap improve``: which few faces to coat."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from query.cli.options import Filter, Threads, read_criterion
from raymap.cli.options import Json, MapPath, Strict, emit_json, opened_map
from raymap.model.doubt import FOOTNOTE, MARK, with_error

if TYPE_CHECKING:
    from query.answers.what_if.improve import Improvement

__all__ = ["improve"]


def improve(
    map: MapPath,
    criterion: Annotated[str, typer.Argument(help="The light that should become less.")],
    reflectance: Annotated[
        str, typer.Option(help="What a coated face reflects at all angles: 0.2%.")
    ],
    faces: Annotated[int, typer.Option(min=1, help="Coat at most so many.")] = 3,
    keep: Annotated[
        str | None,
        typer.Option(
            help="Light that should stay: then the light over this one becomes least.",
        ),
    ] = None,
    of: Annotated[
        list[str] | None,
        typer.Option(help="Faces, objects or surfaces to choose among: L5, L*.front; repeatable."),
    ] = None,
    more: Annotated[bool, typer.Option("--more", help="The light should become most.")] = False,
    filter_string: Filter = False,
    threads: Threads = None,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Find the few faces whose coating takes most of some light, without tracing."""
    from query.answers.what_if.changes import parse_share
    from query.answers.what_if.improve import improve as best_of

    share = parse_share(reflectance, "--reflectance")
    with opened_map(map, strict) as ray_map:
        wanted: Any = read_criterion(criterion, ray_map, filter_string)
        kept: Any = read_criterion(keep, ray_map, filter_string)
        found = best_of(
            ray_map, wanted, reflectance=share, faces=faces, keep=kept, of=of or (), more=more,
            threads=threads,
        )  # fmt: skip
    if json:
        emit_json(found.to_json())
        return
    _print(found)


def _print(found: Improvement) -> None:
    from rich.table import Table
    from rich.text import Text

    from raymap.cli.terminal import console as make_console

    console = make_console(soft_wrap=True)
    unit = found.flux_unit
    how = "all" if found.exhaustive else "added and exchanged one by one,"
    console.print(
        f"{len(found.candidates)} faces; {how} {found.tried:,} combinations weighed by "
        f"{found.chosen_by:,} rays, judged by {found.judged_by:,} others"
    )
    table = Table("coat", f"before [{unit}]", f"after [{unit}]", "difference")
    kept = found.rows[0].keep is not None
    if kept:
        table.add_column("of what stays")
    shown = []
    for row in found.rows:
        cells = [
            _told(row.before, row.before_se),
            _told(row.after, row.after_se),
            _told(row.difference, row.difference_se),
        ]
        if row.keep is not None:
            cells.append(_told(row.keep[4], row.keep[5]))
        shown += cells
        table.add_row(Text(" ".join(row.faces)), *cells)
    console.print(table)
    console.print(
        "these are estimates of rays that did not choose; to confirm, give these faces such a "
        "coating in the scene and record it, or look closer:"
    )
    settings = " ".join(f"--set '{text}'" for text in found.settings)
    console.print(f"  raymap what-if MAP CRITERION {settings}", markup=False)
    if any(text.endswith(MARK) for text in shown):
        console.print(FOOTNOTE)


def _told(value: float, se: float) -> str:
    """With its error, unless it is 0 for certain."""
    return with_error(value, se) if value or se else "0"

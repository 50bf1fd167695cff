"""``raymap sensitivity``: which coatings, paints and glasses matter for some light."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from query.cli.options import Criterion, Filter, Threads, read_criterion
from raymap.cli.options import Json, MapPath, Strict, emit_json, opened_map
from raymap.model.doubt import FOOTNOTE, MARK, with_error

if TYPE_CHECKING:
    from query.answers.what_if.sensitivity import Sensitivity

__all__ = ["sensitivity"]


def sensitivity(
    map: MapPath,
    criterion: Criterion = None,
    by: Annotated[
        Literal["face", "object", "surface"],
        typer.Option(help="Whose reflectances change together."),
    ] = "face",
    top: Annotated[int, typer.Option(min=1, help="Rows to show.")] = 20,
    filter_string: Filter = False,
    threads: Threads = None,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Rank faces and media by how much their reflectance or absorption changes the flux."""
    from query.answers.what_if.sensitivity import sensitivity as derivatives

    with opened_map(map, strict) as ray_map:
        wanted: Any = read_criterion(criterion, ray_map, filter_string)
        found = derivatives(ray_map, wanted, by=by, threads=threads)
    if json:
        emit_json(found.to_json())
        return
    _print(found, top)


def _print(found: Sensitivity, top: int) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console(soft_wrap=True, highlight=False)
    unit = found.flux_unit
    if not found.rays:
        bound = found.flux.bound_95 or 0.0
        console.print(
            f"no ray does what is asked, so that its flux is below {bound:.3g} {unit} (95 %)"
        )
        return
    flux = with_error(found.flux.flux, found.flux.se, f" {unit}")
    console.print(f"flux {flux} of {found.rays:,} rays")
    table = Table("of", "what", "mean R", f"per 100 % more [{unit}]", "per 1 % more")
    shown = [flux]
    for row in found.rows[:top]:
        derivative = with_error(row.derivative, row.derivative_se) if row.rays else ""
        if row.from_zero is not None and not row.derivative:
            low, high = row.from_zero
            derivative = f"R = 0: {low:.3g} to {high:.3g} per unit of R"
        shown.append(derivative)
        table.add_row(
            Text(row.name),
            row.what,
            "" if row.mean is None else f"{row.mean:.3%}",
            derivative,
            "" if row.share is None or not row.derivative else f"{row.share:+.3f} %",
        )
    console.print(table)
    if len(found.rows) > top:
        console.print(f"{len(found.rows) - top:,} more; --top shows them")
    for name, why in found.unknown[:top]:
        console.print(f"{name}: {why}", markup=False)
    if any(text.endswith(MARK) for text in shown):
        console.print(FOOTNOTE)

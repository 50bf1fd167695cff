"""``raymap focus``: spot size along the axis of a plane, and the best focus."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from query.cli.options import Criterion, Filter, Threads, read_criterion
from raymap.cli.options import Json, MapPath, Strict, emit_json, opened_map
from raymap.model.doubt import FOOTNOTE, MARK, with_error

if TYPE_CHECKING:
    from query.answers.images.focus import Focus, FocusRow

__all__ = ["focus"]


def focus(
    map: MapPath,
    detector: Annotated[
        str, typer.Argument(help="A plane: a detector, or 'plane(z=120, size=[36, 24])'.")
    ],
    criterion: Criterion = None,
    low: Annotated[
        float | None, typer.Option("--from", help="First distance from the plane.")
    ] = None,
    high: Annotated[float | None, typer.Option("--to", help="Last distance.")] = None,
    steps: Annotated[int, typer.Option(min=2, max=10_000, help="Distances in all.")] = 21,
    filter_string: Filter = False,
    threads: Threads = None,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Find the best focus: rms and encircled radii along the axis of a plane."""
    import numpy as np

    from query.answers.images.focus import focus as focus_of
    from raymap.model.errors import RayMapError

    if (low is None) != (high is None):
        raise RayMapError("give both --from and --to, or neither")
    distances = None if low is None or high is None else np.linspace(low, high, steps).tolist()
    with opened_map(map, strict) as ray_map:
        wanted: Any = read_criterion(criterion, ray_map, filter_string)
        found = focus_of(ray_map, detector, wanted, distances=distances, threads=threads)
    if json:
        emit_json(found.to_json())
        return
    _print(found)


def _print(found: Focus) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console(soft_wrap=True, highlight=False)
    unit = found.length_unit
    console.print(f"{found.rays:,} registrations, followed along straight lines")
    if found.best is None:
        console.print("the light is parallel: it has no focus")
    else:
        best = found.best
        # Where the plane lies is no measure of what a distance from it is known to
        sure = f"standard error {found.best_se:.2g} {unit}"
        console.print(f"best focus {best.distance:.6g} {unit} from the plane ({sure})")
        console.print(f"rms radius there {with_error(best.rms, best.rms_se, f' {unit}')}")
    shares = list(found.rows[0].radius) if found.rows else []
    heads = [f"distance [{unit}]", "rms radius", *(f"holds {float(s):.0%}" for s in shares)]
    table = Table(*heads)
    cells = [_cells(row) for row in found.rows]
    for row in cells:
        table.add_row(*row)
    console.print(table)
    if any(cell.endswith(MARK) for row in cells for cell in row):
        console.print(FOOTNOTE)


def _cells(row: FocusRow) -> list[str]:
    radii = [with_error(row.radius[name], row.radius_se[name]) for name in row.radius]
    return [f"{row.distance:.5g}", with_error(row.rms, row.rms_se), *radii]

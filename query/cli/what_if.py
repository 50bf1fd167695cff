"""``raymap what-if``: changes to a recorded map, answered without tracing."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from query.cli.options import Criterion, Filter, Threads, read_criterion
from raymap.cli.options import Json, MapPath, Strict, emit_json, opened_map
from raymap.model.doubt import FOOTNOTE, MARK, marked, with_error

if TYPE_CHECKING:
    from query.answers.what_if.effect import Effect

__all__ = ["what_if"]


def what_if(
    map: MapPath,
    criterion: Criterion = None,
    set: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="A change: L5.back.reflectance=0.5%, seat*.black=true, lamp.flux=2; repeatable.",
        ),
    ] = None,
    scene: Annotated[
        Path | None,
        typer.Option("--scene", help="Take the changes from a scene of the same geometry."),
    ] = None,
    stop: Annotated[
        list[str] | None,
        typer.Option(
            "--stop",
            help="An ideal absorber put in: ring(z=30, inner=12, outer=32), rectangle(z=30, "
            "size=[20, 10]), mesh(baffle.stl); repeatable.",
        ),
    ] = None,
    keep: Annotated[
        list[str] | None,
        typer.Option("--keep", help="Light that the changes should not cost; repeatable."),
    ] = None,
    top: Annotated[
        int, typer.Option(min=0, help="Rows of the table of paths that changed most.")
    ] = 10,
    filter_string: Filter = False,
    threads: Threads = None,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Ask what other coatings, surfaces, media, sources or stops would change, without tracing."""
    from query.answers.what_if.changes import parse_setting
    from query.answers.what_if.effect import changed_paths, effect
    from query.answers.what_if.effect import what_if as revise
    from raymap.cli.terminal import console as make_console
    from raymap.model.errors import RayMapError

    if (set and scene is not None) or not (set or stop or scene is not None):
        raise RayMapError(
            "say what is changed: --set NAME.WHAT=VALUE, as --set L5.back.reflectance=0.5%, or "
            "--scene FILE; or what is put in: --stop 'ring(z=30, inner=12, outer=32)'"
        )
    changes = dict(parse_setting(each) for each in set or ())
    with opened_map(map, strict) as ray_map:
        wanted: Any = read_criterion(criterion, ray_map, filter_string)
        view = revise(ray_map, changes or None, scene=scene, stops=stop or ())
        found = effect(ray_map, view, wanted, threads=threads)
        costs = [
            effect(ray_map, view, read_criterion(text, ray_map, filter_string), threads=threads)
            for text in keep or ()
        ]
        rows = changed_paths(ray_map, view, wanted, top, threads=threads) if top else []
        unit = ray_map.directory.flux_unit
    if json:
        told = {"scene": str(scene)} if scene is not None else changes
        kept = [
            {"criterion": text, **cost.to_json()}
            for text, cost in zip(keep or (), costs, strict=True)
        ]
        emit_json(
            {**found.to_json(), "changes": told, "stops": stop or [], "keep": kept, "paths": rows}
        )
        return
    _print(found, rows, unit)
    _print_costs(list(zip(keep or (), costs, strict=True)), unit)
    if stop:
        make_console(soft_wrap=True).print(
            "stops absorb all light that meets them: what they would scatter is not in this answer"
        )


def _print_costs(costs: list[tuple[str, Effect]], unit: str) -> None:
    """What the changes do to light that is to stay."""
    from raymap.cli.terminal import console as make_console

    console = make_console(soft_wrap=True)
    shown = []
    for text, cost in costs:
        before = with_error(cost.before.flux, cost.before.se, f" {unit}")
        difference = f"0 {unit}"
        if cost.difference or cost.difference_se:
            difference = with_error(cost.difference, cost.difference_se, f" {unit}")
        shown += [before, difference]
        share = f" ({cost.difference / cost.before.flux:+.3%})" if cost.before.flux > 0.0 else ""
        console.print(f"keep {text}: {difference}{share} of {before}", markup=False)
    if any(text.endswith(MARK) for text in shown):
        console.print(FOOTNOTE)


def _print(found: Effect, rows: list[dict[str, Any]], unit: str) -> None:
    from rich.table import Table
    from rich.text import Text

    from query.answers.what_if.effect import FEWEST
    from raymap.cli.terminal import console as make_console

    console = make_console(soft_wrap=True)
    if not found.rays:
        bound = found.after.bound_95 or 0.0
        console.print(
            f"no ray does what is asked, so that its flux is below {bound:.3g} {unit} (95 %)"
        )
        return
    shown = {
        "before": with_error(found.before.flux, found.before.se, f" {unit}"),
        "after": with_error(found.after.flux, found.after.se, f" {unit}"),
    }
    if found.difference or found.difference_se:
        shown["difference"] = with_error(found.difference, found.difference_se, f" {unit}")
    for name, text in shown.items():
        console.print(f"{name}: {text}")
    if not found.difference and not found.difference_se:
        console.print("the changes do not reach this light")
    if found.ratio is not None:
        console.print(f"after / before: {found.ratio:.5g}")
    weak = f"; fewer than {FEWEST}, so that the error is not to be relied on" if found.weak else ""
    console.print(f"{found.rays:,} rays, as good as {found.effective:,.0f} of equal weight{weak}")
    for each in found.opened:
        console.print(
            f"never drawn: light {each.branch} at {each.face}; at most {each.flux:.3g} {unit} "
            "would go there, and is missing above",
            markup=False,
        )
    if found.impossible:
        console.print(f"{found.impossible:,} events were taken at the nearest possible angle")
    if found.vague:
        console.print(
            f"{found.vague:,} scatterings go into a lobe narrower than ten times the error of "
            "their stored direction: they count as before"
        )
    if rows:
        paths = Table("path", f"before [{unit}]", f"after [{unit}]", "difference")
        for row in rows:
            paths.add_row(
                Text(row["path"]),
                marked(f"{row['flux_before']:.4g}", row["flux_before"], row["flux_before_se"]),
                marked(f"{row['flux']:.4g}", row["flux"], row["flux_se"]),
                f"{row['difference']:+.4g}",
            )
        console.print(paths)
    if any(text.endswith(MARK) for text in shown.values()) or any(row["doubtful"] for row in rows):
        console.print(FOOTNOTE)

"""Commands that ask a map: query, paths, report, image; the studies stand in `cli_studies`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from query.cli.focus import focus
from query.cli.histograms import histogram
from query.cli.improve import improve
from query.cli.options import (
    Criterion,
    Filter,
    Scheduler,
    Threads,
    progress_line,
    read_criterion,
    workers,
)
from query.cli.rayfile import rayfile
from query.cli.sensitivity import sensitivity
from query.cli.studies import audit, compare, ghosts, illuminated, sweep
from query.cli.what_if import what_if
from raymap.cli.options import Json, MapPath, Panel, Strict, emit_json, opened_map
from raymap.model.doubt import FOOTNOTE, marked, with_doubts, with_error

if TYPE_CHECKING:
    from query.answers.reports.histograms import PathNumbers
    from raymap.file.reader import RayMap

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Hang the commands of this package on the application."""
    app.command("query", rich_help_panel=Panel.ASK)(query)
    app.command("paths", rich_help_panel=Panel.ASK)(paths)
    app.command("report", rich_help_panel=Panel.ASK)(report)
    app.command("image", rich_help_panel=Panel.PICTURES)(image)
    app.command("focus", rich_help_panel=Panel.PICTURES)(focus)
    app.command("rayfile", rich_help_panel=Panel.FILES)(rayfile)
    app.command("audit", rich_help_panel=Panel.ASK)(audit)
    app.command("ghosts", rich_help_panel=Panel.ASK)(ghosts)
    app.command("illuminated", rich_help_panel=Panel.ASK)(illuminated)
    app.command("sweep", rich_help_panel=Panel.ASK)(sweep)
    app.command("compare", rich_help_panel=Panel.ASK)(compare)
    app.command("histogram", rich_help_panel=Panel.ASK)(histogram)
    app.command("what-if", rich_help_panel=Panel.ASK)(what_if)
    app.command("sensitivity", rich_help_panel=Panel.ASK)(sensitivity)
    app.command("improve", rich_help_panel=Panel.ASK)(improve)


def query(
    map: MapPath,
    criterion: Criterion = None,
    count: Annotated[bool, typer.Option("--count", help="Print no ray numbers.")] = False,
    limit: Annotated[
        int | None, typer.Option(min=1, help="At most this many: those with the smallest numbers.")
    ] = None,
    explain: Annotated[
        bool, typer.Option("--explain", help="Show the plan, and the rays of each part.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="Write the rays: .raymap, .parquet, .arrow, .csv. An existing table is replaced.",
        ),
    ] = None,
    rows: Annotated[
        Literal["segments", "rays"],
        typer.Option(help="Rows of the table: one per segment record, or per ray."),
    ] = "segments",
    force: Annotated[bool, typer.Option("--force", help="Replace an existing map, too.")] = False,
    filter_string: Filter = False,
    threads: Threads = None,
    scheduler: Scheduler = None,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Find the rays that satisfy a criterion."""
    from query.answers.selections.selector import select
    from query.answers.selections.warm import warm_up

    # A table can be made again; a map may be somebody's original
    replace = force or (output is not None and output.suffix.lower() != ".raymap")
    if output is not None:
        from query.answers.selections.output import check_target

        check_target(output, rows, force=replace)
    with opened_map(map, strict) as ray_map, workers(scheduler) as executor:
        asked = read_criterion(criterion, ray_map, filter_string)
        if explain:
            _explain(ray_map, asked, threads, json)
            return
        warm_up(ray_map, asked)
        only_count = count and output is None and limit is None
        selection = select(
            ray_map,
            asked,
            limit=limit,
            rays=not only_count,
            threads=threads,
            progress=progress_line(json),
            executor=executor,
        )
        if output is not None:
            selection.write(output, rows, force=replace)
        if not json:
            from query.cli.terminal import print_selection

            print_selection(selection, show_rays=not count)
            if output is not None:
                typer.echo(f"wrote {output}")
            return
        answer = selection.summary()
        if not count:
            answer["ray_ids"] = selection.ray_ids
        if output is not None:
            answer["output"] = str(output)
        emit_json(answer)


def _explain(ray_map: RayMap, asked: Any, threads: int | None, json: bool) -> None:
    from query.answers.selections.explanation import explain

    explanation = explain(ray_map, asked, threads=threads)
    if json:
        emit_json(explanation.to_json())
    else:
        typer.echo(str(explanation))


def paths(
    map: MapPath,
    criterion: Criterion = None,
    by: Annotated[
        Literal["face", "object"], typer.Option(help="Tell faces apart, or objects only.")
    ] = "face",
    top: Annotated[int, typer.Option(min=1, help="Rows to show.")] = 20,
    sort: Annotated[
        Literal["flux", "rays", "peak"], typer.Option(help="Order of the rows.")
    ] = "flux",
    peak: Annotated[
        str | None, typer.Option(help="Show each path's brightest cell on this detector.")
    ] = None,
    column: Annotated[
        list[str] | None,
        typer.Option(
            "--column",
            help='Mean and spread of a number of the rays: time, length, incidence(hit("L1")), …; '
            "repeatable.",
        ),
    ] = None,
    min_rays: Annotated[
        int, typer.Option(min=1, help="Paths of fewer rays go to the remainder.")
    ] = 1,
    min_share: Annotated[
        float, typer.Option(min=0, help="Paths with a smaller share of the flux go there, too.")
    ] = 0.0,
    reflections: Annotated[
        int | None, typer.Option(min=0, help="Only paths with exactly this many reflections.")
    ] = None,
    first: Annotated[
        str | None, typer.Option(help="Only paths that meet this object first.")
    ] = None,
    last: Annotated[str | None, typer.Option(help="Only paths that meet this object last.")] = None,
    source: Annotated[str | None, typer.Option(help="Only paths from this source.")] = None,
    filter_string: Filter = False,
    threads: Threads = None,
    scheduler: Scheduler = None,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """List the paths of a selection: rays, flux, standard error, share."""
    from query.answers.paths.tables import path_table

    with opened_map(map, strict) as ray_map, workers(scheduler) as executor:
        asked = read_criterion(criterion, ray_map, filter_string)
        table = path_table(
            ray_map,
            asked,
            by=by,
            sort=sort,
            peak=peak,
            threads=threads,
            progress=progress_line(json),
            executor=executor,
        )
        table = table.filter(
            reflections=reflections,
            first=first,
            last=last,
            source=source,
            min_rays=min_rays,
            min_share=min_share,
        )
        numbers = []
        if column:
            from query.answers.reports.histograms import path_numbers

            numbers = [
                path_numbers(ray_map, text, asked, by=by, threads=threads) for text in column
            ]
        if json:
            emit_json(_with_numbers(table.to_json(top), numbers))
            return
        from query.cli.terminal import print_paths

        print_paths(table, top, numbers)


def _with_numbers(rows: list[dict[str, Any]], numbers: list[PathNumbers]) -> list[dict[str, Any]]:
    """JSON rows of a path table with columns of numbers, null where no ray of a path has any."""
    for row in rows if numbers else ():
        row["columns"] = {
            each.quantity: {**each.of[row["path"]]._asdict(), "unit": each.unit}
            if row["path"] in each.of
            else None
            for each in numbers
        }
    return rows


def report(
    map: MapPath,
    ray_id: Annotated[int, typer.Argument(help="Number of the ray.")],
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Show everything that is recorded of one ray, point by point."""
    from query.answers.reports.ray_report import report as report_of

    with opened_map(map, strict) as ray_map:
        ray = report_of(ray_map, ray_id)
        if json:
            emit_json(ray)
            return
        from query.cli.terminal import print_report

        print_report(ray)


def image(
    map: MapPath,
    detector: Annotated[
        str,
        typer.Argument(
            help="Name of the detector, or a place: plane(z=120, size=[36, 24], cells=[72, 48])."
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            help="Its suffix chooses the format (raymap kinds image_formats); an existing file is "
            "replaced.",
        ),
    ],
    criterion: Criterion = None,
    kind: Annotated[
        str | None,
        typer.Option(
            help="Colours (rgb, spectral), flux, flux_se or rays of each cell; density, "
            "density_se: flux per area, solid angle or étendue in the unit of the map; by watt "
            "irradiance, intensity, radiance, by lumen illuminance, candela, luminance. Left out: "
            "colours, in .csv flux, density and channels, in .ies candela."
        ),
    ] = None,
    layer: Annotated[
        list[str] | None,
        typer.Option(help="NAME=CRITERION: one more picture, made in the same pass; repeatable."),
    ] = None,
    bin: Annotated[
        int, typer.Option("--bin", min=1, help="Join blocks of N x N cells: less speckle.")
    ] = 1,
    filter_string: Filter = False,
    threads: Threads = None,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Write the picture that the selected rays make on a detector."""
    from query.answers.images.image_files import check_image, write_image
    from query.answers.images.images import detector_images
    from query.answers.images.obstructed import ended_before
    from query.answers.images.values import KINDS

    if kind is not None and kind not in KINDS:
        raise typer.BadParameter(f"--kind is one of {', '.join(KINDS)}")
    targets = {"": output}
    for text in layer or ():
        name, equals, _ = text.partition("=")
        if not equals or not name:
            raise typer.BadParameter("--layer is NAME=CRITERION")
        targets[name] = output.with_name(f"{output.stem}-{name}{output.suffix}")
    check_image(output, kind)
    with opened_map(map, strict) as ray_map:
        layers = {"": read_criterion(criterion, ray_map, filter_string)}
        for text in layer or ():
            name, _, asked = text.partition("=")
            layers[name] = read_criterion(asked, ray_map, filter_string)
        pictures = detector_images(
            ray_map, detector, layers, bin=bin, threads=threads, progress=progress_line(json)
        )
        written = [
            _written(write_image(picture, targets[name], kind, zoom=bin), picture, kind)
            for name, picture in pictures.items()
        ]
        before = ended_before(ray_map, detector, layers[""], threads=threads)
        if json:
            more: dict[str, Any] = {"layers": written[1:]} if written[1:] else {}
            emit_json(written[0] | more | ({"ended_before": before} if before else {}))
            return
        for item, picture in zip(written, pictures.values(), strict=True):
            peak = "" if item["peak"] is None else f", peak {_peak(item)}"
            counted = f"from {item['registrations']:,} registrations"
            if item["summed_while_tracing"]:
                counted = "through an opening of unit area, summed up while tracing"
            flux = marked(f"{item['flux']:.6g}", item["flux"], item["flux_se"])
            typer.echo(f"wrote {item['output']}: {flux} {item['flux_unit']} {counted}{peak}")
            if speckle := _speckle(picture, bin):
                typer.echo(speckle)
        if before:
            unit = ray_map.directory.flux_unit
            taken = ", ".join(f"{name} {flux:.3g} {unit}" for name, flux in before.items())
            typer.echo(f"ended before it, straight in front of it: {taken}")
        if any(item["doubtful"] for item in written):
            typer.echo(FOOTNOTE)


def _peak(item: dict[str, Any]) -> str:
    return f"{with_error(item['peak'], item['peak_se'])} {item['peak_unit']}"


def _speckle(picture: Any, bin: int) -> str:
    """How coarse the picture's grain is, and what helps; empty where it is fine."""
    calmer = picture.calmer()
    if calmer is None:
        return ""
    side, grain = calmer
    return (
        f"speckle: a lit cell is known to ± {picture.grain:.0%}; --bin {side * bin} brings that to "
        f"about ± {grain:.0%}, or record more rays"
    )


def _written(path: Path, picture: Any, kind: str | None) -> dict[str, Any]:
    """What a picture holds, in numbers: in the unit of its kind, else in that of the map."""
    from query.answers.images.lit import QUANTITIES
    from query.answers.images.readings import readings
    from raymap.optics.cells import is_pinhole

    name, unit, peak = picture.density_name, picture.density_unit, {}
    flux_unit = picture.flux_unit
    if kind in QUANTITIES:
        name, flux_unit = kind, picture.lit.unit_of(kind)
        peak = readings(picture, kind)
        unit = peak["unit"]
    elif picture.measure is not None:
        peak = readings(picture)
    written = {
        "output": str(path),
        "detector": picture.detector.name,
        "cells": list(picture.detector.cells),
        "flux": picture.total_in(flux_unit),
        "flux_se": picture.total_se_in(flux_unit),
        "flux_unit": flux_unit,
        "registrations": picture.registrations,
        "grain": picture.grain,
        "summed_while_tracing": is_pinhole(picture.detector),
        "quantity": name,
        "peak": peak.get("peak"),
        "peak_se": peak.get("peak_se"),
        "peak_unit": unit,
        "cell_area_m2": picture.cell_area_m2,
    }
    return with_doubts(written)

"""Commands for studies of a map: audit, ghosts, illuminated, sweep, compare."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from query.cli.options import Criterion, Threads
from raymap.cli.options import Json, MapPath, Strict, emit_json, opened_map

__all__ = ["audit", "compare", "ghosts", "illuminated", "sweep"]


def audit(
    map: MapPath,
    criterion: Criterion = None,
    threads: Threads = None,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Show where the light of each source ended: absorbed, detected, left, stopped, errors."""
    from query.answers.reports.energy import CLASSES
    from query.answers.reports.energy import audit as audit_of

    with opened_map(map, strict) as ray_map:
        result = audit_of(ray_map, criterion, threads=threads)
        answer = result.to_json()
        if json:
            emit_json(answer)
            return
        from query.cli.terminal import print_rows

        kinds = ("emitted", *CLASSES, "missing")
        rows = [
            {"source": name} | {kind: entry["flux"][kind] for kind in kinds}
            for name, entry in answer["sources"].items()
        ]
        errors = [entry["flux_se"] for entry in answer["sources"].values()]
        print_rows(rows, f"flux [{result.flux_unit}] by how it ended", errors=errors)
        takers = [
            {"object": name} | {key: entry[key] for key in ("rays", "flux", "flux_se")}
            for name, entry in answer["absorbed_by"].items()
        ]
        print_rows(takers, "absorbed by", result.flux_unit)


def ghosts(
    map: MapPath,
    detector: Annotated[
        str | None, typer.Argument(help="Only ghosts that this one registers.")
    ] = None,
    criterion: Criterion = None,
    reflections: Annotated[
        int, typer.Option(min=1, help="How many ghost reflections each ray has.")
    ] = 2,
    top: Annotated[int, typer.Option(min=1, help="Rows to show.")] = 20,
    threads: Threads = None,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """List ghosts by the faces that reflect, mirrors left out, in the order of the light."""
    from query.answers.paths.ghosts import ghost_table, matrix_of

    with opened_map(map, strict) as ray_map:
        table = ghost_table(ray_map, detector, criterion, reflections=reflections, threads=threads)
        if json:
            matrix = matrix_of(table) if reflections == 2 else None
            pairs = {} if matrix is None else matrix.to_json() | {"pairs": matrix.pairs()}
            emit_json(table.to_json() | pairs)
            return
        if not len(table):
            typer.echo(table.nothing())
            return
        from query.cli.terminal import print_rows

        rows = [
            {_reflection(k): label for k, label in enumerate(row["labels"])}
            | {k: row[k] for k in ("rays", "flux", "flux_se", "share")}
            for row in table.rows(top)
        ]
        unit = table.flux_unit
        number = {1: "one", 2: "two"}.get(reflections, str(reflections))
        print_rows(rows, f"{number}-reflection ghosts, {table.total:.5g} {unit}", unit)


def _reflection(number: int) -> str:
    """The head of the column of a reflection."""
    names = ("first", "second", "third", "fourth", "fifth")
    return names[number] if number < len(names) else f"{number + 1}th"


def illuminated(
    map: MapPath,
    detector: Annotated[str, typer.Argument(help="Name of the detector.")],
    criterion: Criterion = None,
    threads: Threads = None,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """List the objects that the sources light, those that a detector sees, and both."""
    from query.answers.reports.illumination import illuminated as light_of

    with opened_map(map, strict) as ray_map:
        result = light_of(ray_map, detector, criterion, threads=threads)
        if json:
            emit_json(result.to_json())
            return
        from query.cli.terminal import print_rows

        unit = ray_map.directory.flux_unit
        objects = result.to_json()["objects"]
        print_rows(objects, f"objects lit, and seen by {result.detector}", unit)
        typer.echo(f"illuminated and critical: {', '.join(result.both) or 'none'}")


def sweep(
    map: MapPath,
    detector: Annotated[str, typer.Argument(help="Name of the detector.")],
    criterion: Criterion = None,
    threads: Threads = None,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Show flux at a detector and point source transmittance, source by source."""
    from query.answers.reports.sweeps import sweep as sweep_of

    with opened_map(map, strict) as ray_map:
        rows = [row.to_json() for row in sweep_of(ray_map, detector, criterion, threads=threads)]
        if json:
            emit_json(rows)
            return
        from query.cli.terminal import print_rows

        shown = [{k: v for k, v in row.items() if k != "parameters"} for row in rows]
        print_rows(shown, f"flux at {detector} by source", ray_map.directory.flux_unit)


def compare(
    map: MapPath,
    other: Annotated[Path, typer.Argument(help="The map to compare with.")],
    criterion: Criterion = None,
    by: Annotated[
        Literal["face", "object"], typer.Option(help="Tell faces apart, or objects only.")
    ] = "face",
    different_scenes: Annotated[
        bool,
        typer.Option("--different-scenes", help="Compare maps of different scenes, paths by name."),
    ] = False,
    top: Annotated[int, typer.Option(min=1, help="Rows to show.")] = 20,
    threads: Threads = None,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Compare two maps path by path, with the significance of each difference."""
    from query.answers.reports.comparison import compare as compare_maps

    with opened_map(map, strict) as first, opened_map(other, strict) as second:
        result = compare_maps(
            first, second, criterion, by=by, different_scenes=different_scenes, threads=threads
        )
        if json:
            emit_json(result.to_json(top))
            return
        from query.cli.terminal import print_rows

        typer.echo(result.head())
        rows = [
            {
                "flux_a": path.flux_a,
                "flux_a_se": path.se_a,
                "flux_b": path.flux_b,
                "flux_b_se": path.se_b,
                "difference": path.difference,
                "difference_se": path.se,
                "z": path.z,
                "significant": "yes" if path.significant else "",
                "path": path.path,
            }
            for path in result.paths[:top]
        ]
        print_rows(rows, f"{len(result.significant)} significant of {len(result.paths)} paths")

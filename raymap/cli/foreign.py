"""The command ``raymap import``: what another program recorded, as a ray map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from raymap.cli.options import Force, Json, emit_json
from raymap.model.errors import RayMapError
from raymap.model.givenfile import given_text
from raymap.model.giventext import toml_tables

__all__ = ["import_"]


def import_(
    file: Annotated[
        Path,
        typer.Argument(
            help="A file of rays that another program traced; raymap kinds lists the formats."
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="The ray map to write.")],
    names: Annotated[
        Path | None, typer.Option(help='TOML with names by number: 3 = "lens", "3.1" = "front".')
    ] = None,
    length_unit: Annotated[
        Literal["um", "mm", "cm", "m", "in"], typer.Option(help="Lens unit of the database.")
    ] = "mm",
    flux_unit: Annotated[Literal["W", "lm"], typer.Option(help="Unit of its intensities.")] = "W",
    wavelength_nm: Annotated[float, typer.Option(help="Wavelength of the rays [nm].")] = 550.0,
    force: Force = False,
    json: Json = False,
) -> None:
    """Make a ray map of what another program recorded."""
    from raymap.foreign.formats import import_recorded

    written = import_recorded(
        file,
        output,
        names=_read_names(names),
        length_unit=length_unit,
        flux_unit=flux_unit,
        wavelength_nm=wavelength_nm,
        force=force,
    )
    if json:
        emit_json({"output": str(output)} | written)
        return
    trees = f" of {written['trees']:,} ray trees" if "trees" in written else ""
    typer.echo(f"wrote {output}: {written['rays']:,} rays, {written['records']:,} records{trees}")


def _read_names(path: Path | None) -> dict[str, str]:
    """Names by number; a table ``[names]`` or the keys of the file itself."""
    if path is None:
        return {}
    table: Any = toml_tables(given_text(path, "file of names"), f"{path}: names")
    table = table.get("names", table)
    if not all(isinstance(value, str) and value for value in table.values()):
        raise RayMapError(f'{path}: write names as 3 = "lens" and "3.1" = "front"')
    return dict(table)

"""The command ``raymap check-rays``: what a ray file holds, and the same rays in another format."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from raymap.cli.options import Force, Json, emit_json, warnings_on_stderr

__all__ = ["check_rays"]


def check_rays(
    file: Annotated[Path, typer.Argument(help="A ray file: .tm25ray, .dat or .sdf.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Write the rays as .tm25ray, .dat or .sdf."),
    ] = None,
    zemax_version: Annotated[
        int,
        typer.Option(
            min=1, max=2, help="Version of the header of .dat and .sdf; 1 for old programs."
        ),
    ] = 2,
    flux_from: Annotated[
        Literal["header", "rays"],
        typer.Option(help="What counts where the header states another flux than the rays carry."),
    ] = "header",
    force: Force = False,
    json: Json = False,
) -> None:
    """Check a ray file and show what it holds; with -o, write its rays in another format."""
    from raymap import rayfiles

    with warnings_on_stderr():
        rays = rayfiles.read(file, flux_from=flux_from)
    if output is not None:
        version: Any = zemax_version
        rayfiles.write(rays, output, force=force, zemax_version=version)
    found = rays.describe()
    if json:
        emit_json({"file": str(file)} | found | ({"output": str(output)} if output else {}))
        return
    _print(file, found)
    if output is not None:
        typer.echo(f"wrote {output}")


def _print(file: Path, found: dict[str, Any]) -> None:
    typer.echo(f"{file}: {found['rays']:,} rays, {found['flux']:.6g} {found['flux_unit']}")
    if found["title"]:
        typer.echo(f"title: {found['title']}")
    low, high = found["box"]
    sides = " x ".join(f"{b - a:.4g}" for a, b in zip(low, high, strict=True))
    corner = ", ".join(f"{a:.4g}" for a in low)
    typer.echo(f"starts: {sides} {found['length_unit']} from ({corner})")
    if found["mean_direction"]:
        mean = ", ".join(f"{value:z.3f}" for value in found["mean_direction"])
        typer.echo(f"mean direction: ({mean})")
    if found["wavelength_nm"]:
        low_nm, high_nm = found["wavelength_nm"]
        typer.echo(f"wavelengths: {low_nm:g} to {high_nm:g} nm")
    if found["spectra"]:
        typer.echo(f"spectra: {found['spectra']}")
    for key, text in found["description"].items():
        typer.echo(f"{key.replace('_', ' ')}: {text}")

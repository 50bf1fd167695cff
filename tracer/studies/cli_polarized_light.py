"""Commands: picture of a crystal plate under the microscope; recording with polarised light."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from raymap.cli.options import Json, emit_json
from raymap.model.errors import SceneError

if TYPE_CHECKING:
    from tracer.studies.microscopy.specimens import CrystalPlate

__all__ = ["microscope", "record_polarized"]

Picture = Annotated[
    Path, typer.Option("-o", "--output", help="Picture to write; an existing one is replaced.")
]


def microscope(
    output: Picture,
    crystal: Annotated[
        Literal["calcite", "quartz", "muscovite"], typer.Option(help="Crystal of the plate.")
    ] = "calcite",
    thickness: Annotated[float, typer.Option(help="Thickness of the plate [µm].")] = 60.0,
    tilt: Annotated[
        float, typer.Option(help="Optic axis (or acute bisectrix) to the plate's normal [deg].")
    ] = 0.0,
    stage: Annotated[float, typer.Option(help="Turn of the stage [deg].")] = 0.0,
    aperture: Annotated[float, typer.Option(help="Numerical aperture.")] = 0.65,
    polariser: Annotated[float, typer.Option(help="Azimuth of the polariser [deg].")] = 0.0,
    analyser: Annotated[float, typer.Option(help="Azimuth of the analyser [deg].")] = 90.0,
    wavelength: Annotated[
        float | None, typer.Option(help="Monochromatic light [nm]; white light if not given.")
    ] = None,
    compensator: Annotated[
        float, typer.Option(help="Path difference of a compensator at 45 degrees [nm].")
    ] = 0.0,
    real_lenses: Annotated[
        bool,
        typer.Option("--real-lenses", help="Send rays through a real condenser and objective."),
    ] = False,
    pixels: Annotated[int, typer.Option(help="Pixels along each side.")] = 301,
    json: Json = False,
) -> None:
    """Paint the conoscopic figure of a crystal plate under the polarising microscope."""
    from raymap.pictures.files import check_pixels, write_pixels
    from tracer.optics.polarization_elements import Retarder
    from tracer.studies.interference_colors import srgb_of
    from tracer.studies.microscopy.microscope import Microscope, conoscopy
    from tracer.studies.microscopy.microscope_bench import bench_conoscopy

    check_pixels(output)
    plate = _plate(crystal, thickness, tilt, stage)
    view = Microscope(
        polariser_deg=polariser,
        analyser_deg=analyser,
        numerical_aperture=aperture,
        compensator=Retarder.at_angle(45.0, compensator) if compensator else None,
        wavelength_nm=wavelength,
    )
    if real_lenses:
        xyz, brightest = bench_conoscopy(plate, view, pixels=pixels)
        write_pixels(output, srgb_of(xyz)[::-1])
    else:
        figure = conoscopy(plate, view, pixels=pixels)
        brightest = float(figure.transmission.max())
        write_pixels(output, srgb_of(figure.xyz)[::-1])
    if json:
        emit_json({"output": str(output), "brightest": brightest, "aperture": aperture})
        return
    typer.echo(f"wrote {output}")


def record_polarized(context: typer.Context) -> None:
    """Say how polarised light is recorded."""
    raise SceneError(
        "record-polarized is now raymap record: write [trace] light = 'polarised' (or lens_trees = "
        "8) into the scene, or into a variant of it"
    )


def _plate(crystal: str, thickness_um: float, tilt_deg: float, stage_deg: float) -> CrystalPlate:
    """A plate with its axis tilted towards x, then turned about the normal."""
    import numpy as np

    from tracer.optics.crystals.media import biaxial, calcite, uniaxial
    from tracer.studies.microscopy.specimens import CrystalPlate

    tilt, turn = math.radians(tilt_deg), math.radians(stage_deg)
    about_y = np.array(
        [
            [math.cos(tilt), 0.0, math.sin(tilt)],
            [0.0, 1.0, 0.0],
            [-math.sin(tilt), 0.0, math.cos(tilt)],
        ]
    )
    about_z = np.array(
        [
            [math.cos(turn), -math.sin(turn), 0.0],
            [math.sin(turn), math.cos(turn), 0.0],
            [0.0, 0.0, 1.0],
        ]
    )
    axes = about_z @ about_y
    if crystal == "muscovite":
        bisectrix_up = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
        medium = biaxial(1.556, 1.587, 1.593, axes @ bisectrix_up, name="muscovite")
    elif crystal == "quartz":
        medium = uniaxial(1.5443, 1.5534, axes[:, 2], name="quartz, without optical activity")
    else:
        medium = calcite(axes[:, 2])
    return CrystalPlate(crystal=medium, thickness_mm=thickness_um * 1e-3)

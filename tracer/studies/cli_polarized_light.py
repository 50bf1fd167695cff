"""Commands: picture of a crystal plate under the microscope; recording with polarised light."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from raymap.cli import Json, emit_json, warnings_on_stderr

if TYPE_CHECKING:
    from tracer.studies.specimens import CrystalPlate

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
    from tracer.figures import check_picture, save_picture
    from tracer.optics.polarization_elements import Retarder
    from tracer.studies.interference_colors import srgb_of
    from tracer.studies.microscope import Microscope, conoscopy
    from tracer.studies.microscope_bench import bench_conoscopy

    check_picture(output)
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
        save_picture(srgb_of(xyz)[::-1], output)
    else:
        figure = conoscopy(plate, view, pixels=pixels)
        brightest = float(figure.transmission.max())
        save_picture(srgb_of(figure.xyz)[::-1], output)
    if json:
        emit_json({"output": str(output), "brightest": brightest, "aperture": aperture})
        return
    typer.echo(f"wrote {output}")


def record_polarized(
    scene: Annotated[Path, typer.Argument(help="A scene file (TOML).", show_default=False)],
    output: Annotated[Path, typer.Option("-o", "--output", help="The ray map to write.")],
    rays: Annotated[int, typer.Option(min=1, help="Rays to trace.")] = 100_000,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random numbers.")] = 1,
    threads: Annotated[
        int | None, typer.Option(min=1, help="Worker threads; by default one per core.")
    ] = None,
    append: Annotated[bool, typer.Option("--append", help="Continue the map.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing map.")] = False,
    states: Annotated[
        Literal["linear", "natural"],
        typer.Option(help="Draw a linear state for every ray, or carry natural light along."),
    ] = "linear",
    polariser: Annotated[
        list[str] | None,
        typer.Option(help="FACE=X,Y,Z: a sheet that absorbs vibrations along an axis; repeatable."),
    ] = None,
    source: Annotated[
        list[str] | None,
        typer.Option(help="SOURCE=X,Y,Z: vibration of a polarised source; repeatable."),
    ] = None,
    phases: Annotated[
        bool, typer.Option("--phases", help="Store phases, and exact optical paths.")
    ] = False,
    lens_trees: Annotated[
        int | None,
        typer.Option(min=1, help="Lenses as primitives: depth of their trees, all branches kept."),
    ] = None,
    json: Json = False,
) -> None:
    """Trace a scene with polarised light and record every path."""
    from dataclasses import asdict, fields

    from tracer.lens.record import record_lens_trees
    from tracer.polarized_record import Polarization
    from tracer.polarized_record import record_polarized as record
    from tracer.recording import refuse_scene_file

    refuse_scene_file(scene, output)
    result: dict[str, object]
    if lens_trees is not None:
        _refuse_with_trees(
            {
                "--threads": threads,
                "--append": append,
                "--states": states if states != "linear" else None,
                "--polariser": polariser,
                "--source": source,
                "--phases": phases,
            }
        )
        with warnings_on_stderr():
            tree = record_lens_trees(
                scene, output, emissions=rays, depth=lens_trees, seed=seed, force=force
            )
        result = asdict(tree)
    else:
        with warnings_on_stderr():
            done = record(
                scene,
                output,
                polarization=Polarization(
                    states=states,
                    polarisers={name: (axis, 0.0) for name, axis in _axes(polariser, "polariser")},
                    sources=dict(_axes(source, "source")),
                    phases=phases,
                ),
                rays=rays,
                seed=seed,
                threads=threads,
                append=append,
                force=force,
            )
        result = {
            item.name: getattr(done, item.name) for item in fields(done) if item.name != "detectors"
        }
    if json:
        emit_json(result)
        return
    typer.echo(f"{result['rays']:,} rays, {result['records']:,} records in {output}")


def _refuse_with_trees(options: dict[str, object]) -> None:
    """Refuse options that would have no effect on lenses as primitives."""
    from raymap.errors import SceneError

    given = [name for name, value in options.items() if value]
    if given:
        raise SceneError(
            f"--lens-trees does not know {', '.join(given)}: its trees start from natural light "
            "and are written in one go; leave it out"
        )


def _axes(texts: list[str] | None, option: str) -> list[tuple[str, tuple[float, float, float]]]:
    """Read NAME=X,Y,Z."""
    from raymap.errors import SceneError

    found = []
    for text in texts or []:
        name, _, numbers = text.rpartition("=")
        try:
            x, y, z = (float(number) for number in numbers.split(","))
        except ValueError:
            raise SceneError(
                f"--{option} {text!r}: expected NAME=X,Y,Z, for example sheet.face=0,1,0"
            ) from None
        found.append((name, (x, y, z)))
    return found


def _plate(crystal: str, thickness_um: float, tilt_deg: float, stage_deg: float) -> CrystalPlate:
    """A plate with its axis tilted towards x, then turned about the normal."""
    import numpy as np

    from tracer.crystals.media import biaxial, calcite, uniaxial
    from tracer.studies.specimens import CrystalPlate

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

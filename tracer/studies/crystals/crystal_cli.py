"""Commands for crystals: ``verify-crystals`` and ``render``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from raymap.cli.options import Json, Panel, emit_json
from raymap.model.errors import RayMapError, SceneError
from raymap.model.replacing import check_folder, check_place

__all__ = ["register"]


class VerificationFailed(RayMapError):
    """Some check of the crystal suite did not pass."""


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command("verify-crystals", rich_help_panel=Panel.STUDIES)(verify_crystals)
    app.command("render", rich_help_panel=Panel.STUDIES)(render)


def verify_crystals(
    model: Annotated[
        str, typer.Option(help="Local model to verify, module:function; default Raymap's own.")
    ] = "",
    pictures: Annotated[
        Path | None,
        typer.Option("--pictures", "-o", help="Folder for the pictures; its own are replaced."),
    ] = None,
    scenes: Annotated[
        Path | None,
        typer.Option(help="Folder of configuration files that replace the supplied ones."),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(help="Run only this part: 'numeric' or the name of a scene; repeatable."),
    ] = None,
    width: Annotated[int, typer.Option(help="Width of the picture of the calcite box.")] = 120,
    threads: Annotated[
        int | None, typer.Option(help="Worker threads; by default one per core.")
    ] = None,
    json: Json = False,
) -> None:
    """Verify light in crystals: Snell, Brewster, double refraction, figures, furnace."""
    from tracer.studies.crystals.crystal_verification import SCENES, find_model, verify_crystals
    from tracer.studies.crystals.crystal_verification import as_json as plain

    if pictures is not None:
        check_folder(pictures)
    if scenes is not None and not scenes.is_dir():
        raise SceneError(f"there is no folder {str(scenes)!r} of configuration files")
    chosen = tuple(only) if only else ("numeric", *SCENES)
    # Another's model is checked by numbers; the scenes run on Raymap's own tracing
    if model and not only:
        chosen = ("numeric",)
    results: list[dict[str, Any]] = []
    failed = 0
    for check in verify_crystals(
        find_model(model) if model else None,
        numeric="numeric" in chosen,
        scenes=tuple(name for name in chosen if name != "numeric"),
        pictures=pictures,
        scene_folder=scenes,
        width=width,
        threads=threads,
    ):
        failed += not check.passed
        results.append(plain(check))
        if not json:
            verdict = "pass" if check.passed else "FAIL"
            line = f"{verdict}  {check.name:36s} {check.deviation:9.2e} <= {check.limit:7.1e}"
            typer.echo(f"{line}  {check.statement}")
    if json:
        for result in results:
            if not math.isfinite(result["deviation"]):
                result["deviation"] = None
        emit_json({"passed": failed == 0, "failed": failed, "checks": results})
    else:
        typer.echo(f"{len(results) - failed} of {len(results)} checks passed")
    if failed:
        raise VerificationFailed(f"{failed} of {len(results)} checks of the crystal suite failed")


def render(
    scene: Annotated[Path, typer.Argument(help="Scene of crystals in a room, TOML.")],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="Picture, .png or .exr; an existing one is replaced."),
    ],
    threads: Annotated[
        int | None, typer.Option(help="Worker threads; by default one per core.")
    ] = None,
    width: Annotated[
        int | None, typer.Option(help="Width in pixels, instead of the scene's.")
    ] = None,
    analyser: Annotated[
        float | None, typer.Option(help="Analyser before the camera, degrees from horizontal.")
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", hidden=True, help="Pictures are replaced anyway.")
    ] = False,
    json: Json = False,
) -> None:
    """Render crystals in a room of glowing walls; an interrupted picture goes on when run again."""
    from dataclasses import replace

    from rich.progress import Progress

    from raymap.cli.terminal import console as make_console
    from tracer.render.load import load_render_scene
    from tracer.render.renderer import render as render_scene
    from tracer.studies.crystals.calcite_box import resized

    if output.suffix.lower() not in (".png", ".exr"):
        raise SceneError(f"picture {str(output)!r}: write .png or .exr")
    check_place(output)
    description = load_render_scene(scene)
    if width is not None:
        if width < 1:
            raise SceneError(f"width is {width}; it must be at least 1")
        description = resized(description, width)
    if analyser is not None:
        camera = replace(description.camera, analyser_deg=analyser)
        description = replace(description, camera=camera)
    state = output.with_name(output.name + ".state.npz")
    with Progress(console=make_console(), disable=json, transient=True) as bar:
        task = bar.add_task(description.name, total=None)
        picture = render_scene(
            description,
            threads=threads,
            state=state,
            keep_state=True,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )
    picture.save(output)
    state.unlink(missing_ok=True)
    summary = {
        "picture": str(output),
        "pixels": list(description.camera.pixels),
        "wavelengths": len(description.wavelengths_nm),
        "seconds": picture.seconds,
        "pruning_steps": float(picture.error_steps.max()),
        "truncated": float(picture.truncated.max()),
    }
    if json:
        emit_json(summary)
    else:
        typer.echo(
            f"{output}: {picture.seconds:.1f} s, pruning error at most "
            f"{summary['pruning_steps']:.2f} of an 8-bit step, at most "
            f"{100.0 * float(picture.truncated.max()):.2g} % cut at the depth limit"
        )

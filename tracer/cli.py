"""Commands of this package: record, check, and those of the studies."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from raymap.cli.options import Json, Panel, emit_json, warnings_on_stderr
from raymap.model.doubt import FOOTNOTE, MARK, is_doubtful, marked

if TYPE_CHECKING:
    from tracer.run.results import Progress, RecordResult
    from tracer.scene.model import Scene

__all__ = ["register"]

_AGAIN_SECONDS = 0.05
"""Until a signal that got lost is sent again."""

SceneArgument = Annotated[
    Path,
    typer.Argument(help="A scene (TOML) or lens file (.zmx, .seq).", show_default=False),
]
Simulation = Annotated[
    str | None,
    typer.Option("--simulation", help="Trace the choice [simulations.NAME] of the scene."),
]
Variant = Annotated[
    list[str] | None,
    typer.Option("--variant", help="Lay a [variants.NAME] table over the scene; repeatable."),
]


def register(app: typer.Typer) -> None:
    """Hang the commands of this package on the application."""
    from tracer.importers import cli as importers_cli
    from tracer.scattering import cli as scattering_cli

    app.command("record", rich_help_panel=Panel.RECORD)(record)
    app.command("check", rich_help_panel=Panel.RECORD)(check)
    scattering_cli.register(app)
    importers_cli.register(app)


def record(
    scene: SceneArgument,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The ray map to write.")
    ] = None,
    rays: Annotated[int | None, typer.Option(min=1, help="Stop after this many rays.")] = None,
    seconds: Annotated[float | None, typer.Option(min=0, help="Stop after this time [s].")] = None,
    threads: Annotated[
        int | None, typer.Option(min=1, help="Worker threads; by default one per core.")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of the random numbers.")] = None,
    append: Annotated[bool, typer.Option("--append", help="Continue the map.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing map.")] = False,
    raw: Annotated[bool, typer.Option("--raw", help="Store streams uncompressed.")] = False,
    no_rays: Annotated[
        bool, typer.Option("--no-rays", help="Store no rays, only what detectors count.")
    ] = False,
    scheduler: Annotated[
        str | None,
        typer.Option(
            help="Trace on the workers of the Dask scheduler at this address; -o names a folder."
        ),
    ] = None,
    variant: Variant = None,
    simulation: Simulation = None,
    json: Json = False,
) -> None:
    """Trace a scene and record every light path."""
    from tracer.run.recording import check_target, refuse_scene_file
    from tracer.run.recording import record as record_scene

    if output is None and not no_rays:
        raise typer.BadParameter("name the map to write with -o MAP", param_hint="--output")
    if output is not None:
        refuse_scene_file(scene, output)
        if scheduler is None and not append:
            check_target(output, force=force)
    loaded = _load(scene, variant, simulation)
    if scheduler is not None:
        from raymap.remote.cluster import scheduler_executor
    workers = contextlib.nullcontext() if scheduler is None else scheduler_executor(scheduler)
    with (
        _stopped_by_sigterm(),
        warnings_on_stderr(),
        _Display(quiet=json) as display,
        workers as executor,
    ):
        result = record_scene(
            loaded,
            output,
            rays=rays,
            seconds=seconds,
            threads=threads,
            seed=seed,
            append=append,
            force=force,
            raw=raw,
            no_rays=no_rays,
            progress=display.show,
            executor=executor,
        )
    if json:
        emit_json(result.to_json())
    else:
        _print_result(result, output)
    if result.interrupted:
        raise typer.Exit(130)


@contextlib.contextmanager
def _stopped_by_sigterm() -> Iterator[None]:
    """Take SIGTERM as Ctrl-C: what is under way is finished, and the map closed.

    While code compiles, either may come within a callback or a finaliser, from where no exception
    gets out: Python would print it and go on. It is sent again then.
    """

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    def again(lost: Any) -> None:
        if not issubclass(lost.exc_type, KeyboardInterrupt):
            told(lost)
            return
        later = threading.Timer(_AGAIN_SECONDS, os.kill, (os.getpid(), signal.SIGTERM))
        later.daemon = True
        later.start()

    before, told = signal.signal(signal.SIGTERM, stop), sys.unraisablehook
    sys.unraisablehook = again
    try:
        yield
    finally:
        sys.unraisablehook = told
        signal.signal(signal.SIGTERM, before)


def _load(path: Path, variants: list[str] | None, simulation: str | None) -> Scene:
    """Load a scene; warnings about its files go to stderr."""
    from tracer.scene.load import load_scene

    with warnings_on_stderr():
        return load_scene(path, variants=variants or (), simulation=simulation)


def _design(path: Path) -> dict[str, Any]:
    """The numbers of a lens file in its own order of surfaces; empty for other files."""
    import warnings

    from tracer.importers.lens_scene import import_lens
    from tracer.scene.files import scene_suffixes

    if path.suffix.lower() not in scene_suffixes():
        return {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # they were printed when the scene was loaded
        return {"design": import_lens(path).design()}


def _print_result(result: RecordResult, output: Path | None) -> None:
    from rich.markup import escape
    from rich.table import Table

    from raymap.cli.terminal import console as make_console

    console = make_console(soft_wrap=True)
    size = f", {result.bytes:,} bytes" if output else ""
    console.print(
        f"{result.rays:,} rays, {result.records:,} records{size} in {result.seconds:.2f} s "
        f"({result.rays_per_second:,.0f} rays/s, {result.threads} threads, seed {result.seed})"
    )
    columns = ["emitted", "absorbed", "detected", "left", "stopped", "errors"]
    table = Table("source", *columns)
    doubtful = False
    for name, row in result.audit.items():
        own = result.fluxes["sources"][name]
        cells = [_count(row[column], own[column]) for column in columns]
        table.add_row(name, *cells)
        doubtful |= any(cell.endswith(MARK) for cell in cells)
    notes = [FOOTNOTE] if doubtful else []
    seen = any(row["flux"] > 0.0 for row in result.fluxes["detectors"].values())
    if seen and not any(row["detected"] for row in result.audit.values()):
        notes.append("detected: ended on a blocking detector; the others let light go on")
    table.caption = "\n".join(notes) or None
    console.print(table)
    if result.fluxes["detectors"]:
        unit = escape(f"[{result.fluxes['unit']}]")
        rows = result.fluxes["detectors"]
        weighted = any("effective_rays" in row for row in rows.values())
        more = ["rays", "effective"] if weighted else []
        table = Table("detector", f"flux {unit}", "standard error", *more)
        for name, row in rows.items():
            flux, se = row["flux"], row["flux_se"]
            cells = [f"{row['rays']:,}", f"{row['effective_rays']:,.0f}"] if weighted else []
            table.add_row(name, f"{flux:.6g}", marked(f"{se:.2g}", flux, se), *cells)
            if is_doubtful(flux, se):
                table.caption = FOOTNOTE
        console.print(table)
    if result.interrupted:
        console.print("interrupted; the map holds the rays traced so far")


def _count(value: float, flux: Any) -> str:
    """A number of rays, with weights a sum of them: tenths are finer than its error.

    A number of rays says itself how sure it is; a sum of weights is marked where its flux is.
    """
    if float(value).is_integer() or not isinstance(flux, dict):
        return f"{value:,}"
    return marked(f"{value:,.1f}", flux["flux"], flux["flux_se"])


class _Display:
    """A line of live progress on stderr; nothing where nobody watches."""

    def __init__(self, *, quiet: bool) -> None:
        self.quiet = quiet
        self.live: Any = None

    def __enter__(self) -> _Display:
        from raymap.cli.terminal import console as make_console

        console = make_console(stderr=True)
        if not self.quiet and console.is_terminal:
            from rich.live import Live

            self.live = Live(console=console, transient=True, refresh_per_second=8)
            self.live.start()
            self.live.update("preparing; the first trace of its kind compiles for a minute")
        return self

    def __exit__(self, *_: object) -> None:
        if self.live:
            self.live.stop()

    def show(self, progress: Progress) -> None:
        """Show where the trace stands."""
        if not self.live:
            return
        rate = progress.rays / max(progress.seconds, 1e-9)
        left = []
        if progress.total_rays is not None:
            left.append((progress.total_rays - progress.rays) / max(rate, 1e-9))
        if progress.total_seconds is not None:
            left.append(progress.total_seconds - progress.seconds)
        total = f" of {progress.total_rays:,}" if progress.total_rays else ""
        self.live.update(
            f"{progress.rays:,}{total} rays, {rate:,.0f} rays/s, "
            f"{progress.bytes / 1e6:,.1f} MB, {max(0.0, min(left, default=0.0)):.0f} s left"
        )


def check(
    scene: SceneArgument,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="Write a section drawing (SVG); an existing one is replaced."
        ),
    ] = None,
    variant: Variant = None,
    simulation: Simulation = None,
    json: Json = False,
) -> None:
    """Validate a scene without tracing it; of a lens, first-order data and a section drawing."""
    from tracer.scene.load import load_scene
    from tracer.studies.lens import examine

    with warnings_on_stderr() as said:
        loaded = load_scene(scene, variants=variant or (), simulation=simulation)
        design = _design(scene)
        report = examine(loaded, design["design"]["wavelength_nm"] if design else None)
    report["warnings"] = [*dict.fromkeys([*said, *report.get("warnings", [])])]
    report |= design
    if output is not None:
        from tracer.studies.section import draw_section

        draw_section(loaded, output)
        report["drawing"] = str(output)
    if json:
        emit_json(report)
        return
    from tracer.studies.check_text import check_lines

    for line in check_lines(report):
        typer.echo(line)

"""The commands ``raymap picture``, ``raymap chart`` and ``raymap view``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from raymap.cli.options import (
    Json,
    MapPath,
    Panel,
    Strict,
    emit_json,
    opened_map,
    warnings_on_stderr,
)

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Hang the commands of this package on the application."""
    from viewer.export.cli import export_3d

    app.command("picture", rich_help_panel=Panel.PICTURES)(picture)
    app.command("chart", rich_help_panel=Panel.PICTURES)(chart)
    app.command("export-3d", rich_help_panel=Panel.FILES)(export_3d)
    app.command("view", rich_help_panel=Panel.PICTURES)(view)


def picture(
    map: MapPath,
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="Its suffix chooses the format (raymap kinds pixel_formats); an existing file is "
            "replaced.",
        ),
    ],
    criterion: Annotated[
        str | None, typer.Argument(help="Which rays; all of them if there is no criterion.")
    ] = None,
    rays: Annotated[int, typer.Option(min=1, help="Draw at most this many rays.")] = 500,
    color: Annotated[
        str,
        typer.Option(
            help="natural, path, source, reflections, ending, flux, wavelength or optical_length."
        ),
    ] = "natural",
    view: Annotated[str | None, typer.Option(help="side, top, front, back or tilted.")] = None,
    up: Annotated[
        Literal["y", "z", "x"] | None, typer.Option(help="The axis that points upward.")
    ] = None,
    width: Annotated[int, typer.Option(help="Width in pixels.")] = 1600,
    height: Annotated[int, typer.Option(help="Height in pixels.")] = 900,
    section: Annotated[
        str | None,
        typer.Option(help="Cut away: +x, -x, +y, -y, +z or -z, and optionally =PLACE, as in +x=5."),
    ] = None,
    after: Annotated[int, typer.Option(help="Draw rays from their n-th reflection on.")] = 0,
    opacity: Annotated[float, typer.Option(min=0, max=1, help="Opacity of rays.")] = 0.5,
    line_width: Annotated[
        float, typer.Option(min=0.1, max=1000.0, help="Width of rays in pixels.")
    ] = 1.0,
    fade: Annotated[bool, typer.Option("--fade", help="Fade rays by their flux.")] = False,
    hide: Annotated[list[str] | None, typer.Option(help="Leave out an object; repeatable.")] = None,
    names: Annotated[bool, typer.Option("--names", help="Write the names of objects.")] = False,
    light: Annotated[bool, typer.Option("--light", help="Light background.")] = False,
    session: Annotated[
        Path | None, typer.Option(help="Take everything else from a saved session.")
    ] = None,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Paint the scene with the rays that satisfy a criterion."""
    from dataclasses import replace

    from viewer.drawn.state import Clip, ViewState, load_state
    from viewer.paint.rendering import picture as paint

    state = load_state(session) if session is not None else ViewState()
    if session is None:
        state = replace(
            state,
            opacity=opacity,
            width=line_width,
            fade=fade,
            names=names,
            dark=not light,
            hidden=tuple(hide or ()),
            clip=Clip(after=after),
            section=parse_section(section),
        )
    text = criterion if criterion is not None else state.criterion
    with opened_map(map, strict) as ray_map, warnings_on_stderr():
        _check_names(ray_map, state.hidden)
        pixels = paint(
            ray_map,
            text or None,
            out=output,
            rays=rays if session is None else state.rays,
            color=color if session is None else None,
            view=view,
            up=up,
            size=(width, height),
            state=state,
        )
        if json:
            emit_json(
                {
                    "output": str(output),
                    "width": pixels.shape[1],
                    "height": pixels.shape[0],
                    "damaged": len(ray_map.damage),
                }
            )
            return
    typer.echo(f"wrote {output} ({pixels.shape[1]} x {pixels.shape[0]} pixels)")


def chart(
    map: MapPath,
    detector: Annotated[str, typer.Argument(help="Name of the detector.")],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="Its suffix chooses the format (raymap kinds chart_formats); an existing file is "
            "replaced.",
        ),
    ],
    criterion: Annotated[
        str | None, typer.Argument(help="Which rays; all of them if there is no criterion.")
    ] = None,
    bin: Annotated[
        int, typer.Option(min=1, help="Join blocks of N x N cells, against speckle.")
    ] = 1,
    luminous: Annotated[
        bool, typer.Option("--luminous", help="Lux and candela of a spectral map in watts.")
    ] = False,
    log: Annotated[bool, typer.Option("--log", help="Logarithmic scale.")] = False,
    low: Annotated[float | None, typer.Option(min=0, help="Lower end of the scale.")] = None,
    high: Annotated[float | None, typer.Option(min=0, help="Upper end of the scale.")] = None,
    at: Annotated[
        tuple[float, float] | None,
        typer.Option(help="Place u v of the cross sections; by default the middle."),
    ] = None,
    colors: Annotated[
        Literal["inferno", "viridis", "turbo", "gray"], typer.Option(help="Colour map.")
    ] = "inferno",
    title: Annotated[str | None, typer.Option(help="Written above the chart.")] = None,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Draw what a detector measures: scale, cross sections, candela diagram, beam angles."""
    from query.answers.images.readings import reading_lines
    from viewer.paint.charts import chart as draw

    with opened_map(map, strict) as ray_map:
        numbers = draw(
            ray_map,
            detector,
            criterion,
            out=output,
            bin=bin,
            luminous=luminous,
            log=log,
            low=low,
            high=high,
            at=at,
            colors=colors,
            title=title,
        )
        if json:
            emit_json({"output": str(output), **numbers, "damaged": len(ray_map.damage)})
            return
    typer.echo("\n".join((f"wrote {output}", *reading_lines(numbers))))


def parse_section(text: str | None) -> Any:
    """``+x=5``: take away what lies at x > 5.

    Raises
    ------
    StateError
    """
    from viewer.drawn.state import Section, StateError

    if text is None:
        return Section()
    side, _, place = text.replace(" ", "").partition("=")
    try:
        offset = float(place or 0)
        sign = {"+": 1.0, "-": -1.0}[side[0]]
        axis = "xyz".index(side[1:])
    except (KeyError, ValueError, IndexError):
        raise StateError(f"section {text!r}: write +x, -y=2.5 …: an axis, and where") from None
    if len(side) != 2:
        raise StateError(f"section {text!r}: write +x, -y=2.5 …: an axis, and where")
    normal = [0.0, 0.0, 0.0]
    normal[axis] = sign
    return Section(on=True, normal=(normal[0], normal[1], normal[2]), offset=sign * offset)


def _check_names(ray_map: RayMap, names: tuple[str, ...]) -> None:
    """Refuse names of objects that the map does not have."""
    from difflib import get_close_matches

    from raymap.model.errors import UnknownName

    known = [item.name for item in ray_map.directory.objects]
    for name in names:
        if name not in known:
            near = get_close_matches(name, known, 3) or known[:5]
            raise UnknownName(f"no object is called {name!r}; there are {', '.join(near)}")


def view(
    map: MapPath,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; 0 takes a free one.")] = 0,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Only print the address.")
    ] = False,
    session: Annotated[Path | None, typer.Option(help="Open a saved session.")] = None,
    criterion: Annotated[
        str | None, typer.Option("--criterion", "-c", help="Begin with this criterion.")
    ] = None,
    render: Annotated[
        Literal["auto", "client", "server"],
        typer.Option(help="Who draws the scene: the browser, this program, or the faster of them."),
    ] = "auto",
    window: Annotated[
        bool, typer.Option("--window", help="The scene alone, in a window (PyVista).")
    ] = False,
) -> None:
    """Open the application in the browser: scene, rays, detectors, paths and reports."""
    from dataclasses import replace

    from viewer.drawn.answers import check_criterion
    from viewer.drawn.state import ViewState, load_state

    state = load_state(session) if session is not None else ViewState()
    with opened_map(map) as ray_map:
        if criterion is not None:
            check_criterion(ray_map, criterion)
            state = replace(state, criterion=criterion)
        if window:
            from viewer.shown.window import open_window

            open_window(ray_map, state).plotter.show()
            return
        from viewer.app.server import serve

        serve(ray_map, state=state, port=port, browser=not no_browser, render=render)

"""The command ``raymap``: gathers the sub-commands of the packages, and says what went wrong."""

from __future__ import annotations

import atexit
import contextlib
import errno
import gc
import os
import re
import sys
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from raymap.cli.numbers import check_numbers
from raymap.cli.options import Panel
from raymap.cli.terminal import plain_streams
from raymap.model.errors import CriterionError, RayMapError
from raymap.model.parts import missing_part
from raymap.model.plaintext import plain_text
from raymap.rooms import check_room

if TYPE_CHECKING:
    pass

__all__ = ["application", "main", "register"]


def register(app: typer.Typer) -> None:
    """Hang the commands of this package on the application."""
    from raymap.cli.doctor import doctor
    from raymap.cli.foreign import import_
    from raymap.cli.kinds import kinds
    from raymap.cli.maps import export, info, repair, verify
    from raymap.cli.mix import mix
    from raymap.cli.rayfiles import check_rays

    app.command("import", rich_help_panel=Panel.FILES)(import_)
    app.command("info", rich_help_panel=Panel.FILES)(info)
    app.command("verify", rich_help_panel=Panel.FILES)(verify)
    app.command("repair", rich_help_panel=Panel.FILES)(repair)
    app.command("mix", rich_help_panel=Panel.FILES)(mix)
    app.command("export", rich_help_panel=Panel.FILES)(export)
    app.command("check-rays", rich_help_panel=Panel.FILES)(check_rays)
    app.command("kinds", rich_help_panel=Panel.SETUP)(kinds)
    app.command("doctor", rich_help_panel=Panel.SETUP)(doctor)


def application(asked: str = "") -> typer.Typer:
    """The application with the sub-commands of all installed packages.

    Parameters
    ----------
    asked : name of a command; if there is such a one, the others are left out, because what the
        command line says of all of them takes a tenth of a second to find out
    """
    app = typer.Typer(
        name="raymap",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        help="Record every light path of a Monte Carlo trace; ask which of them matter.",
    )
    app.callback()(_group)
    for point in sorted(entry_points(group="raymap.commands"), key=lambda point: point.name):
        check_room(point.module.split(".")[0])
        try:
            point.load()(app)
        except ModuleNotFoundError as error:
            # A package that is not installed takes its commands with it, not the others
            if missing_part(error) is None:
                raise
    only = [command for command in app.registered_commands if command.name == asked]
    app.registered_commands = only or sorted(app.registered_commands, key=_place_in_list)
    groups = [group.typer_instance for group in app.registered_groups]
    for each in (app, *filter(None, groups)):
        for command in each.registered_commands:
            command.cls = _Command
    return app


def _place_in_list(command: Any) -> int:
    """Panels in their order; commands of other packages, which may have none, at the end."""
    panels: list[object] = list(Panel)
    own = command.rich_help_panel
    return panels.index(own) if own in panels else len(panels)


class _Command(TyperCommand):
    """A command whose help keeps what stands in square brackets; it prints texts plainly."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        from rich.markup import escape

        for parameter in self.params:
            text = getattr(parameter, "help", None)
            if text:
                parameter.help = escape(text)  # type: ignore[attr-defined]
        super().format_help(ctx, formatter)

    def invoke(self, ctx: Any) -> Any:
        """Run the command; texts of files that it prints do nothing to a terminal."""
        for parameter in self.params:
            check_numbers(ctx.params.get(parameter.name or ""), parameter, ctx)
        with plain_streams():
            return super().invoke(ctx)


def _print_version(asked: bool) -> None:
    if asked:
        from raymap import __version__

        typer.echo(f"raymap {__version__}")
        raise typer.Exit


def _group(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Record every light path of a Monte Carlo trace; ask which of them matter."""


def _told(error: RayMapError) -> str:
    """The line on stderr; a short criterion stands in it, with carets below."""
    head = "error: "
    lines = [plain_text(line) for line in str(error).split("\n")]
    if not isinstance(error, CriterionError) or len(lines) != 3:
        return head + "\n".join(lines)
    message, shown, carets = lines[0], lines[1][2:].rstrip(), lines[2]
    if len(head) + len(shown) > 72:
        return head + "\n".join(lines)
    message = re.sub(r" \(column \d+\)$", "", message)
    return f"{head}{shown}: {message}\n{' ' * len(head)}{carets[2:]}"


def main() -> None:
    """Run the command line: 0 good, 1 a refused request, 2 usage, 130 after Ctrl-C."""
    # The process ends soon after: search no garbage among all that was imported and compiled
    atexit.register(gc.freeze)
    try:
        _run(application(*sys.argv[1:2]))
    except RayMapError as error:
        typer.echo(_told(error), err=True)
        raise SystemExit(1) from None
    except ImportError as error:
        from raymap.model.extras import missing_extra

        told = missing_extra(error) or missing_part(error)
        if told is None:
            raise
        typer.echo(_told(told), err=True)
        raise SystemExit(1) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    except BrokenPipeError:
        # The reader of our output went away (head, less): nothing is wrong
        raise SystemExit(_quiet_end()) from None
    except (MemoryError, RecursionError) as error:
        typer.echo(
            f"error: what is asked does not fit in memory ({type(error).__name__})", err=True
        )
        raise SystemExit(1) from None
    except OSError as error:
        # A full disk, a missing folder, no permission: the file's name and the system's reason
        where = f"{error.filename}: " if error.filename else ""
        typer.echo(f"error: {where}{error.strerror or error}", err=True)
        raise SystemExit(1) from None


def _run(app: typer.Typer) -> None:
    """Run a command; what it has printed is on its way when this ends."""
    try:
        app()
    except SystemExit as end:
        # Click says 1 for a broken pipe
        if isinstance(end.__context__, OSError) and end.__context__.errno == errno.EPIPE:
            raise BrokenPipeError from None
        sys.stdout.flush()
        raise


def _quiet_end() -> int:
    """Let nothing more be written on the way out; returns the exit status."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            os.dup2(nowhere, stream.fileno())
    return 0

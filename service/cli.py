"""The command ``raymap serve``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from raymap.cli import Panel, emit_json

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Hang the command on the application."""
    app.command("serve", rich_help_panel=Panel.FILES)(serve)


def serve(
    folder: Annotated[Path, typer.Argument(help="Folder whose maps and scenes are served.")] = Path(
        "."
    ),
    host: Annotated[str, typer.Option(help="Host name to listen at.")] = "localhost",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; 0 takes a free one.")] = 0,
    token_file: Annotated[
        Path | None,
        typer.Option(help="File with the token; else the variable RAYMAP_TOKEN, else a new one."),
    ] = None,
    tls_certificate: Annotated[Path | None, typer.Option(help="Certificate chain (PEM).")] = None,
    tls_key: Annotated[Path | None, typer.Option(help="Private key (PEM).")] = None,
    without_tls: Annotated[
        bool, typer.Option("--without-tls", help="Serve other machines without TLS.")
    ] = False,
    threads: Annotated[
        int | None, typer.Option(min=1, help="Worker threads of each search or recording.")
    ] = None,
    searches: Annotated[int, typer.Option(min=1, help="Most searches at a time.")] = 4,
    search_seconds: Annotated[
        float, typer.Option(min=0.1, help="Time limit of a search [s].")
    ] = 120.0,
    record_seconds: Annotated[
        float, typer.Option(min=0.1, help="Time limit of a recording [s].")
    ] = 24 * 3600.0,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Never open a browser for a client.")
    ] = False,
    json: Annotated[
        bool, typer.Option("--json", help="Print address and token as one line of JSON.")
    ] = False,
) -> None:
    """Serve a folder to other programs over Arrow Flight: load, record, ask, look."""
    from raymap.errors import RayMapError
    from service.access import Tls, choose_token
    from service.limits import Limits
    from service.server import RaymapService
    from service.server import serve as run

    if (tls_certificate is None) != (tls_key is None):
        raise RayMapError("TLS takes both --tls-certificate and --tls-key")
    tls = None
    if tls_certificate is not None and tls_key is not None:
        tls = Tls.read(tls_certificate, tls_key)
    token = choose_token(token_file)
    service = RaymapService(
        folder,
        token,
        host=host,
        port=port,
        tls=tls,
        without_tls=without_tls,
        limits=Limits(
            searches=searches, search_seconds=search_seconds, record_seconds=record_seconds
        ),
        threads=threads,
        browser=not no_browser,
    )
    if json:
        import sys

        emit_json({"address": service.address, "token": token, "folder": str(folder.resolve())})
        sys.stdout.flush()
    else:
        typer.echo(
            f"Raymap serves {folder.resolve()} at {service.address}\n"
            f'  raymap.connect("{service.address}", token="{token}")\nPress Ctrl-C to stop.'
        )
    run(service)

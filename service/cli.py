"""The command ``raymap serve``, and ``raymap token`` for those who may ask it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from raymap.cli.options import Json, Panel, emit_json

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Hang the command on the application."""
    app.command("serve", rich_help_panel=Panel.FILES)(serve)
    group = typer.Typer(no_args_is_help=True, help="Make, list and withdraw tokens of the service.")
    for name, command in (("add", add_token), ("list", list_tokens), ("remove", remove_token)):
        group.command(name)(command)
    app.add_typer(group, name="token", rich_help_panel=Panel.FILES)


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
    tokens: Annotated[
        Path | None,
        typer.Option(help="File of further tokens, as `raymap token add` makes them."),
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
    metrics_port: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=65535,
            help="Port of /metrics and /health, on this machine only.",
        ),
    ] = None,
    stop_seconds: Annotated[
        float, typer.Option(min=0.0, help="What answers under way may take after SIGTERM [s].")
    ] = 30.0,
    scene_seconds: Annotated[
        float, typer.Option(min=0.1, help="Time limit for reading a scene [s].")
    ] = 120.0,
    memory_bytes: Annotated[
        int, typer.Option(min=2**28, help="Memory of each process that reads, records or paints.")
    ] = 2**33,
    disk_bytes: Annotated[
        int, typer.Option(min=0, help="What clients may record and upload into the folder, in all.")
    ] = 2**37,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Never open a browser for a client.")
    ] = False,
    json: Annotated[
        bool, typer.Option("--json", help="Print address and token as one line of JSON.")
    ] = False,
) -> None:
    """Serve a folder to other programs over Arrow Flight: load, record, ask, look."""
    from raymap.model.errors import RayMapError
    from service.callers.access import Tls, choose_token
    from service.callers.tokens import TokenFile
    from service.limits import Limits
    from service.metrics import MetricsServer
    from service.server import RaymapService
    from service.server import serve as run

    if (tls_certificate is None) != (tls_key is None):
        raise RayMapError("TLS takes both --tls-certificate and --tls-key")
    tls = None
    if tls_certificate is not None and tls_key is not None:
        tls = Tls.read(tls_certificate, tls_key)
    # Where others were made, there is none for everything unless it is given
    token = choose_token(token_file, invent=tokens is None)
    service = RaymapService(
        folder,
        token,
        host=host,
        port=port,
        tls=tls,
        without_tls=without_tls,
        limits=Limits(
            searches=searches,
            search_seconds=search_seconds,
            record_seconds=record_seconds,
            scene_seconds=scene_seconds,
            memory_bytes=memory_bytes,
            disk_bytes=disk_bytes,
        ),
        threads=threads,
        browser=not no_browser,
        tokens=None if tokens is None else TokenFile(tokens),
    )
    told = None if metrics_port is None else MetricsServer(service.metrics, metrics_port)
    where = str(folder.resolve())
    if json:
        import sys

        answer = {"address": service.address, "token": token, "folder": where}
        emit_json(answer if told is None else {**answer, "metrics": told.address})
        sys.stdout.flush()
    else:
        shown = "…" if token is None else token
        metrics = "" if told is None else f"Metrics at {told.address}/metrics\n"
        typer.echo(
            f"Raymap serves {where} at {service.address}\n"
            f'  raymap.connect("{service.address}", token="{shown}")\n{metrics}'
            "Press Ctrl-C to stop."
        )
    try:
        run(service, stop_seconds=stop_seconds)
    finally:
        if told is not None:
            told.close()


TokensFile = Annotated[
    Path | None,
    typer.Option("--tokens", help="File of the tokens; else one in your configuration folder."),
]


def add_token(
    name: Annotated[str, typer.Argument(help="Who gets it, or what for.")],
    rights: Annotated[
        str, typer.Option(help="ask, record, write; several with commas between.")
    ] = "ask",
    map: Annotated[
        list[str] | None,
        typer.Option("--map", help="Only this map of the served folder; may be given again."),
    ] = None,
    days: Annotated[
        float | None, typer.Option(min=0.0, help="It expires after so many days.")
    ] = None,
    tokens: TokensFile = None,
) -> None:
    """Make a token and print it, this once: only its digest is kept."""
    import time

    from service.callers.rights import read_rights
    from service.callers.tokens import TokenFile, default_token_file

    file = TokenFile(tokens or default_token_file())
    expires = None if days is None else time.time() + 86400 * days
    maps = tuple(dict.fromkeys(map)) if map else None
    token = file.add(name, read_rights(rights.split(",")), maps=maps, expires=expires)
    typer.echo(f"{name!r} is kept in {file.path}", err=True)
    typer.echo(token)


def list_tokens(tokens: TokensFile = None, json: Json = False) -> None:
    """List names, rights, maps and times of the tokens."""
    import time

    from service.callers.tokens import TokenFile, default_token_file

    rows = TokenFile(tokens or default_token_file()).rows()
    if json:
        emit_json({"tokens": rows})
        return
    for row in rows:
        end = "never expires"
        if row["expires"] is not None:
            day = time.strftime("%Y-%m-%d %H:%M", time.localtime(row["expires"]))
            end = f"expired {day}" if row["expires"] <= time.time() else f"expires {day}"
        where = "all maps" if row["maps"] is None else ", ".join(row["maps"])
        typer.echo(f"{row['name']}: {', '.join(row['rights'])}; {where}; {end}")


def remove_token(
    name: Annotated[str, typer.Argument(help="Of the token.")], tokens: TokensFile = None
) -> None:
    """Withdraw a token; running services refuse it at once."""
    from service.callers.tokens import TokenFile, default_token_file

    file = TokenFile(tokens or default_token_file())
    file.remove(name)
    typer.echo(f"{name!r} is withdrawn from {file.path}")

"""What commands of all packages share: options, how maps are opened, JSON, warnings."""

from __future__ import annotations

import contextlib
import enum
import json
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from raymap.model.errors import DamagedPortion, DamageWarning
from raymap.model.plaintext import plain_json, plain_text

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = [
    "Force",
    "Json",
    "MapPath",
    "Panel",
    "Strict",
    "emit_json",
    "opened_map",
    "warnings_on_stderr",
]


class Panel(enum.StrEnum):
    """Parts of the list of commands, in the order in which they are shown."""

    RECORD = "Record"
    ASK = "Ask a map"
    PICTURES = "Pictures"
    FILES = "Files and other programs"
    STUDIES = "Studies"
    SETUP = "This installation"


MapPath = Annotated[Path, typer.Argument(help="A ray map, or a folder of them.")]


Force = Annotated[bool, typer.Option("--force", help="Replace an existing file.")]


Json = Annotated[bool, typer.Option("--json", help="Print JSON and nothing else.")]


Strict = Annotated[bool, typer.Option("--strict", help="Fail at damage instead of skipping it.")]


def emit_json(value: Any) -> None:
    """Print a value as JSON, and nothing else, on stdout."""
    # Within a text of JSON such characters can only stand in strings
    sys.stdout.write(plain_json(json.dumps(value, ensure_ascii=False, default=_plain)) + "\n")


def _plain(value: Any) -> Any:
    """NumPy numbers and arrays, paths and sets as JSON has them."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, set | frozenset):
        return sorted(value)
    return str(value)


@contextlib.contextmanager
def opened_map(path: Path, strict: bool = False) -> Iterator[RayMap]:
    """A map, or a folder of maps, for one command.

    Unless ``strict``, damage is skipped; it is reported on stderr, at once where it is found at
    opening, else at the end.
    """
    from raymap.file.opening import open

    if strict:
        # The error says it
        warnings.simplefilter("ignore", DamageWarning)
    with open(path, on_damage="raise" if strict else "skip") as ray_map:
        if strict:
            _refuse_damage(ray_map)
            yield ray_map
            _refuse_damage(ray_map)
            return
        known = len(ray_map.damage)
        _warn_of_damage(ray_map)
        try:
            yield ray_map
        finally:
            _warn_of_damage(ray_map, known)


@contextlib.contextmanager
def warnings_on_stderr() -> Iterator[list[str]]:
    """Print each different warning of the block once on stderr, when it ends normally.

    Yields the list that their texts are put into.
    """
    said: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield said
    said += dict.fromkeys(str(item.message) for item in caught)
    for text in said:
        typer.echo(f"warning: {plain_text(text)}", err=True)


def _refuse_damage(ray_map: RayMap) -> None:
    """Fail at damage that cost no rays, such as that of a footer."""
    for damage in ray_map.damage:
        raise DamagedPortion(
            f"{ray_map.path}: bytes {damage.offset}–{damage.offset + damage.length - 1}: "
            f"{damage.reason}"
        )


def _warn_of_damage(ray_map: RayMap, known: int = 0) -> None:
    """Report damage on stderr, from entry ``known`` of the map's list on."""
    for damage in ray_map.damage[known:]:
        what = "bytes" if damage.portion is None else f"portion {damage.portion}, bytes"
        typer.echo(
            f"warning: {ray_map.path}: {what} {damage.offset}–{damage.offset + damage.length - 1} "
            f"cannot be read ({damage.reason})",
            err=True,
        )

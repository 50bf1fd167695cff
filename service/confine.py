"""The served folder: no request reaches a file outside it, not by dots, links or scene files."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterator
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from raymap.errors import RayMapError, SceneError

__all__ = ["OutsideFolder", "ServedFolder"]

_FREE_TEXT = {"title", "description", "comment", "note"}


class OutsideFolder(RayMapError, PermissionError):
    """A request names a file outside the served folder."""


class ServedFolder:
    """A folder, and what may be reached in it by relative names.

    Parameters
    ----------
    root : the folder; it must exist

    Raises
    ------
    RayMapError
        It does not.
    """

    def __init__(self, root: str | os.PathLike[str]) -> None:
        self.root = Path(root).resolve()
        if not self.root.is_dir():
            raise RayMapError(f"{root} is not a folder: name the folder that is to be served")

    def path(self, name: object) -> Path:
        """The file or folder that a request names; links are followed, and must stay inside.

        Raises
        ------
        OutsideFolder
            The name is absolute, climbs up, is hidden, or a link leads out.
        """
        if not isinstance(name, str) or not name or len(name) > 1000 or "\0" in name:
            raise OutsideFolder("a path is a text such as 'maps/lens.raymap'")
        plain = PurePosixPath(name.replace("\\", "/"))
        drive = PureWindowsPath(name).drive or ":" in plain.parts[0]
        if plain.is_absolute() or drive or ".." in plain.parts or name.startswith("~"):
            raise OutsideFolder(
                f"{name!r} is outside the served folder: paths are relative to it, without '..'"
            )
        if any(part.startswith(".") for part in plain.parts):
            raise OutsideFolder(f"{name!r} is hidden: such files are not served")
        try:
            found = (self.root / plain).resolve()
        except (OSError, RuntimeError):
            raise OutsideFolder(f"{name!r} cannot be followed: its links lead nowhere") from None
        if not self.holds(found):
            raise OutsideFolder(f"{name!r} leads outside the served folder through a link")
        return found

    def holds(self, path: Path) -> bool:
        """Whether a resolved path lies inside."""
        return path == self.root or self.root in path.parents

    def serves(self, path: Path) -> bool:
        """Whether a path of the folder may be shown: not hidden, and its links stay inside."""
        try:
            return not path.name.startswith(".") and self.holds(path.resolve(strict=True))
        except (OSError, RuntimeError):
            return False

    def map_paths(self, name: object) -> list[Path]:
        """The files of a map: itself, or those of a folder of maps, each of them inside."""
        from raymap.shards import shard_paths

        found = self.path(name)
        if not found.is_dir():
            return [found]
        paths = [path.resolve() for path in shard_paths(found)]
        if not all(self.holds(path) for path in paths):
            raise OutsideFolder(f"a map in {name!r} leads outside the served folder through a link")
        return paths

    def shown(self, path: Path) -> str:
        """A path as clients name it."""
        return path.relative_to(self.root).as_posix()

    def plain(self, text: str) -> str:
        """A message without the place of the folder on this machine."""
        return text.replace(f"{self.root}{os.sep}", "").replace(str(self.root), ".")

    def check_scene(self, text: str, folder: Path, origin: str) -> None:
        """Refuse a scene that names files outside.

        Every text of a scene that could be a path is looked at, whatever its key means.

        Raises
        ------
        OutsideFolder, SceneError
        """
        try:
            tree = tomllib.loads(text)
        except (tomllib.TOMLDecodeError, RecursionError) as error:
            raise SceneError(f"{origin}: not a TOML file: {error}") from None
        for key, value in _texts(tree, "", 0):
            if len(value) > 1000 or "\0" in value:
                continue
            slashed = value.replace("\\", "/")
            candidate = folder / slashed
            if not ("/" in slashed or slashed.startswith((".", "~")) or os.path.lexists(candidate)):
                continue
            try:
                inside = self.holds(candidate.resolve()) and not slashed.startswith("~")
            except (OSError, RuntimeError, ValueError):
                inside = False
            if not inside:
                raise OutsideFolder(
                    f"{origin}: {key}: {value!r} is outside the served folder; put the file into it"
                )


def _texts(value: Any, key: str, depth: int) -> Iterator[tuple[str, str]]:
    """(key, text) of every text of a scene, names and remarks left out."""
    if depth > 64:
        raise SceneError(f"{key}: the scene nests deeper than 64")
    if isinstance(value, str):
        yield key, value
    elif isinstance(value, list):
        for item in value:
            yield from _texts(item, key, depth + 1)
    elif isinstance(value, dict):
        for name, item in value.items():
            if name not in _FREE_TEXT:
                yield from _texts(item, f"{key}.{name}" if key else name, depth + 1)

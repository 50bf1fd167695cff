"""The served folder: no request reaches a file outside it, not by dots, links or scene files."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath

from raymap.model.errors import RayMapError

__all__ = ["MOST_FOLDERS", "HeldFolder", "OutsideFolder", "ServedFolder"]

_WALKS = os.open in os.supports_dir_fd and hasattr(os, "O_NOFOLLOW")
"""Whether files can be opened from a folder that is held open (not on Windows)."""

MOST_FOLDERS = 16
"""Folders within each other that are made for one file."""

_NO_LINK = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0)
_READ = os.O_RDONLY | _NO_LINK
_WRITE = os.O_RDWR | _NO_LINK | getattr(os, "O_BINARY", 0)


class OutsideFolder(RayMapError, PermissionError):
    """A request names a file outside the served folder."""


@dataclass(frozen=True)
class HeldFolder:
    """A folder that is held open: its files are named from there, whatever its name comes to mean.

    Attributes
    ----------
    place : its path
    descriptor : of the folder; None where the system holds none open
    """

    place: Path
    descriptor: int | None

    def create(self, name: str) -> int:
        """A descriptor of a new file; links and files of that name are in the way."""
        return os.open(
            self._named(name), _WRITE | os.O_CREAT | os.O_EXCL, 0o666, dir_fd=self.descriptor
        )

    def open_to_write(self, name: str) -> int:
        """A descriptor of a file that is there and no link, to read and to write.

        Raises
        ------
        OutsideFolder
            It has become a link, or is no file.
        OSError
            It is not there, or cannot be written.
        """
        try:
            # A pipe must not make the service wait for who reads from it
            flags = _WRITE | getattr(os, "O_NONBLOCK", 0)
            descriptor = os.open(self._named(name), flags, dir_fd=self.descriptor)
        except OSError as error:
            if error.errno in (errno.ELOOP, errno.ENXIO, errno.EISDIR):
                raise OutsideFolder(f"{name!r} has become a link, or is no file") from None
            raise
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            os.close(descriptor)
            raise OutsideFolder(f"{name!r} is no file")
        return descriptor

    def replace(self, name: str, target: str) -> None:
        """Give a file another name; a link of that name is replaced, not followed."""
        os.replace(
            self._named(name), self._named(target),
            src_dir_fd=self.descriptor, dst_dir_fd=self.descriptor,
        )  # fmt: skip

    def remove(self, name: str) -> None:
        """Remove a file, if it is there."""
        with suppress(FileNotFoundError):
            os.unlink(self._named(name), dir_fd=self.descriptor)

    def names(self) -> list[str]:
        """What lies in it."""
        return sorted(os.listdir(self.place if self.descriptor is None else self.descriptor))

    def _named(self, name: str) -> str | Path:
        return self.place / name if self.descriptor is None else name


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
        drive = PureWindowsPath(name).drive or ":" in "".join(plain.parts[:1])
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

    def open(self, found: Path) -> int:
        """A descriptor of a file inside, to read; no link is followed that appeared meanwhile.

        Parameters
        ----------
        found : as `path` answered it

        Raises
        ------
        OutsideFolder
            It is no file, or one of its folders has become a link.
        OSError
            It cannot be read.
        """
        if not self.holds(found) or found == self.root:
            raise OutsideFolder(f"{found.name!r} is outside the served folder")
        descriptor = self._walk(found) if _WALKS else _open_and_look(found)
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            os.close(descriptor)
            raise OutsideFolder(f"{self.shown(found)!r} is no file")
        return descriptor

    def _walk(self, found: Path) -> int:
        """Go down from the root, folder by folder."""
        held = self._hold(found.parent)
        try:
            # A pipe must not make the service wait for who writes into it
            return os.open(found.name, _READ | os.O_NONBLOCK, dir_fd=held)
        except OSError as error:
            raise self._link(found, error) from None
        finally:
            os.close(held)

    @contextmanager
    def holding(self, found: Path, *, make: bool = False) -> Iterator[HeldFolder]:
        """Hold a folder inside open.

        Parameters
        ----------
        found : as `path` answered it
        make : make it, and those above it, where they are missing

        Raises
        ------
        OutsideFolder
            One of the folders has become a link.
        RayMapError
            More folders within each other are missing than are made at a time.
        OSError
            It cannot be opened or made.
        """
        if make and len(self.missing(found)) > MOST_FOLDERS:
            raise RayMapError(
                f"more than {MOST_FOLDERS} folders of {self.shown(found)[:100]!r} are missing: put "
                "the file into fewer of them"
            )
        if not _WALKS:
            if make:
                found.mkdir(parents=True, exist_ok=True)
            yield HeldFolder(found, None)
            return
        held = self._hold(found, make=make)
        try:
            yield HeldFolder(found, held)
        finally:
            os.close(held)

    def missing(self, found: Path) -> list[Path]:
        """A folder inside and those above it, as far as they are missing, the upper ones first."""
        missing: list[Path] = []
        place = self.root
        for part in found.relative_to(self.root).parts:
            place /= part
            if missing or not place.exists():
                missing.append(place)
        return missing

    def _hold(self, found: Path, *, make: bool = False) -> int:
        """A descriptor of a folder inside."""
        held = os.open(self.root, _READ | os.O_DIRECTORY)
        try:
            for folder in found.relative_to(self.root).parts:
                if make:
                    with suppress(FileExistsError):
                        os.mkdir(folder, dir_fd=held)
                inner = os.open(folder, _READ | os.O_DIRECTORY, dir_fd=held)
                os.close(held)
                held = inner
        except OSError as error:
            os.close(held)
            raise self._link(found, error) from None
        return held

    def _link(self, found: Path, error: OSError) -> OSError:
        """The error of an opening, said as what it means here."""
        if error.errno in (errno.ELOOP, errno.ENOTDIR, errno.ENXIO):
            return OutsideFolder(f"{self.shown(found)!r} has become a link, or is no file")
        return error

    def enter(self, found: Path) -> None:
        """Make a folder inside the current one, whatever its name may come to mean."""
        if not _WALKS:
            os.chdir(found)
            return
        held = self._hold(found)
        try:
            os.fchdir(held)
        finally:
            os.close(held)

    def same(self, found: Path, identity: tuple[int, int]) -> bool:
        """Whether an opened file (device and inode) is the one that lies inside."""
        try:
            descriptor = self.open(found)
        except (OSError, OutsideFolder):
            return False
        try:
            status = os.fstat(descriptor)
        finally:
            os.close(descriptor)
        return (status.st_dev, status.st_ino) == identity

    def map_paths(self, name: object) -> list[Path]:
        """The files of a map: itself, or those of a folder of maps, each of them inside."""
        from raymap.file.shards import shard_paths

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


def _open_and_look(found: Path) -> int:
    """Open, then look where that was: for systems without folders that are held open."""
    descriptor = os.open(found, os.O_RDONLY | getattr(os, "O_BINARY", 0))
    opened, there = os.fstat(descriptor), found.lstat()
    if found.resolve() != found or (opened.st_dev, opened.st_ino) != (there.st_dev, there.st_ino):
        os.close(descriptor)
        raise OutsideFolder(f"{found.name!r} has become a link")
    return descriptor

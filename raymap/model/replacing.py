"""Write a file beside its place and rename it: never half a file, never one lost by mistake."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path

from raymap.model.errors import MapExists, RayMapError

__all__ = ["NotWritten", "check_folder", "check_place", "refuse_existing", "replacing"]

_FULL = (errno.ENOSPC, errno.EDQUOT)


class NotWritten(RayMapError):
    """The system refuses to write a file."""

    def __init__(self, target: Path, reason: str) -> None:
        super().__init__(f"{target} cannot be written: {reason}")
        self.reason = reason


def refuse_existing(target: Path, *, force: bool, folder: bool = False) -> None:
    """Refuse to write where something stands, unless it may be replaced.

    Parameters
    ----------
    folder : a folder is to be written, not a file

    Raises
    ------
    MapExists
        Something stands there and ``force`` is off.
    NotWritten
        Nothing can be written there at all.
    """
    if folder:
        check_folder(target)
    else:
        check_place(target)
    if not force and target.exists():
        raise MapExists(
            f"{target} exists: choose another name, or replace it with --force "
            "(in Python: force=True)"
        )


def check_place(target: Path) -> Path:
    """Refuse, before anything is computed for it, a place where no file can be written.

    Returns
    -------
    path : where the file will stand: behind a symbolic link

    Raises
    ------
    NotWritten
        A folder or a device stands there, there is no folder for it, or it is closed.
    """
    if os.path.isdir(target):
        raise NotWritten(target, "it is a folder; name a file")
    if os.path.exists(target) and not os.path.isfile(target):
        raise NotWritten(target, "it is a device; name a file")
    place = Path(os.path.realpath(target)) if os.path.islink(target) else target
    if not os.path.isdir(place.parent):
        if os.path.exists(place.parent):
            raise NotWritten(target, f"{place.parent} is no folder; choose another place")
        raise NotWritten(target, f"there is no folder {place.parent}; make it, or choose another")
    _check_open(place.parent, target)
    return place


def check_folder(folder: Path) -> None:
    """Refuse, before anything is computed for it, a folder that cannot be made or written into.

    Raises
    ------
    NotWritten
        A file stands there or where a folder above it would, or it is closed.
    """
    nearest = folder
    while not os.path.lexists(nearest) and nearest != nearest.parent:
        nearest = nearest.parent
    if not os.path.isdir(nearest):
        where = "it" if nearest == folder else str(nearest)
        raise NotWritten(folder, f"{where} is a file; name a folder")
    _check_open(nearest, folder)


def _check_open(folder: Path, target: Path) -> None:
    """Refuse a folder into which this user may not write."""
    effective = os.access in os.supports_effective_ids
    if not os.access(folder, os.W_OK | os.X_OK, effective_ids=effective):
        raise NotWritten(target, f"permission denied in {folder}; choose another folder")


@contextlib.contextmanager
def replacing(target: Path) -> Iterator[Path]:
    """A name beside the target; the file written there takes the target's place if all goes well.

    A symbolic link stays one: the file that it points to is replaced.

    Raises
    ------
    NotWritten
        The system refuses; the message gives its reason.
    """
    place = check_place(target)
    temporary = place.with_name(f".{place.name}.{os.getpid()}.part")
    try:
        yield temporary
        os.replace(temporary, place)
    except BaseException as error:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        if reason := _refusal(error):
            raise NotWritten(target, reason) from None
        raise


def _refusal(error: BaseException) -> str:
    """Why the system would not write; empty for errors of other kinds."""
    if isinstance(error, NotWritten):
        return error.reason  # of the file beside, which nobody knows
    if isinstance(error, RayMapError):
        # So says the writer of a map
        cause = error.__context__
        full = isinstance(cause, OSError) and cause.errno in _FULL
        return "the disk is full" if full else ""
    if not isinstance(error, OSError):
        return ""
    if error.errno in _FULL or (error.errno is None and "written" in str(error)):
        return "the disk is full"  # NumPy counts the bytes that found no room
    return os.strerror(error.errno) if error.errno else str(error)

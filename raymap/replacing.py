"""Write a file beside its place and rename it: never half a file, never one lost by mistake."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path

from raymap.errors import MapExists, RayMapError

__all__ = ["NotWritten", "refuse_existing", "replacing"]

_FULL = (errno.ENOSPC, errno.EDQUOT)


class NotWritten(RayMapError):
    """The system refuses to write a file."""

    def __init__(self, target: Path, reason: str) -> None:
        super().__init__(f"{target} cannot be written: {reason}")
        self.reason = reason


def refuse_existing(target: Path, *, force: bool) -> None:
    """Refuse to write where a file stands, unless it may be replaced.

    Raises
    ------
    MapExists
        Something stands there and ``force`` is off.
    """
    if not force and target.exists():
        raise MapExists(
            f"{target} exists: choose another name, or replace it with --force "
            "(in Python: force=True)"
        )


@contextlib.contextmanager
def replacing(target: Path) -> Iterator[Path]:
    """A name beside the target; the file written there takes the target's place if all goes well.

    A symbolic link stays one: the file that it points to is replaced.

    Raises
    ------
    NotWritten
        The system refuses; the message gives its reason.
    """
    if target.is_dir():
        raise NotWritten(target, "it is a folder; name a file")
    if target.exists() and not target.is_file():
        raise NotWritten(target, "it is a device; name a file")
    place = Path(os.path.realpath(target)) if target.is_symlink() else target
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

"""Files that a user gives: read whole, or refused in one line with the remedy.

Folders, devices and pipes that nobody fills have names like files; a device such as ``/dev/full``
never ends. So what is given is looked at before it is opened, and read up to a bound.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

from raymap.model.errors import RayMapError

__all__ = ["LARGEST_TEXT", "check_given", "given_bytes", "given_text", "not_readable"]

LARGEST_TEXT = 64 * 2**20
"""Bytes of a text that a person writes or a program exports for persons, at most."""

Place = str | os.PathLike[str]


def check_given(path: Place, what: str, error: type[RayMapError] = RayMapError) -> None:
    """Refuse what is no file with something in it.

    Parameters
    ----------
    path : of the file
    what : it should be, such as "scene file"
    error : that is raised

    Raises
    ------
    RayMapError
        Of the given kind: nothing stands there, or a folder, a device, an empty file, or one that
        this user may not read.
    """
    name = os.fspath(path)
    try:
        status = os.stat(path)
    except (OSError, ValueError) as failure:
        raise error(not_readable(path, what, failure)) from None
    if stat.S_ISDIR(status.st_mode):
        raise error(f"{name!r} is a folder; name a {what} in it")
    if not stat.S_ISREG(status.st_mode) and not stat.S_ISFIFO(status.st_mode):
        raise error(f"{name!r} is a device; name a {what}")
    if stat.S_ISREG(status.st_mode) and status.st_size == 0:
        raise error(f"{name!r} is empty: no {what}; name another")
    effective = os.access in os.supports_effective_ids
    if not os.access(path, os.R_OK, effective_ids=effective):
        denied = OSError(errno.EACCES, os.strerror(errno.EACCES))
        raise error(not_readable(path, what, denied))


def given_bytes(
    path: Place,
    what: str,
    error: type[RayMapError] = RayMapError,
    *,
    largest: int = LARGEST_TEXT,
) -> bytes:
    """All bytes of a file; parameters and errors as for `check_given`.

    Raises
    ------
    RayMapError
        Also for a file that may not be read, or that is larger than ``largest`` bytes.
    """
    check_given(path, what, error)
    try:
        with open(path, "rb") as file:
            # A bound of gigabytes makes room for them, whatever the file holds
            status = os.fstat(file.fileno())
            data = file.read(min(status.st_size, largest) + 1)
            if len(data) > status.st_size:
                data += file.read(largest + 1 - len(data))
    except OSError as failure:
        raise error(not_readable(path, what, failure)) from None
    if len(data) > largest:
        raise error(f"{os.fspath(path)!r} is too large for a {what}: over {largest:,} bytes")
    return data


def given_text(path: Place, what: str, error: type[RayMapError] = RayMapError) -> str:
    """The text of a file in UTF-8, with or without a mark; otherwise as `given_bytes`.

    Raises
    ------
    RayMapError
        Also where the bytes are no such text.
    """
    data = given_bytes(path, what, error)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as failure:
        raise error(
            f"{os.fspath(path)!r} is not a {what}: no text in UTF-8 (byte {failure.start}: "
            f"{failure.reason})"
        ) from None


def not_readable(path: Place, what: str, failure: Exception) -> str:
    """One line about a file that the system does not open."""
    name = os.fspath(path)
    number = failure.errno if isinstance(failure, OSError) else None
    if number in (errno.ENOENT, errno.ENOTDIR, errno.ENAMETOOLONG, None):
        folder = Path(name).parent
        if not os.path.isdir(folder):
            return f"there is no {what} {name!r}: there is no folder {folder}; check the path"
        return f"there is no {what} {name!r}; check the path"
    if number in (errno.EACCES, errno.EPERM):
        return f"{name!r} cannot be read: permission denied; ask its owner for the right to read it"
    reason = os.strerror(number) if number is not None else str(failure)
    return f"{name!r} cannot be read: {reason}"

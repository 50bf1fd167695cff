"""Tokens with names and rights: made, listed and withdrawn; only their digests are kept.

A token is 192 random bits, so its plain SHA-256 cannot be turned back by trying: a slow hash, which
passwords need because people choose them, would only make every call slow.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import secrets
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from raymap.bytes.locking import try_lock
from raymap.model.errors import RayMapError
from raymap.model.givenfile import check_given, not_readable
from raymap.model.replacing import check_place, replacing
from service.callers.rights import Grant, read_rights

__all__ = ["TokenFile", "default_token_file", "digest_of"]

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._@-]{0,63}")
_MOST_BYTES = 2**20
_MOST_TOKENS = 1000
_KEYS = {"name", "sha256", "rights", "maps", "made", "expires"}


def default_token_file() -> Path:
    """Where the command keeps tokens unless told otherwise."""
    base = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(base) / "raymap" / "tokens.json"


def digest_of(token: bytes) -> str:
    """SHA-256 of a token, in hexadecimal digits."""
    return hashlib.sha256(token).hexdigest()


class TokenFile:
    """A file of tokens; what a command changes in it holds at once for a running service.

    Parameters
    ----------
    path : of the file; it need not exist until a token is looked for
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._stamp: tuple[int, ...] | None = None
        self._known: dict[str, Grant] = {}
        self._lock = threading.Lock()

    # -- for the command -------------------------------------------------------------------------

    def add(
        self,
        name: str,
        rights: frozenset[str],
        *,
        maps: tuple[str, ...] | None = None,
        expires: float | None = None,
    ) -> str:
        """Make a token, and give it back: it is not kept, so this is the only time it is seen.

        Raises
        ------
        RayMapError
            The name is taken or no name, or the file cannot be written.
        """
        if not _NAME.fullmatch(name):
            raise RayMapError(
                f"{name!r} is no name of a token: letters, digits and ._@- are taken, 64 at most"
            )
        with self._changing() as rows:
            if any(row["name"] == name for row in rows):
                raise RayMapError(
                    f"there is a token {name!r} already: choose another name, or withdraw that one "
                    f"with `raymap token remove {name}`"
                )
            if len(rows) >= _MOST_TOKENS:
                raise RayMapError(f"{self.path} holds {len(rows)} tokens, at most {_MOST_TOKENS}")
            token = secrets.token_urlsafe(24)
            rows.append(
                {
                    "name": name,
                    "sha256": digest_of(token.encode()),
                    "rights": sorted(rights),
                    "maps": None if maps is None else list(maps),
                    "made": time.time(),
                    "expires": expires,
                }
            )
        return token

    def remove(self, name: str) -> None:
        """Withdraw a token.

        Raises
        ------
        RayMapError
            There is none of this name.
        """
        self.check()
        with self._changing() as rows:
            kept = [row for row in rows if row["name"] != name]
            if len(kept) == len(rows):
                known = ", ".join(row["name"] for row in rows) or "none"
                raise RayMapError(f"there is no token {name!r} in {self.path}; it holds {known}")
            rows[:] = kept

    def rows(self) -> list[dict[str, Any]]:
        """What is kept of each token, without the digest.

        Raises
        ------
        RayMapError
        """
        self.check()
        return [
            {key: value for key, value in row.items() if key != "sha256"} for row in self._read()
        ]

    @contextmanager
    def _changing(self) -> Iterator[list[dict[str, Any]]]:
        """The rows, written when the block ends; one command at a time."""
        if os.path.lexists(self.path.parent):
            check_place(self.path)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            handle = os.open(self.path.with_name(f".{self.path.name}.lock"), os.O_CREAT, 0o600)
        except OSError as error:
            raise RayMapError(f"{self.path} cannot be written: {error.strerror}") from None
        try:
            if not try_lock(handle):
                raise RayMapError(f"another command is changing {self.path}: try again")
            rows = self._read() if self.path.exists() else []
            yield rows
            text = json.dumps({"tokens": rows}, indent=1) + "\n"
            with replacing(self.path) as beside:
                # Nobody else may read it, not even while it is written
                beside.unlink(missing_ok=True)
                file = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
                with os.fdopen(file, "w", encoding="utf-8") as stream:
                    stream.write(text)
        finally:
            os.close(handle)

    # -- for the service -------------------------------------------------------------------------

    def check(self) -> None:
        """Refuse a file that is not there, not readable, or open to others.

        Raises
        ------
        RayMapError
        """
        if not self.path.exists():
            raise RayMapError(
                f"there is no file {self.path}: `raymap token add NAME --tokens {self.path}` "
                "makes it"
            )
        self._read()

    def find(self, digest: str) -> Grant | None:
        """What the token of a digest allows; None if it is unknown, withdrawn or out of time.

        A file that cannot be read any more allows nothing.
        """
        with self._lock:
            self._refresh()
            found = None
            for known, grant in self._known.items():
                # All are compared, in the same time each
                if secrets.compare_digest(known, digest):
                    found = grant
        if found is None or (found.expires is not None and time.time() >= found.expires):
            return None
        return found

    def _refresh(self) -> None:
        """Read the file again where it has changed."""
        try:
            state = self.path.stat()
            stamp = (state.st_ino, state.st_size, state.st_mtime_ns, state.st_mode)
            if stamp != self._stamp:
                self._known = {row["sha256"]: _grant(row) for row in self._read()}
                self._stamp = stamp
        except (OSError, RayMapError):
            self._known, self._stamp = {}, None

    def _read(self) -> list[dict[str, Any]]:
        """The rows of the file, each of them checked."""
        check_given(self.path, "file of tokens")
        try:
            with self.path.open("rb") as stream:
                mode = os.fstat(stream.fileno()).st_mode
                text = stream.read(_MOST_BYTES + 1)
        except OSError as error:
            raise RayMapError(not_readable(self.path, "file of tokens", error)) from None
        if mode & 0o077:
            raise RayMapError(
                f"{self.path} is open to other users of this machine: chmod 600 {self.path}"
            )
        try:
            rows = json.loads(text)["tokens"] if len(text) <= _MOST_BYTES else None
            if not isinstance(rows, list) or not all(map(_is_row, rows)):
                raise ValueError
        except (ValueError, KeyError, TypeError, RecursionError):
            raise RayMapError(
                f"{self.path} is no file of tokens as `raymap token add` writes it"
            ) from None
        return rows


def _is_row(row: Any) -> bool:
    """Whether a value of the file is what `TokenFile.add` puts there."""
    if not isinstance(row, dict) or set(row) != _KEYS:
        return False
    texts = [row["name"], row["sha256"]]
    lists = [row["rights"], [] if row["maps"] is None else row["maps"]]
    numbers = [row["made"], 0.0 if row["expires"] is None else row["expires"]]
    if not all(isinstance(value, int | float) and value >= 0 for value in numbers):
        return False
    if not all(isinstance(part, list) for part in lists):
        return False
    if not all(isinstance(text, str) for text in [*texts, *lists[0], *lists[1]]):
        return False
    try:
        read_rights(row["rights"])
    except RayMapError:
        return False
    return bool(_NAME.fullmatch(row["name"]) and re.fullmatch("[0-9a-f]{64}", row["sha256"]))


def _grant(row: dict[str, Any]) -> Grant:
    return Grant(
        name=row["name"],
        rights=read_rights(row["rights"]),
        maps=None if row["maps"] is None else tuple(row["maps"]),
        expires=row["expires"],
    )

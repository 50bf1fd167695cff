"""Who may ask: a token with every call, over TLS where the network is not this machine."""

from __future__ import annotations

import os
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow.flight as flight

from raymap.errors import RayMapError
from raymap.protocol import TOKEN_HEADER, TOKEN_VARIABLE, encode_error

__all__ = ["NoAccess", "Tls", "TokenCheck", "choose_token", "is_local"]

LEAST_TOKEN = 16


class NoAccess(RayMapError, PermissionError):
    """A call without the right token."""


@dataclass(frozen=True)
class Tls:
    """Certificate chain and private key, PEM."""

    certificate: bytes
    key: bytes

    @classmethod
    def read(cls, certificate: Path, key: Path) -> Tls:
        """Read both files.

        Raises
        ------
        RayMapError
        """
        parts = []
        for path in (certificate, key):
            try:
                parts.append(path.read_bytes())
            except OSError as error:
                raise RayMapError(f"{path} cannot be read: {error.strerror}") from None
            if b"-----BEGIN" not in parts[-1]:
                raise RayMapError(f"{path} is no PEM file: TLS takes certificate and key as PEM")
        return cls(*parts)


class TokenCheck(flight.ServerMiddlewareFactory):  # type: ignore[misc]
    """Turns away every call that does not carry the token."""

    def __init__(self, token: str) -> None:
        super().__init__()
        self._expected = f"Bearer {token}".encode()

    def start_call(self, info: Any, headers: Mapping[str, Sequence[Any]]) -> None:
        """Look at the headers of a call."""
        given = [
            value if isinstance(value, bytes) else str(value).encode()
            for name, values in headers.items()
            if name.lower() == TOKEN_HEADER
            for value in values
        ]
        if not any(secrets.compare_digest(value, self._expected) for value in given):
            error = NoAccess(
                "this service wants its token with every call, as the header "
                "'authorization: Bearer TOKEN'; `raymap serve` printed it"
            )
            raise flight.FlightUnauthenticatedError(str(error), encode_error(error))


def choose_token(file: Path | None) -> str:
    """The token of the environment or of a file, else a new one.

    Raises
    ------
    RayMapError
        It is too short to keep anybody out.
    """
    token = os.environ.get(TOKEN_VARIABLE, "")
    place = TOKEN_VARIABLE
    if file is not None:
        place = str(file)
        try:
            token = file.read_text(encoding="utf-8").strip()
        except (OSError, UnicodeDecodeError) as error:
            raise RayMapError(f"the token file {file} cannot be read: {error}") from None
    elif not token:
        return secrets.token_urlsafe(24)
    if len(token) < LEAST_TOKEN or not token.isascii() or not token.isprintable():
        raise RayMapError(
            f"the token in {place} is not {LEAST_TOKEN} or more plain ASCII characters; "
            "python -c 'import secrets; print(secrets.token_urlsafe())' makes one"
        )
    return token


def is_local(host: str) -> bool:
    """Whether a host name is this machine's own loop."""
    return host in ("localhost", "127.0.0.1", "::1", "[::1]")

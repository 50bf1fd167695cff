"""Who asks: a token with every call, over TLS where the network is not this machine."""

from __future__ import annotations

import os
import secrets
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow.flight as flight

from raymap.model.errors import RayMapError
from raymap.model.givenfile import given_bytes, given_text
from raymap.remote.protocol import TOKEN_HEADER, TOKEN_VARIABLE, encode_error
from service.callers.rights import EVERYTHING, Grant
from service.callers.tokens import TokenFile, digest_of

__all__ = ["Caller", "NoAccess", "Tls", "TokenCheck", "choose_token", "is_local"]

LEAST_TOKEN = 16
_BEARER = b"Bearer "
_MOST_HEADERS = 8
_LOOK_SECONDS = 1.0
"""How soon a running call ends whose token was withdrawn."""


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
            parts.append(given_bytes(path, "PEM file"))
            if b"-----BEGIN" not in parts[-1]:
                raise RayMapError(f"{path} is no PEM file: TLS takes certificate and key as PEM")
        return cls(*parts)


class Caller(flight.ServerMiddleware):  # type: ignore[misc]
    """Who makes a call: what the token allows, and whether it still does.

    Attributes
    ----------
    grant : what the token allowed when the call began
    """

    def __init__(self, grant: Grant, look: Callable[[], Grant | None]) -> None:
        super().__init__()
        self.grant = grant
        self._look = look
        self._next = time.monotonic() + _LOOK_SECONDS

    def valid(self) -> bool:
        """Whether the token was not withdrawn meanwhile, looked up once a second."""
        if time.monotonic() >= self._next:
            found = self._look()
            if found is None or found != self.grant:
                return False
            self._next = time.monotonic() + _LOOK_SECONDS
        return True


class TokenCheck(flight.ServerMiddlewareFactory):  # type: ignore[misc]
    """Turns away every call that does not carry a token.

    Parameters
    ----------
    token : that allows everything, or None for none
    tokens : further ones with their rights
    refused : told of each call that is turned away
    """

    def __init__(
        self, token: str | None, tokens: TokenFile | None, refused: Callable[[], None]
    ) -> None:
        super().__init__()
        # Only digests are held: a picture of the memory or a traceback shows no token
        self._all = None if token is None else digest_of(token.encode())
        self._tokens, self._refused = tokens, refused

    def start_call(self, info: Any, headers: Mapping[str, Sequence[Any]]) -> Caller:
        """Look at the headers of a call."""
        given = [
            value if isinstance(value, bytes) else str(value).encode()
            for name, values in headers.items()
            if name.lower() == TOKEN_HEADER
            for value in values
        ]
        for value in given[:_MOST_HEADERS]:
            if value.startswith(_BEARER):
                digest = digest_of(value[len(_BEARER) :])
                grant = self._grant(digest)
                if grant is not None:
                    return Caller(grant, partial(self._grant, digest))
        self._refused()
        error = NoAccess(
            "this service wants its token with every call, as the header "
            "'authorization: Bearer TOKEN'; `raymap serve` or `raymap token add` printed it"
        )
        raise flight.FlightUnauthenticatedError(str(error), encode_error(error))

    def _grant(self, digest: str) -> Grant | None:
        """What the token of a digest allows now."""
        if self._all is not None and secrets.compare_digest(digest, self._all):
            return EVERYTHING
        return None if self._tokens is None else self._tokens.find(digest)


def choose_token(file: Path | None, *, invent: bool = True) -> str | None:
    """The token that allows everything: of a file or of the environment, else a new one.

    Parameters
    ----------
    file : that holds it
    invent : make a new one where none is given

    Raises
    ------
    RayMapError
        It is too short to keep anybody out.
    """
    token = os.environ.get(TOKEN_VARIABLE, "")
    place = TOKEN_VARIABLE
    if file is not None:
        place = str(file)
        token = given_text(file, "token file").strip()
    elif not token:
        return secrets.token_urlsafe(24) if invent else None
    if len(token) < LEAST_TOKEN or not token.isascii() or not token.isprintable():
        raise RayMapError(
            f"the token in {place} is not {LEAST_TOKEN} or more plain ASCII characters; "
            "python -c 'import secrets; print(secrets.token_urlsafe())' makes one"
        )
    return token


def is_local(host: str) -> bool:
    """Whether a host name is this machine's own loop."""
    return host in ("localhost", "127.0.0.1", "::1", "[::1]")

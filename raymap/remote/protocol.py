"""What client and service agree on: the version, the token's header, errors on the wire."""

from __future__ import annotations

import json

from raymap.model import errors
from raymap.model.errors import RayMapError

__all__ = [
    "ADDRESS_VARIABLE",
    "PROTOCOL",
    "TOKEN_HEADER",
    "TOKEN_VARIABLE",
    "ServiceError",
    "decode_error",
    "encode_error",
]

PROTOCOL = 1
TOKEN_HEADER = "authorization"
TOKEN_VARIABLE = "RAYMAP_TOKEN"
ADDRESS_VARIABLE = "RAYMAP_SERVICE"


class ServiceError(RayMapError):
    """What a service refused; ``kind`` is the name of the error there."""

    kind = "ServiceError"


def encode_error(error: RayMapError) -> bytes:
    """The details that go with a failed call, as JSON."""
    kind = next(
        (base.__name__ for base in type(error).__mro__ if hasattr(errors, base.__name__)),
        "RayMapError",
    )
    return json.dumps({"kind": kind, "error": type(error).__name__, "message": str(error)}).encode()


def decode_error(details: bytes, message: str) -> RayMapError:
    """The error of a failed call: of the same class as on the other side, if it is known here."""
    try:
        found = json.loads(details)
        kind, name, text = (str(found[key]) for key in ("kind", "error", "message"))
    except (ValueError, KeyError, TypeError):
        return ServiceError(message.partition(". gRPC client debug")[0])
    chosen = getattr(errors, kind, None) if kind in errors.__all__ else None
    if chosen is None or chosen is RayMapError:
        other = ServiceError(text)
        other.kind = name
        return other
    return chosen(text)  # type: ignore[no-any-return]

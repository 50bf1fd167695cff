"""A client of gRPC made by hand, which need not keep any of its rules.

References
----------
RFC 9113 (HTTP/2), section 4.1: frames; RFC 7541 (HPACK), section 6.2.2: literal header fields.
"""

from __future__ import annotations

import json
import socket
import time
from typing import Any

PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"
DATA, HEADERS, RESET, SETTINGS, WINDOW_UPDATE, CONTINUATION = 0, 1, 3, 4, 8, 9
END_STREAM, END_HEADERS = 1, 4
_SERVICE = "/arrow.flight.protocol.FlightService/"
_INITIAL_WINDOW_SIZE = 4
_WIDEST = 2**31 - 1


def frame(kind: int, flags: int, stream: int, payload: bytes = b"") -> bytes:
    """A frame."""
    head = len(payload).to_bytes(3, "big") + bytes([kind, flags]) + stream.to_bytes(4, "big")
    return head + payload


def message(size: int, sent: bytes, flag: int = 0) -> bytes:
    """The beginning of a gRPC message: flag, length, and what is sent of it."""
    return bytes([flag]) + size.to_bytes(4, "big") + sent


def greeting() -> bytes:
    """Preface and settings of a client that says it takes everything."""
    widest = _INITIAL_WINDOW_SIZE.to_bytes(2, "big") + _WIDEST.to_bytes(4, "big")
    more = (_WIDEST - 65535).to_bytes(4, "big")
    return PREFACE + frame(SETTINGS, 0, 0, widest) + frame(WINDOW_UPDATE, 0, 0, more)


def headers(method: str, token: str | None) -> bytes:
    """The headers of a call, each of them spelt out."""
    fields = {
        ":method": "POST", ":scheme": "http", ":path": _SERVICE + method, ":authority": "localhost",
        "te": "trailers", "content-type": "application/grpc", "user-agent": "by-hand",
    }  # fmt: skip
    if token is not None:
        fields["authorization"] = f"Bearer {token}"
    return b"".join(
        b"\0" + _text(name.encode()) + _text(value.encode()) for name, value in fields.items()
    )


def ticket(fields: dict[str, Any]) -> bytes:
    """The protocol buffer ``Ticket { bytes ticket = 1; }``."""
    content = json.dumps(fields).encode()
    return b"\x0a" + _varint(len(content)) + content


def asks(method: str, token: str | None, content: bytes, stream: int = 1) -> bytes:
    """A whole request."""
    return frame(HEADERS, END_HEADERS, stream, headers(method, token)) + frame(
        DATA, END_STREAM, stream, message(len(content), content)
    )


def connect(address: str, *, narrow: bool = False, seconds: float = 20.0) -> socket.socket:
    """A connection; a narrow one takes little into the system's own buffers."""
    host, _, port = address.partition("://")[2].rpartition(":")
    made = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    if narrow:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    made.settimeout(seconds)
    try:
        made.connect(("127.0.0.1" if host == "localhost" else host, int(port)))
    except OSError:
        made.close()
        raise
    return made


def take_all(made: socket.socket, seconds: float) -> tuple[int, bool]:
    """Bytes that come until the other side ends it, and whether it does within some seconds."""
    end, taken = time.monotonic() + seconds, 0
    made.settimeout(1.0)
    while time.monotonic() < end:
        try:
            part = made.recv(2**20)
        except TimeoutError:
            continue
        except OSError:
            return taken, True
        if not part:
            return taken, True
        taken += len(part)
    return taken, False


def _text(value: bytes) -> bytes:
    return _integer(len(value), 7) + value


def _integer(value: int, bits: int) -> bytes:
    """RFC 7541, section 5.1."""
    most = 2**bits - 1
    return bytes([value]) if value < most else bytes([most]) + _varint(value - most)


def _varint(value: int) -> bytes:
    parts = []
    while value > 127:
        parts.append(value & 127 | 128)
        value >>= 7
    return bytes([*parts, value])

"""The front of the service: bytes of the network pass only in bounded messages, streams and time.

Flight's own server takes messages of any size before anybody asks for a token, and waits for ever
for readers that do not read. So it listens at a socket of this user alone, and the front stands
before it. It ends TLS, and reads as much of HTTP/2 (RFC 9113, section 4.1: frames; 6.5.2:
settings) and of gRPC (five bytes before each message: a flag, the length) as it takes to count;
it alters nothing but how many streams the server's settings allow. Headers are not looked at.
"""

from __future__ import annotations

import asyncio
import errno
import socket
import ssl
import struct
import tempfile
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from raymap.model.errors import RayMapError
from service.callers.access import Tls
from service.limits import Limits

__all__ = ["Front", "Refused", "Sieve", "Streams", "is_possible"]

_PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"
_HEADER, _MESSAGE, _GOODBYE = 9, 5, 8
_DATA, _HEADERS, _RESET, _SETTINGS, _GOAWAY, _CONTINUATION = 0, 1, 3, 4, 7, 9
_END_STREAM, _ACK, _END_HEADERS, _PADDED = 1, 1, 4, 8
_MOST_HEADERS = 2**16
"""Bytes of the headers of a request, their frames included; gRPC takes a quarter of it."""

_MAX_CONCURRENT_STREAMS = 3
_ENHANCE_YOUR_CALM = 11
_CHUNK = 2**17
_HELLO_SECONDS = 10.0
_TRIES = 20


def is_possible() -> bool:
    """Whether this system has sockets that only their user reaches (Windows has not for gRPC)."""
    return hasattr(socket, "AF_UNIX") and hasattr(asyncio, "open_unix_connection")


class Refused(RayMapError):
    """A connection that asks for more than it may have."""


@dataclass
class Streams:
    """The streams of a connection that neither side has ended.

    Attributes
    ----------
    opened : which sides have ended each of them
    owed : since when the client owes the end of a message, or of the stream [s]
    asked : whether any request ever came to its end
    given_up : requests that the client gave up lately
    """

    most: int
    opened: dict[int, set[str]] = field(default_factory=dict)
    owed: dict[int, float] = field(default_factory=dict)
    asked: bool = False
    given_up: float = 0.0
    _looked: float = field(default_factory=time.monotonic)

    def open(self, stream: int) -> None:
        """The client opens a stream.

        Raises
        ------
        Refused
            It has too many already.
        """
        if stream not in self.opened:
            if len(self.opened) >= self.most:
                raise Refused(f"more than {self.most} requests at a time on one connection")
            self.opened[stream] = set()
            self.owed[stream] = time.monotonic()

    def hear(self, stream: int) -> None:
        """A message of the client came to its end."""
        if stream in self.owed:
            self.owed[stream] = time.monotonic()

    def wait(self, seconds: float) -> None:
        """The client had to wait for so long."""
        for stream in self.owed:
            self.owed[stream] += seconds

    def overdue(self, seconds: float) -> bool:
        """Whether the client owes something for longer than that."""
        return bool(self.owed) and min(self.owed.values()) < time.monotonic() - seconds

    def end(self, stream: int, side: str) -> None:
        """One side has said all that it had to say."""
        ended = self.opened.get(stream)
        if ended is not None:
            ended.add(side)
            if side == "client":
                self.owed.pop(stream, None)
                self.asked = True
            if len(ended) == 2:
                self.reset(stream)

    def give_up(self, stream: int) -> None:
        """The client gives up what it asked, which the server has begun to work at.

        Twice as many as it may ask at a time pass at once, and then as many in each second.

        Raises
        ------
        Refused
            It begins and gives up so fast that this is all that the server would do.
        """
        if stream in self.opened:
            now = time.monotonic()
            self.given_up = max(0.0, self.given_up - self.most * (now - self._looked)) + 1.0
            self._looked = now
            if self.given_up > 2 * self.most:
                raise Refused("too many requests are begun and given up")
        self.reset(stream)

    def reset(self, stream: int) -> None:
        """A side has given a stream up."""
        self.opened.pop(stream, None)
        self.owed.pop(stream, None)


class Total:
    """Bytes of unfinished messages of all connections together."""

    def __init__(self, most: int) -> None:
        self.most, self.taken = most, 0


class Sieve:
    """Counts what comes from a client.

    Parameters
    ----------
    streams : of the connection
    most : bytes of one message
    total : of unfinished messages of all connections
    """

    def __init__(self, streams: Streams, most: int, total: Total) -> None:
        self.streams, self.most, self.total = streams, most, total
        self._frames = Frames()
        self._prefaces = len(_PREFACE)
        self._goodbye = 0
        self._headers = 0
        self._messages: dict[int, _Message] = {}

    def take(self, data: bytes) -> None:
        """Look at bytes before they are passed on.

        Raises
        ------
        Refused
            A message is too large, or what comes is no HTTP/2.
        """
        if self._prefaces:
            part = data[: self._prefaces]
            if part != _PREFACE[len(_PREFACE) - self._prefaces :][: len(part)]:
                raise Refused("this is no gRPC")
            self._prefaces -= len(part)
            data = data[len(part) :]
        for kind, flags, stream, payload, last in self._frames.take(data):
            if kind == _HEADERS:
                self.streams.open(stream)
            if kind in (_HEADERS, _CONTINUATION):
                self._count_headers(payload, flags, last)
            elif kind == _RESET:
                self._forget(stream)
                self.streams.give_up(stream)
                continue
            elif kind == _DATA:
                self._data(stream, flags, payload)
            elif kind == _GOAWAY:
                self._hear_goodbye(payload, last)
            if last and kind in (_DATA, _HEADERS) and flags & _END_STREAM:
                self._forget(stream)
                self.streams.end(stream, "client")

    def close(self) -> None:
        """The connection is gone."""
        for stream in list(self._messages):
            self._forget(stream)

    def _count_headers(self, payload: bytes, flags: int, last: bool) -> None:
        """Headers may go on in as many frames as a client likes, empty ones among them."""
        self._headers += len(payload) + _HEADER * last
        if self._headers > _MOST_HEADERS:
            raise Refused(f"headers of more than {_MOST_HEADERS} bytes are not taken")
        if last and flags & _END_HEADERS:
            self._headers = 0

    def _hear_goodbye(self, payload: bytes, last: bool) -> None:
        """The text of a GOAWAY stands in the server's log: it may not act on a terminal."""
        text = payload[max(0, _GOODBYE - self._goodbye) :]
        self._goodbye = 0 if last else self._goodbye + len(payload)
        if any(not 32 <= byte < 127 for byte in text):
            raise Refused("this goodbye is no plain text")

    def _data(self, stream: int, flags: int, payload: bytes) -> None:
        if flags & _PADDED:
            raise Refused("padded frames are not taken")
        if stream not in self.streams.opened:
            return
        message = self._messages.setdefault(stream, _Message())
        for size in message.take(payload):
            if size > self.most:
                raise Refused(f"a message of {size} bytes; at most {self.most} are taken at a time")
            self._count(message, size)
        if not message.left:
            self._count(message, 0)
            self.streams.hear(stream)

    def _count(self, message: _Message, size: int) -> None:
        self.total.taken += size - message.counted
        message.counted = size
        if self.total.taken > self.total.most:
            raise Refused("too many large messages at a time: ask again later")

    def _forget(self, stream: int) -> None:
        message = self._messages.pop(stream, None)
        if message is not None:
            self._count(message, 0)


class _Message:
    """Where a stream stands within a gRPC message."""

    def __init__(self) -> None:
        self._head = b""
        self.left = 0
        self.counted = 0

    def take(self, payload: bytes) -> list[int]:
        """Sizes of the messages that begin."""
        begun, at = [], 0
        while at < len(payload):
            if self.left:
                step = min(self.left, len(payload) - at)
                self.left -= step
            else:
                step = min(_MESSAGE - len(self._head), len(payload) - at)
                self._head += payload[at : at + step]
                if len(self._head) == _MESSAGE:
                    if self._head[0]:
                        # What it unpacks to, nobody knows before it is unpacked
                        raise Refused("compressed messages are not taken")
                    self.left = int.from_bytes(self._head[1:], "big")
                    begun.append(self.left)
                    self._head = b""
            at += step
        return begun


class Frames:
    """Splits bytes into frames, in whatever pieces they come."""

    def __init__(self) -> None:
        self._head = b""
        self._frame = (0, 0, 0)
        self._left = 0

    @property
    def at_boundary(self) -> bool:
        """Whether the last frame is complete."""
        return not self._head and not self._left

    def take(self, data: bytes) -> list[tuple[int, int, int, bytes, bool]]:
        """(kind, flags, stream, part of the payload, whether it is the last part) of each frame."""
        found, at = [], 0
        while at < len(data):
            if not self._left:
                step = min(_HEADER - len(self._head), len(data) - at)
                self._head += data[at : at + step]
                at += step
                if len(self._head) < _HEADER:
                    break
                self._left = int.from_bytes(self._head[:3], "big")
                stream = int.from_bytes(self._head[5:], "big") & 0x7FFFFFFF
                self._frame = (self._head[3], self._head[4], stream)
                self._head = b""
                if not self._left:
                    found.append((*self._frame, b"", True))
                continue
            part = data[at : at + self._left]
            at += len(part)
            self._left -= len(part)
            found.append((*self._frame, part, not self._left))
        return found


class _Answers:
    """Counts what the server answers, and says in its settings how many streams there may be."""

    def __init__(self, streams: Streams) -> None:
        self.streams = streams
        self.frames = Frames()
        self._begun = b""
        self._settled = False

    def take(self, data: bytes) -> bytes:
        """The bytes to pass on."""
        if not self._settled:
            self._begun += data
            if len(self._begun) < _HEADER:
                return b""
            size = int.from_bytes(self._begun[:3], "big")
            if len(self._begun) < _HEADER + size:
                return b""
            data = self._with_setting(size)
            self._settled, self._begun = True, b""
        for kind, flags, stream, _, last in self.frames.take(data):
            if kind == _RESET:
                self.streams.reset(stream)
            elif last and kind in (_DATA, _HEADERS) and flags & _END_STREAM:
                self.streams.end(stream, "server")
        return data

    def _with_setting(self, size: int) -> bytes:
        """The server's first frame, with one setting more."""
        if self._begun[3] != _SETTINGS or self._begun[4] & _ACK:
            return self._begun
        setting = struct.pack(">HI", _MAX_CONCURRENT_STREAMS, self.streams.most)
        head = (size + len(setting)).to_bytes(3, "big") + self._begun[3:_HEADER]
        return (
            head + self._begun[_HEADER : _HEADER + size] + setting + self._begun[_HEADER + size :]
        )


@dataclass(eq=False)
class _Connection:
    """One client's connection."""

    streams: Streams
    writer: asyncio.StreamWriter
    used: float = field(default_factory=time.monotonic)


class Front:
    """Listens for clients, and passes what is bounded on to a socket of this user.

    Parameters
    ----------
    host, port : where to listen; port 0 takes a free one
    tls : certificate and key
    limits : of messages, streams, connections and time
    """

    def __init__(self, host: str, port: int, tls: Tls | None, limits: Limits) -> None:
        self.limits = limits
        self._folder = tempfile.TemporaryDirectory(prefix="raymap-")
        self.inner = Path(self._folder.name) / "flight"
        self._context = None if tls is None else _context(tls, Path(self._folder.name))
        self._total = Total(limits.incoming_bytes)
        self._connections: set[_Connection] = set()
        self._loop = asyncio.new_event_loop()
        self._sockets = _listen(host, port)
        self.port = int(self._sockets[0].getsockname()[1])
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run, name="front", daemon=True)

    def start(self) -> None:
        """Begin to take connections; `inner` is listened at by then."""
        self._thread.start()
        self._ready.wait(10.0)

    def stop(self) -> None:
        """Take no connections any more, and end those that there are."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join(10.0)
        for each in self._sockets:
            each.close()
        self._folder.cleanup()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        servers = [
            self._loop.run_until_complete(
                asyncio.start_server(self._serve, sock=each, limit=_CHUNK)
            )
            for each in self._sockets
        ]
        self._ready.set()
        self._loop.run_forever()
        for server in servers:
            server.close()
        tasks = asyncio.all_tasks(self._loop)
        for task in tasks:
            task.cancel()
        self._loop.run_until_complete(asyncio.gather(*tasks, return_exceptions=True))
        self._loop.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """One connection, until a side ends it or asks for too much."""
        streams = Streams(self.limits.connection_requests)
        sieve = Sieve(streams, self.limits.message_bytes, self._total)
        own = _Connection(streams, writer)
        if not self._admitted(own):
            writer.transport.abort()
            return
        answers, inner = _Answers(streams), None
        try:
            if self._context is not None:
                # Only now: whoever begins TLS takes one of the places, and no other
                reader, writer = await _secured(self._context, writer)
                own.writer = writer
            # Who says nothing gets no place at the server
            async with asyncio.timeout(_HELLO_SECONDS):
                first = await reader.read(_CHUNK)
            sieve.take(first)
            back, inner = await asyncio.open_unix_connection(str(self.inner), limit=_CHUNK)
            inner.write(first)
            tasks = [
                asyncio.ensure_future(self._inward(own, reader, inner, sieve)),
                asyncio.ensure_future(self._outward(own, back, writer, answers)),
            ]
            for task in tasks:
                task.add_done_callback(_look_at)
            done, rest = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            inner.transport.abort()
            for task in rest:
                task.cancel()
            for task in done:
                task.result()
        except asyncio.CancelledError:
            # The front stops; the stream's own callback would print what is no failure
            pass
        except Refused as error:
            await _go_away(writer, answers, str(error))
        except (TimeoutError, OSError, asyncio.IncompleteReadError):
            pass
        finally:
            self._connections.discard(own)
            sieve.close()
            for each in (writer, inner):
                if each is not None:
                    each.transport.abort()

    def _admitted(self, own: _Connection) -> bool:
        """Take a connection in; where there are too many, one that asks nothing has to go."""
        if len(self._connections) >= self.limits.connections:
            # Who never asked to the end may be anybody; what is asked has a token or has ended
            idle = [each for each in self._connections if not each.streams.opened]
            unheard = [each for each in self._connections if not each.streams.asked]
            if not idle and not unheard:
                return False
            oldest = min(idle or unheard, key=lambda each: each.used)
            self._connections.discard(oldest)
            oldest.writer.transport.abort()
        self._connections.add(own)
        return True

    async def _inward(
        self, own: _Connection, reader: asyncio.StreamReader, inner: asyncio.StreamWriter,
        sieve: Sieve,
    ) -> None:  # fmt: skip
        while data := await self._heard(own, reader):
            own.used = time.monotonic()
            sieve.take(data)
            inner.write(data)
            began = time.monotonic()
            await inner.drain()
            # What the server takes its time for, the client does not owe
            own.streams.wait(time.monotonic() - began)

    async def _heard(self, own: _Connection, reader: asyncio.StreamReader) -> bytes:
        """What comes next; a client that owes something may not let others wait for ever."""
        while True:
            with suppress(TimeoutError):
                async with asyncio.timeout(self.limits.stall_seconds / 4):
                    data = await reader.read(_CHUNK)
                    break
            self._check_owed(own)
        self._check_owed(own)
        return data

    def _check_owed(self, own: _Connection) -> None:
        if own.streams.overdue(self.limits.stall_seconds):
            raise Refused(
                f"a message, or a request, did not come to its end within "
                f"{self.limits.stall_seconds:g} s"
            )

    async def _outward(
        self, own: _Connection, back: asyncio.StreamReader, writer: asyncio.StreamWriter,
        answers: _Answers,
    ) -> None:  # fmt: skip
        writer.transport.set_write_buffer_limits(high=_CHUNK)
        while data := await back.read(_CHUNK):
            own.used = time.monotonic()
            writer.write(answers.take(data))
            # A reader that does not read keeps what the server has prepared for it
            async with asyncio.timeout(self.limits.stall_seconds):
                await writer.drain()


def _look_at(task: asyncio.Task[None]) -> None:
    """Take an end that nobody else asks for any more."""
    if not task.cancelled():
        task.exception()


async def _go_away(writer: asyncio.StreamWriter, answers: _Answers, text: str) -> None:
    """Say why, if no frame is under way."""
    if not answers.frames.at_boundary:
        return
    payload = struct.pack(">II", 2**31 - 1, _ENHANCE_YOUR_CALM) + text.encode()
    with suppress(OSError):
        writer.write(len(payload).to_bytes(3, "big") + bytes([_GOAWAY, 0, 0, 0, 0, 0]) + payload)
        async with asyncio.timeout(1.0):
            await writer.drain()
        # Let it arrive before the connection is cut
        await asyncio.sleep(0.1)


async def _secured(
    context: ssl.SSLContext, writer: asyncio.StreamWriter
) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    """The streams inside of TLS, when its handshake has ended.

    Raises
    ------
    OSError
        It did not end, or the client speaks no TLS.
    """
    loop = asyncio.get_running_loop()
    reader = asyncio.StreamReader(limit=_CHUNK, loop=loop)
    protocol = asyncio.StreamReaderProtocol(reader, loop=loop)
    secured = await loop.start_tls(
        writer.transport, protocol, context, server_side=True,
        ssl_handshake_timeout=_HELLO_SECONDS,
    )  # fmt: skip
    if secured is None:
        raise ConnectionResetError
    protocol.connection_made(secured)
    return reader, asyncio.StreamWriter(secured, protocol, reader, loop)


def _context(tls: Tls, folder: Path) -> ssl.SSLContext:
    """TLS as gRPC speaks it; the module reads certificates from files only."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    places = folder / "certificate", folder / "key"
    try:
        for path, content in zip(places, (tls.certificate, tls.key), strict=True):
            path.touch(mode=0o600)
            path.write_bytes(content)
        context.load_cert_chain(*places)
    except (ssl.SSLError, OSError) as error:
        raise RayMapError(f"the certificate and key cannot be used for TLS: {error}") from None
    finally:
        for path in places:
            path.unlink(missing_ok=True)
    context.set_alpn_protocols(["h2"])
    return context


def _listen(host: str, port: int) -> list[socket.socket]:
    """Sockets at all addresses of a host, at one port.

    Raises
    ------
    OSError
        They cannot be had.
    """
    found = socket.getaddrinfo(
        host.strip("[]"), port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
    )
    addresses = dict.fromkeys((family, address) for family, _, _, _, address in found)
    for tries_left in range(_TRIES if port == 0 else 1, 0, -1):
        sockets: list[socket.socket] = []
        try:
            for family, address in addresses:
                chosen = sockets[0].getsockname()[1] if sockets else port
                with suppress(_NoSuchAddress):
                    sockets.append(_listen_at(family, (address[0], chosen, *address[2:])))
            if sockets:
                return sockets
            raise OSError("no address of it can be listened at")
        except OSError as error:
            # A free port of one kind of address may be taken at the other: by whom tokens would
            # be seen, if clients came to it
            for each in sockets:
                each.close()
            if error.errno != errno.EADDRINUSE or tries_left == 1:
                raise
    raise AssertionError("unreachable")


class _NoSuchAddress(Exception):
    """The system has no addresses of this kind switched on."""


def _listen_at(family: int, address: tuple[object, ...]) -> socket.socket:
    try:
        one = socket.socket(family, socket.SOCK_STREAM)
    except OSError:
        raise _NoSuchAddress from None
    try:
        if family == socket.AF_INET6:
            one.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        one.bind(address)
        one.listen(64)
    except OSError as error:
        one.close()
        if error.errno == errno.EADDRNOTAVAIL:
            raise _NoSuchAddress from None
        raise
    return one

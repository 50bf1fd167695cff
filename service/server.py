"""The Arrow Flight server: calls in, answers or one clear error out; it outlives every request."""

from __future__ import annotations

import json
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.flight as flight

import raymap
from raymap.errors import RayMapError
from raymap.protocol import PROTOCOL, encode_error
from service.access import Tls, TokenCheck, is_local
from service.applications import Applications
from service.confine import ServedFolder
from service.library import Library
from service.limits import Busy, Gate, Limits, OutOfTime
from service.questions import Questions
from service.recording import record_events
from service.requests import BadRequest, Request
from service.streams import STREAMS, Answer, Streams
from service.uploads import take_file

__all__ = ["RaymapService", "serve"]

ACTIONS = {
    "hello": "version, actions and limits of the service",
    "files": "maps, folders and scenes of the served folder",
    "scene": "read and check a scene; its sources, objects, faces, detectors",
    "record": "trace a scene into a map; progress, then the result",
    "describe": "what a map holds",
    "criterion": "read a criterion; its text and its JSON",
    "count": "how many rays satisfy a criterion, and their flux",
    "report": "everything that is recorded of one ray",
    "view": "open the application for the user",
    "drawn": "criterion and detector region as the user has drawn them",
    "close_view": "close an application",
}

_LONGEST_MESSAGE = 1500


class RaymapService(flight.FlightServerBase):  # type: ignore[misc]
    """Serves one folder.

    Parameters
    ----------
    folder : whose maps and scenes are served
    token : that every call must carry
    host, port : where to listen; port 0 takes a free one
    tls : certificate and key; without them only this machine is served
    without_tls : serve other machines without TLS all the same
    limits : what requests may cost
    threads : of a search or a recording; all processors by default
    browser : clients may open a browser on this machine

    Raises
    ------
    RayMapError
        The folder does not exist, the port is taken, or the host needs TLS.
    """

    def __init__(
        self,
        folder: str | Path,
        token: str,
        *,
        host: str = "localhost",
        port: int = 0,
        tls: Tls | None = None,
        without_tls: bool = False,
        limits: Limits | None = None,
        threads: int | None = None,
        browser: bool = True,
    ) -> None:
        if tls is None and not is_local(host) and not without_tls:
            raise RayMapError(
                f"{host!r} is reached from other machines: give --tls-certificate and --tls-key "
                "(or --without-tls, where something else keeps the line private)"
            )
        self.limits = limits or Limits()
        self.folder = ServedFolder(folder)
        self.library = Library(self.folder, self.limits.maps)
        self.threads = threads
        searches = Gate(self.limits.searches, self.limits.turn_seconds, "searches")
        self._recordings = Gate(self.limits.recordings, self.limits.turn_seconds, "recordings")
        self._questions = Questions(self.folder, self.library, searches, threads)
        self._streams = Streams(self.library, searches, threads)
        self.applications = Applications(self.library, self.limits, browser=browser)
        self._scheme = "grpc" if tls is None else "grpc+tls"
        self._host = host
        certificates = None if tls is None else [(tls.certificate, tls.key)]
        try:
            super().__init__(
                f"{self._scheme}://{host}:{port}",
                tls_certificates=certificates,
                middleware={"token": TokenCheck(token)},
            )
        except (pa.ArrowException, OSError) as error:
            line = str(error).splitlines()[0]
            raise RayMapError(
                f"cannot serve at {host}:{port} ({line}); choose another with --port"
            ) from None

    @property
    def address(self) -> str:
        """What clients connect to."""
        return f"{self._scheme}://{self._host}:{self.port}"

    def close(self) -> None:
        """End all applications and close all maps; call it after `shutdown`."""
        self.applications.close()
        self.library.close()

    # -- calls ---------------------------------------------------------------------------------

    def list_actions(self, context: Any) -> list[tuple[str, str]]:
        """Names of the actions, each with a line about it."""
        return list(ACTIONS.items())

    def do_action(self, context: Any, action: Any) -> Iterator[bytes]:
        """Answer with JSON objects: one, or several while something runs."""
        try:
            for answer in self._act(action.type, action.body, context.is_cancelled):
                yield json.dumps(answer, default=_plain).encode()
        except GeneratorExit:
            raise
        except BaseException as error:
            raise _refusal(error, self.folder) from None

    def _act(self, kind: str, body: Any, gone: Callable[[], bool]) -> Iterator[dict[str, Any]]:
        if kind not in ACTIONS:
            raise BadRequest(f"there is no action {kind[:40]!r}; there are {', '.join(ACTIONS)}")
        request = Request(_bytes(body, self.limits), self.limits, kind)
        if kind == "record":
            yield from record_events(request, self.folder, self._recordings, self.threads, gone)
        elif kind == "hello":
            request.finish()
            yield self._hello()
        elif kind == "view":
            yield self.applications.open(request)
        elif kind == "drawn":
            yield self.applications.drawn(request, gone)
        elif kind == "close_view":
            yield self.applications.close_view(request)
        else:
            yield getattr(self._questions, kind)(request, gone)

    def _hello(self) -> dict[str, Any]:
        return {
            "service": "raymap",
            "protocol": PROTOCOL,
            "version": raymap.__version__,
            "folder": self.folder.root.name,
            "actions": list(ACTIONS),
            "streams": list(STREAMS),
            "limits": dict(vars(self.limits)),
        }

    def do_get(self, context: Any, ticket: Any) -> Any:
        """Stream what a ticket asks for."""
        try:
            answer = self._answer(ticket.ticket, context.is_cancelled)
        except BaseException as error:
            raise _refusal(error, self.folder) from None
        return flight.GeneratorStream(answer.schema, self._checked(answer.batches))

    def _answer(self, body: Any, gone: Callable[[], bool]) -> Answer:
        return self._streams.answer(Request(_bytes(body, self.limits), self.limits, "get"), gone)

    def _checked(self, batches: Iterator[pa.RecordBatch]) -> Iterator[pa.Table]:
        """The batches as tables: only so does Flight send their dictionaries of names along."""
        try:
            for batch in batches:
                yield pa.Table.from_batches([batch])
        except GeneratorExit:
            raise
        except BaseException as error:
            raise _refusal(error, self.folder) from None

    def get_flight_info(self, context: Any, descriptor: Any) -> Any:
        """Schema and ticket of a request that stands in the descriptor's command."""
        try:
            body = _bytes(descriptor.command or b"", self.limits)
            schema = self._answer(body, context.is_cancelled).schema
        except BaseException as error:
            raise _refusal(error, self.folder) from None
        endpoint = flight.FlightEndpoint(flight.Ticket(body), [])
        return flight.FlightInfo(schema, descriptor, [endpoint], -1, -1)

    def list_flights(self, context: Any, criteria: bytes) -> Iterator[Any]:
        """The maps of the folder, each as the flight of all its segments."""
        try:
            request = Request(b"", self.limits, "files")
            rows = self._questions.files(request, context.is_cancelled)["files"]
            names = [row["name"] for row in rows if row["kind"] == "map"]
        except BaseException as error:
            raise _refusal(error, self.folder) from None
        for name in names:
            command = json.dumps({"get": "rays", "map": name}).encode()
            try:
                schema = self._answer(command, context.is_cancelled).schema
            except RayMapError:
                continue
            descriptor = flight.FlightDescriptor.for_command(command)
            endpoint = flight.FlightEndpoint(flight.Ticket(command), [])
            yield flight.FlightInfo(schema, descriptor, [endpoint], -1, -1)

    def do_put(self, context: Any, descriptor: Any, reader: Any, writer: Any) -> None:
        """Take a file into the folder."""
        try:
            body = _bytes(descriptor.command or b"", self.limits)
            target = take_file(Request(body, self.limits, "upload"), self.folder, reader)
            answer = {"file": self.folder.shown(target), "bytes": target.stat().st_size}
            writer.write(json.dumps(answer).encode())
        except BaseException as error:
            raise _refusal(error, self.folder) from None


def serve(service: RaymapService) -> None:
    """Serve until Ctrl-C, or until the service is shut down."""
    try:
        service.serve()
    finally:
        service.shutdown()
        service.close()


def _bytes(body: Any, limits: Limits) -> bytes:
    """The bytes of a body, not copied where they are too many."""
    size = len(body) if isinstance(body, bytes) else body.size
    if size > limits.request_bytes:
        raise BadRequest(f"the request has {size} bytes, at most {limits.request_bytes} are taken")
    return body if isinstance(body, bytes) else bytes(body.to_pybytes())


def _refusal(error: BaseException, folder: ServedFolder) -> Exception:
    """The error of a call as Flight sends it: one message, and its kind as JSON."""
    if isinstance(error, flight.FlightError):
        return error  # type: ignore[no-any-return]
    if isinstance(error, RayMapError):
        text = _shortened(folder.plain(str(error)))
        known = type(error)(text)
        kinds = {OutOfTime: flight.FlightTimedOutError, Busy: flight.FlightUnavailableError}
        chosen = kinds.get(type(error), flight.FlightServerError)
        return chosen(text, encode_error(known))  # type: ignore[no-any-return]
    # A mistake of the service itself: its own people see where, the client that it happened
    trace = "".join(traceback.format_exception(error))
    print(f"in {threading.current_thread().name}:\n{trace}", file=sys.stderr, flush=True)
    text = f"the service failed at this request ({type(error).__name__}); it goes on"
    return flight.FlightInternalError(text, encode_error(RayMapError(text)))  # type: ignore[no-any-return]


def _shortened(text: str) -> str:
    """A message that fits the headers of a call, in which Flight sends it."""
    # Headers spell letters beyond ASCII with up to twelve bytes each, twice
    most = _LONGEST_MESSAGE if text.isascii() else _LONGEST_MESSAGE // 4
    return text if len(text) <= most else text[:most] + "…"


def _plain(value: Any) -> Any:
    """NumPy numbers and arrays as JSON has them."""
    return value.tolist() if hasattr(value, "tolist") else str(value)

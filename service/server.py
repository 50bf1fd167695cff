"""The Arrow Flight server: calls in, answers or one clear error out; it outlives every request."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.flight as flight

import raymap
from raymap.model.errors import RayMapError
from raymap.remote.protocol import PROTOCOL, encode_error
from service.answers.applications import Applications
from service.answers.questions import Questions
from service.answers.recording import Recorder
from service.answers.requests import BadRequest, Request
from service.answers.streams import STREAMS, Answer, Streams
from service.answers.uploads import take_file
from service.callers.access import Caller, Tls, TokenCheck, is_local
from service.callers.rights import Grant, NotAllowed
from service.callers.tokens import TokenFile
from service.calls import Calls
from service.files.confine import ServedFolder
from service.files.disk import Disk
from service.files.library import Library
from service.front import Front, is_possible
from service.limits import Busy, Gate, Limits, OutOfTime, Shares
from service.metrics import Metrics
from service.processes.workers import Workers

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
_LAST_SECONDS = 10.0
"""What is told to end at a stop may take so long."""


class RaymapService(flight.FlightServerBase):  # type: ignore[misc]
    """Serves one folder.

    Parameters
    ----------
    folder : whose maps and scenes are served
    token : that allows everything; None if only those of ``tokens`` count
    host, port : where to listen; port 0 takes a free one
    tls : certificate and key; without them only this machine is served
    without_tls : serve other machines without TLS all the same
    limits : what requests may cost
    threads : of a search or a recording; all processors by default
    browser : clients may open a browser on this machine
    tokens : file of further tokens with their rights

    Raises
    ------
    RayMapError
        The folder does not exist, the port is taken, or the host needs TLS.
    """

    def __init__(
        self,
        folder: str | Path,
        token: str | None,
        *,
        host: str = "localhost",
        port: int = 0,
        tls: Tls | None = None,
        without_tls: bool = False,
        limits: Limits | None = None,
        threads: int | None = None,
        browser: bool = True,
        tokens: TokenFile | None = None,
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
        recordings = Gate(self.limits.recordings, self.limits.turn_seconds, "recordings")
        self._workers = Workers(spares=self.limits.spare_workers > 0)
        self._disk = Disk(self.folder, self.limits)
        self._recorder = Recorder(self.folder, recordings, self._workers, self._disk, threads)
        self._questions = Questions(self.folder, self.library, searches, self._workers, threads)
        self._streams = Streams(self.library, searches, self._workers, threads)
        self.applications = Applications(self.library, self.limits, browser=browser)
        self.metrics = Metrics(
            {
                "maps_open": ("Maps that are open.", lambda: float(len(self.library))),
                "applications_open": (
                    "Applications that are open.",
                    lambda: float(len(self.applications)),
                ),
            }
        )
        self.calls = Calls(self.metrics)
        self._ended = threading.Event()
        if token is None and tokens is None:
            raise RayMapError("a service without any token answers nobody: give one")
        if tokens is not None:
            tokens.check()
        self._scheme = "grpc" if tls is None else "grpc+tls"
        self._host = host
        self._requests = Shares(self.limits.requests, self.limits.client_requests, "requests")
        self._answers = Shares(self.limits.streams, self.limits.client_streams, "streams")
        location, certificates = f"{self._scheme}://{host}:{port}", None
        self._front: Front | None = None
        # What clients do wrong is no news for its terminal
        os.environ.setdefault("GRPC_VERBOSITY", "ERROR")
        try:
            if is_possible():
                self._front = Front(host, port, tls, self.limits)
                location = f"grpc+unix://{self._front.inner}"
            elif tls is not None:
                certificates = [(tls.certificate, tls.key)]
            super().__init__(
                location,
                tls_certificates=certificates,
                middleware={"token": TokenCheck(token, tokens, self.metrics.refuse)},
            )
        except (pa.ArrowException, OSError) as error:
            line = str(error).splitlines()[0]
            raise RayMapError(
                f"cannot serve at {host}:{port} ({line}); choose another with --port"
            ) from None
        if self._front is not None:
            self._front.start()

    @property
    def address(self) -> str:
        """What clients connect to."""
        port = self.port if self._front is None else self._front.port
        return f"{self._scheme}://{self._host}:{port}"

    def close(self) -> None:
        """End all applications and close all maps; call it after `shutdown`."""
        self.applications.close()
        self._workers.close()
        self.library.close()

    def notice(self) -> None:
        """Let `wait` return; a handler of signals may call it."""
        self._ended.set()

    def shutdown(self) -> None:
        """End it, after the calls under way."""
        self._ended.set()
        if self._front is not None:
            self._front.stop()
        super().shutdown()

    def wait(self) -> None:
        """Wait until it is shut down, or until `notice`."""
        self._ended.wait()

    # -- calls ---------------------------------------------------------------------------------

    def list_actions(self, context: Any) -> list[tuple[str, str]]:
        """Names of the actions, each with a line about it."""
        return list(ACTIONS.items())

    def do_action(self, context: Any, action: Any) -> Iterator[bytes]:
        """Answer with JSON objects: one, or several while something runs."""
        caller = context.get_middleware("token")
        try:
            with (
                self._requests.one(caller.grant.name),
                self.calls.under_way(action.type, caller, context.is_cancelled) as gone,
            ):
                for answer in self._act(action.type, action.body, caller, gone):
                    body = json.dumps(answer, default=_plain).encode()
                    self.metrics.transfer("sent", len(body))
                    yield body
        except GeneratorExit:
            raise
        except BaseException as error:
            raise _refusal(error, self.folder) from None

    def _act(
        self, kind: str, body: Any, caller: Caller, gone: Callable[[], bool]
    ) -> Iterator[dict[str, Any]]:
        grant = caller.grant
        if kind not in ACTIONS:
            raise BadRequest(f"there is no action {kind[:40]!r}; there are {', '.join(ACTIONS)}")
        request = self._request(body, kind)
        self._check(grant, kind, request)
        if kind == "record":
            yield from self._recorder.events(request, gone)
        elif kind == "hello":
            request.finish()
            yield {**self._hello(), "rights": sorted(grant.rights), "maps": grant.maps}
        elif kind == "view":
            yield self.applications.open(request, caller.valid)
        elif kind == "drawn":
            yield self.applications.drawn(request, gone)
        elif kind == "close_view":
            yield self.applications.close_view(request)
        elif kind == "files":
            answer = self._questions.files(request, gone)
            yield {"files": [row for row in answer["files"] if self._shows(grant, row)]}
        else:
            yield getattr(self._questions, kind)(request, gone)

    def _request(self, body: Any, what: str) -> Request:
        request = Request(_bytes(body, self.limits), self.limits, what)
        self.metrics.transfer("received", len(body) if isinstance(body, bytes) else body.size)
        return request

    def _check(self, grant: Grant, call: str, request: Request) -> None:
        """Refuse what the token does not allow, also by the key of an application.

        Raises
        ------
        NotAllowed, OutsideFolder
        """
        fields = request.fields()
        grant.check(call, fields, self.folder)
        shown = self.applications.map_of(fields.get("view"))
        if shown is not None and not grant.reaches(shown, self.folder):
            raise NotAllowed(f"{call}: this token does not reach the map of that application")

    def _shows(self, grant: Grant, row: dict[str, Any]) -> bool:
        return grant.maps is None or (
            row["kind"] in ("map", "folder") and grant.reaches(row["name"], self.folder)
        )

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
        caller, asked = context.get_middleware("token"), ticket.ticket
        try:
            kind = self._kind(asked)
            with (
                self._requests.one(caller.grant.name),
                self.calls.under_way(kind, caller, context.is_cancelled) as gone,
            ):
                answer = self._answer(asked, caller.grant, gone)
        except BaseException as error:
            raise _refusal(error, self.folder) from None
        batches = self._checked(answer.batches, kind, caller.grant.name, gone)
        return flight.GeneratorStream(answer.schema, batches)

    def _kind(self, body: Any) -> str:
        """Which stream a ticket asks for."""
        kind = Request(_bytes(body, self.limits), self.limits, "get").fields().get("get")
        return kind if isinstance(kind, str) and kind in STREAMS else "unknown"

    def _answer(self, body: Any, grant: Grant, gone: Callable[[], bool]) -> Answer:
        request = self._request(body, "get")
        kind = request.fields().get("get")
        # What is no stream is refused below, by its name
        if isinstance(kind, str) and kind in STREAMS:
            self._check(grant, kind, request)
        return self._streams.answer(request, gone)

    def _checked(
        self,
        batches: Iterator[pa.RecordBatch],
        kind: str,
        client: str,
        gone: Callable[[], bool],
    ) -> Iterator[pa.Table]:
        """The batches as tables: only so does Flight send their dictionaries of names along."""
        try:
            with self._answers.one(client), self.calls.sending(kind):
                for batch in batches:
                    if gone():
                        raise OutOfTime("nobody may have the rest of this answer any more")
                    self.metrics.transfer("sent", batch.nbytes)
                    yield pa.Table.from_batches([batch])
        except GeneratorExit:
            raise
        except BaseException as error:
            raise _refusal(error, self.folder) from None

    def get_flight_info(self, context: Any, descriptor: Any) -> Any:
        """Schema and ticket of a request that stands in the descriptor's command."""
        caller = context.get_middleware("token")
        try:
            body = _bytes(descriptor.command or b"", self.limits)
            kind = self._kind(body)
            with (
                self._requests.one(caller.grant.name),
                self.calls.under_way(kind, caller, context.is_cancelled) as gone,
            ):
                schema = self._answer(body, caller.grant, gone).schema
        except BaseException as error:
            raise _refusal(error, self.folder) from None
        endpoint = flight.FlightEndpoint(flight.Ticket(body), [])
        return flight.FlightInfo(schema, descriptor, [endpoint], -1, -1)

    def list_flights(self, context: Any, criteria: bytes) -> Iterator[Any]:
        """The maps of the folder that the token reaches, each as the flight of all its segments."""
        caller = context.get_middleware("token")
        try:
            with self.calls.under_way("list_flights", caller, context.is_cancelled) as gone:
                request = self._request(b"", "files")
                self._check(caller.grant, "list_flights", request)
                rows = self._questions.files(request, gone)["files"]
                names = [
                    row["name"]
                    for row in rows
                    if row["kind"] == "map" and self._shows(caller.grant, row)
                ]
        except BaseException as error:
            raise _refusal(error, self.folder) from None
        for name in names:
            command = json.dumps({"get": "rays", "map": name}).encode()
            try:
                schema = self._answer(command, caller.grant, gone).schema
            except RayMapError:
                continue
            descriptor = flight.FlightDescriptor.for_command(command)
            endpoint = flight.FlightEndpoint(flight.Ticket(command), [])
            yield flight.FlightInfo(schema, descriptor, [endpoint], -1, -1)

    def do_put(self, context: Any, descriptor: Any, reader: Any, writer: Any) -> None:
        """Take a file into the folder."""
        caller = context.get_middleware("token")
        try:
            with (
                self._requests.one(caller.grant.name),
                self.calls.under_way("upload", caller, context.is_cancelled),
            ):
                request = self._request(descriptor.command or b"", "upload")
                self._check(caller.grant, "upload", request)
                target = take_file(request, self.folder, self._disk, reader)
                size = target.stat().st_size
                self.metrics.transfer("received", size)
                answer = {"file": self.folder.shown(target), "bytes": size}
                writer.write(json.dumps(answer).encode())
        except BaseException as error:
            raise _refusal(error, self.folder) from None


def serve(service: RaymapService, *, stop_seconds: float = 30.0) -> None:
    """Serve until SIGINT (Ctrl-C) or SIGTERM, or until the service is shut down.

    A signal lets answers under way end for ``stop_seconds``; recordings end at once, with a valid
    map. A second signal does not wait.

    Raises
    ------
    RayMapError
        Answers had not ended by then and were cut off.
    """
    asked = 0

    def stop(number: int, frame: object) -> None:
        nonlocal asked
        asked += 1
        service.notice()

    known = {}
    if threading.current_thread() is threading.main_thread():
        known = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    left = 0
    try:
        service.wait()
        end = time.monotonic() + stop_seconds
        left = service.calls.stop(lambda: asked > 1 or time.monotonic() >= end)
    finally:
        # Calls that were told to end take a moment; one that does not hear must not hold us
        ending = threading.Thread(target=service.shutdown, name="shutdown", daemon=True)
        ending.start()
        ending.join(_LAST_SECONDS)
        if not ending.is_alive():
            service.close()
        for number, handler in known.items():
            signal.signal(number, handler)
    if left:
        raise RayMapError(
            f"stopped: {left} answers had not ended after {stop_seconds:g} s and were cut off; "
            "--stop-seconds waits longer"
        )


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
        kinds = {
            OutOfTime: flight.FlightTimedOutError,
            Busy: flight.FlightUnavailableError,
            NotAllowed: flight.FlightUnauthorizedError,
        }
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

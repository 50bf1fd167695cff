"""Ask a Raymap service: `connect` mirrors the local functions; needs nothing but pyarrow."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace, TracebackType
from typing import Any

from raymap.model.errors import MissingExtra, RayMapError
from raymap.model.givenfile import check_given, given_bytes
from raymap.remote.clientmap import RemoteMap
from raymap.remote.protocol import (
    ADDRESS_VARIABLE,
    PROTOCOL,
    TOKEN_HEADER,
    TOKEN_VARIABLE,
    ServiceError,
    decode_error,
)

__all__ = ["Service", "connect"]

_CHUNK = 2**20


def connect(
    address: str | None = None,
    *,
    token: str | None = None,
    root_certificates: str | os.PathLike[str] | None = None,
) -> Service:
    """Connect to a service that `raymap serve` runs.

    Parameters
    ----------
    address : ``grpc://localhost:PORT`` or ``grpc+tls://host:PORT``; by default what the variable
        RAYMAP_SERVICE says
    token : as `raymap serve` printed it; by default what the variable RAYMAP_TOKEN says
    root_certificates : PEM file with the certificate of a service with TLS, where the system does
        not know it

    Raises
    ------
    ServiceError
        Nobody answers, the token is wrong, or the service speaks another version.

    Examples
    --------
    >>> service = raymap.connect("grpc://localhost:41000", token="…")    # doctest: +SKIP
    >>> lens = service.open("lens.raymap")                               # doctest: +SKIP
    >>> lens.query('hit("L1", reflected)').matched                       # doctest: +SKIP
    """
    try:
        import pyarrow.flight as flight
    except ImportError:
        raise MissingExtra("this build of pyarrow has no Flight: pip install pyarrow") from None
    where = address or os.environ.get(ADDRESS_VARIABLE)
    if not where:
        raise ServiceError(
            f"no service is named: give its address, or set {ADDRESS_VARIABLE}; `raymap serve` "
            "prints it"
        )
    secret = os.environ.get(TOKEN_VARIABLE, "") if token is None else token
    options: dict[str, Any] = {}
    try:
        if root_certificates is not None:
            options["tls_root_certs"] = given_bytes(root_certificates, "PEM file", ServiceError)
        client = flight.connect(where, **options)
    except ServiceError:
        raise
    except Exception as error:  # Arrow's own kinds of errors for a bad address
        raise ServiceError(f"{where!r} is not the address of a service: {_line(error)}") from None
    service = Service(client, where, secret)
    try:
        service.about = service.ask("hello", {})
    except BaseException:
        service.close()
        raise
    if service.about.get("protocol") != PROTOCOL:
        service.close()
        raise ServiceError(
            f"the service at {where} speaks protocol {service.about.get('protocol')}, this program "
            f"{PROTOCOL}: install the same version on both sides"
        )
    return service


class Service:
    """A connection; close it or use it as a context manager. Safe to use from many threads.

    Attributes
    ----------
    address : of the service
    about : what it says of itself: version, actions, limits
    """

    def __init__(self, client: Any, address: str, token: str) -> None:
        self.address = address
        self.about: dict[str, Any] = {}
        self._client = client
        self._headers = [(TOKEN_HEADER.encode(), f"Bearer {token}".encode())]

    def __enter__(self) -> Service:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<Service {self.address}>"

    def close(self) -> None:
        """End the connection; what runs for it on the other side ends, too."""
        self._client.close()

    # -- files and scenes ----------------------------------------------------------------------

    def files(self, folder: str | None = None) -> list[dict[str, Any]]:
        """Maps, scenes and folders: ``name``, ``kind``, ``bytes`` of each."""
        return list(self.ask("files", {"folder": folder})["files"])

    def upload(self, path: str | os.PathLike[str], name: str | None = None, *, force: bool = False
               ) -> str:  # fmt: skip
        """Put a file (a scene, a mesh, …) into the served folder; returns its name there."""
        source = Path(path)
        check_given(source, "file", ServiceError)
        with source.open("rb") as file:
            chunks = iter(lambda: file.read(_CHUNK), b"")
            return self._put(name or source.name, chunks, force)

    def upload_text(self, text: str, name: str, *, force: bool = False) -> str:
        """As `upload`, of a text, such as a scene."""
        return self._put(name, [text.encode()], force)

    def _put(self, name: str, chunks: Iterator[bytes] | Sequence[bytes], force: bool) -> str:
        import pyarrow as pa
        import pyarrow.flight as flight

        command = json.dumps({"file": name, "force": force}).encode()
        schema = pa.schema([("data", pa.binary())])
        descriptor = flight.FlightDescriptor.for_command(command)
        with _translated():
            writer, answers = self._client.do_put(descriptor, schema, self._options())
            try:
                for chunk in chunks:
                    writer.write_batch(pa.record_batch([pa.array([chunk], pa.binary())], schema))
                writer.done_writing()
                answer = answers.read()
            finally:
                writer.close()
        return str(json.loads(answer.to_pybytes())["file"]) if answer is not None else name

    def scene(
        self,
        scene: str | None = None,
        *,
        text: str | None = None,
        variants: Sequence[str] = (),
        simulation: str | None = None,
    ) -> SimpleNamespace:
        """Read and check a scene: its sources, objects, faces, media, detectors, units."""
        asked = {"scene": scene, "text": text, "variants": list(variants),
                 "simulation": simulation}  # fmt: skip
        return SimpleNamespace(**self.ask("scene", asked))

    def record(
        self,
        scene: str | None,
        map: str,
        *,
        text: str | None = None,
        variants: Sequence[str] = (),
        simulation: str | None = None,
        rays: int | None = None,
        seconds: float | None = None,
        seed: int | None = None,
        append: bool = False,
        force: bool = False,
        progress: Callable[[SimpleNamespace], None] | None = None,
    ) -> SimpleNamespace:
        """Trace a scene on the other side, as `tracer.record` does.

        Parameters
        ----------
        scene : file of the served folder; None with ``text``, the scene itself
        variants, simulation : of the scene file, as for `tracer.load_scene`
        map : to be written there
        progress : called with ``rays``, ``records``, ``seconds``, ``bytes``, ``total_rays``; an
            exception that it raises ends the trace with a valid map

        Returns
        -------
        result : as `tracer.RecordResult`
        """
        asked = {
            "scene": scene, "text": text, "variants": list(variants), "simulation": simulation,
            "map": map, "rays": rays, "seconds": seconds, "seed": seed, "append": append,
            "force": force,
        }  # fmt: skip
        for event in self._events("record", asked):
            if "done" in event:
                return SimpleNamespace(**event["done"])
            if progress is not None:
                progress(SimpleNamespace(**event["progress"]))
        raise ServiceError("the service ended the recording without a result")

    def open(self, map: str) -> RemoteMap:
        """A map of the served folder, to be asked as a local one."""
        return RemoteMap(self, map)

    # -- calls ---------------------------------------------------------------------------------

    def ask(self, action: str, request: Mapping[str, Any]) -> dict[str, Any]:
        """One action with one answer; keys without a value are left out."""
        for answer in self._events(action, request):
            return answer
        raise ServiceError(f"the service did not answer {action}")

    def stream(self, kind: str, request: Mapping[str, Any]) -> Any:
        """A stream of record batches, as `pyarrow.flight.FlightStreamReader`."""
        import pyarrow.flight as flight

        ticket = flight.Ticket(_body({"get": kind, **request}))
        with _translated():
            return self._client.do_get(ticket, self._options())

    def table(self, kind: str, request: Mapping[str, Any]) -> Any:
        """A whole stream as one `pyarrow.Table`."""
        reader = self.stream(kind, request)
        with _translated():
            return reader.read_all()

    def _events(self, action: str, request: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
        import pyarrow.flight as flight

        with _translated():
            results = self._client.do_action(flight.Action(action, _body(request)), self._options())
            for result in results:
                yield json.loads(result.body.to_pybytes())

    def _options(self) -> Any:
        import pyarrow.flight as flight

        return flight.FlightCallOptions(headers=self._headers)


def _body(request: Mapping[str, Any]) -> bytes:
    """A request as JSON; criteria in any spelling, what has no value left out."""
    plain = {
        key: value.to_json() if hasattr(value, "to_json") else value
        for key, value in request.items()
        if value is not None
    }
    try:
        return json.dumps(plain).encode()
    except (TypeError, ValueError, RecursionError) as error:
        raise RayMapError(f"this cannot be asked of a service: {_line(error)}") from None


class _translated:
    """Turns errors of Flight into those that the local functions raise."""

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        import pyarrow as pa
        import pyarrow.flight as flight

        if isinstance(error, flight.FlightUnavailableError) and not error.extra_info:
            raise ServiceError(f"the service cannot be reached: {_line(error)}") from None
        if isinstance(error, flight.FlightError):
            raise decode_error(error.extra_info or b"", _line(error)) from None
        if isinstance(error, pa.ArrowException):
            raise ServiceError(_line(error)) from None


def _line(error: BaseException) -> str:
    """What an error says, in one line."""
    text = " ".join(str(error).split())
    return text.partition(". gRPC client debug context")[0] or type(error).__name__

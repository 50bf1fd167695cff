"""Applications opened for the user, and what was drawn in them."""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from raymap.model.errors import RayMapError
from service.answers.requests import BadRequest, Request
from service.files.library import Library
from service.limits import Limits

if TYPE_CHECKING:
    from raymap.file.reader import RayMap
    from viewer.app.server import RunningServer

__all__ = ["Applications"]

_LOOK_SECONDS = 0.1
_VALID_SECONDS = 1.0


@dataclass(frozen=True)
class _Opened:
    """One application and the map that it shows."""

    name: str
    map: RayMap
    server: RunningServer
    valid: Callable[[], bool]


class Applications:
    """The applications that clients opened; each is the trame application of `raymap view`."""

    def __init__(self, library: Library, limits: Limits, *, browser: bool) -> None:
        self.library, self.limits, self.browser = library, limits, browser
        self._opened: dict[str, _Opened] = {}
        self._opening = 0
        self._lock = threading.Lock()

    def __len__(self) -> int:
        """Applications that are open."""
        return len(self._opened)

    def map_of(self, key: object) -> str | None:
        """Name of the map that an application shows; None if there is no such application."""
        with self._lock:
            opened = self._opened.get(key) if isinstance(key, str) else None
        return None if opened is None else opened.name

    def open(self, request: Request, valid: Callable[[], bool]) -> dict[str, Any]:
        """Open the application; answers its key and its address.

        Parameters
        ----------
        request : of the client
        valid : whether its token still is; the application ends with it

        Raises
        ------
        MissingExtra
            what the application needs is not installed.
        """

        name, criterion = request.text("map"), request.criterion()
        detector, browser = request.text("detector", None), request.flag("browser")
        request.finish()
        key = secrets.token_hex(8)
        with self._place():
            opened = self._start(name, criterion, detector, valid)
            with self._lock:
                self._opened[key] = opened
        if browser and self.browser:
            opened.server.show()
        threading.Thread(target=self._watch, args=(key, opened), daemon=True).start()
        return {"view": key, "map": name, "url": opened.server.url}

    @contextmanager
    def _place(self) -> Iterator[None]:
        """One of the places, while an application is being opened."""
        with self._lock:
            if len(self._opened) + self._opening >= self.limits.views:
                raise RayMapError(
                    f"{self.limits.views} applications are open already: close one with close_view"
                )
            self._opening += 1
        try:
            yield
        finally:
            with self._lock:
                self._opening -= 1

    def _start(
        self, name: str, criterion: Any, detector: str | None, valid: Callable[[], bool]
    ) -> _Opened:
        from viewer.app.server import run_in_thread
        from viewer.drawn.state import ViewState
        from viewer.panels.saved_criteria import CriterionRegistry

        ray_map = self.library.open(name)
        try:
            known = [item.name for item in ray_map.directory.detectors]
            if detector is not None and detector not in known:
                raise BadRequest(f"view: the map has no detector {detector!r}; it has {known}")
            text = "" if criterion is None else str(criterion)
            state = ViewState(criterion=text, detector=detector)
            # What the owner of the service asked lately is no client's business
            server = run_in_thread(ray_map, state, registry=CriterionRegistry.empty())
            if not server.url:
                server.stop()
                raise RayMapError("the application did not start within a minute")
        except BaseException:
            ray_map.close()
            raise
        return _Opened(name, ray_map, server, valid)

    def _watch(self, key: str, opened: _Opened) -> None:
        """Close an application whose token was withdrawn."""
        while opened.valid():
            time.sleep(_VALID_SECONDS)
            with self._lock:
                if self._opened.get(key) is not opened:
                    return
        with self._lock:
            mine = self._opened.pop(key, None)
        if mine is not None:
            _end(mine)

    def drawn(self, request: Request, gone: Callable[[], bool]) -> dict[str, Any]:
        """What the user has entered and drawn, at once or when it changes."""
        key = request.text("view")
        since = request.text("since", None)
        seconds = request.number("wait_seconds", 0.0, self.limits.wait_seconds, 0.0)
        request.finish()
        end = time.monotonic() + seconds
        while True:
            answer = self._look(key)
            if answer["state"] != since or time.monotonic() >= end or gone():
                return answer
            time.sleep(_LOOK_SECONDS)

    def close_view(self, request: Request) -> dict[str, Any]:
        """Close one application."""
        key = request.text("view")
        request.finish()
        with self._lock:
            opened = self._opened.pop(key, None)
        if opened is None:
            raise BadRequest(f"close_view: no application {key!r} is open")
        _end(opened)
        return {"closed": key}

    def close(self) -> None:
        """Close all."""
        with self._lock:
            all_of_them = list(self._opened.values())
            self._opened.clear()
        for opened in all_of_them:
            _end(opened)

    def _look(self, key: str) -> dict[str, Any]:
        from viewer.panels.detector import region_in_words

        with self._lock:
            opened = self._opened.get(key)
        if opened is None:
            raise BadRequest(f"drawn: no application {key!r} is open")
        application = opened.server.application
        state, detector = application.session.state, application.session.detector()
        drawn: dict[str, Any] = {
            "view": key,
            "map": opened.name,
            "criterion": state.criterion,
            "detector": detector.name if detector is not None else None,
            "region": region_in_words(application.session),
            "ray": state.ray,
            "paths": list(state.paths),
            "answered": int(application.page.answered),
        }
        marks = {name: value for name, value in drawn.items() if name != "answered"}
        drawn["state"] = f"{hash(repr(sorted(marks.items()))) & (2**64 - 1):016x}"
        return drawn


def _end(opened: _Opened) -> None:
    opened.server.stop()
    opened.map.close()

"""What one request may cost; and the gates that many clients pass one after the other."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from raymap.model.errors import RayMapError

__all__ = ["Busy", "Deadline", "Gate", "Limits", "OutOfTime", "Shares"]


class OutOfTime(RayMapError, TimeoutError):
    """A request took longer than the service allows."""


class Busy(RayMapError):
    """So many requests are under way that this one was not begun."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Bounds of the service.

    Attributes
    ----------
    request_bytes : of one request
    criterion_characters : of a criterion in text; in JSON it may have a tenth as many nodes
    search_seconds : of one search, path table, image or picture
    searches : at a time; others wait their turn
    turn_seconds : how long they wait
    record_rays, record_seconds : of one recording
    recordings : at a time
    end_seconds : that a recording has to end with a valid map when it is stopped
    scene_seconds : for reading and compiling a scene that is not recorded
    scene_bytes : of a scene file
    scene_files_bytes : of all files that a scene names
    spare_workers : whether a worker process of each kind is started before it is wanted (0 or 1)
    memory_bytes : of one worker process, which reads a scene, records or paints
    upload_bytes : of one uploaded file
    disk_bytes : of all that clients record and upload into the folder, over all runs of the service
    written_files : that clients may have put there
    spare_bytes : that stay free on the disk of the served folder
    message_bytes : of one message, token or not; an upload comes in several
    incoming_bytes : of all messages that are coming in at a time
    connections : at a time
    connection_requests : at a time on one connection
    requests, client_requests : under way at a time, in all and with one token
    streams, client_streams : of answers, the same
    stall_seconds : that a client may take nothing of what it asked for
    rows : of one answer
    maps : open at a time; the one that was not used for longest is closed
    views : applications open at a time
    wait_seconds : a client may wait so long for what is drawn in an application
    pixels : of a picture
    """

    request_bytes: int = 2**20
    criterion_characters: int = 20_000
    search_seconds: float = 120.0
    searches: int = 4
    turn_seconds: float = 30.0
    record_rays: int = 10**10
    record_seconds: float = 24 * 3600.0
    recordings: int = 1
    end_seconds: float = 30.0
    scene_seconds: float = 120.0
    scene_bytes: int = 2**24
    scene_files_bytes: int = 2**31
    spare_workers: int = 1
    memory_bytes: int = 2**33
    upload_bytes: int = 2**28
    disk_bytes: int = 2**37
    written_files: int = 10_000
    spare_bytes: int = 2**30
    message_bytes: int = 2**23
    incoming_bytes: int = 2**28
    connections: int = 64
    connection_requests: int = 32
    requests: int = 64
    client_requests: int = 48
    streams: int = 16
    client_streams: int = 12
    stall_seconds: float = 60.0
    rows: int = 10**9
    maps: int = 16
    views: int = 8
    wait_seconds: float = 60.0
    pixels: int = 2**25


@dataclass
class Gate:
    """Lets so many through at a time; the others wait a while."""

    size: int
    seconds: float
    what: str
    _places: threading.BoundedSemaphore = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._places = threading.BoundedSemaphore(self.size)

    @contextmanager
    def turn(self) -> Iterator[None]:
        """Wait for a place, and hold it.

        Raises
        ------
        Busy
        """
        if not self._places.acquire(timeout=self.seconds):
            raise Busy(
                f"{self.size} {self.what} are under way, and none ended within "
                f"{self.seconds:g} s: ask again later"
            )
        try:
            yield
        finally:
            self._places.release()


class Shares:
    """Lets so many through at a time, in all and of one client; the others are told to come later.

    Parameters
    ----------
    most : in all
    each : of one client
    what : they are
    """

    def __init__(self, most: int, each: int, what: str) -> None:
        self.most, self.each, self.what = most, each, what
        self._under_way: Counter[str] = Counter()
        self._lock = threading.Lock()

    @contextmanager
    def one(self, client: str) -> Iterator[None]:
        """Count one while it is under way.

        Raises
        ------
        Busy
        """
        with self._lock:
            own = self._under_way[client]
            if own >= self.each or self._under_way.total() >= self.most:
                whose = "of yours " if own >= self.each else ""
                most = self.each if whose else self.most
                raise Busy(f"{most} {self.what} {whose}are under way: ask again later")
            self._under_way[client] += 1
        try:
            yield
        finally:
            with self._lock:
                self._under_way[client] -= 1
                if not self._under_way[client]:
                    del self._under_way[client]


class Deadline:
    """A function that turns true after some time, or when the client has gone."""

    def __init__(self, seconds: float, gone: Callable[[], bool]) -> None:
        self.seconds, self.gone = seconds, gone
        self._end = time.monotonic() + seconds

    def __call__(self) -> bool:
        return time.monotonic() >= self._end or self.gone()

    def check(self) -> None:
        """Raise what ended it.

        Raises
        ------
        OutOfTime
        """
        if self.gone():
            raise OutOfTime("the client has gone")
        if self():
            raise OutOfTime(
                f"the answer took longer than the {self.seconds:g} s that this service allows: "
                "ask for less, or raise --search-seconds"
            )

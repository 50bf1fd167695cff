"""What one request may cost; and the gates that many clients pass one after the other."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from raymap.errors import RayMapError

__all__ = ["Busy", "Deadline", "Gate", "Limits", "OutOfTime"]


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
    scene_bytes : of a scene file
    upload_bytes : of one uploaded file
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
    scene_bytes: int = 2**24
    upload_bytes: int = 2**28
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

"""The calls under way: whether they may go on, what is counted of them, how they end at a stop."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from raymap.model.errors import RayMapError
from service.callers.access import Caller
from service.callers.rights import NEEDS, NotAllowed
from service.limits import Busy, OutOfTime
from service.metrics import Metrics

__all__ = ["Calls"]

_LOOK_SECONDS = 0.05


class Calls:
    """All calls of a service.

    Parameters
    ----------
    metrics : counts them
    """

    def __init__(self, metrics: Metrics) -> None:
        self.metrics = metrics
        self._stopping = threading.Event()
        self._cut = threading.Event()

    @contextmanager
    def under_way(
        self, call: str, caller: Caller, cancelled: Callable[[], bool]
    ) -> Iterator[Callable[[], bool]]:
        """Count a call; yields the function that says that nobody waits for its answer any more.

        That is so when the client has gone, its token was withdrawn, or the service stops: for a
        recording at once, because it ends with a valid map; for a question when its time is over.

        Raises
        ------
        Busy
            The service stops.
        """
        known = call if call in NEEDS else "unknown"
        if self._stopping.is_set():
            raise Busy("the service is stopping: ask again later")
        ends = self._stopping if call == "record" else self._cut

        def gone() -> bool:
            return cancelled() or ends.is_set() or not caller.valid()

        began = time.monotonic()
        outcome = "ok"
        self.metrics.begin(known)
        try:
            yield gone
        except BaseException as error:
            outcome = _outcome(error)
            raise
        finally:
            self.metrics.end(known, outcome, time.monotonic() - began)

    @contextmanager
    def sending(self, call: str) -> Iterator[None]:
        """A stream that was begun is being sent; it still counts as under way."""
        began = time.monotonic()
        self.metrics.begin(call)
        try:
            yield
        finally:
            self.metrics.end(call, None, time.monotonic() - began)

    def stop(self, over: Callable[[], bool]) -> int:
        """Take no more calls, and wait for those under way.

        Parameters
        ----------
        over : whether the time is over

        Returns
        -------
        How many had not ended by then; they are told to end now.
        """
        self.metrics.healthy = False
        self._stopping.set()
        while self.metrics.running() and not over():
            time.sleep(_LOOK_SECONDS)
        left = self.metrics.running()
        self._cut.set()
        return left


def _outcome(error: BaseException) -> str:
    """How a call ended, in one word."""
    if isinstance(error, GeneratorExit):
        return "gone"
    for kind, word in ((OutOfTime, "timeout"), (Busy, "busy"), (NotAllowed, "denied")):
        if isinstance(error, kind):
            return word
    return "refused" if isinstance(error, RayMapError) else "failed"

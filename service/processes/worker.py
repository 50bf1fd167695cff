"""A process that does one job for the service: reads a scene, records, or paints; then it ends.

`service.processes.workers` starts it by its path, isolated from the environment
(``python -I worker.py``). It takes one job from its standard input and tells what becomes of it, as
lines of JSON.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import traceback
from importlib import import_module
from typing import Any

MODULES = {
    "scene": ("tracer.scene.compile", "tracer.run.recording", "tracer.importers.expand"),
    "picture": (
        "viewer.paint.rendering",
        "viewer.drawn.scene",
        "query.answers.selections.selector",
    ),
}
"""What is imported before there is a job, by what the process is kept for."""


class Wire:
    """Lines from and to the service; other output of the process goes to its standard error."""

    def __init__(self) -> None:
        self._out = os.fdopen(os.dup(1), "wb")
        self._in = os.fdopen(os.dup(0), "rb")
        # Children and foreign code neither take the job nor write between the answers
        os.dup2(2, 1)
        nothing = os.open(os.devnull, os.O_RDONLY)
        os.dup2(nothing, 0)
        os.close(nothing)
        self._stop = threading.Event()

    def job(self) -> dict[str, Any]:
        """The job; from then on a further line, or the end of the service, asks to stop."""
        line = self._in.readline()
        if not line:
            sys.exit(0)
        threading.Thread(target=self._wait, daemon=True).start()
        return dict(json.loads(line))

    def _wait(self) -> None:
        self._in.readline()
        self._stop.set()

    def stopped(self) -> bool:
        """Whether the job is to end early."""
        return self._stop.is_set()

    def tell(self, message: dict[str, Any]) -> None:
        """Send a message; without a service to hear it, the job is to end."""
        try:
            self._out.write(json.dumps(message, default=_plain).encode() + b"\n")
            self._out.flush()
        except (BrokenPipeError, ValueError):
            self._stop.set()


def main(kind: str) -> None:
    """Do one job."""
    wire = Wire()
    for module in MODULES[kind]:
        import_module(module)
    from raymap.model.errors import RayMapError
    from raymap.remote.protocol import encode_error
    from service.processes.jobs import JOBS

    job = wire.job()
    try:
        wire.tell({"answer": JOBS[job["job"]](job["arguments"], job["bounds"], wire)})
    except RayMapError as error:
        wire.tell({"error": json.loads(encode_error(error))})
    except MemoryError:
        wire.tell({"over": "memory"})
    except BaseException as error:
        wire.tell({"fault": type(error).__name__})
        traceback.print_exc()
    # Nothing is left to be done that destructors of foreign libraries could fail at
    sys.stderr.flush()
    os._exit(0)


def _plain(value: Any) -> Any:
    """NumPy numbers and arrays as JSON has them."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


if __name__ == "__main__":
    sys.path[:] = json.loads(sys.argv[2])
    main(sys.argv[1])

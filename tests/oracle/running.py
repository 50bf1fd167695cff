"""Runs commands of the build whose interpreter runs this file: JSON of commands in, of answers out.

It imports nothing of this repository, so that any build can run it.
"""

import contextlib
import io
import json
import sys
import time
import traceback
import warnings
from pathlib import Path


def run(arguments: list[str]) -> dict[str, object]:
    """What ``raymap ARGUMENTS`` prints, and its exit status."""
    from raymap.cli import main

    out, err = io.StringIO(), io.StringIO()
    sys.argv = ["raymap", *arguments]
    status: object = 0
    began = time.perf_counter()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            with warnings.catch_warnings():
                main()
        except SystemExit as end:
            status = end.code or 0
        except BaseException:
            status = "traceback"
            traceback.print_exc(file=err)
    seconds = time.perf_counter() - began
    return {"status": status, "out": out.getvalue(), "err": err.getvalue(), "seconds": seconds}


if __name__ == "__main__":
    commands, answers = Path(sys.argv[1]), Path(sys.argv[2])
    found = {}
    for command in json.loads(commands.read_text()):
        found[command["name"]] = run(command["arguments"])
        print(f"{command['name']}: {found[command['name']]['seconds']:.1f} s", file=sys.__stderr__)
        answers.write_text(json.dumps(found))

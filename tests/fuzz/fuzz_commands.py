"""Fuzzing of commands: ``NUMBA_BOUNDSCHECK=1 python tests/fuzz/fuzz_commands.py [seconds]``.

Maps are changed as in `fuzz_values`, with all checksums made to fit again, and a command is run
over each of them: every command that takes a map, in its forms. Whatever the values say, a command

- ends with exit 0 or 1, and with a line on stderr where it is 1 (`verify` says it on stdout);
- raises nothing but the project's own errors, and shows no traceback or warning of others;
- prints JSON that strict readers take: no NaN, no half characters.

Cases are numbered and drawn from their number alone: ``--first N --cases 1`` repeats one.
"""

from __future__ import annotations

import contextlib
import dataclasses
import io
import json
import random
import shlex
import sys
import traceback
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

_ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(_ROOT))

from tests.fuzz.fuzz_laws import seeds as law_seeds  # noqa: E402
from tests.fuzz.fuzz_values import Seed, change, put_together  # noqa: E402
from tests.fuzz.fuzz_values import seeds as value_seeds  # noqa: E402
from tests.fuzz.supervised import command_line  # noqa: E402

__all__ = ["LINES", "look", "one_case", "run", "seeds"]

LINES = (
    "info MAP", "info MAP --streams", "info MAP --scene", "verify MAP",
    "query MAP 'hit(\"*\", reflected)'", "query MAP 'length > 10' --limit 3",
    "query MAP all -o OUT.csv", "query MAP all -o OUT.raymap",
    "paths MAP", "paths MAP --by object", "report MAP 0", "audit MAP", "ghosts MAP",
    "ghosts MAP sensor",
    "illuminated MAP sensor", "sweep MAP sensor", "compare MAP MAP",
    "what-if MAP 'detected(\"sensor\")' --set lamp.flux=5",
    "sensitivity MAP 'detected(\"sensor\")'",
    "histogram MAP length", "histogram MAP 'u(\"sensor\")' --by object",
    "improve MAP 'detected(\"sensor\")' --reflectance 1% --faces 1",
    "mix MAP:0.5 -o OUT.raymix",
    "focus MAP sensor", "image MAP sensor -o OUT.png", "image MAP sensor -o OUT.exr",
    "chart MAP sensor -o OUT.svg", "chart MAP sky -o OUT.svg",
    "picture MAP -o OUT.png --rays 20 --width 64 --height 48", "rayfile MAP sensor -o OUT.sdf",
    "rayfile MAP sensor -o OUT.tm25ray", "export MAP -o OUT.parquet", "export MAP -o OUT.csv",
    "export-3d MAP -o OUT.glb --rays 20", "export-3d MAP -o OUT.step --rays 5",
    "export-3d MAP -o OUT.dxf --rays 20", "repair MAP -o OUT.raymap",
)  # fmt: skip
"""Command lines over a map; the options ``--json`` and ``--strict`` are drawn."""


def seeds(folder: Path) -> Sequence[Seed]:
    """Small maps of every encoding, and one of each law."""
    return [*value_seeds(folder), *law_seeds(folder)]


def run(words: Sequence[str]) -> tuple[int, str, str, str]:
    """A command line in this process: exit code, stdout, stderr, what no handler had a word for."""
    from raymap.cli import main

    out, err, foreign = io.StringIO(), io.StringIO(), ""
    code = 0
    before = sys.argv
    sys.argv = ["raymap", *words]
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            main()
    except SystemExit as end:
        code = int(end.code or 0)
    except BaseException:
        foreign = traceback.format_exc()
    finally:
        sys.argv = before
    return code, out.getvalue(), err.getvalue(), foreign


def one_case(seed: Seed, dice: random.Random, path: Path, line: str | None = None) -> int:
    """Change a map and run a command over it, any unless one is given; the number of changes.

    Raises
    ------
    AssertionError
        A promise of this module's head does not hold.
    """
    parts = [
        dataclasses.replace(part, streams=[dataclasses.replace(each) for each in part.streams])
        for part in seed.parts
    ]
    n = dice.choice((1, 1, 2, 4, 16))
    for _ in range(n):
        change(parts, dice)
    path.write_bytes(put_together(parts))
    look(line or dice.choice(LINES), path, dice)
    return n


@cache
def options(command: str) -> frozenset[str]:
    """The options that a command takes."""
    import typer

    from raymap.cli import application

    group: Any = typer.main.get_command(application(command))
    return frozenset(opt for each in group.commands[command].params for opt in each.opts)


def look(line: str, path: Path, dice: random.Random) -> None:
    """Run a command line over a map, and look at how it ends.

    Raises
    ------
    AssertionError
    """
    words = [
        {"MAP": str(path)}.get(word, word.replace("OUT", str(path.parent / "out")))
        for word in shlex.split(line)
    ]
    if "-o" in words:
        Path(words[words.index("-o") + 1]).unlink(missing_ok=True)
    takes = options(words[0])
    as_json = "--json" in takes and dice.random() < 0.5
    words += ["--json"] * as_json
    words += ["--strict"] * ("--strict" in takes and dice.random() < 0.3)
    code, out, err, foreign = run(words)
    assert not foreign, f"{words}\n{foreign}"
    assert code in (0, 1), f"{words}: exit {code}\n{err}"
    assert "Traceback" not in err, f"{words}\n{err}"
    assert "Warning:" not in err, f"{words}\n{err}"
    assert code == 0 or err or words[0] == "verify", f"{words}: exit {code} without a word"
    if as_json and code == 0:
        json.loads(out, parse_constant=_refuse)
        out.encode()


def _refuse(constant: str) -> object:
    raise AssertionError(f"{constant} is no JSON")


if __name__ == "__main__":
    sys.exit(command_line(Path(__file__), seeds, one_case))

"""Console blocks of the pages run with few rays, and say what the pages say."""

from __future__ import annotations

import re
import shlex
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.docs.blocks import EVERY, blocks
from tests.docs.outside import healthy, outside
from tests.docs.prepared import FEW_RAYS, RECORDED, own_folder
from tests.docs.sampled_output import says

RAYS = 100_000

BLOCKS = blocks("console")
PAGES = sorted({block.page for block in BLOCKS})
TOGETHER = ("README.md", "docs/find_the_ghost.md")
"""Pages that stand in one folder with the samples' pages; the others get one of their own."""

NOT_RUN = {
    "dask": "commands of another package; a local cluster stands in for what they start",
    "raymap verify-crystals": "minutes of computing; tests/tracer/crystals verifies the same",
    "raymap fit-scattering": "minutes of computing; tests/tracer/scattering fits materials",
}
"""Commands that a test cannot run, with the reason."""

SMALLER = {
    "goniophotometer": ["--rays", "2000"],
    "render": ["--width", "8"],
    "export-3d": ["--rays", str(500 * FEW_RAYS // RECORDED)],
    "lens-picture": ["--pixels", "16"],
    "lens-levels": ["--rays", "500"],
    "lens-vignetting": ["--rays", "200", "--steps", "3"],
    "microscope": ["--pixels", "31"],
}
"""Options that make a command quick."""

ROUGH = {"check-rays": 0.06, "chart": 0.25}
"""Commands that print extents and maxima of samples, which no count beside them bounds."""


@dataclass(frozen=True)
class Command:
    """A command of a page with the output that the page shows."""

    page: str
    line: int
    text: str
    output: tuple[str, ...]


def commands(page: str) -> list[Command]:
    found: list[Command] = []
    for block in BLOCKS:
        if block.page != page:
            continue
        for number, row in enumerate(block.text.splitlines(), start=block.line):
            if row.startswith("$ "):
                found.append(Command(page, number, row[2:], ()))
            elif row.strip():
                last = found[-1]
                found[-1] = Command(last.page, last.line, last.text, (*last.output, row.strip()))
    return found


def shortened(command: Command, written: dict[str, float]) -> tuple[list[str], float]:
    """Words of the command with few rays, and how many times more the page records."""
    words = shlex.split(command.text, comments=True)
    scale = next((written[word] for word in words if word in written), 1.0)
    if "--rays" in words and words[1] == "record":
        place = words.index("--rays") + 1
        rays = int(words[place])
        scale = max(rays / RAYS, 1.0)
        words[place] = str(min(rays, RAYS))
    elif words[1] == "record":
        words += ["--rays", str(FEW_RAYS)]
    if "-o" in words:
        written[words[words.index("-o") + 1]] = scale
    return [*words[1:], *SMALLER.get(words[1], ())], scale


def test_no_block_of_commands_is_left_out() -> None:
    left = []
    for block in EVERY:
        rows = block.text.splitlines()
        if block.language != "console":
            left += [str(block) for row in rows if re.match(r"(\$ )?raymap [a-z]", row)]
        else:
            assert rows[0].startswith("$ "), str(block)
    assert left == []
    every = [command.text for page in PAGES for command in commands(page)]
    for skipped in NOT_RUN:
        assert any(text.startswith(skipped) for text in every), f"no page has {skipped}"


def anyones(text: str, home: Path = Path("/home/ada")) -> str:
    """The text without what differs from user to user: home, secrets, time."""
    text = re.sub(r"\d{4}-\d\d-\d\d \d\d:\d\d", "DATE", text.replace(str(home), "HOME"))
    text = re.sub(r"localhost:\d+", "localhost:PORT", text)
    text = re.sub(r"(token=\"|secret=)[^\"\s]+", r"\1…", text)
    return re.sub(r"^\w{3}…$", "…", text, flags=re.M)


@pytest.mark.parametrize("page", PAGES)
def test_console_blocks(page: str, folder: Path, run: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    written: dict[str, float] = {}
    if page not in TOGETHER and not page.startswith("docs/samples/"):
        folder = own_folder(page, folder / Path(page).stem, folder, run)
        written["lens.raymap"] = RECORDED / FEW_RAYS
    monkeypatch.chdir(folder)
    # What a command keeps in the configuration of its user stays in the test
    monkeypatch.setenv("HOME", str(folder))
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    ran = 0
    with ExitStack() as stack:
        for command in commands(page):
            if any(command.text.startswith(skipped) for skipped in NOT_RUN):
                continue
            ran += 1
            carry_out(command, folder, written, run, stack)
    assert ran


def carry_out(
    command: Command, folder: Path, written: dict[str, float], run: Any, stack: ExitStack
) -> None:
    """Run a command of a page, and hold its output against what the page shows."""
    where = f"{command.page}:{command.line}: {command.text}"
    words, scale = shortened(command, written)
    words = shlex.split(outside(shlex.join(words), folder, stack))
    if words[0] == "record":
        words.append("--force")
    if words[0] in ("view", "serve"):
        out, error = healthy(words, folder), ""
    else:
        code, out, error = run(*words)
        assert code == 0, f"{where}: {error}"
    lines = iter(anyones(error + out, folder).splitlines())
    for expected in map(anyones, command.output):
        rough = ROUGH.get(words[0], 0.0)
        assert any(says(expected, " ".join(line.split()), scale, rough) for line in lines), (
            f"{where} does not say {expected!r}:\n{out}"
        )

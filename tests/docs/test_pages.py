"""Console blocks of the pages run with few rays, and say what the pages say.

Figures are compared as samples of the same light: counts are scaled by the rays recorded, and agree
within six standard errors of what the short run counts; ± grows with the root of that scale. On a
page `…` stands for anything.
"""

from __future__ import annotations

import math
import re
import shlex
import shutil
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.docs.outside import healthy, outside
from tests.docs.prepared import PREPARE, lens_map

ROOT = Path(__file__).parents[2]
RAYS = 100_000

FEW_RAYS = 20_000
RECORDED = 2_000_000
"""Rays of the map that the pages call lens.raymap."""

PAGES = sorted(
    str(page.relative_to(ROOT))
    for page in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md"))
    if "```console" in page.read_text(encoding="utf-8")
)
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
    text = (ROOT / page).read_text(encoding="utf-8")
    found: list[Command] = []
    for block in re.finditer(r"^```console\n(.*?)^```", text, re.S | re.M):
        line = text[: block.start()].count("\n") + 2
        for number, row in enumerate(block[1].splitlines()):
            if row.startswith("$ "):
                found.append(Command(page, line + number, row[2:], ()))
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
    if "-o" in words:
        written[words[words.index("-o") + 1]] = scale
    return [*words[1:], *SMALLER.get(words[1], ())], scale


TOKEN = re.compile(r"…|[-+]?\d(?:[\d,]*\d)?(?:\.\d+)?(?:e[-+]?\d+)?|±|[^\s\d…±]+")


def number(token: str) -> float | None:
    try:
        return float(token.replace(",", ""))
    except ValueError:
        return None


def says(expected: str, got: str, scale: float, rough: float = 0.0) -> bool:
    """Whether a line of output says what a line of a page says."""
    wanted, found = TOKEN.findall(expected), TOKEN.findall(got)
    counts = [int(t.replace(",", "")) for t in re.findall(r"(?<!\S)\d[\d,]*(?!\S)", got)]
    fewest = min([c for c in counts if c > 20], default=0)
    spread = 6.0 / math.sqrt(fewest) if fewest else rough

    def agree(i: int, j: int) -> bool:
        a, b = number(wanted[i]), number(found[j])
        if a is None or b is None:
            return wanted[i] == found[j]
        if math.isclose(a, b, rel_tol=1e-9):
            return True
        if j and found[j - 1] == "±":
            return 0.4 < b / (a * math.sqrt(scale)) < 2.5
        error = number(found[j + 2]) if found[j + 1 : j + 2] == ["±"] else None
        if error is not None:
            return abs(a - b) <= 6.0 * error
        times = scale if re.fullmatch(r"\d[\d,]*", found[j]) else 1.0
        return abs(b * times - a) <= spread * abs(a) + (rough if a == 0.0 else 0.0)

    def match(i: int, j: int) -> bool:
        if i == len(wanted):
            return j == len(found) or (bool(wanted) and wanted[-1] == "…")
        if wanted[i] == "…":
            return any(match(i + 1, k) for k in range(j, len(found) + 1))
        return j < len(found) and agree(i, j) and match(i + 1, j + 1)

    return match(0, 0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder in which the pages' commands run one after the other."""
    folder = tmp_path_factory.mktemp("pages")
    shutil.copytree(ROOT / "samples", folder / "samples")
    ghost = (ROOT / "docs" / "find_the_ghost.md").read_text(encoding="utf-8")
    scene = (ROOT / "samples" / "double_gauss.toml").read_text(encoding="utf-8")
    [addition] = re.findall(r"```toml\n(.*?)```", ghost, re.S)
    (folder / "pair.toml").write_text(scene + "\n" + addition, encoding="utf-8")
    return folder


def own_folder(page: str, folder: Path, run: Any) -> Path:
    """A folder for one page with the samples, a map of the lens, and what the page needs."""
    if not (folder / "few").exists():
        (folder / "few").mkdir()
        lens_map(folder / "few", run, FEW_RAYS)
    own = folder / Path(page).stem
    own.mkdir()
    (own / "samples").symlink_to(folder / "samples", target_is_directory=True)
    shutil.copy(folder / "few" / "lens.raymap", own)
    PREPARE.get(page, lambda *_: None)(own, run)
    return own


def test_no_block_of_commands_is_left_out() -> None:
    left = []
    for page in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md")):
        text = page.read_text(encoding="utf-8")
        for block in re.finditer(r"^```([^\n]*)\n(.*?)^```", text, re.S | re.M):
            rows = block[2].splitlines()
            if block[1] != "console" and any(re.match(r"(\$ )?raymap [a-z]", r) for r in rows):
                left.append((page.name, rows[0]))
            if block[1] == "console":
                assert rows[0].startswith("$ "), (page.name, rows[0])
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
        folder = own_folder(page, folder, run)
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


@pytest.mark.parametrize(
    ("expected", "got", "scale", "good"),
    [
        ("19,518 of 2,000,000 rays (0.9759%)", "976 of 100,000 rays (0.976%)", 20.0, True),
        ("19,518 of 2,000,000 rays (0.9759%)", "700 of 100,000 rays (0.7%)", 20.0, False),
        ("flux 0.0098 ± 7e-05 W", "flux 0.0101 ± 0.00031 W", 20.0, True),
        ("flux 0.0098 ± 7e-05 W", "flux 0.0131 ± 0.00031 W", 20.0, False),
        ("wrote a.png", "wrote b.png", 1.0, False),
        ("2,000,000 rays, …", "100,000 rays, 3 records in 2 s", 20.0, True),
    ],
)
def test_lines_are_compared_as_samples(expected: str, got: str, scale: float, good: bool) -> None:
    assert says(expected, got, scale) is good

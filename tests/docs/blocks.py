"""The fenced blocks of the pages: README, changes, and everything under docs."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
FILES = (ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md")))

_FENCE = re.compile(r" *(`{3,}|~{3,})([^`]*)$")


@dataclass(frozen=True)
class Block:
    """A fenced block: its page, the number of its first row, its language and its text."""

    page: str
    line: int
    language: str
    text: str

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"

    @property
    def key(self) -> tuple[str, str]:
        """Page and first row, by which lists of tests name a block."""
        return self.page, next((row for row in self.text.splitlines() if row.strip()), "")


def of_page(page: str, text: str) -> list[Block]:
    """Blocks of a page in their order."""
    found: list[Block] = []
    fence, language, first, rows = "", "", 0, [""]
    for number, row in enumerate(text.splitlines(), start=1):
        mark = _FENCE.match(row)
        if not fence and mark:
            fence, language, first, rows = mark[1], mark[2].strip(), number + 1, []
        elif fence and mark and mark[1].startswith(fence) and not mark[2].strip():
            found.append(Block(page, first, language, "".join(f"{row}\n" for row in rows)))
            fence = ""
        else:
            rows.append(row)
    assert not fence, f"{page}:{first}: a block that does not end"
    return found


EVERY = [
    block
    for file in FILES
    for block in of_page(str(file.relative_to(ROOT)), file.read_text(encoding="utf-8"))
]


def blocks(language: str) -> list[Block]:
    """All blocks of a language."""
    return [block for block in EVERY if block.language == language]

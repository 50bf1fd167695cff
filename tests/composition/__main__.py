"""Write the table of `docs/composition.md`: ``python -m tests.composition``."""

from __future__ import annotations

from pathlib import Path

from tests.composition.running import RUNNING, ran
from tests.composition.table import MODES, filled, page, signs

PAGE = Path(__file__).parents[2] / "docs" / "composition.md"
MARKS = "<!-- made by python -m tests.composition -->\n", "<!-- end -->\n"
RUNS = "<!-- made by python -m tests.composition: running -->\n"


def part(text: str, mark: str) -> str:
    """What stands on the page behind a mark."""
    return text.partition(mark)[2].partition(MARKS[1])[0]


def running() -> str:
    """The table of ways of running."""
    return signs({name: {mode: ran(name, mode) for mode in MODES} for name in RUNNING})


def main() -> None:
    text = PAGE.read_text(encoding="utf-8")
    for mark, made in ((MARKS[0], page(filled())), (RUNS, running())):
        text = text.replace(mark + part(text, mark), mark + made)
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()

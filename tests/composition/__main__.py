"""Write the table of `docs/composition.md`: ``python -m tests.composition``."""

from __future__ import annotations

from pathlib import Path

from tests.composition.table import filled, page

PAGE = Path(__file__).parents[2] / "docs" / "composition.md"
MARKS = "<!-- made by python -m tests.composition -->\n", "<!-- end -->\n"


def main() -> None:
    text = PAGE.read_text(encoding="utf-8")
    before, _, rest = text.partition(MARKS[0])
    _, _, after = rest.partition(MARKS[1])
    PAGE.write_text(f"{before}{MARKS[0]}{page(filled())}{MARKS[1]}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()

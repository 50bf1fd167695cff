"""Runs outside checks and writes their page: ``python -m tests.validation [SECTION ...]``."""

from __future__ import annotations

import argparse
import sys
from contextlib import ExitStack

from tests.validation import Check, Row, sections
from tests.validation.page import PAGE, read_sections, section_text, write_page
from tests.whole_engine import whole_engine


def main() -> int:
    """Write the page; 1 where a row is outside of its tolerance."""
    registered = sections()
    parser = argparse.ArgumentParser(prog="python -m tests.validation", description=__doc__)
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=", ".join(registered))
    parser.add_argument(
        "--one-engine", action="store_true", help="compile one engine for all scenes: quicker"
    )
    asked = parser.parse_args()
    unknown = [name for name in asked.sections if name not in registered]
    if unknown:
        parser.error(f"no section {unknown[0]!r}; there are {', '.join(registered)}")
    written = read_sections(PAGE.read_text(encoding="utf-8")) if PAGE.exists() else {}
    texts, bad = [], []
    with ExitStack() as stack:
        if asked.one_engine:
            stack.enter_context(whole_engine())
        for name, (heading, checks) in registered.items():
            if asked.sections and name not in asked.sections and heading in written:
                texts.append(written[heading])
                continue
            done: list[tuple[Check, list[Row]]] = []
            for check in checks:
                print(f"{name}: {check.what}", file=sys.stderr)
                done.append((check, check.rows()))
                bad += [(check, row) for row in done[-1][1] if not row.good]
            texts.append(section_text(heading, done))
    write_page(texts)
    for check, row in bad:
        print(f"outside of its tolerance: {check.what}: {row}", file=sys.stderr)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())

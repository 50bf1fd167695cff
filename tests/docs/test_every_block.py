"""Every block of README, changes and docs is run by a test, or stands here with the reason."""

from __future__ import annotations

import pytest

from tests.docs import test_pages, test_python, test_toml
from tests.docs.blocks import EVERY, FILES, Block, of_page
from tests.query.expression import test_docs

RUN = {
    *test_pages.BLOCKS,
    *test_python.BLOCKS,
    *test_python.OUTPUTS,
    *test_toml.BLOCKS,
    *test_docs.BLOCKS,
}
"""Blocks that the tests of these modules go through."""

FORMAT = "docs/format.md"
NOT_RUN = {
    ("README.md", "make demo     # makes an environment, records a lens, finds its ghosts, draws "
     "them (Python 3.11 or newer)"): "makes an environment; its targets are looked up below",
    ("docs/architecture.md", "scene.toml ─► Scene (validated) ─► CompiledScene (plain arrays) ─► "
     "wavefront of rays ─► Portion ─► encoded streams ─► file"): "a diagram of the way of the data",
    (FORMAT, "file      magic 12 │ major u2 │ minor u2 │ chunk │ chunk │ chunk │ …"):
        "a diagram; the independent reader of tests/naive reads files by it",
    (FORMAT, "A = q_aa"): "formulas; the independent reader of tests/naive computes them",
    (FORMAT, "0000  89 52 41 59 4D 41 50 0D 0A 1A 0A 00    magic"):
        "bytes of a map; tests/raymap/file/test_format_page.py reads and writes them",
    ("docs/service.md", 'var channel = GrpcChannel.ForAddress("http://localhost:36413");'):
        "C#, which needs .NET; test_python.py sends what it sends",
}  # fmt: skip
"""Blocks that nothing runs, by page and first row, with the reason."""


def test_every_block_is_run_or_listed() -> None:
    left = [str(block) for block in EVERY if block not in RUN and block.key not in NOT_RUN]
    assert left == [], "neither run by a test nor listed with a reason"


def test_what_is_listed_stands_on_a_page_and_is_not_run() -> None:
    keys = [block.key for block in EVERY if block not in RUN]
    assert sorted(keys) == sorted(NOT_RUN)
    python = {block.key for block in test_python.BLOCKS}
    assert set(test_python.NEEDS) <= python


def test_no_fence_and_no_indented_command_escapes() -> None:
    for file in FILES:
        rows = file.read_text(encoding="utf-8").splitlines()
        fences = sum(row.lstrip("> ").startswith(("```", "~~~")) for row in rows)
        page = [block for block in EVERY if file.match(block.page)]
        assert fences == 2 * len(page), file.name
        assert not [row for row in rows if row.startswith(("    $ ", "    import ", "    >>> "))]


def test_targets_of_make_exist() -> None:
    [block] = [b for b in EVERY if b.page == "README.md" and b.text.startswith("make ")]
    makefile = (FILES[0].parent / "Makefile").read_text(encoding="utf-8")
    for row in block.text.splitlines():
        assert f"\n{row.split()[1]}:" in makefile


def test_blocks_are_found() -> None:
    text = "a\n```toml\nx = 1\n\n```\nb\n  ~~~\n```\n  ~~~\n"
    assert of_page("p.md", text) == [
        Block("p.md", 3, "toml", "x = 1\n\n"),
        Block("p.md", 8, "", "```\n"),
    ]
    with pytest.raises(AssertionError, match="does not end"):
        of_page("p.md", "```\n")

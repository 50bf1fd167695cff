"""A wrong file in the first place of any command: one clear line, exit code 1, no traceback."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.test_without_extras import WORDS

TAKES_A_FILE = [name for name, words in WORDS.items() if words and not words[0].startswith("-")]


@pytest.mark.parametrize("command", sorted(set(TAKES_A_FILE) - {"serve"}))
def test_what_is_no_map_and_no_scene(
    command: str, tmp_path: Path, run: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "text.txt").write_text("Nothing of the kind.\nTwo lines.\n", encoding="utf-8")
    (tmp_path / "empty").write_bytes(b"")
    (tmp_path / "folder").mkdir()
    for name in ("text.txt", "empty", "folder", "missing"):
        code, out, error = run(command, name, *WORDS[command][1:])
        told = [line for line in error.splitlines() if line.startswith("error: ")]
        assert (code, len(told)) == (1, 1), (command, name, code, out, error)
        assert name in told[0], told
        assert "Traceback" not in error


@pytest.mark.parametrize("command", sorted(set(TAKES_A_FILE) - {"serve"}))
def test_a_missing_argument_is_named(command: str, run: Any) -> None:
    code, _, error = run(command)
    assert code == 2
    assert "Missing" in error

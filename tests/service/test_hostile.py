"""The script of hostile requests in its short form: each try is survived, in little memory."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.service.hostile import Row, attack

pytestmark = pytest.mark.skipif(
    sys.platform != "linux", reason="memory and processes of a server are looked up in /proc"
)


def test_hostile_requests(tmp_path: Path) -> None:
    rows: list[Row] = []
    attack(tmp_path, short=True, tell=rows.append)
    assert len(rows) == 15
    assert [row for row in rows if row.survived < row.tried] == []
    # 24 answers of 22 MB each, and 600 MB announced: what a server takes that bounds nothing
    assert max(row.peak for row in rows) < 600e6
    said = (tmp_path / "stderr.txt").read_text(encoding="utf-8")
    # Nothing that a client sends acts on the terminal of the service
    assert all(line.isprintable() for line in said.splitlines())
    assert "Traceback" not in said
    assert "Bearer" not in said

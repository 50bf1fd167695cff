"""The page of the protocol and the code say the same."""

from __future__ import annotations

import re
from pathlib import Path

from raymap.remote.client import Service
from raymap.remote.protocol import PROTOCOL
from service import Limits
from service.answers.streams import _LINES, _PATHS, STREAMS
from service.server import ACTIONS

PAGE = (Path(__file__).parents[2] / "docs" / "service.md").read_text(encoding="utf-8")


def rows(heading: str) -> dict[str, str]:
    """First cell of a table's rows, without code marks, to the whole row."""
    part = PAGE.partition(heading)[2].partition("\n##")[0]
    found = re.findall(r"^\| `(\w+)` \|(.*)\|$", part, re.M)
    return {name: rest for name, rest in found if "further keys" not in rest}


def test_every_action_and_stream_is_described() -> None:
    assert list(rows("### Actions")) == list(ACTIONS)
    streams = rows("### Streams")
    assert list(streams) == list(STREAMS)
    for kind, schema in (("lines", _LINES), ("paths", _PATHS)):
        for name in schema.names:
            assert f"`{name}`" in streams[kind]
    assert f"Version {PROTOCOL}; " in PAGE


def test_limits_are_those_of_the_code() -> None:
    limits = Limits()
    assert "One request: 1 MiB" in PAGE
    assert limits.request_bytes == 2**20
    assert f"{limits.criterion_characters:,} characters" in PAGE
    assert f"{limits.criterion_characters // 10:,} JSON nodes" in PAGE
    assert f"one search {limits.search_seconds:g} s" in PAGE
    assert f"wait\n  their turn for {limits.turn_seconds:g} s" in PAGE
    assert f"an upload {limits.upload_bytes // 2**20} MiB" in PAGE
    assert f"{limits.views} applications" in PAGE
    assert f"{limits.maps} maps open" in PAGE


def test_every_call_of_the_client_is_described() -> None:
    for name in ("files", "upload", "upload_text", "scene", "record", "open"):
        assert hasattr(Service, name)
        assert f"`{name}(" in PAGE

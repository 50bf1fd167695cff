"""What a map says reaches a terminal as text alone."""

from __future__ import annotations

from query.cli.terminal import _medium


def test_parameters_of_media_do_nothing_to_a_terminal() -> None:
    point = {"refractive_index": 1.5, "medium_parameters": {"no\x1b[2Jte": "\x9b2J", "n_d": 1.5}}
    assert _medium(point).splitlines() == ["n 1.500000", "no\\x1b[2Jte \\x9b2J", "n_d 1.5"]

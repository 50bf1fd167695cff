"""Numbers and characters of TOML and JSON that the languages allow and nobody can use."""

from __future__ import annotations

import json

import pytest

from raymap.model.errors import FormatError, SceneError
from raymap.model.giventext import json_value, toml_tables
from raymap.model.jsontext import parse_json


def test_whole_numbers_of_toml_have_64_bits() -> None:
    assert toml_tables(f"x = {2**64 - 1}", "here") == {"x": 2**64 - 1}
    for text in (f"x = {2**64}", f"x = -{2**64}", f"[a]\nx = [[1], {{y = [{10**400}]}}]"):
        with pytest.raises(SceneError, match=r"here: (a\.)?x(\.y)?: a whole number has at most 64"):
            toml_tables(text, "here", SceneError)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x = " + "9" * 5001, "a number cannot be read"),
        ("x = " + "[" * 5000 + "]" * 5000, "nest too deep"),
        ("x = [", "not a TOML file"),
        ("x = 2026-13-01", "not a TOML file"),
    ],
)
def test_what_is_no_toml(text: str, words: str) -> None:
    with pytest.raises(SceneError, match=words):
        toml_tables(text, "here", SceneError)


def test_numbers_of_json_are_those_of_other_readers() -> None:
    """RFC 8259, section 6: what goes beyond is approximated by a double."""
    assert json_value(f"[{2**64 - 1}, {2**64}, 1{'0' * 30}]") == [2**64 - 1, 2.0**64, 1e30]
    assert isinstance(json_value(str(2**64)), float)
    for text in ("9" * 400, "9" * 5001, "1e400", "-1e400", "[" * 10**5):
        with pytest.raises(ValueError, match=r"too large|too deeply|Expecting"):
            json_value(text)


def test_halves_of_characters_are_spelt_out() -> None:
    assert json_value('{"\\ud800": "a\\udfffb"}') == {"\\ud800": "a\\udfffb"}
    assert json_value(b'["\\ud83d\\ude00", "\\u00e9"]') == ["\U0001f600", "é"]


def test_texts_of_maps_nest_up_to_128_levels() -> None:
    for depth in (128, 129):
        text = b"[" * depth + b"]" * depth
        if depth == 128:
            assert parse_json(text, list, "here") == json.loads(text)
            continue
        with pytest.raises(FormatError, match="nests deeper than 128 levels"):
            parse_json(text, list, "here")
    assert len(parse_json(b"[" + b"[]," * 1000 + b"[]]", list, "here")) == 1001

"""Numbers of command lines that are none, or too long, are refused before anything is looked at."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

COMMANDS = (
    "import FILE -o OUT --wavelength-nm VALUE",
    "chart FILE sensor -o OUT --at VALUE VALUE",
    "chart FILE sensor -o OUT --low VALUE",
    "report FILE VALUE",
    "paths FILE --top VALUE",
    "record FILE -o OUT --seconds VALUE",
    "record FILE -o OUT --rays VALUE",
    "picture FILE -o OUT --opacity VALUE",
    "goniophotometer FILE --thickness VALUE",
    "goniophotometer FILE --thickness 1 --wavelength VALUE",
    "token add name --tokens OUT --days VALUE",
    "microscope -o OUT --thickness VALUE",
)


@pytest.mark.parametrize("value", ["nan", "inf", "9" * 400, "9" * 5001])
@pytest.mark.parametrize("line", COMMANDS)
def test_numbers_that_are_none(run: Any, tmp_path: Path, line: str, value: str) -> None:
    (tmp_path / "file").write_text("nothing")
    places = {"FILE": tmp_path / "file", "OUT": tmp_path / "out", "VALUE": value}
    code, out, err = run(*(places.get(word, word) for word in line.split()))
    # Usage, as for a number that Click itself refuses
    assert code == 2
    assert "Invalid value" in err
    assert out == ""
    assert not (tmp_path / "out").exists()

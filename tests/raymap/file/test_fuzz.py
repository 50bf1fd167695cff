"""The short form of the fuzz run."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

from tests.fuzz.fuzz_reader import mend, read_everything, seeds, short_run

_SCRIPT = Path(__file__).resolve().parents[2] / "fuzz" / "fuzz_reader.py"


def test_mending_leaves_a_sound_map_alone():
    for content in seeds()[::2]:
        assert mend(content[:-1]) == content[:-1]
        read_everything(content[:-1])


def test_a_table_of_colours_without_whole_rows_is_damage():
    """Its rows are counted by columns that do not read it."""
    found = 0
    for content in seeds()[::2]:
        data = bytearray(content[:-1])
        place = data.find(b"color.table\0")
        while place >= 0:
            data[place + 36 : place + 40] = (16386).to_bytes(4, "little")
            found += 1
            place = data.find(b"color.table\0", place + 1)
        read_everything(mend(bytes(data)))
    assert found


def test_a_short_run_finds_nothing():
    assert short_run(60) == 60


@pytest.mark.slow
def test_a_long_run_finds_nothing():
    assert short_run(20_000, seed=2) == 20_000


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("atheris") is None, reason="needs atheris")
def test_atheris_finds_nothing():
    command = [sys.executable, str(_SCRIPT), "-runs=5000"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=1200, check=False)
    assert done.returncode == 0, done.stderr[-4000:]

"""What is falsified stands once, and every feature names a test that exists."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.mutants.falsehoods import MUTANTS, Mutant

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_falsehoods_have_a_place_and_tests(mutant: Mutant) -> None:
    assert (ROOT / mutant.file).read_text().count(mutant.true) == 1
    for test in mutant.features.values():
        file, _, name = test.partition("::")
        assert f"def {name}" in (ROOT / file).read_text()

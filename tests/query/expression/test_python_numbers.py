"""Numbers that Python takes and no criterion can compare with."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import pytest

import query
from raymap.model.errors import CriterionError


@pytest.mark.parametrize(
    "value",
    [
        "1.2.3 mm", "1..2", ".", "٣ mm", "9" * 400 + " mm", "1e400", "nan", 10**400, 10**5000,
        Fraction(10**400), float("nan"), float("inf"), "5 mm mm", True, None,
    ],
    ids=lambda value: str(type(value).__name__),
)  # fmt: skip
def test_numbers_that_are_none(value: Any) -> None:
    with pytest.raises(CriterionError, match="expected a") as refused:
        _ = query.length > value
    assert len(str(refused.value)) < 200


@pytest.mark.parametrize("text", ["{%s}", "{1,%s}", "{%s,}"])
def test_repetitions_of_many_digits(text: str) -> None:
    with pytest.raises(CriterionError, match="too large"):
        query.as_criterion('path("* .%s")' % text.replace("%s", "9" * 5001))  # noqa: UP031

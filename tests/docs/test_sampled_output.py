"""Lines of output are compared as samples."""

from __future__ import annotations

import pytest

from tests.docs.sampled_output import says


@pytest.mark.parametrize(
    ("expected", "got", "scale", "good"),
    [
        ("19,518 of 2,000,000 rays (0.9759%)", "976 of 100,000 rays (0.976%)", 20.0, True),
        ("19,518 of 2,000,000 rays (0.9759%)", "700 of 100,000 rays (0.7%)", 20.0, False),
        ("flux 0.0098 ± 7e-05 W", "flux 0.0101 ± 0.00031 W", 20.0, True),
        ("flux 0.0098 ± 7e-05 W", "flux 0.0131 ± 0.00031 W", 20.0, False),
        ("wrote a.png", "wrote b.png", 1.0, False),
        ("2,000,000 rays, …", "100,000 rays, 3 records in 2 s", 20.0, True),
    ],
)
def test_lines_are_compared_as_samples(expected: str, got: str, scale: float, good: bool) -> None:
    assert says(expected, got, scale) is good

"""Every outside check holds, and the page shows every row of it."""

from __future__ import annotations

from importlib import metadata

import pytest

from tests.validation import Check, Row, sections
from tests.validation.page import PAGE, beginning, read_sections

SECTIONS = sections()
CHECKS = [
    pytest.param(
        heading, check, id=f"{name}-{check.name}", marks=[pytest.mark.slow] if check.slow else []
    )
    for name, (heading, checks) in SECTIONS.items()
    for check in checks
]
WRITTEN = read_sections(PAGE.read_text(encoding="utf-8"))


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the packages compared with
@pytest.mark.parametrize(("heading", "check"), CHECKS)
def test_check(heading: str, check: Check) -> None:
    for package in check.packages:
        try:
            metadata.version(package)
        except metadata.PackageNotFoundError:
            pytest.skip(f"{package} is not installed")
    rows = check.rows()
    assert rows
    for row in rows:
        assert row.good, f"{check.what}: {row}, error {row.error:.2e}"
        lines = [x for x in WRITTEN[heading].splitlines() if x.startswith(beginning(check, row))]
        assert len(lines) == 1, f"run python -m tests.validation: {beginning(check, row)}"


def test_the_page_has_the_registered_checks_and_no_others() -> None:
    assert list(WRITTEN) == [heading for heading, _ in SECTIONS.values()]
    for heading, checks in SECTIONS.values():
        table = [x for x in WRITTEN[heading].splitlines() if x.startswith("| ")][1:]
        known = {check.what: check.source for check in checks}
        assert len(known) == len(checks), f"two checks of {heading} say the same"
        shown = {
            check.what
            for check in checks
            for x in table
            if x.startswith((f"| {check.what} |", f"| {check.what}: ")) and check.source in x
        }
        assert shown == set(known)
        for x in table:
            assert any(x.startswith((f"| {what} |", f"| {what}: ")) for what in known), x
        assert len(set(table)) == len(table)


def test_a_value_outside_of_its_tolerance_is_bad() -> None:
    assert Row(expected=1.0, got=1.1, tolerance=0.2).good
    assert not Row(expected=1.0, got=1.3, tolerance=0.2).good
    assert not Row(expected=1.0, got=float("nan"), tolerance=0.2).good


def test_a_bound_must_mean_something() -> None:
    with pytest.raises(ValueError, match="without a bound"):
        Row(expected=1.0, got=1.0, tolerance=float("inf"))
    with pytest.raises(ValueError, match="six standard errors"):
        Row(expected=1.0, got=1.0, tolerance=1.0, got_error=0.1)

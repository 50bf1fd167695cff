"""Outside checks: what the product computes beside what a formula, a standard or a package says.

A module of this package is a section of ``docs/validation.md``; the first line of its docstring is
the heading. A check is a small function under the decorator::

    @check(what="Reflection of glass at 45°", source="Fresnel (Born & Wolf, 1.5.2)")
    def fresnel_at_45() -> Row:
        return Row(expected=0.050239911, got=..., tolerance=1e-9)

*What* says what is computed, *source* where the right value comes from: never from this project.
A check may return several rows; ``of`` tells them apart. A value known only within an error says
so by ``expected_error`` or ``got_error``; the tolerance then covers both, 4 to 5 standard errors
and no more. ``packages`` names the packages of the `peers` extra that a check calls: their versions
stand on the page, and where they are missing its test is skipped. A check of more than a few
seconds is ``slow``.

``python -m tests.validation`` runs every check and writes the page, ``python -m tests.validation
light lenses`` runs those sections and leaves the others as they are. The command is not one of
``raymap``: the checks lean on oracles, scenes and packages that are not installed with it. The test
beside holds every row to its tolerance and the page to the rows.
"""

from __future__ import annotations

import importlib
import math
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass, field

__all__ = ["Check", "Row", "check", "sections"]


@dataclass(frozen=True, kw_only=True)
class Row:
    """A value of the product beside its right value; errors and tolerance are absolute."""

    expected: float
    got: float
    tolerance: float
    unit: str = ""
    of: str = ""
    expected_error: float = 0.0
    got_error: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.expected) and 0.0 <= self.tolerance < math.inf):
            raise ValueError(f"a row without a bound: {self}")
        spread = math.hypot(self.expected_error, self.got_error)
        if spread and self.tolerance > 6.0 * spread:
            raise ValueError(f"the tolerance is more than six standard errors: {self}")

    @property
    def error(self) -> float:
        """What was got less what is expected."""
        return self.got - self.expected

    @property
    def good(self) -> bool:
        """Whether the error is within the tolerance."""
        return abs(self.error) <= self.tolerance


@dataclass(frozen=True, kw_only=True)
class Check:
    """A registered function with what it is about."""

    name: str
    what: str
    source: str
    packages: tuple[str, ...]
    slow: bool
    compute: Callable[[], Row | list[Row]] = field(repr=False)

    def rows(self) -> list[Row]:
        """Run the check."""
        found = self.compute()
        return [found] if isinstance(found, Row) else found


_REGISTERED: dict[str, list[Check]] = {}


def check(
    *, what: str, source: str, packages: tuple[str, ...] = (), slow: bool = False
) -> Callable[[Callable[[], Row | list[Row]]], Callable[[], Row | list[Row]]]:
    """Register a function as an outside check of its module's section."""

    def register(compute: Callable[[], Row | list[Row]]) -> Callable[[], Row | list[Row]]:
        section = compute.__module__.rpartition(".")[2]
        made = Check(
            name=compute.__name__,
            what=what,
            source=source,
            packages=packages,
            slow=slow,
            compute=compute,
        )
        if any(made.name == other.name for other in _REGISTERED.setdefault(section, [])):
            raise ValueError(f"two checks of {section} are called {made.name}")
        _REGISTERED[section].append(made)
        return compute

    return register


def sections() -> dict[str, tuple[str, list[Check]]]:
    """Heading and checks of every module of this package, by its name."""
    found: dict[str, tuple[str, list[Check]]] = {}
    for module in pkgutil.iter_modules(__path__):
        if module.name.startswith(("_", "test_", "page")):
            continue
        room = importlib.import_module(f"{__name__}.{module.name}")
        heading = (room.__doc__ or "").splitlines()[0].rstrip(".")
        found[module.name] = (heading, _REGISTERED[module.name])
    return dict(sorted(found.items()))

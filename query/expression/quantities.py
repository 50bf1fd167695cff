"""Numbers that a ray has, compared with numbers: ``wavelength < 500 nm``, ``count(...) >= 2``."""

from __future__ import annotations

import math
import numbers
import re
from dataclasses import dataclass
from typing import Any, ClassVar

from query.expression.criterion import Criterion, check_point
from raymap.model.errors import CriterionError

__all__ = [
    "OPERATORS",
    "AngleOfPolarisation",
    "Bounces",
    "Compare",
    "Count",
    "DegreeOfPolarisation",
    "Flux",
    "Incidence",
    "Length",
    "OpticalLength",
    "OpticalPath",
    "Quantity",
    "Recorded",
    "Wavelength",
    "finite",
]

OPERATORS = ("==", "!=", "<", "<=", ">", ">=")


class Quantity:
    """A number that a ray has; compare it with a number to get a criterion.

    Comparison builds a `Compare` node: ``wavelength < 500``, ``length >= "12 cm"``.
    """

    word: ClassVar[str] = ""

    def __lt__(self, other: object) -> Compare:
        return Compare(self, "<", *_measure(other))

    def __le__(self, other: object) -> Compare:
        return Compare(self, "<=", *_measure(other))

    def __gt__(self, other: object) -> Compare:
        return Compare(self, ">", *_measure(other))

    def __ge__(self, other: object) -> Compare:
        return Compare(self, ">=", *_measure(other))

    def __eq__(self, other: object) -> Any:
        if isinstance(other, Quantity):
            return type(self) is type(other) and self._key() == other._key()
        return Compare(self, "==", *_measure(other))

    def __ne__(self, other: object) -> Any:
        if isinstance(other, Quantity):
            return not (type(self) is type(other) and self._key() == other._key())
        return Compare(self, "!=", *_measure(other))

    def __hash__(self) -> int:
        return hash((type(self).__name__, self._key()))

    def __bool__(self) -> bool:
        raise TypeError(
            f"{self.word} has no truth value; compare it with a number: {self.word} > 1"
        )

    def _key(self) -> object:
        return None


class Wavelength(Quantity):
    """Vacuum wavelength of the ray at its end [nm]; undefined while several channels travel."""

    word = "wavelength"


class Length(Quantity):
    """Geometric length of the ray [scene units], without the last segment of one that left."""

    word = "length"


class OpticalLength(Quantity):
    """Sum of refractive index x length [scene units]."""

    word = "optical_length"


class Bounces(Quantity):
    """Points between the first and the last."""

    word = "bounces"


class Flux(Quantity):
    """Flux that the ray carries [flux unit of the map]."""

    word = "flux"


@dataclass(frozen=True, eq=False)
class Count(Quantity):
    """How many points satisfy a point condition."""

    point: Criterion
    word = "count"

    def __post_init__(self) -> None:
        check_point(self.point, "count")

    def _key(self) -> object:
        return self.point


@dataclass(frozen=True, eq=False)
class Incidence(Quantity):
    """Angle between the arriving ray and the normal at a point that satisfies a condition [deg].

    The comparison holds if it holds at one such point.
    """

    point: Criterion
    word = "incidence"

    def __post_init__(self) -> None:
        check_point(self.point, "incidence")

    def _key(self) -> object:
        return self.point


@dataclass(frozen=True, eq=False)
class Recorded(Quantity):
    """A quantity that polarised traces record, at the ray's end or at certain points.

    Without ``point`` it speaks of the light of the ray's last segment; with one, of the light that
    goes on from points that satisfy it, and the comparison holds if it holds at one of them.
    Undefined in maps without the column. Calling it adds the point:
    ``degree_of_polarisation(hit("L1")) > 0.5``.
    """

    point: Criterion | None = None

    def __post_init__(self) -> None:
        if self.point is not None:
            check_point(self.point, self.word)

    def __call__(self, point: Criterion) -> Recorded:
        return type(self)(point)

    def _key(self) -> object:
        return self.point


@dataclass(frozen=True, eq=False)
class DegreeOfPolarisation(Recorded):
    """Polarised share of the light, 0 to 1."""

    word = "degree_of_polarisation"


@dataclass(frozen=True, eq=False)
class AngleOfPolarisation(Recorded):
    """Azimuth of the vibration from the transverse axis x [deg], (-90, 90]."""

    word = "angle_of_polarisation"


@dataclass(frozen=True, eq=False)
class OpticalPath(Recorded):
    """Recorded optical path from the emission to the point [scene units]."""

    word = "optical_path"


@dataclass(frozen=True)
class Compare(Criterion):
    """A quantity compared with a number."""

    quantity: Quantity
    operator: str
    value: float
    unit: str = ""

    def __post_init__(self) -> None:
        if self.operator not in OPERATORS:
            raise CriterionError(
                f"{self.operator!r} is not a comparison; write one of == != < <= > >="
            )
        object.__setattr__(self, "value", finite(self.value))


def finite(value: object) -> float:
    """A number that is one, or an error that says so."""
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise CriterionError(f"expected a number, found {value!r}")
    number = float(value)
    if not math.isfinite(number):
        raise CriterionError(f"expected a finite number, found {value!r}")
    return number + 0.0  # one zero only


def _measure(value: object) -> tuple[float, str]:
    """A number, or a text such as ``"12.5 mm"``, as (number, unit)."""
    if isinstance(value, str):
        match = re.fullmatch(r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*([^\d\s]\S*)?\s*", value)
        if match is None:
            raise CriterionError(
                f"expected a number with a unit such as '12.5 mm', found {value!r}"
            )
        return finite(float(match.group(1))), match.group(2) or ""
    return finite(value), ""

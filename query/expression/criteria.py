"""The expression tree of criteria: every node under one name.

A criterion speaks about one ray. Text (`query.expression.grammar`), Python operators
(`query.expression.builders`) and JSON (`query.expression.json_form`) are three spellings of this
one immutable tree; nothing in it knows a map.

`query.expression.criterion`   what a criterion is, and the operators that join them
`query.expression.conditions`  what a ray did: source, hit, event, detected, medium, last, path …
`query.expression.quantities`  numbers that a ray has, compared: count, wavelength, length …
"""

from __future__ import annotations

from query.expression.conditions import (
    All,
    Crossed,
    Detected,
    EventAt,
    EventSet,
    Hit,
    Last,
    Medium,
    Path,
    Region,
    Source,
    SurfaceTest,
)
from query.expression.criterion import And, Criterion, Not, Or, Then, Xor
from query.expression.quantities import (
    OPERATORS,
    AngleOfPolarisation,
    Bounces,
    Compare,
    Count,
    DegreeOfPolarisation,
    Flux,
    Incidence,
    Length,
    OpticalLength,
    OpticalPath,
    Quantity,
    Recorded,
    Wavelength,
)

__all__ = [
    "All",
    "And",
    "AngleOfPolarisation",
    "Bounces",
    "Compare",
    "Count",
    "Criterion",
    "Crossed",
    "DegreeOfPolarisation",
    "Detected",
    "EventAt",
    "EventSet",
    "Flux",
    "Hit",
    "Incidence",
    "Last",
    "Length",
    "Medium",
    "Not",
    "OPERATORS",
    "OpticalLength",
    "OpticalPath",
    "Or",
    "Path",
    "Quantity",
    "Recorded",
    "Region",
    "Source",
    "SurfaceTest",
    "Then",
    "Wavelength",
    "Xor",
]

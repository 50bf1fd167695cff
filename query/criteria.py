"""The expression tree of criteria: every node under one name.

A criterion speaks about one ray. Text (`query.grammar`), Python operators (`query.builders`) and
JSON (`query.json_form`) are three spellings of this one immutable tree; nothing in it knows a map.

`query.criterion`   what a criterion is, and the operators that join them
`query.conditions`  what a ray did: source, hit, event, detected, medium, last, path …
`query.quantities`  numbers that a ray has, and their comparison: count, wavelength, length …
"""

from __future__ import annotations

from query.conditions import (
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
from query.criterion import And, Criterion, Not, Or, Then, Xor
from query.quantities import (
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

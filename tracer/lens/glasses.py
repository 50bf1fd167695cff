"""A few glasses that lenses are often made of.

Sellmeier coefficients and internal transmittances of 10 mm as Schott prints them (N-BK7, N-SF11);
fused silica after I. H. Malitson, J. Opt. Soc. Am. 55, 1205 (1965). Indices are relative to air.
"""

from __future__ import annotations

from tracer.lens.errors import LensError
from tracer.lens.glass import Glass
from tracer.optics.dispersion import sellmeier

__all__ = ["GLASSES", "named_glass"]

N_BK7 = Glass(
    dispersion=sellmeier(
        (1.03961212, 0.231792344, 1.01046945),
        (0.00600069867, 0.0200179144, 103.560653),
        range_nm=(300.0, 2500.0),
        name="N-BK7",
    ),
    transmittance={
        365.0: 0.9883,
        380.0: 0.99276,
        400.0: 0.99679,
        436.0: 0.99679,
        460.0: 0.99719,
        500.0: 0.9976,
        546.0: 0.9984,
        580.0: 0.9984,
        620.0: 0.9980,
        660.0: 0.9980,
        700.0: 0.9984,
        780.0: 0.9984,
    },
)

N_SF11 = Glass(
    dispersion=sellmeier(
        (1.73759695, 0.313747346, 1.89878101),
        (0.013188707, 0.0623068142, 155.23629),
        range_nm=(370.0, 2500.0),
        name="N-SF11",
    )
)

FUSED_SILICA = Glass(
    dispersion=sellmeier(
        (0.6961663, 0.4079426, 0.8974794),
        (0.0684043**2, 0.1162414**2, 9.896161**2),
        range_nm=(210.0, 3710.0),
        name="fused silica",
    )
)

GLASSES: dict[str, Glass] = {
    "N-BK7": N_BK7,
    "N-SF11": N_SF11,
    "fused silica": FUSED_SILICA,
}


def named_glass(text: str) -> Glass | float:
    """A glass by name, or a constant index from a number.

    Raises
    ------
    LensError
        neither a known name nor a number
    """
    if text in GLASSES:
        return GLASSES[text]
    try:
        return float(text)
    except ValueError:
        raise LensError(
            f"glass is {text!r}: give a refractive index or one of {', '.join(GLASSES)}"
        ) from None

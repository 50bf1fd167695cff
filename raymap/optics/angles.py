"""Sine and cosine of angles in turns.

A random number is an azimuth in turns as it is. Its sine and cosine are found sooner than those of
an angle: nothing has to be brought back into one period.
"""

from __future__ import annotations

import math

from raymap.jit.kernels import inline_kernel

__all__ = ["turned"]

_TURN = 2.0 * math.pi


@inline_kernel
def turned(u: float) -> tuple[float, float]:
    """Cosine and sine of 2 pi u for u from 0 to 1, within a rounding or two.

    References
    ----------
    The polynomials of FDLIBM, Sun Microsystems 1993, for angles up to an eighth of a turn.
    """
    quarter = int(4.0 * u + 0.5)
    x = _TURN * (u - 0.25 * quarter)
    z = x * x
    s = 2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)  # noqa: E501  # fmt: skip
    s = 8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + z * s)
    s = x + x * z * (-1.66666666666666324348e-01 + z * s)
    c = -2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 - z * 1.13596475577881948265e-11)  # noqa: E501  # fmt: skip
    c = -1.38888888888741095749e-03 + z * (2.48015872894767294178e-05 + z * c)
    c = 1.0 - (0.5 * z - z * z * (4.16666666666666019037e-02 + z * c))
    # Turn on by whole quarters
    odd = quarter & 1 != 0
    cosine, sine = (s if odd else c), (c if odd else s)
    return (
        -cosine if (quarter + 1) & 2 != 0 else cosine,
        -sine if quarter & 2 != 0 else sine,
    )

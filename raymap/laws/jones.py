"""How laws of surfaces treat the two polarisations: what compiled code is told of a law.

A row names one of the forms below; its numbers by channel are laid out as `raymap.laws.amplitudes`
reads them. Laws without a row of their own leave light behind that is unpolarised.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "BARE",
    "DEPOLARISES",
    "EVEN",
    "EVEN_MIRROR",
    "LAYERS",
    "METAL",
    "POLARISER",
    "RETARDER",
    "STRAIGHT",
    "TABLES",
    "JonesRow",
]

F64 = NDArray[np.float64]

(
    DEPOLARISES,
    BARE,
    EVEN,
    EVEN_MIRROR,
    METAL,
    LAYERS,
    TABLES,
    STRAIGHT,
    POLARISER,
    RETARDER,
) = range(10)
"""Forms, with their numbers by channel.

DEPOLARISES : light that leaves has no memory; none
BARE : Fresnel's amplitudes of a bare interface; none
EVEN : an interface that treats both polarisations alike; its table of shares
EVEN_MIRROR : a mirror that does; its reflectance, and that of light that meets several facets
METAL : Fresnel's amplitudes of n + i k; n, k, and the reflectance after several facets
LAYERS : amplitudes of a stack; its table of shares, number of layers, and for each, from the rarer
    medium to the denser, n, k and 2 pi thickness / wavelength
TABLES : shares of s and of p that were measured; a table for natural light, for s and for p
STRAIGHT : light goes on as it is; none
POLARISER : axis that it absorbs, extinction, transmittance of what it does not absorb
RETARDER : slow axis, retardation [rad]
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class JonesRow:
    """What a law does to polarised light.

    Attributes
    ----------
    form : one of the above
    numbers : (n_channels, m)
    roughness : of facets that have the form (GGX), 0 where the surface is smooth
    scatter : tables of a law about the specular light (`raymap.laws.radial`), one or one per
        channel; what it scatters leaves unpolarised
    """

    form: int
    numbers: F64
    roughness: float = 0.0
    scatter: F64 | None = None

"""``scatter = { k_correlation = [A, B, C] }``: A / (1 + (B rho)²)^(C / 2), the ABC model."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import SceneError
from tracer.surfaces.scatter_laws.law import ScatterLaw

__all__ = ["K_CORRELATION", "k_correlation"]

F64 = NDArray[np.float64]


def k_correlation(
    a: float, b: float, c: float, *, wavelength_nm: float = 0.0, reference_nm: float = 0.0
) -> Callable[[F64], F64]:
    """The BSDF [1/sr] of a surface whose roughness has a K-correlation spectrum.

    The roughness is the same at all wavelengths: with x = λ / λ_ref, A becomes A x^-4 and B becomes
    B / x, since rho / λ is the spatial frequency.

    References
    ----------
    J. C. Stover, Optical Scattering, 3rd ed., SPIE (2012), section 2.4.
    """
    if not (a > 0.0 and b > 0.0 and c >= 0.0):
        raise SceneError("K-correlation scattering: A and B must be positive, C not negative")
    x = wavelength_nm / reference_nm if wavelength_nm > 0.0 and reference_nm > 0.0 else 1.0
    return lambda rho: a * x**-4.0 * (1.0 + (b / x * rho) ** 2) ** (-0.5 * c)


K_CORRELATION = ScatterLaw(
    word="k_correlation",
    parameters=("A", "B", "C"),
    title="A (1 + (B rho)²)^(-C / 2) [1/sr]",
    bsdf=k_correlation,
)

"""Refractive index as a function of wavelength.

Host functions over arrays, used when a scene is compiled. Wavelengths are vacuum wavelengths in
nm; inside the formulas in µm, as all catalogues print them. Catalogue indices of glasses are
relative to air; they are used as they stand, with the index of air taken as 1.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.model.errors import SceneError

__all__ = [
    "LINE_NM",
    "Dispersion",
    "Kind",
    "OutOfRangeWarning",
    "abbe_number",
    "cauchy_index",
    "constant",
    "cauchy",
    "polynomial_index",
    "sellmeier",
    "sellmeier_index",
    "tabulated",
    "tabulated_index",
]

LINE_NM = {
    "h": 404.6561,
    "g": 435.8343,
    "F'": 479.9914,
    "F": 486.1327,
    "e": 546.0740,
    "d": 587.5618,
    "D": 589.2938,
    "C'": 643.8469,
    "C": 656.2725,
    "r": 706.5188,
}
"""Fraunhofer lines [nm, in air, as glass catalogues use them]."""


class OutOfRangeWarning(UserWarning):
    """A material was asked for outside the wavelengths that its data cover."""


def sellmeier_index(wavelength_nm: ArrayLike, coefficients: Sequence[float]) -> NDArray[np.float64]:
    """Index from n² = 1 + A + Σ B_i λ² / (λ² - C_i), λ in µm.

    Parameters
    ----------
    wavelength_nm : (...) [nm]
    coefficients : (A, B_1, C_1, B_2, C_2, …), C in µm²; A = 0 in the three-term form of the
        glass catalogues

    References
    ----------
    W. Sellmeier, Annalen der Physik und Chemie 219, 272 (1871).
    """
    square = (np.asarray(wavelength_nm, np.float64) * 1e-3) ** 2
    total = np.full_like(square, 1.0 + coefficients[0])
    for b, c in zip(coefficients[1::2], coefficients[2::2], strict=True):
        total += b * square / (square - c)
    return _root(total)


def polynomial_index(
    wavelength_nm: ArrayLike, coefficients: Sequence[float]
) -> NDArray[np.float64]:
    """Index from n² = a_0 + Σ a_i λ^p_i, λ in µm (Schott's older form and its extensions).

    Parameters
    ----------
    wavelength_nm : (...) [nm]
    coefficients : (a_0, a_1, p_1, a_2, p_2, …)
    """
    return _root(_power_series(wavelength_nm, coefficients))


def cauchy_index(wavelength_nm: ArrayLike, coefficients: Sequence[float]) -> NDArray[np.float64]:
    """Index from n = A + B / λ² + C / λ⁴ + …, λ in µm.

    Parameters
    ----------
    wavelength_nm : (...) [nm]
    coefficients : (A, B [µm²], C [µm⁴], …)
    """
    square = (np.asarray(wavelength_nm, np.float64) * 1e-3) ** 2
    total = np.zeros_like(square)
    for number, coefficient in enumerate(coefficients):
        total += coefficient / square**number
    return total


def tabulated_index(
    wavelength_nm: ArrayLike, table_nm: ArrayLike, table_index: ArrayLike
) -> NDArray[np.float64]:
    """Index interpolated linearly in λ; the end values hold outside the table."""
    return np.interp(
        np.asarray(wavelength_nm, np.float64),
        np.asarray(table_nm, np.float64),
        np.asarray(table_index, np.float64),
    )


def _power_series(wavelength_nm: ArrayLike, coefficients: Sequence[float]) -> NDArray[np.float64]:
    micrometre = np.asarray(wavelength_nm, np.float64) * 1e-3
    total = np.full_like(micrometre, coefficients[0])
    for factor, power in zip(coefficients[1::2], coefficients[2::2], strict=True):
        total += factor * micrometre**power
    return total


def _root(square: NDArray[np.float64]) -> NDArray[np.float64]:
    """Index from its square; negative squares (inside a resonance) become nan."""
    return np.sqrt(np.where(square > 0.0, square, np.nan))


Kind = Literal["constant", "sellmeier", "polynomial", "cauchy", "tabulated"]


@dataclass(frozen=True, kw_only=True)
class Dispersion:
    """A refractive index law with the range where its data hold.

    Attributes
    ----------
    kind : which formula
    coefficients : of the formula; for "constant" (n,), for "tabulated" the indices
    table_nm : wavelengths of a table [nm], rising
    range_nm : wavelengths that the data cover [nm]
    name : of the material, for messages
    """

    kind: Kind
    coefficients: tuple[float, ...]
    table_nm: tuple[float, ...] = ()
    range_nm: tuple[float, float] = (0.0, np.inf)
    name: str = ""

    @property
    def dispersive(self) -> bool:
        """Whether the index depends on the wavelength."""
        return self.kind != "constant" and len(set(self.coefficients)) > 1

    def index(self, wavelength_nm: ArrayLike) -> NDArray[np.float64]:
        """Refractive index at vacuum wavelengths [nm]; warns outside ``range_nm``.

        Raises
        ------
        SceneError
            if the formula gives no index above 0 there
        """
        wavelength = np.asarray(wavelength_nm, np.float64)
        self._warn_outside(wavelength)
        if self.kind == "constant":
            values = np.full_like(wavelength, self.coefficients[0])
        elif self.kind == "sellmeier":
            values = sellmeier_index(wavelength, self.coefficients)
        elif self.kind == "polynomial":
            values = polynomial_index(wavelength, self.coefficients)
        elif self.kind == "cauchy":
            values = cauchy_index(wavelength, self.coefficients)
        else:
            values = tabulated_index(wavelength, self.table_nm, self.coefficients)
        if not np.all(values > 0.0):
            worst = float(wavelength[~(values > 0.0)].flat[0]) if wavelength.ndim else wavelength
            raise SceneError(
                f"{self._label} has no real refractive index at {worst:g} nm: "
                f"its {self.kind} formula holds from {self.range_nm[0]:g} to "
                f"{self.range_nm[1]:g} nm; choose wavelengths inside"
            )
        return values

    @property
    def _label(self) -> str:
        return f"medium {self.name!r}" if self.name else f"a {self.kind} index"

    def _warn_outside(self, wavelength: NDArray[np.float64]) -> None:
        low, high = self.range_nm
        outside = (wavelength < low) | (wavelength > high)
        if np.any(outside):
            example = np.atleast_1d(wavelength)[np.atleast_1d(outside)][0]
            warnings.warn(
                f"{self._label}: index asked for at {example:g} nm, its data cover {low:g} to "
                f"{high:g} nm; "
                + (
                    "the end value of the table is used"
                    if self.kind == "tabulated"
                    else "the formula is extrapolated"
                ),
                OutOfRangeWarning,
                stacklevel=3,
            )


def constant(n: float, *, name: str = "") -> Dispersion:
    """The same index at every wavelength."""
    _require_positive(n, name)
    return Dispersion(kind="constant", coefficients=(float(n),), name=name)


def sellmeier(
    b: Sequence[float],
    c_um2: Sequence[float],
    *,
    offset: float = 0.0,
    range_nm: tuple[float, float] = (0.0, np.inf),
    name: str = "",
) -> Dispersion:
    """Sellmeier formula n² = 1 + offset + Σ b λ² / (λ² - c), c in µm²."""
    if len(b) != len(c_um2) or not b:
        raise SceneError(
            f"medium {name!r}: a Sellmeier formula needs as many B as C, got {len(b)} and "
            f"{len(c_um2)}"
        )
    pairs = [float(x) for pair in zip(b, c_um2, strict=True) for x in pair]
    return Dispersion(
        kind="sellmeier", coefficients=(float(offset), *pairs), range_nm=range_nm, name=name
    )


def cauchy(
    coefficients: Sequence[float],
    *,
    range_nm: tuple[float, float] = (0.0, np.inf),
    name: str = "",
) -> Dispersion:
    """Cauchy formula n = A + B / λ² + C / λ⁴ + …, λ in µm."""
    if not coefficients:
        raise SceneError(f"medium {name!r}: a Cauchy formula needs at least the coefficient A")
    return Dispersion(
        kind="cauchy",
        coefficients=tuple(float(x) for x in coefficients),
        range_nm=range_nm,
        name=name,
    )


def tabulated(
    wavelength_nm: Sequence[float], index: Sequence[float], *, name: str = ""
) -> Dispersion:
    """Index from a table, interpolated linearly in wavelength [nm]."""
    table = np.asarray(wavelength_nm, np.float64)
    if table.ndim != 1 or table.size < 2 or table.size != len(index):
        raise SceneError(
            f"medium {name!r}: an index table needs two or more wavelengths and as many indices, "
            f"got {table.size} and {len(index)}"
        )
    order = np.argsort(table, kind="stable")
    table = table[order]
    if not (np.all(np.isfinite(table)) and np.all(np.diff(table) > 0.0)):
        raise SceneError(f"medium {name!r}: a wavelength stands twice in its index table")
    values = np.asarray(index, np.float64)[order]
    for value in values:
        _require_positive(float(value), name)
    return Dispersion(
        kind="tabulated",
        coefficients=tuple(values.tolist()),
        table_nm=tuple(table.tolist()),
        range_nm=(float(table[0]), float(table[-1])),
        name=name,
    )


def abbe_number(dispersion: Dispersion) -> float:
    """Abbe number (n_d - 1) / (n_F - n_C), infinite without dispersion."""
    n_f, n_d, n_c = dispersion.index([LINE_NM["F"], LINE_NM["d"], LINE_NM["C"]])
    if n_f == n_c:
        return float("inf")
    return float((n_d - 1.0) / (n_f - n_c))


def _require_positive(n: float, name: str) -> None:
    if not (np.isfinite(n) and n > 0.0):
        raise SceneError(f"medium {name!r}: the refractive index must be positive, got {n:g}")

"""Scattering of polished surfaces: ABg and Harvey–Shack, shift-invariant in direction cosines.

The BSDF depends only on ``rho`` = |beta - beta_0|, the distance of the projections of the scattered
and the specular direction on the surface: f = A / (B + rho^g) or f = b [1 + (rho / l)²]^(s / 2).
It is held as a table over rho, a power law from node to node, so that its integrals and its
samples are exact for what is evaluated. The same table serves reflection (beta_0 of the mirrored
ray) and transmission (beta_0 of the refracted ray, on its side).

The law is the BSDF itself: the scattered share of the light that arrives is the total integrated
scatter TIS(angle of incidence) = ∫ f cos θ dΩ, whatever the surface reflects. It is taken from the
specular light, so it is at most the specular reflectance, or transmittance
(`tracer.surfaces.scatter_check`). `radial_table` refuses more than 1 at any angle.

References
----------
J. E. Harvey, R. N. Pfisterer, Opt. Eng. 58, 087102 (2019); J. E. Harvey, Ph.D. thesis, University
of Arizona (1976); J. C. Stover, Optical Scattering, 3rd ed., SPIE (2012), ch. 4.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import FailFast, Field, model_validator

from raymap.jit.kernels import lean_kernel
from raymap.laws.law import Part
from raymap.model.errors import SceneError

__all__ = [
    "RADIAL_HEAD",
    "RADIAL_NODES",
    "RADIAL_REACH",
    "RadialScatter",
    "abg",
    "eval_radial",
    "harvey_shack",
    "radial_table",
    "scatter_share",
    "scatter_tables",
    "tabulated_radial",
]

F64 = NDArray[np.float64]

RADIAL_NODES = 513
"""Nodes of a table over rho."""
_ANGLES = 65
RADIAL_REACH = 2.0
"""The farthest two projections can be apart."""
RADIAL_HEAD = 4
"""Smallest rho, logarithmic step, whole integral to rho = 2, value below the first node."""
_SIZE = RADIAL_HEAD + 2 * RADIAL_NODES + _ANGLES


class RadialScatter(Part):
    """Scatter about the specular light: a law of Harvey's or ABg, or values over rho.

    Attributes
    ----------
    abg : A, B, g
    harvey_shack : b, width, s
    rho, value : a measured BSDF [1/sr]
    reference_nm : wavelength of the numbers, from which they are scaled; 0 they hold at all
    """

    abg: tuple[float, float, float] | None = None
    harvey_shack: tuple[float, float, float] | None = None
    rho: Annotated[tuple[float, ...], FailFast()] = ()
    value: Annotated[tuple[float, ...], FailFast()] = ()
    reference_nm: Annotated[float, Field(ge=0.0)] = 0.0

    @model_validator(mode="after")
    def _check(self) -> RadialScatter:
        if (self.abg is not None) + (self.harvey_shack is not None) + bool(self.rho) != 1:
            raise ValueError("scatter is abg, harvey_shack, or rho and value")
        return self

    def bsdf(self, wavelength_nm: float) -> Callable[[F64], F64]:
        """BSDF [1/sr] over rho at a wavelength."""
        if self.rho:
            return tabulated_radial(self.rho, self.value)
        scaled = {"wavelength_nm": wavelength_nm, "reference_nm": self.reference_nm}
        if self.abg is not None:
            return abg(*self.abg, **scaled)
        assert self.harvey_shack is not None
        return harvey_shack(*self.harvey_shack, **scaled)

    def half_width(self, wavelength_nm: float) -> float:
        """Distance of projections at which the BSDF has fallen to half of its peak, at most 2."""
        rho = np.geomspace(1e-9, RADIAL_REACH, 4096)
        value = self.bsdf(wavelength_nm)(rho)
        below = np.flatnonzero(value < 0.5 * value[0])
        return float(rho[below[0]]) if len(below) else RADIAL_REACH

    def tables(self, wavelengths_nm: ArrayLike, name: str = "") -> F64:
        """(n, size) tables for `eval_radial`: one, or one per channel where they are scaled."""
        wavelengths = np.asarray(wavelengths_nm, np.float64)
        if self.reference_nm <= 0.0 or self.rho:
            return radial_table(self.bsdf(0.0), name=name)[None]
        return np.stack([radial_table(self.bsdf(float(nm)), name=name) for nm in wavelengths])


def scatter_tables(scatter: RadialScatter | None, wavelengths_nm: ArrayLike) -> F64 | None:
    """Tables of the scatter of a law, if it has any."""
    return None if scatter is None else scatter.tables(wavelengths_nm)


@lean_kernel
def eval_radial(table: F64, first: int, rho: float) -> float:
    """BSDF [1/sr] at the distance ``rho`` of the direction cosines from the specular ray."""
    if rho <= table[first]:
        return float(table[first + 3])
    x = math.log(rho / table[first]) / table[first + 1]
    low = int(x)
    if low >= RADIAL_NODES - 1:
        last = float(table[first + RADIAL_HEAD + RADIAL_NODES - 1])
        return 0.0 if rho > RADIAL_REACH * (1.0 + 1e-12) else last
    a = math.log(table[first + RADIAL_HEAD + low])
    b = math.log(table[first + RADIAL_HEAD + low + 1])
    return math.exp(a + (x - low) * (b - a))


@lean_kernel
def _fill_radial(table: F64, rho: F64, values: F64) -> None:
    for i in range(rho.size):
        values[i] = eval_radial(table, 0, rho[i])


@lean_kernel
def scatter_share(table: F64, first: int, beta: float) -> float:
    """Total integrated scatter TIS for a specular ray whose projection has length ``beta``."""
    x = min(1.0, max(0.0, beta)) * (_ANGLES - 1)
    low = min(_ANGLES - 2, int(x))
    k = first + RADIAL_HEAD + 2 * RADIAL_NODES + low
    return float(table[k] + (x - low) * (table[k + 1] - table[k]))


def abg(
    a: float, b: float, g: float, *, wavelength_nm: float = 0.0, reference_nm: float = 0.0
) -> Callable[[F64], F64]:
    """The ABg law A / (B + rho^g), scaled from the wavelength where it was fitted.

    The roughness is the same at all wavelengths: with x = λ / λ_ref, A becomes A x^(g - 4) and B
    becomes B x^g (Rayleigh–Rice).
    """
    _require_positive("ABg", A=a, B=b)
    if not (math.isfinite(g) and g >= 0.0):
        raise SceneError(f"ABg scattering: g must not be negative, got {g:g}")
    x = _ratio(wavelength_nm, reference_nm)
    with np.errstate(all="ignore"):
        scaled_a, scaled_b = a * x ** (g - 4.0), b * x**g
    return lambda rho: scaled_a / (scaled_b + rho**g)


def harvey_shack(
    b: float, width: float, s: float, *, wavelength_nm: float = 0.0, reference_nm: float = 0.0
) -> Callable[[F64], F64]:
    """Harvey's law b [1 + (rho / width)²]^(s / 2), s <= 0, scaled from its wavelength.

    With x = λ / λ_ref, b becomes b x^-4 and the width becomes width x: the roughness stays.
    """
    _require_positive("Harvey–Shack", b=b, width=width)
    if not (math.isfinite(s) and s <= 0.0):
        raise SceneError(f"Harvey–Shack scattering: s must not be positive, got {s:g}")
    x = _ratio(wavelength_nm, reference_nm)
    with np.errstate(all="ignore"):
        scaled_b, scaled_width = b * x**-4.0, width * x
    return lambda rho: np.asarray(scaled_b * (1.0 + (rho / scaled_width) ** 2) ** (0.5 * s))


def radial_table(law: Callable[[F64], F64], *, name: str = "") -> F64:
    """Table of a radial BSDF for the flat pool of tables.

    Parameters
    ----------
    law : BSDF [1/sr] over rho
    name : of the surface, for messages

    Raises
    ------
    SceneError
        if the law is not positive and finite, or scatters more light than arrives at some angle
    """
    # What numbers of a made-up law do is seen by what comes of them
    with np.errstate(all="ignore"):
        table = _filled_table(law, name)
    if not np.all(np.isfinite(table)):
        raise SceneError(f"surface {name!r}: its scattering law must be positive and finite")
    shares = table[RADIAL_HEAD + 2 * RADIAL_NODES :]
    worst = int(np.argmax(shares))
    if shares[worst] > 1.0:
        angle = math.degrees(math.asin(worst / (_ANGLES - 1)))
        raise SceneError(
            f"surface {name!r} scatters {shares[worst]:.4g} times the light that arrives at "
            f"{angle:.0f} degrees: its total integrated scatter must not exceed 1; lower its "
            "amplitude"
        )
    return table


def _filled_table(law: Callable[[F64], F64], name: str) -> F64:
    """As `radial_table`, without looking at what comes of it."""
    smallest = _flat_below(law)
    step = math.log(RADIAL_REACH / smallest) / (RADIAL_NODES - 1)
    rho = smallest * np.exp(step * np.arange(RADIAL_NODES))
    values = np.asarray(law(rho), np.float64)
    if not (np.all(np.isfinite(values)) and np.all(values > 0.0)):
        raise SceneError(f"surface {name!r}: its scattering law must be positive and finite")
    table = np.zeros(_SIZE)
    fall = np.diff(np.log(values)) / step
    growth = (fall + 2.0) * step
    factor = np.where(np.abs(growth) < 1e-9, step, np.expm1(growth) / (fall + 2.0))
    parts = 2.0 * math.pi * values[:-1] * rho[:-1] ** 2 * factor
    cumulative = np.cumsum(np.concatenate(([math.pi * values[0] * smallest**2], parts)))
    table[:RADIAL_HEAD] = smallest, step, cumulative[-1], values[0]
    table[RADIAL_HEAD : RADIAL_HEAD + RADIAL_NODES] = values
    table[RADIAL_HEAD + RADIAL_NODES : RADIAL_HEAD + 2 * RADIAL_NODES] = cumulative / cumulative[-1]
    table[RADIAL_HEAD + 2 * RADIAL_NODES :] = _shares(table)
    return table


def _flat_below(law: Callable[[F64], F64]) -> float:
    """Distance below which the law is flat to 1e-4."""
    peak = float(law(np.array([1e-12]))[0])
    rho = np.exp(np.linspace(math.log(1e-9), math.log(1e-4), 400))
    flat = np.abs(law(rho) - peak) < 1e-4 * abs(peak)
    inside = np.cumprod(flat)
    return float(rho[max(0, int(inside.sum()) - 1)])


def _shares(table: F64) -> F64:
    """TIS over the length of the specular ray's projection.

    A ring of radius rho about beta lies inside the unit disc with the half angle phi.
    """
    nodes, weights = np.polynomial.legendre.leggauss(16)
    shares = np.empty(_ANGLES)
    for k, beta in enumerate(np.linspace(0.0, 1.0, _ANGLES)):
        edges = np.exp(np.linspace(math.log(table[0]), math.log(1.0 + beta + 1e-15), 200))
        inner = max(0.0, 1.0 - beta)
        edges = np.unique(np.concatenate((edges, _around(inner, table[0], 1.0 + beta))))
        half = np.diff(edges) / 2
        rho = edges[:-1, None] + half[:, None] * (1.0 + nodes)
        ratio = (rho**2 + beta**2 - 1.0) / np.maximum(2.0 * rho * beta, 1e-300)
        arc = np.arccos(np.clip(ratio, -1.0, 1.0))
        values = np.empty(rho.size)
        _fill_radial(table, rho.ravel(), values)
        ring = 2.0 * arc * values.reshape(rho.shape) * rho
        core = math.pi * table[3] * table[0] ** 2 * (1.0 if beta < 1.0 else 0.5)
        shares[k] = core + float((ring * half[:, None] * weights).sum())
    return shares


def _around(inner: float, low: float, high: float) -> F64:
    """Edges that close in on the rim of the disc, where the arc has a vertical slope."""
    if inner <= low:
        return np.zeros(0)
    steps = np.geomspace(1e-10, 1.0, 40)
    edges = np.concatenate((inner + steps * (high - inner), high - steps * (high - inner), [inner]))
    return edges[(edges > low) & (edges < high)]


def _ratio(wavelength_nm: float, reference_nm: float) -> np.float64:
    if wavelength_nm <= 0.0 or reference_nm <= 0.0:
        return np.float64(1.0)
    with np.errstate(all="ignore"):
        return np.float64(wavelength_nm) / reference_nm


def _require_positive(kind: str, **values: float) -> None:
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise SceneError(f"{kind} scattering: {name} must be positive, got {value:g}")


def tabulated_radial(rho: ArrayLike, values: ArrayLike) -> Callable[[F64], F64]:
    """A law measured over rho, interpolated in logarithms; the end values hold outside."""
    x, y = np.asarray(rho, np.float64), np.asarray(values, np.float64)
    if x.ndim != 1 or x.size < 2 or x.shape != y.shape:
        raise SceneError("scattering table: needs two or more distances and as many values")
    if not (np.all(np.diff(x) > 0.0) and x[0] > 0.0 and np.all(y > 0.0)):
        raise SceneError("scattering table: distances must rise from above 0, values be positive")
    return lambda r: np.exp(np.interp(np.log(r), np.log(x), np.log(y)))

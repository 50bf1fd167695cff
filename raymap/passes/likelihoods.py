"""How likely a law makes what happened at a face: shares of flux, or densities of directions.

A recorded ray is weighed anew by the likelihood of its branch under a new law over that under the
law that it was drawn by. Indices stay, so both laws meet the light at the same angles; densities
with which a tracer *chose* directions do not enter, as a ray's weight holds them already.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import lean_kernel
from raymap.laws.lambertian import LambertianLaw
from raymap.laws.law import InChannels, Law
from raymap.laws.mirror import MirrorLaw
from raymap.laws.radial import RadialScatter, eval_radial, scatter_share
from raymap.laws.retroreflector import RetroreflectorLaw, pdf_retro
from raymap.laws.rough import RoughLaw
from raymap.laws.smooth import AbsorberLaw, FresnelLaw
from raymap.laws.stack import StackLaw
from raymap.laws.table import TableLaw
from raymap.laws.tabulated import TabulatedLaw, eval_tabulated
from raymap.passes.branches import (
    ABSORBED,
    BACK,
    SCATTERED_BACK,
    SCATTERED_THROUGH,
    THROUGH,
    TOTAL,
)

__all__ = ["Incidence", "Likelihoods", "is_even", "is_total", "needs_index", "same_facets"]

F64 = NDArray[np.float64]

_NEAR = 1e-6
"""How far from the critical angle a branch is taken that rounding puts on its other side."""


class Incidence(NamedTuple):
    """How light meets a face.

    Attributes
    ----------
    n_i, n_o : (n_channels,) indices before and beyond
    cos_i : (n,) cosines of the angle of incidence
    wi, wo : (n, 3) unit vectors back along the light that comes and along the light that goes, in a
        frame whose z is the normal on the incident side; of no rows where nothing is scattered
    error : (n,) of the direction in which scattered light goes from the specular one, as far as
        stored positions and normals say it; of no rows where nothing is scattered
    """

    n_i: F64
    n_o: F64
    cos_i: F64
    wi: F64
    wo: F64
    error: F64 = np.zeros(0)


def is_even(law: Law, branch: int) -> bool:
    """Whether a branch is as likely at every angle, whatever lies beyond."""
    if isinstance(law, AbsorberLaw | LambertianLaw):
        return True
    if isinstance(law, MirrorLaw):
        even = bool(law.reflectance) and law.scatter is None
        return even and (law.roughness == 0.0 or branch == ABSORBED)
    return isinstance(law, RetroreflectorLaw) and branch == ABSORBED


def is_total(law: Law) -> bool:
    """Whether all light is reflected beyond the critical angle, specularly."""
    layered = isinstance(law, StackLaw) and not any(any(layer.k) for layer in law.layers)
    clear = layered or isinstance(law, TableLaw | FresnelLaw)
    return clear and getattr(law, "scatter", None) is None and not getattr(law, "roughness", 0.0)


def needs_index(law: Law) -> bool:
    """Whether it depends on the medium beyond."""
    return isinstance(law, FresnelLaw | TableLaw | StackLaw)


def same_facets(old: Law, new: Law) -> bool:
    """Whether rough surfaces scatter to the same directions, so that only their shares differ."""
    rough = [law for law in (old, new) if getattr(law, "roughness", 0.0) > 0.0]
    return len({getattr(law, "roughness", 0.0) for law in rough}) <= 1 and len(rough) != 1


class Likelihoods:
    """What a law makes of light in the channels of a set; tables are made once.

    Parameters
    ----------
    law : of a surface
    channels : that its numbers by channel belong to
    """

    def __init__(self, law: Law, channels: InChannels) -> None:
        self.law, self.channels = law, channels
        if isinstance(law, StackLaw):
            # Evaluated as a table, as who traces does
            tables = law.tables(channels)
            self._shares: Callable[..., tuple[F64, F64]] = _from_tables(tables)
        elif isinstance(law, TableLaw):
            self._shares = _from_tables(law.tables())
        else:
            self._shares = lambda n_i, n_o, cos_i: law.shares(channels, n_i, n_o, cos_i)
        scatter: RadialScatter | None = getattr(law, "scatter", None)
        self._radial = None if scatter is None else scatter.tables(channels.wavelengths_nm)
        self.half_width = math.inf
        if scatter is not None:
            self.half_width = min(map(scatter.half_width, channels.wavelengths_nm))
        self._sides: tuple[F64 | None, F64 | None] = (None, None)
        if isinstance(law, TabulatedLaw):
            reflected, transmitted = law.reflected, law.transmitted
            self._sides = (
                None if reflected is None else reflected.table(),
                None if transmitted is None else transmitted.table(),
            )

    def of(self, branch: int, met: Incidence) -> F64:
        """(n_channels, n) share of the light that takes a branch; a density [1/sr] where scattered.

        A branch that rounding puts on the other side of the critical angle is taken at the nearest
        angle where it can happen.
        """
        if branch == ABSORBED:
            back, through = self._shares(met.n_i, met.n_o, met.cos_i)
            return np.maximum(0.0, 1.0 - back - through)
        if branch in (BACK, TOTAL, THROUGH):
            return self._specular(branch, met)
        return self._scattered(branch, met)

    def shares_met(self, branch: int, met: Incidence) -> tuple[F64, F64]:
        """(n_channels, n) shares that go back and through, of whatever branch."""
        return self._shares(met.n_i, met.n_o, self.cosine_met(branch, met))

    def cosine_met(self, branch: int, met: Incidence) -> F64:
        """(n,) cosine of the angle of incidence: at the facet that scattered, where rough."""
        rough = getattr(self.law, "roughness", 0.0) > 0.0
        if rough and branch in (SCATTERED_BACK, SCATTERED_THROUGH):
            return self._facet_cosine(branch, met)
        return met.cos_i

    def share(self, branch: int, met: Incidence) -> F64:
        """(n_channels, n) share of the light that takes a branch, to whatever direction."""
        if branch not in (SCATTERED_BACK, SCATTERED_THROUGH):
            return self.of(branch, met)
        back, through = self._shares(met.n_i, met.n_o, met.cos_i)
        whole, specular = (back, BACK) if branch == SCATTERED_BACK else (through, THROUGH)
        return np.maximum(0.0, whole - self._specular(specular, met))

    def _specular(self, branch: int, met: Incidence) -> F64:
        if isinstance(self.law, LambertianLaw | RetroreflectorLaw | TabulatedLaw) or (
            getattr(self.law, "roughness", 0.0) > 0.0
        ):
            return np.zeros((len(met.n_i), len(met.cos_i)))
        cos_i = met.cos_i
        if needs_index(self.law):
            critical = np.sqrt(np.maximum(0.0, 1.0 - (met.n_o / met.n_i) ** 2))
            if branch == THROUGH:
                nearest = min(1.0, float(critical.max()) * (1.0 + _NEAR))
                cos_i = np.maximum(cos_i, nearest)
            elif branch == TOTAL and critical.max() > 0.0:
                cos_i = np.minimum(cos_i, float(critical.min()) * (1.0 - _NEAR))
        back, through = self._shares(met.n_i, met.n_o, cos_i)
        share = through if branch == THROUGH else back
        if self._radial is None:
            return share
        # What the law scatters is taken from the specular light
        sine = np.sqrt(np.maximum(0.0, 1.0 - cos_i**2))
        left = np.empty(share.shape)
        for channel, (n_i, n_o) in enumerate(zip(met.n_i, met.n_o, strict=True)):
            beta = sine * (n_i / n_o) if branch == THROUGH else sine
            _leave(self._table(channel), beta, share[channel], left[channel])
        return left

    def _table(self, channel: int) -> F64:
        assert self._radial is not None
        table: F64 = self._radial[min(channel, len(self._radial) - 1)]
        return table

    def _scattered(self, branch: int, met: Incidence) -> F64:
        law, n = self.law, len(met.cos_i)
        if isinstance(law, LambertianLaw):
            back, through = self._shares(met.n_i, met.n_o, met.cos_i)
            return (back if branch == SCATTERED_BACK else through) / math.pi
        found = np.zeros((len(met.n_i), n))
        if isinstance(law, TabulatedLaw):
            table = self._sides[branch == SCATTERED_THROUGH]
            if table is not None:
                _tabulated(table, met.wi, met.wo, found[0])
                found[1:] = found[0]
        elif isinstance(law, RetroreflectorLaw) and branch == SCATTERED_BACK:
            _retro(met.wi, met.wo, math.cos(math.radians(law.spread_deg)), found[0])
            found[:] = np.asarray(law.reflectance)[:, None] * found[0]
        elif getattr(law, "roughness", 0.0) > 0.0:
            found = self._facet(branch, met)
        elif self._radial is not None and (branch == SCATTERED_BACK or needs_index(law)):
            for channel, (n_i, n_o) in enumerate(zip(met.n_i, met.n_o, strict=True)):
                eta = n_i / n_o if branch == SCATTERED_THROUGH else 1.0
                _around_specular(self._table(channel), met.wi, met.wo, eta, found[channel])
        return found

    def _facet(self, branch: int, met: Incidence) -> F64:
        """Share at the facet that the light met, up to the distribution of facets."""
        if branch == SCATTERED_THROUGH and not isinstance(self.law, RoughLaw):
            return np.zeros((len(met.n_i), len(met.cos_i)))
        back, through = self._shares(met.n_i, met.n_o, self._facet_cosine(branch, met))
        return back if branch == SCATTERED_BACK else through

    def _facet_cosine(self, branch: int, met: Incidence) -> F64:
        if branch == SCATTERED_BACK:
            half = met.wi + met.wo
        else:
            # The facet that refracts (Walter et al., EGSR 2007, eq. 16), at the first channel
            half = -(met.n_i[0] * met.wi + met.n_o[0] * met.wo)
        length = np.maximum(np.linalg.norm(half, axis=1), 1e-300)
        cosine: F64 = np.clip(np.abs((met.wi * half).sum(axis=1)) / length, 0.0, 1.0)
        return cosine


def _from_tables(tables: F64) -> Callable[..., tuple[F64, F64]]:
    from raymap.laws.table import shares_of_tables

    return lambda n_i, n_o, cos_i: shares_of_tables(tables, n_i, n_o, cos_i)


@lean_kernel
def _leave(table: F64, beta: F64, share: F64, left: F64) -> None:
    """Specular shares without what is scattered from them."""
    for i in range(len(beta)):
        left[i] = max(0.0, share[i] - scatter_share(table, 0, min(1.0, beta[i])))


@lean_kernel
def _around_specular(table: F64, wi: F64, wo: F64, eta: float, found: F64) -> None:
    """BSDF at the distance of the projections of scattered and specular direction."""
    for i in range(len(wi)):
        x, y = wo[i, 0] + eta * wi[i, 0], wo[i, 1] + eta * wi[i, 1]
        found[i] = eval_radial(table, 0, math.sqrt(x * x + y * y))


@lean_kernel
def _tabulated(table: F64, wi: F64, wo: F64, found: F64) -> None:
    for i in range(len(wi)):
        side = 1.0 if wo[i, 2] > 0.0 else -1.0
        found[i] = eval_tabulated(
            table, 0, wi[i, 0], wi[i, 1], wi[i, 2], wo[i, 0], wo[i, 1], wo[i, 2], side
        )


@lean_kernel
def _retro(wi: F64, wo: F64, cos_spread: float, found: F64) -> None:
    for i in range(len(wi)):
        found[i] = pdf_retro(wi[i, 0], wi[i, 1], wi[i, 2], wo[i, 0], wo[i, 1], wo[i, 2], cos_spread)

"""Densities of light from few rays: cells of a detector joined as far as their errors ask.

About every node a parabola (on planes a mean) is fitted to the cells in windows of growing size.
Windows grow until the relative error is small, and only while they agree with all smaller ones
within the noise (O. V. Lepski, Theory Probab. Appl. 35 (1991) 454); among those the one is taken
whose error is least, of its noise and of what its shape adds, which shows where the parabola
departs from the mean of a quarter of the window.

What is chosen by its noise is no longer free of it. So the rays are dealt into shares; windows are
chosen by all of them but one, and that one is fitted in them; the mean over the shares is the
density. Every fit is linear in the flux of the cells, so that shares cost next to nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["SHARES", "Fit", "Joined", "join_windows", "largest", "least", "rays_of", "shares_of"]

Floats = NDArray[np.float64]

SHARES = 5
"""Shares that the rays are dealt into."""
_ENOUGH = 0.015
"""Relative standard error at which a node's window grows no more."""
_TESTED = 9.0
"""Rays that a window must be expected to hold before a larger one is tested against it."""
_SURE = 2.0
"""Standard errors that an extreme value is asked to be away from the others."""
_CAUTION = 1.4
"""Factor of the errors of extreme values: windows are chosen by the light that they are laid on.
With it 95 of 100 lie within two errors (tests over cosine lamps, Gaussian beams, batwings, edges).
"""
_SURE_RAYS = 1e6
"""Rays that light without an error counts as."""
_TRAINED = SHARES / (SHARES - 1.0)


def rays_of(flux: Floats, variance: Floats) -> Floats:
    """(…) how many rays, all alike, would have brought the flux of each cell with this variance.

    At least one where there is light; many where it has no error.
    """
    rays = np.divide(flux**2, variance, out=np.full_like(flux, _SURE_RAYS), where=variance > 0.0)
    return np.asarray(np.where(flux > 0.0, np.maximum(rays, 1.0), 0.0))


def shares_of(flux: Floats, variance: Floats) -> Floats:
    """Deal the rays of cells into shares at random, always the same for the same cells.

    Rays of a cell count as many as its variance says, all alike.

    Parameters
    ----------
    flux, variance : (…)

    Returns
    -------
    (SHARES, …) flux, whose sum is that of the cells; light without variance in equal parts
    """
    random = np.random.default_rng(20)
    counts = np.minimum(np.rint(rays_of(flux, variance)), 2.0**62).astype(np.int64)
    dealt = np.zeros((SHARES, *flux.shape))
    left = counts.copy()
    for share in range(SHARES):
        dealt[share] = random.binomial(left, 1.0 / (SHARES - share))
        left -= dealt[share].astype(np.int64)
    dealt *= np.divide(flux, counts, out=np.zeros_like(flux), where=counts > 0)
    return np.where(variance > 0.0, dealt, flux / SHARES)


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """Fits at all nodes in windows of one size.

    Attributes
    ----------
    values : (SHARES, n_nodes) density of the light of each share
    departure : (SHARES, n_nodes) density less the mean of a quarter of the window
    spread, departure_spread : (n_nodes,) variance of both, per density and flux of a ray
    ray : (n_nodes,) flux of a ray in the window
    cost : rays that a density takes over those that a mean with the same error takes
    """

    values: Floats
    departure: Floats
    spread: Floats
    departure_spread: Floats
    ray: Floats
    cost: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Joined:
    """Densities at nodes, each from its own window.

    Attributes
    ----------
    values, se : (n_nodes,) density and its standard error, with what the window adds
    chosen, chosen_se : (SHARES, n_nodes) the same of all shares but one
    left_out : (SHARES, n_nodes) of that share, in windows that it did not choose
    """

    values: Floats
    se: Floats
    chosen: Floats
    chosen_se: Floats
    left_out: Floats

    def part(self, nodes: Any) -> Joined:
        """Some of the nodes."""
        return Joined(**{name: values[..., nodes] for name, values in vars(self).items()})

    def reversed(self) -> Joined:
        return self.part(slice(None, None, -1))

    def mixed(self, other: Joined, share: float) -> Joined:
        """Between these nodes and others, ``share`` of the others; errors as if they went along."""
        return Joined(
            **{
                name: (1.0 - share) * values + share * vars(other)[name]
                for name, values in vars(self).items()
            }
        )

    @staticmethod
    def of(parts: Sequence[Joined]) -> Joined:
        """Nodes one after the other."""
        return Joined(
            **{
                name: np.concatenate([vars(part)[name] for part in parts], axis=-1)
                for name in vars(parts[0])
            }
        )

    def without_each(self) -> Floats:
        """(SHARES, n_nodes) density of all shares but one."""
        result: Floats = (self.left_out.sum(axis=0) - self.left_out) / (SHARES - 1.0)
        return result


def largest(joined: Joined) -> tuple[float, float]:
    """The largest density, and its standard error with that of looking for it.

    The largest of many uncertain values is too large. A share knows nothing of where the others
    are largest, so what it says there is not, but falls short by what the place is wrong; the truth
    lies between them, and half of what is between them counts as error.
    """
    return _extreme(joined, 1.0)


def least(joined: Joined) -> tuple[float, float]:
    """The smallest density, and its standard error with that of looking for it."""
    return _extreme(joined, -1.0)


def _extreme(joined: Joined, sign: float) -> tuple[float, float]:
    doubt = np.sqrt((joined.chosen_se**2).mean(axis=0))
    own = int(np.argmax(sign * joined.values - _SURE * doubt))
    places = np.argmax(sign * joined.chosen - _SURE * joined.chosen_se, axis=1)
    blind = float(joined.left_out[np.arange(SHARES), places].mean())
    looked = float(joined.values[own])
    noise = float((joined.se[places] ** 2).mean())
    value = max(0.5 * (blind + looked), 0.0)
    return value, _CAUTION * math.sqrt(noise + 0.25 * (looked - blind) ** 2)


def join_windows(fits: Iterator[Fit], rays: float) -> Joined:
    """Choose a window for every node, and every share that is left out.

    Parameters
    ----------
    fits : in windows of growing size
    rays : number of rays in all, effective if their fluxes differ
    """
    history: list[Fit] = []
    trained: list[Floats] = []
    for fit in fits:
        history.append(fit)
        density = (fit.values.sum(axis=0) - fit.values) * _TRAINED
        trained.append(density)
        if len(history) == 1:
            last = np.zeros(density.shape, np.int64)
            grows = np.ones(density.shape, np.bool_)
        grows = _agrees(history, trained, grows, rays / _TRAINED)
        last[grows] = len(history) - 1
        noise = _TRAINED * fit.ray * np.maximum(density, 0.0) * fit.spread
        grows &= ~((noise <= (_ENOUGH * density) ** 2) & (density > 0.0))
        if not grows.any():
            break
    # Errors of small windows from the density that the largest one shows: few rays scatter
    density = np.maximum(_taken(np.stack(trained), last), 0.0)
    # Where even that one holds no ray, one in it may have been missed
    one = _TRAINED * np.stack([fit.ray * fit.spread for fit in history])
    density = np.maximum(density, np.take_along_axis(one, last, axis=0))
    best, least = np.zeros_like(last), np.full(last.shape, np.inf)
    doubt, variance = np.zeros(last.shape), np.zeros(last.shape)
    for level, fit in enumerate(history):
        ray = _TRAINED * fit.ray
        departure = (fit.departure.sum(axis=0) - fit.departure) * _TRAINED
        noise = ray * density * fit.spread
        known = ray * density * fit.departure_spread
        shape = np.maximum(departure**2 - known, 0.0)
        error = np.maximum(noise, (_ENOUGH * density) ** 2) + shape
        better = (level <= last) & (error < least)
        best[better], least[better] = level, error[better]
        doubt[better] = np.sqrt(noise + departure**2)[better]
        variance[better] = (shape + noise / _TRAINED)[better]
    left_out = SHARES * _taken(np.stack([fit.values for fit in history]), best)
    return Joined(
        values=left_out.mean(axis=0),
        se=np.sqrt(variance.mean(axis=0)),
        chosen=_taken(np.stack(trained), best),
        chosen_se=doubt,
        left_out=left_out,
    )


def _taken(levels: Floats, which: NDArray[np.int64]) -> Floats:
    """(SHARES, n_nodes) values of the level that is named for each."""
    result: Floats = np.take_along_axis(levels, which[None], axis=0)[0]
    return result


def _agrees(
    history: list[Fit], trained: list[Floats], growing: NDArray[np.bool_], rays: float
) -> NDArray[np.bool_]:
    """Of the growing windows those whose last fit lies within the noise of all smaller ones."""
    last, density = history[-1], np.maximum(trained[-1], 0.0)
    result = growing.copy()
    for fit, value in zip(history[:-1], trained[:-1], strict=True):
        ray = _TRAINED * fit.ray
        weight = ray * fit.spread
        few = np.zeros_like(density)
        expected = np.divide(fit.cost * density, weight, out=few, where=weight > 0.0)
        tested = result & (expected >= _TESTED)
        if not tested.any():
            continue
        _, node = np.nonzero(tested)
        held = density[tested]
        noise = (ray[node] * held) * np.maximum(fit.spread - last.spread, 0.0)[node]
        # The largest of so many deviations that chance brings
        many = np.maximum(rays / expected[tested], 4.0)
        limit = np.sqrt(2.0 * np.log(many) * noise)
        result[tested] = np.abs(value[tested] - trained[-1][tested]) <= limit
    return result

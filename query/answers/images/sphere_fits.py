"""Quadratics fitted to the cells of a far field about every corner of its cells.

A fit takes the cells in a disc on the sphere, so that the pole is a place like any other. Of what
changes around the axis it keeps the first harmonics of C, as many as the light shows: light that is
even around the axis is averaged over all of it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from query.answers.images.local_fits import Fit

__all__ = ["harmonics_shown", "sphere_fits"]

Floats = NDArray[np.float64]
Span = tuple[float, float]

_FIRST, _LARGEST = 1.6, math.radians(50.0)
"""Radius of the first window in cells, and of the last."""
_MOST_ROWS = 100
"""Rows that the radius of a window spans at most."""
_AROUND, _WITHIN = 72, 3
"""Parts that a circle of cells and a row are divided into."""
_MANY = 30.0
"""Rays from which on a band of rows is asked for its harmonics."""
_BLOCK, _KEPT = 2**21, 2**22
"""Numbers of the kernels that are made at a time, and that are kept for the next picture."""


def harmonics_shown(flux: Floats, variance: Floats) -> int:
    """The highest harmonic of C that the light of a far field shows, 0 if it is even around.

    Parameters
    ----------
    flux, variance : (n_gamma, n_c)

    Notes
    -----
    Of light that is even around its axis 2 |A|² / Σ variance is χ² with two degrees of freedom, A a
    harmonic of the flux of some rows. Rows are taken together in bands of 1, 2, 4 … of them.
    """
    n_gamma, n_c = flux.shape
    if n_c < 3:
        return int(n_c // 2)
    amplitude = np.fft.rfft(flux, axis=1)[:, 1:]
    noise = variance.sum(axis=1)
    tests = 2 * n_gamma * amplitude.shape[1]
    # exp(-|A|² / Σ variance) is the chance of so much
    limit = math.log(tests / 0.01)
    highest = 0
    height = 1
    while True:
        starts = np.arange(0, n_gamma, height)
        power = np.abs(np.add.reduceat(amplitude, starts, axis=0)) ** 2
        total = np.add.reduceat(noise, starts)
        # Sums of few rays are not normal; light without an error is as it is
        light = np.add.reduceat(flux.sum(axis=1), starts)
        many = light**2 >= _MANY * total
        shown = (power > (limit * total + (1e-9 * light) ** 2)[:, None]) & many[:, None]
        places = np.flatnonzero(shown.any(axis=0))
        highest = max(highest, int(places[-1]) + 1 if len(places) else 0)
        if height >= n_gamma:
            return highest
        height *= 2


def sphere_fits(flux: Floats, variance: Floats, gamma_deg: Span, harmonics: int) -> Iterator[Fit]:
    """Fits in discs on the sphere of growing radius.

    Parameters
    ----------
    flux : (n_shares, n_gamma, n_c) flux per cell of shares of the light
    variance : (n_gamma, n_c) of the flux of all of it
    gamma_deg : of the first and last row
    harmonics : of C that are kept

    Yields
    ------
    Fit, at (n_gamma + 1) x n_c nodes: the corners of cells, C = 0 first
    """
    n_shares, n_gamma, n_c = flux.shape
    total, squares = float(flux.sum()), float(variance.sum())
    known = squares / total if total > 0.0 else 0.0
    images = np.concatenate((flux, flux.sum(axis=0)[None], variance[None]))
    kept = min(harmonics, n_c // 2) + 1
    # Nodes lie between cells: half a cell before the first one
    spectra = np.fft.rfft(images, axis=2)[:, :, :kept] * _half_cell(n_c)[:kept]
    grid = _Grid(gamma_deg, n_gamma, n_c)
    lit = np.flatnonzero(images.any(axis=(0, 2)))
    shape = n_gamma + 1, n_c
    last = [np.zeros((n_shares, *shape)), np.zeros((n_shares, *shape)), np.zeros(shape)]
    last += [np.zeros(shape), np.full(shape, known)]
    for level in range(grid.n_levels):
        # Where a window is that of the level before, or no light comes, all stays as it is
        last = [values.copy() for values in last]
        for block in grid.blocks(level, lit):
            rows = slice(block.begin, block.end)
            fit, mean, window = (k[:, :, :kept] for k in block.kernels)
            values = _correlated(fit, spectra[:n_shares, rows], n_c)
            departure = values - _correlated(mean, spectra[:n_shares, rows], n_c)
            held, noise = _correlated(window, spectra[n_shares:, rows], n_c)
            least = 1e-12 * total
            ray = np.where(
                held > least, np.maximum(noise, 0.0) / np.maximum(held, least or 1.0), known
            )
            spreads = [_squared(k, n_c, grid.solid[rows]) for k in (fit, fit - mean)]
            for before, found in zip(last, (values, departure, *spreads, ray), strict=True):
                before[..., block.nodes, :] = found
        yield Fit(
            values=last[0].reshape(n_shares, -1),
            departure=last[1].reshape(n_shares, -1),
            spread=last[2].ravel(),
            departure_spread=last[3].ravel(),
            ray=last[4].ravel(),
            # The middle of a parabola over a disc has four times the variance of the mean
            cost=4.0,
        )


def _squared(kernel: Floats, n_c: int, solid: Floats) -> Floats:
    """(n_nodes, 1) sums of squares of kernels over solid angle."""
    # Parseval: every harmonic but the mean stands for two; the last one of an even n_c is zero
    twice = np.where(np.arange(kernel.shape[2]) == 0, 1.0, 2.0) / n_c
    return np.asarray(np.einsum("nrm,m,r->n", kernel**2, twice, solid, optimize=True))[:, None]


def _half_cell(n_c: int) -> NDArray[np.complex128]:
    """Factors of harmonics that turn by half a cell."""
    turn: NDArray[np.complex128] = np.exp(-1j * np.pi * np.arange(n_c // 2 + 1) / n_c)
    return turn


def _even_harmonics(values: Floats) -> Floats:
    """Harmonics of values over cells (last axis) that are even about the first edge: all real."""
    n_c = values.shape[-1]
    result: Floats = (np.fft.rfft(values, axis=-1) * _half_cell(n_c)).real
    return result


def _correlated(kernel: Floats, spectra: NDArray[np.complex128], n_c: int) -> Floats:
    """(n_images, n_nodes, n_c) sums of images weighed by kernels that are even in C."""
    m = kernel.shape[2]
    total = np.einsum("nrm,irm->inm", kernel, spectra[:, :, :m], optimize=True)
    result: Floats = np.fft.irfft(total, n_c, axis=2)
    return result


@dataclass(frozen=True, eq=False)
class _Block:
    """Kernels of some nodes at C = 0 over rows [begin, end), as harmonics of C.

    Attributes
    ----------
    nodes : (n_nodes,) their numbers, from the first edge on
    kernels : (3, n_nodes, n_rows, n_c // 2 + 1), weights of flux: of the density of the parabola,
        and of the mean in half the radius; 1 in cells within the disc
    """

    nodes: NDArray[np.int64]
    begin: int
    end: int
    kernels: Floats


@lru_cache(maxsize=4)
class _Grid:
    """The nodes of a far field and their windows."""

    def __init__(self, gamma_deg: Span, n_gamma: int, n_c: int) -> None:
        low, high = np.radians(gamma_deg)
        self.low, self.step = float(low), float(high - low) / n_gamma
        self.n_gamma, self.n_c = n_gamma, n_c
        self.parts = max(1, -(-_AROUND // n_c))
        edges = self.low + self.step * np.arange(n_gamma + 1)
        self.solid: Floats = (np.cos(edges[:-1]) - np.cos(edges[1:])) * 2.0 * np.pi / n_c
        self.largest = max(min(_LARGEST, _MOST_ROWS * self.step), 4.0 * self.step)
        self.n_levels = 1 + int(2.0 * math.log2(max(self.largest / (_FIRST * self.step), 2.0)))
        self._kept: dict[int, list[_Block]] = {}

    def blocks(self, level: int, lit: NDArray[np.int64]) -> Iterator[_Block]:
        """Kernels of a level, some nodes at a time, where they differ from those of the last one.

        Parameters
        ----------
        lit : rows with light; windows of which no row is may be left out
        """
        new = np.array([self._is_new(node, level) for node in range(self.n_gamma + 1)])
        size = 3 * (self.n_gamma + 1) * self.n_gamma * (self.n_c // 2 + 1)
        if size * self.n_levels > _KEPT:
            reach = [self._rows(node, level) for node in range(self.n_gamma + 1)]
            begin, end = np.searchsorted(lit, np.array(reach)).T
            yield from self._made(np.flatnonzero(new & (begin < end)), level)
            return
        if level not in self._kept:
            self._kept[level] = list(self._made(np.flatnonzero(new), level))
        yield from self._kept[level]

    def _radius(self, node: int, level: int) -> float:
        """Of the window [rad]; no smaller than 1.6 of the cells there."""
        around = 2.0 * math.pi / (self.n_c * self.parts)
        first = _FIRST * max(self.step, around * math.sin(self.low + node * self.step))
        return float(min(first * 2.0 ** (0.5 * level), max(self.largest, first)))

    def _is_new(self, node: int, level: int) -> bool:
        return level == 0 or self._radius(node, level) != self._radius(node, level - 1)

    def _rows(self, node: int, level: int) -> tuple[int, int]:
        """Rows [begin, end) that a window meets."""
        gamma, radius = self.low + node * self.step, self._radius(node, level)
        begin = max(0, math.floor((gamma - radius - self.low) / self.step + 1e-9))
        end = min(self.n_gamma, math.ceil((gamma + radius - self.low) / self.step - 1e-9))
        return begin, end

    def _made(self, chosen: NDArray[np.int64], level: int) -> Iterator[_Block]:
        at_once = max(1, _BLOCK // (self.n_gamma * (self.n_c // 2 + 1)))
        for first in range(0, len(chosen), at_once):
            nodes = chosen[first : first + at_once]
            rows = [self._row(node, level) for node in nodes.tolist()]
            begin, end = min(row.begin for row in rows), max(row.end for row in rows)
            kernels = np.zeros((3, len(rows), end - begin, self.n_c // 2 + 1))
            for k, row in enumerate(rows):
                kernels[:, k, row.begin - begin : row.end - begin] = row.kernels[:, 0]
            yield _Block(nodes, begin, end, kernels)

    def _parts_within(self, gamma: float, radius: float) -> int:
        """Parts of a circle that a window meets, in whole cells about C = 0."""
        # r² of Lambert's projection is 2 (1 - cos θ) at an angle θ
        sin = math.sqrt(max(radius**2 * (1.0 - 0.25 * radius**2), 0.0))
        if radius >= 1.4 or sin >= abs(math.sin(gamma)):
            return self.n_c * self.parts
        half = math.ceil(math.asin(sin / abs(math.sin(gamma))) / (2.0 * math.pi) * self.n_c + 1e-9)
        return min(2 * half, self.n_c) * self.parts

    def _row(self, node: int, level: int) -> _Block:
        """Kernel of the node at C = 0."""
        gamma = self.low + node * self.step
        around = 2.0 * np.pi / (self.n_c * self.parts)
        radius, (begin, end) = self._radius(node, level), self._rows(node, level)
        # Where parts of cells lie, seen from the node
        n_rows, n_parts = end - begin, self._parts_within(gamma, radius)
        fine = self.low + self.step * (begin + (np.arange(n_rows * _WITHIN) + 0.5) / _WITHIN)
        columns = np.arange(n_parts // self.parts) - n_parts // self.parts // 2
        c = (np.arange(n_parts) + columns[0] * self.parts + 0.5) * around
        sin, cos = np.sin(fine)[:, None], np.cos(fine)[:, None]
        along = sin * np.cos(c)
        toward = along * math.sin(gamma) + cos * math.cos(gamma)
        # Lambert's azimuthal projection keeps areas, so that r² grows with the solid angle
        scale = np.sqrt(2.0 / np.maximum(1.0 + toward, 1e-12)) / radius
        x = (along * math.cos(gamma) - cos * math.sin(gamma)) * scale
        y = sin * np.sin(c) * scale
        r2 = x * x + y * y
        share = (sin.reshape(-1, _WITHIN) / sin.reshape(-1, _WITHIN).sum(axis=1, keepdims=True))[
            :, :, None
        ]

        def mean(values: Floats) -> Floats:
            return np.asarray((values.reshape(-1, _WITHIN, n_parts) * share).sum(axis=1))

        # Fit 1, x, y, r² to the means over cells, the near ones with more weight
        w = mean(np.maximum(1.0 - r2, 0.0))
        basis = np.stack([np.ones_like(w), mean(x), mean(y), mean(r2)])
        weighed = basis * w
        area = self.solid[begin:end, None] / self.parts
        gram = np.einsum("aij,bij->ab", weighed * area, basis)
        g = np.linalg.lstsq(gram, np.array([1.0, 0.0, 0.0, 0.0]), rcond=1e-9)[0]
        near = mean(np.maximum(1.0 - 4.0 * r2, 0.0))
        kernels = np.stack([np.tensordot(g, weighed, 1), near / (near * area).sum(), w > 0.0])
        within = kernels.reshape(3, n_rows, -1, self.parts).mean(axis=3)
        cells = np.zeros((3, n_rows, self.n_c))
        cells[:, :, columns % self.n_c] = within
        return _Block(np.array([node]), begin, end, _even_harmonics(cells)[:, None])

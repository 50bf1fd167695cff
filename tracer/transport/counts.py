"""What a trace counted, as flux with its standard error.

A ray of weight w counts as w y, y being the worth of its colour, 1 for flux in watt
(`raymap.optics.photometry`), and brings the flux w y Φ_s/N_s (`raymap.optics.fluxes`). So sums are
kept by groups of sources of one Φ_s/N_s and one colour until the trace has ended.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.doubt import with_doubts
from raymap.optics.fluxes import flux_per_ray, spread

__all__ = ["Count", "Counts", "DetectorCount", "add_counts"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Count:
    """Sums at places of any shape, per group of sources.

    Attributes
    ----------
    source_flux : (G,) flux of each group [flux unit]
    emitted : (G,) rays (emissions) that it sent
    sums : (G, …) Σwy
    squares : (G, …) Σ over emissions of (Σwy)²
    """

    source_flux: Array
    emitted: Array
    sums: Array
    squares: Array

    def __add__(self, other: Count) -> Count:
        return Count(
            source_flux=self.source_flux,
            emitted=self.emitted + other.emitted,
            sums=self.sums + other.sums,
            squares=self.squares + other.squares,
        )

    @property
    def factors(self) -> Array:
        """(G,) flux of a ray of weight 1."""
        return flux_per_ray(self.source_flux, self.emitted)

    @property
    def spread(self) -> Array:
        """(G, …) squared standard error of Σwy."""
        sent = self.emitted.reshape(-1, *[1] * (self.sums.ndim - 1))
        return spread(sent, self.sums, self.squares)

    @property
    def flux(self) -> Array:
        """(…) flux at each place [flux unit]."""
        return np.asarray(np.tensordot(self.factors, self.sums, axes=1))

    @property
    def flux_se(self) -> Array:
        """(…) standard error of the flux at each place."""
        return np.asarray(np.sqrt(np.tensordot(self.factors**2, self.spread, axes=1)))

    @property
    def effective(self) -> Array:
        """(…) effective sample size: as many equal rays would give flux as good.

        (Σ f)² / Σ f² over the emissions, f being the flux that each brings: L. Kish, Survey
        Sampling (1965), 11.7.
        """
        squares = np.tensordot(self.factors**2, self.squares, axes=1)
        return np.asarray(
            np.divide(self.flux**2, squares, out=np.zeros_like(squares), where=squares > 0.0)
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class DetectorCount:
    """What a detector counted.

    Attributes
    ----------
    cells : flux by cell, places (cells_v, cells_u)
    whole : flux by detector, no places
    arrived : rays (emissions) of which it registered anything
    by_channel : (G, cells_v, cells_u, n_channels) Σ w c
    squares_by_channel : (G, cells_v, cells_u, n_channels) Σ over emissions of (Σ w c)²
    worth : (G, n_channels) worth of each channel's light (`raymap.optics.photometry`)
    radiant : (G,) radiant flux of each group [W]
    """

    cells: Count
    whole: Count
    by_channel: Array
    squares_by_channel: Array
    worth: Array
    radiant: Array
    arrived: int = 0

    def __add__(self, other: DetectorCount) -> DetectorCount:
        return DetectorCount(
            cells=self.cells + other.cells,
            whole=self.whole + other.whole,
            by_channel=self.by_channel + other.by_channel,
            squares_by_channel=self.squares_by_channel + other.squares_by_channel,
            worth=self.worth,
            radiant=self.radiant,
            arrived=self.arrived + other.arrived,
        )

    @property
    def sums(self) -> Array:
        """(cells_v, cells_u, n_channels) Σ w c, unnormalised, as maps store it beside rays."""
        if len(self.by_channel) == 1:
            return np.asarray(self.by_channel[0])
        return np.asarray(self.by_channel.sum(axis=0))

    @property
    def sums2(self) -> Array:
        """(cells_v, cells_u, n_channels) Σ over emissions of (Σ w c)²."""
        if len(self.squares_by_channel) == 1:
            return np.asarray(self.squares_by_channel[0])
        return np.asarray(self.squares_by_channel.sum(axis=0))

    def relative_sums(self) -> tuple[Array, Array]:
        """`sums` and `sums2`, each source's light times its radiant flux per ray over the mean.

        Sums do not tell sources apart. With these weights one factor, radiant flux of all sources
        over rays of all of them, makes watt of them, as of maps without rays.
        """
        sent = self.cells.emitted
        own = np.divide(self.radiant, sent, out=np.zeros(len(sent)), where=sent > 0)
        # Sources that sent nothing (switched off) are not in the reader's factor either
        mean = float(self.radiant[sent > 0].sum()) / max(float(sent.sum()), 1.0)
        weights = own / mean if mean > 0.0 else np.ones(len(sent))
        return (
            np.asarray(np.tensordot(weights, self.by_channel, axes=1)),
            np.asarray(np.tensordot(weights**2, self.squares_by_channel, axes=1)),
        )

    @property
    def channels(self) -> Array:
        """(cells_v, cells_u, n_channels) flux by cell and channel [flux unit]."""
        factors = self.cells.factors[:, None] * self.worth
        return np.asarray(np.einsum("gk,gvuk->vuk", factors, self.by_channel))

    @property
    def flux(self) -> Array:
        """(cells_v, cells_u) flux by cell [flux unit]."""
        return self.cells.flux

    @property
    def flux_se(self) -> Array:
        """(cells_v, cells_u) standard error of the flux by cell."""
        return self.cells.flux_se

    @property
    def total(self) -> float:
        """All flux that the detector registered [flux unit]."""
        return float(self.whole.flux)

    @property
    def total_se(self) -> float:
        """Standard error of all flux."""
        return float(self.whole.flux_se)


@dataclass(frozen=True, kw_only=True, eq=False)
class Counts:
    """All that a trace counted; the counts of parts of one trace add up.

    Attributes
    ----------
    flux_unit : of the map
    sources, classes : names of the sources and of the ways in which rays end
    endings : a group per source, places (n_classes,)
    objects, media : names of what absorbs, the places of ``taken``
    detectors : by name
    weighted : whether rays weigh differently
    """

    flux_unit: str
    sources: tuple[str, ...]
    classes: tuple[str, ...]
    endings: Count
    objects: tuple[str, ...]
    media: tuple[str, ...]
    taken: Count
    detectors: dict[str, DetectorCount] = field(default_factory=dict)
    weighted: bool = False

    def __add__(self, other: Counts) -> Counts:
        return Counts(
            flux_unit=self.flux_unit,
            sources=self.sources,
            classes=self.classes,
            endings=self.endings + other.endings,
            objects=self.objects,
            media=self.media,
            taken=self.taken + other.taken,
            detectors={name: own + other.detectors[name] for name, own in self.detectors.items()},
            weighted=self.weighted or other.weighted,
        )

    def stored_sums(self, number: int) -> tuple[Array, Array]:
        """Unnormalised sums of a detector, as maps store them."""
        found = list(self.detectors.values())[number]
        return found.sums, found.sums2

    def fluxes(self) -> dict[str, Any]:
        """Flux and standard error of every ending, absorber and detector, as plain values."""
        factors = self.endings.factors[:, None]
        flux, se = factors * self.endings.sums, factors * np.sqrt(self.endings.spread)
        sources = {}
        for k, name in enumerate(self.sources):
            sent = float(self.endings.source_flux[k]) if self.endings.emitted[k] > 0 else 0.0
            row: dict[str, Any] = {"emitted": sent}
            row |= {c: _plain(flux[k, j], se[k, j]) for j, c in enumerate(self.classes)}
            sources[name] = row
        flux, se = self.taken.flux, self.taken.flux_se
        names = (*self.objects, *self.media)
        lit = [k for k in range(len(names)) if flux[k] > 0.0]
        n = len(self.objects)
        return {
            "unit": self.flux_unit,
            "sources": sources,
            "absorbed_by": {
                "objects": {names[k]: _plain(flux[k], se[k]) for k in lit if k < n},
                "media": {names[k]: _plain(flux[k], se[k]) for k in lit if k >= n},
            },
            "detectors": {name: self._at(count) for name, count in self.detectors.items()},
        }

    def _at(self, count: DetectorCount) -> dict[str, Any]:
        """What a detector saw; of rays that weigh differently also how many equal ones that is."""
        row = _plain(count.total, count.total_se)
        if not self.weighted:
            return row
        return row | {"rays": count.arrived, "effective_rays": float(count.whole.effective)}


def add_counts(parts: list[Counts]) -> Counts:
    """Counts of all parts of one trace."""
    total = parts[0]
    for part in parts[1:]:
        total += part
    return total


def _plain(flux: Any, se: Any) -> dict[str, Any]:
    return with_doubts({"flux": float(flux), "flux_se": float(se)})

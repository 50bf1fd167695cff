"""The energy audit: where the light of each source ended, so that the sum closes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from query.answers.paths.path_sums import PathLabels, sum_over_paths
from query.engine.context import PathContext
from query.engine.scan import Cancel
from query.engine.tally import Tally, source_factors
from raymap.model.doubt import with_doubts
from raymap.model.events import Event
from raymap.optics.fluxes import variances

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["CLASSES", "Audit", "audit"]

CLASSES = ("absorbed", "detected", "left", "stopped", "errors")
_ABSORBED, _DETECTED, _LEFT, _STOPPED, _ERRORS = range(5)


@dataclass(frozen=True, eq=False)
class Audit:
    """Rays and flux by how they ended, exclusive classes.

    detected: ended on a blocking detector; absorbed: every other absorption at surfaces and in
    media; stopped: depth limit or roulette kill; errors: geometry errors; missing: emitted but not
    stored in this map (a saved selection, or a map without rays).

    Attributes
    ----------
    sources : names
    rays, flux, flux_se : (n_sources, 5) per class of `CLASSES`
    stored_se : (n_sources,) standard error of the flux of all classes together
    emitted : (n_sources,) rays; emitted_flux : (n_sources,) [flux unit]
    absorbed_by : per object or medium the (n_sources,) flux that it took, detected light included;
        absorbed_se : standard error of what it took of all sources
    worth_by_color : the flux of a ray follows its colour, as lumens do: the classes then add up to
        ``emitted_flux`` within their errors
    """

    sources: tuple[str, ...]
    rays: NDArray[np.int64]
    flux: NDArray[np.float64]
    flux_se: NDArray[np.float64]
    stored_se: NDArray[np.float64]
    emitted: NDArray[np.int64]
    emitted_flux: NDArray[np.float64]
    absorbed_by: dict[str, NDArray[np.float64]]
    absorbed_rays: dict[str, NDArray[np.int64]]
    absorbed_se: dict[str, float]
    flux_unit: str
    weighted: bool
    worth_by_color: bool = False

    @property
    def missing(self) -> NDArray[np.int64]:
        """(n_sources,) rays emitted but not stored."""
        missing: NDArray[np.int64] = self.emitted - self.rays.sum(axis=1)
        return missing

    @property
    def missing_flux(self) -> NDArray[np.float64]:
        """(n_sources,) what the classes leave of the emitted flux."""
        missing: NDArray[np.float64] = self.emitted_flux - self.flux.sum(axis=1)
        if self.worth_by_color:
            # Lumens of light that changed its colour add up to what was emitted in the mean only
            missing = np.where(self.missing > 0, missing, 0.0)
        # Fluxes are sums of rounded weights
        return np.where(np.abs(missing) > 1e-9 * self.emitted_flux, missing, 0.0)

    @property
    def missing_se(self) -> NDArray[np.float64]:
        """(n_sources,) standard error of `missing_flux`; what is not missing is so for certain."""
        return np.where(self.missing_flux != 0.0, self.stored_se, 0.0)

    def to_json(self) -> dict[str, Any]:
        """Per source the classes in rays and in flux."""
        by_source = {}
        for number, name in enumerate(self.sources):
            row = {
                "emitted": int(self.emitted[number]),
                **{kind: int(self.rays[number, k]) for k, kind in enumerate(CLASSES)},
                "missing": int(self.missing[number]),
                "flux": {
                    "emitted": float(self.emitted_flux[number]),
                    **{kind: float(self.flux[number, k]) for k, kind in enumerate(CLASSES)},
                    "missing": float(self.missing_flux[number]),
                },
                "flux_se": {
                    **{kind: float(self.flux_se[number, k]) for k, kind in enumerate(CLASSES)},
                    "missing": float(self.missing_se[number]),
                },
            }
            by_source[name] = with_doubts(row)
        return {
            "sources": by_source,
            "absorbed_by": {
                name: with_doubts(
                    {
                        "rays": int(self.absorbed_rays[name].sum()),
                        "flux": float(flux.sum()),
                        "flux_se": self.absorbed_se[name],
                    }
                )
                for name, flux in self.absorbed_by.items()
            },
            "flux_unit": self.flux_unit,
        }


def audit(
    map: RayMap, criterion: object = None, *, threads: int | None = None, cancel: Cancel = None
) -> Audit:
    """Where the light of each source ended: by class, object and medium.

    Parameters
    ----------
    criterion : audit only these rays; the others are then "missing"
    """
    directory = map.directory
    n_sources, n_objects = len(directory.sources), len(directory.objects)
    n_takers = n_objects + len(directory.media) + 1
    blocking = np.zeros(n_objects + 1, np.bool_)
    for detector in directory.detectors:
        if detector.blocking and detector.object >= 0:
            blocking[detector.object] = True

    # Every path is counted for its class, for who took it, and for the light of its source
    n_ends, n_taken = n_sources * 5, n_sources * n_takers

    def labels(base: PathContext, rays: NDArray[np.int64]) -> PathLabels:
        ending, taker = _endings(base, blocking, n_objects, n_takers)
        source, path = base.source.astype(np.int64), np.arange(len(rays))
        label = (source * 5 + ending, n_ends + source * n_takers + taker, n_ends + n_taken + source)
        return PathLabels(np.tile(path, 3), np.concatenate(label), n_ends + n_taken + n_sources)

    products, scan = sum_over_paths(map, criterion, labels, threads=threads, cancel=cancel)
    every = Tally.zeros(n_ends + n_taken + n_sources)
    for tally, _ in products:
        every = every + tally
    ends, takers = every.part(slice(n_ends)), every.part(slice(n_ends, n_ends + n_taken))
    stored = every.part(slice(n_ends + n_taken, None))
    emitted = scan.emitted
    factors = source_factors(directory, emitted)
    repeated = np.repeat(factors, 5)
    spread = variances(repeated, np.repeat(emitted, 5), ends.sum_w, ends.sum_w2)
    sent = np.repeat(emitted, n_takers)
    own = variances(np.repeat(factors, n_takers), sent, takers.sum_w, takers.sum_w2)
    taken_se = np.sqrt(own.reshape(n_sources, n_takers).sum(axis=0))
    taken = takers.rays.reshape(n_sources, n_takers)
    taken_flux = takers.sum_w.reshape(n_sources, n_takers) * factors[:, None]
    names = [item.name for item in directory.objects]
    names += [f"medium {medium.name}" for medium in directory.media]
    some = [k for k in range(len(names)) if taken[:, k].any()]
    some.sort(key=lambda k: -taken_flux[:, k].sum())
    return Audit(
        sources=tuple(source.name for source in directory.sources),
        rays=ends.rays.reshape(n_sources, 5),
        flux=(repeated * ends.sum_w).reshape(n_sources, 5),
        flux_se=np.sqrt(spread).reshape(n_sources, 5),
        stored_se=np.sqrt(variances(factors, emitted, stored.sum_w, stored.sum_w2)),
        emitted=emitted,
        emitted_flux=factors * emitted,
        absorbed_by={names[k]: taken_flux[:, k] for k in some},
        absorbed_rays={names[k]: taken[:, k] for k in some},
        absorbed_se={names[k]: float(taken_se[k]) for k in some},
        flux_unit=directory.flux_unit,
        weighted=any(portion.has_weights for portion in map.portions),
        worth_by_color=any(
            map.photometry(number).changes for number in range(len(map.channel_sets))
        ),
    )


def _endings(
    base: PathContext, blocking: NDArray[np.bool_], n_objects: int, n_takers: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(class, taker) of every path; the last taker is "nobody"."""
    event = base.event[base.last_rows]
    owner = base.object[base.last_rows].astype(np.int64)
    before = np.maximum(base.last_rows - 1, base.offsets[:-1])
    medium = base.medium[before].astype(np.int64)
    on_surface = (event & int(Event.SURFACE_ABSORPTION)) != 0
    in_volume = (event & int(Event.VOLUME_ABSORPTION)) != 0
    ending = np.full(len(event), _ERRORS, np.int64)
    ending[(event & int(Event.LEFT_SCENE)) != 0] = _LEFT
    ending[(event & int(Event.DEPTH_LIMIT | Event.ROULETTE_KILL)) != 0] = _STOPPED
    ending[on_surface | in_volume] = _ABSORBED
    ending[on_surface & blocking[owner]] = _DETECTED
    taker = np.full(len(event), n_takers - 1, np.int64)
    taker[on_surface & (owner >= 0)] = owner[on_surface & (owner >= 0)]
    known = in_volume & (medium >= 0)
    taker[known] = n_objects + medium[known]
    return ending, taker

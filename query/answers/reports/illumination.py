"""Which objects the sources light, which the detector sees, and which are both.

An object is *illuminated* where light meets it that was not scattered before, and *critical* where
light leaves it for the detector without being scattered again. Objects that are both can send stray
light to the detector by a single scattering (R. P. Breault, "Control of stray light", Handbook of
Optics, vol. I, ch. 38, Optical Society of America, 1995).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from query.answers.paths.path_sums import PathLabels, sum_over_paths
from query.engine.context import PathColumns, PathContext
from query.engine.scan import Cancel
from query.engine.tally import Tally, source_factors
from query.expression.names import match_indices
from raymap.jit.kernels import kernel
from raymap.model.doubt import with_doubts
from raymap.model.events import FAMILIES
from raymap.optics.fluxes import variances

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["Illumination", "ObjectLight", "illuminated"]

_SCATTERED = int(FAMILIES["scattered"])
_LIT, _SEEN, _FIRST_ORDER = range(3)


@dataclass(frozen=True, kw_only=True)
class ObjectLight:
    """What one object receives and sends on [flux unit], each flux with its standard error.

    Attributes
    ----------
    lit_rays, lit_flux : met it before any scattering
    seen_rays, seen_flux : reached the detector from it without further scattering
    first_order_rays, first_order_flux : were scattered there, only there, and detected
    """

    object: str
    lit_rays: int
    lit_flux: float
    lit_flux_se: float
    seen_rays: int
    seen_flux: float
    seen_flux_se: float
    first_order_rays: int
    first_order_flux: float
    first_order_flux_se: float


@dataclass(frozen=True)
class Illumination:
    """Illuminated and critical objects of a detector."""

    detector: str
    objects: tuple[ObjectLight, ...]
    flux_unit: str

    @property
    def illuminated(self) -> list[str]:
        """Objects that the sources light."""
        return [row.object for row in self.objects if row.lit_rays]

    @property
    def critical(self) -> list[str]:
        """O    map = seen_by(map, detector)
        bjects that the detector sees."""
        return [row.object for row in self.objects if row.seen_rays]

    @property
    def both(self) -> list[str]:
        """Objects that are illuminated and critical."""
        return [row.object for row in self.objects if row.lit_rays and row.seen_rays]

    def to_json(self) -> dict[str, Any]:
        return {
            "detector": self.detector,
            "illuminated": self.illuminated,
            "critical": self.critical,
            "both": self.both,
            "objects": [with_doubts(dict(row.__dict__)) for row in self.objects],
            "flux_unit": self.flux_unit,
        }


@kernel
def _lights(
    paths: PathColumns,
    wanted: NDArray[np.bool_],
    rays: NDArray[np.int64],
    n_objects: int,
    out: NDArray[np.int64],
) -> int:
    """List each path once per object and kind; out : rows of path, kind, object; their number."""
    offsets, event = paths.offsets, paths.event
    n = 0
    stamp = np.full((3, n_objects), -1, np.int64)
    for path in range(len(paths.source)):
        if rays[path] == 0:
            continue
        begin = offsets[path]
        end = offsets[path + 1]
        # Lit: no scattering at any earlier point.
        n_scattered = 0
        for row in range(begin + 1, end):
            owner = paths.object[row]
            if owner >= 0 and n_scattered == 0 and stamp[0, owner] != path:
                stamp[0, owner] = path
                out[n, 0], out[n, 1], out[n, 2] = path, _LIT, owner
                n += 1
            if event[row] & _SCATTERED:
                n_scattered += 1
        # Seen: walk back from each registration to the scattering before it.
        for last in range(begin, end):
            arrived = False
            for crossing in range(paths.crossing_offsets[last], paths.crossing_offsets[last + 1]):
                if paths.registered[crossing] and wanted[paths.detector[crossing]]:
                    arrived = True
            if not arrived:
                continue
            before = 0
            for row in range(begin + 1, last + 1):
                if event[row] & _SCATTERED:
                    before += 1
            row = last
            while row > begin:
                owner = paths.object[row]
                scatters = (event[row] & _SCATTERED) != 0
                if owner >= 0 and stamp[1, owner] != path:
                    stamp[1, owner] = path
                    out[n, 0], out[n, 1], out[n, 2] = path, _SEEN, owner
                    n += 1
                if scatters:
                    if owner >= 0 and before == 1 and stamp[2, owner] != path:
                        stamp[2, owner] = path
                        out[n, 0], out[n, 1], out[n, 2] = path, _FIRST_ORDER, owner
                        n += 1
                    break
                row -= 1
    return n


def illuminated(
    map: RayMap,
    detector: str,
    criterion: object = None,
    *,
    threads: int | None = None,
    cancel: Cancel = None,
) -> Illumination:
    """Illuminated and critical objects.

    Parameters
    ----------
    detector : name or pattern
    criterion : only rays that satisfy this

    Raises
    ------
    UnknownName
    """
    directory = map.directory
    names = [item.name for item in directory.detectors]
    wanted = np.zeros(len(names) + 1, np.bool_)
    wanted[match_indices(detector, names, "detector")] = True
    n_objects, n_sources = len(directory.objects), len(directory.sources)
    size = 3 * n_objects * n_sources

    def labels(base: PathContext, rays: NDArray[np.int64]) -> PathLabels:
        paths = base.columns(face=False)
        lit = np.zeros((3 * len(paths.event), 3), np.int64)
        path, kind, owner = lit[: _lights(paths, wanted, rays, n_objects, lit)].T
        source = paths.source[path].astype(np.int64)
        return PathLabels(path, (kind * n_objects + owner) * n_sources + source, size)

    products, scan = sum_over_paths(map, criterion, labels, threads=threads, cancel=cancel)
    every = Tally.zeros(size)
    for tally, _ in products:
        every = every + tally
    shape = 3, n_objects, n_sources
    rays = every.rays.reshape(shape)
    sum_w, sum_w2 = every.sum_w.reshape(shape), every.sum_w2.reshape(shape)
    factors = source_factors(directory, scan.emitted)
    flux, counts = sum_w @ factors, rays.sum(axis=2)
    se = np.sqrt(variances(factors, scan.emitted, sum_w, sum_w2).sum(axis=2))
    rows = tuple(
        ObjectLight(
            object=item.name,
            lit_rays=int(counts[_LIT, k]),
            lit_flux=float(flux[_LIT, k]),
            lit_flux_se=float(se[_LIT, k]),
            seen_rays=int(counts[_SEEN, k]),
            seen_flux=float(flux[_SEEN, k]),
            seen_flux_se=float(se[_SEEN, k]),
            first_order_rays=int(counts[_FIRST_ORDER, k]),
            first_order_flux=float(flux[_FIRST_ORDER, k]),
            first_order_flux_se=float(se[_FIRST_ORDER, k]),
        )
        for k, item in enumerate(directory.objects)
    )
    return Illumination(detector, rows, directory.flux_unit)

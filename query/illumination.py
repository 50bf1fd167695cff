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

from query.context import PathColumns, PathContext
from query.names import match_indices
from query.path_sums import sum_over_paths
from query.scan import Cancel
from query.tally import Tally, source_factors
from raymap.events import FAMILIES
from raymap.kernels import kernel

if TYPE_CHECKING:
    from raymap.reader import RayMap

__all__ = ["Illumination", "ObjectLight", "illuminated"]

_SCATTERED = int(FAMILIES["scattered"])
_LIT, _SEEN, _FIRST_ORDER = range(3)


@dataclass(frozen=True)
class ObjectLight:
    """What one object receives and sends on [flux unit].

    Attributes
    ----------
    lit_rays, lit_flux : met it before any scattering
    seen_rays, seen_flux : reached the detector from it without further scattering
    first_order_rays, first_order_flux : were scattered there, only there, and detected
    """

    object: str
    lit_rays: int
    lit_flux: float
    seen_rays: int
    seen_flux: float
    first_order_rays: int
    first_order_flux: float


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
        """Objects that the detector sees."""
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
            "objects": [dict(row.__dict__) for row in self.objects],
            "flux_unit": self.flux_unit,
        }


@kernel
def _lights(
    paths: PathColumns,
    wanted: NDArray[np.bool_],
    rays: NDArray[np.int64],
    sum_w: NDArray[np.float64],
    out_rays: NDArray[np.int64],
    out_w: NDArray[np.float64],
) -> None:
    """Add each path once per object and kind; out : (3, n_objects, n_sources)."""
    source, offsets, event = paths.source, paths.offsets, paths.event
    n_objects = out_rays.shape[1]
    stamp = np.full((3, n_objects), -1, np.int64)
    for path in range(len(source)):
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
                out_rays[0, owner, source[path]] += rays[path]
                out_w[0, owner, source[path]] += sum_w[path]
            if event[row] & _SCATTERED:
                n_scattered += 1
        # Seen: walk back from each registration to the scattering before it.
        for last in range(begin, end):
            arrived = False
            for meeting in range(paths.meeting_offsets[last], paths.meeting_offsets[last + 1]):
                if paths.registered[meeting] and wanted[paths.detector[meeting]]:
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
                    out_rays[1, owner, source[path]] += rays[path]
                    out_w[1, owner, source[path]] += sum_w[path]
                if scatters:
                    if owner >= 0 and before == 1 and stamp[2, owner] != path:
                        stamp[2, owner] = path
                        out_rays[2, owner, source[path]] += rays[path]
                        out_w[2, owner, source[path]] += sum_w[path]
                    break
                row -= 1


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
    shape = 3, len(directory.objects), len(directory.sources)

    def reduce(base: PathContext, tally: Tally) -> tuple[Any, Any]:
        out_rays, out_w = np.zeros(shape, np.int64), np.zeros(shape)
        paths = base.columns(face=False)
        _lights(paths, wanted, tally.rays, tally.sum_w, out_rays, out_w)
        return out_rays, out_w

    products, _, scan = sum_over_paths(map, criterion, reduce, threads=threads, cancel=cancel)
    rays, weights = np.zeros(shape, np.int64), np.zeros(shape)
    for more_rays, more_w in products:
        rays += more_rays
        weights += more_w
    flux = weights @ source_factors(directory, scan.emitted)
    counts = rays.sum(axis=2)
    rows = tuple(
        ObjectLight(
            item.name,
            int(counts[_LIT, k]),
            float(flux[_LIT, k]),
            int(counts[_SEEN, k]),
            float(flux[_SEEN, k]),
            int(counts[_FIRST_ORDER, k]),
            float(flux[_FIRST_ORDER, k]),
        )
        for k, item in enumerate(directory.objects)
    )
    return Illumination(detector, rows, directory.flux_unit)

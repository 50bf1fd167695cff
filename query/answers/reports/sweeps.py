"""Many sources of one map side by side: flux at the detector and point source transmittance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from query.answers.selections.selector import select
from query.atoms.detected import detected
from query.engine.places import seen_by
from query.engine.scan import Cancel
from query.engine.tally import source_factors
from query.expression.criterion import Criterion
from query.expression.spellings import as_criterion
from raymap.model.doubt import with_doubts
from raymap.model.units import METRES, length_scale
from raymap.optics.fluxes import variances

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["SweepRow", "sweep"]


@dataclass(frozen=True)
class SweepRow:
    """One source of the sweep.

    Attributes
    ----------
    emitted : rays; source_flux : what it emits [flux unit]
    rays, flux, flux_se : of the source at the detector
    transmittance : flux / source_flux
    pst : point source transmittance: mean irradiance on the detector over the irradiance of the
        source's beam; None where the beam or the detector has no known area
    parameters : of the source, as the scene gives them
    """

    source: str
    emitted: int
    source_flux: float
    rays: int
    flux: float
    flux_se: float
    transmittance: float
    pst: float | None
    parameters: dict[str, Any]

    def to_json(self) -> dict[str, Any]:
        return with_doubts(dict(self.__dict__))


def sweep(
    map: RayMap,
    detector: str,
    criterion: object = None,
    *,
    threads: int | None = None,
    cancel: Cancel = None,
) -> list[SweepRow]:
    """Flux at a detector by source, in the order of the directory.

    Record one map with a source per field angle; each row is one angle. ``criterion`` restricts the
    rays further, for example to stray light: ``event(scattered)``.

    Raises
    ------
    UnknownName, CriterionError
    """
    map = seen_by(map, detector)
    own = as_criterion(criterion)
    whole: Criterion = detected(detector)
    if own is not None:
        whole = whole & own
    found = select(map, whole, rays=False, threads=threads, cancel=cancel)
    directory, tally, emitted = map.directory, found.tally, found.emitted
    factors = source_factors(directory, emitted)
    spread = np.sqrt(variances(factors, emitted, tally.sum_w, tally.sum_w2))
    area = _detector_area(map, detector)
    rows = []
    for number, source in enumerate(directory.sources):
        flux = float(factors[number] * tally.sum_w[number])
        transmittance = flux / source.flux if source.flux else 0.0
        beam = _beam_area(source.parameters)
        pst = transmittance * beam / area if beam and area else None
        rows.append(
            SweepRow(
                source=source.name,
                emitted=int(emitted[number]),
                source_flux=source.flux,
                rays=int(tally.rays[number]),
                flux=flux,
                flux_se=float(spread[number]),
                transmittance=transmittance,
                pst=pst,
                parameters=source.parameters,
            )
        )
    return rows


def _detector_area(map: RayMap, pattern: str) -> float | None:
    """Area of the one flat detector that is meant [scene units²]."""
    from query.expression.names import match_indices

    names = [item.name for item in map.directory.detectors]
    found = match_indices(pattern, names, "detector")
    if len(found) != 1:
        return None
    detector = map.directory.detectors[found[0]]
    own = map.directory.length_unit
    unit = str(detector.parameters.get("size_unit", own))
    if detector.kind != "plane" or (unit != own and not {unit, own} <= METRES.keys()):
        return None
    scale = length_scale(unit, own)
    return float(detector.size[0] * detector.size[1] * scale**2)


def _beam_area(parameters: dict[str, Any]) -> float | None:
    """Cross-section of a collimated beam [scene units²], from what the scene says of its source."""
    scales = {"area": (1.0, 1), "diameter": (math.pi / 4, 2), "radius": (math.pi, 2)}
    for name, (factor, power) in scales.items():
        value = parameters.get(name)
        if isinstance(value, int | float) and not isinstance(value, bool) and value > 0:
            return float(factor * value**power)
    size = parameters.get("size")
    if isinstance(size, list | tuple) and len(size) == 2:
        return float(size[0] * size[1])
    return None

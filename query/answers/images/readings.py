"""What is read off a detector: flux, peak, mean and evenness, the angles of a beam, with errors."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.answers.images.beams import Beam, beam_of
from query.answers.images.local_fits import (
    Joined,
    join_windows,
    largest,
    least,
    rays_of,
    shares_of,
)
from query.answers.images.pictures import DetectorImage
from query.answers.images.plane_fits import cell_fits, plane_fits
from raymap.model.directory import Detector
from raymap.model.doubt import FOOTNOTE, is_doubtful, with_doubts, with_error
from raymap.model.errors import RayMapError
from raymap.optics.cellsizes import CellSizes, TabledSizes

__all__ = ["reading_lines", "readings"]

Floats = NDArray[np.float64]


def readings(
    image: DetectorImage, quantity: str | None = None, beam: Beam | None = None
) -> dict[str, Any]:
    """Flux, peak, mean and evenness of a picture; of a far field the angles of its beam.

    Cells are joined only as far as their errors ask; every number has its standard error beside it
    (``peak_se``), which includes that the largest of many was looked for. ``mean``,
    ``min_over_mean`` and ``min_over_max`` are over all cells that have a size, weighed by it.

    Parameters
    ----------
    quantity : irradiance, illuminance, intensity, candela, radiance or luminance; None: flux per
        measure in the unit of the map, per cell where the size of cells is not known
    beam : of the same picture and quantity, if it is known already

    Raises
    ------
    RayMapError
        No cell has a size, or the cells have no such quantity.
    """
    lit = image.lit
    # Cells of unknown size are of one size
    alike = TabledSizes(np.broadcast_to(1.0, image.detector.cells[::-1]))
    sizes = alike if image.measure is None else image.measure.sizes
    if not (whole := sizes.total()):
        raise RayMapError(f"no cell of detector {image.detector.name!r} has a size")
    values, errors, unit = lit.quantity(quantity)
    here = sizes.at(lit.row, lit.column)
    flux, variance = values * here, (errors * here) ** 2
    mean = flux.sum() / whole
    # The sum of the cells is surer than cells that are independent would make it
    apart = math.sqrt(float(lit.variance.sum()))
    surer = image.total_se / apart if apart > 0.0 else 1.0
    mean_se = surer * math.sqrt(variance.sum()) / whole
    numbers: dict[str, Any] = {
        "detector": image.detector.name,
        "flux": image.total,
        "flux_se": image.total_se,
        "flux_unit": image.flux_unit,
        "registrations": image.registrations,
        "unit": unit,
    }
    if image.detector.kind == "far_field" and image.measure is not None:
        beam = beam or beam_of(image, quantity)
        numbers |= _entry("peak", *beam.peak) | _entry("mean", mean, mean_se)
        numbers["planes"] = [
            with_doubts(
                {"plane": plane.name}
                | _angle("beam_deg", plane.beam_deg)
                | _angle("field_deg", plane.field_deg)
            )
            for plane in beam.planes
        ]
        return with_doubts(numbers)
    joined = _joined((lit.row, lit.column), flux, variance, sizes, image.detector)
    peak, darkest = largest(joined), least(joined)
    numbers |= _entry("peak", *peak) | _entry("mean", mean, mean_se)
    for name, (below, below_se) in (
        ("min_over_mean", (mean, mean_se)),
        ("min_over_max", peak),
    ):
        if below > 0.0:
            ratio = darkest[0] / below
            se = math.hypot(darkest[1] / below, ratio * below_se / below)
            numbers |= _entry(name, ratio, se)
        else:
            numbers |= {name: None, f"{name}_se": None}
    return with_doubts(numbers)


def _joined(
    cell: tuple[NDArray[np.int64], NDArray[np.int64]],
    flux: Floats,
    variance: Floats,
    sizes: CellSizes,
    detector: Detector,
) -> Joined:
    """Densities all over a plane, a face or a camera, from the cells that were met."""
    squares = float(variance.sum())
    rays = float(flux.sum()) ** 2 / squares if squares > 0.0 else 0.0
    shares = shares_of(flux, variance)
    if detector.parameters.get("mapping") == "triangles":
        whole = sizes.part(*map(range, sizes.shape))
        return join_windows(cell_fits(cell, shares, variance, whole), rays)
    bands = plane_fits(cell, shares, variance, rays_of(flux, variance), sizes)
    return Joined.of([join_windows(fits, rays) for fits in bands])


def _entry(name: str, value: float, se: float) -> dict[str, float]:
    return {name: float(value), f"{name}_se": float(se)}


def _angle(name: str, measured: tuple[float, float] | None) -> dict[str, float | None]:
    value, se = measured or (None, None)
    return {name: value, f"{name}_se": se}


def reading_lines(numbers: dict[str, Any]) -> list[str]:
    """The readings in words; what is less sure than 30 % is marked."""
    unit = numbers["unit"]
    marked: list[bool] = []

    def said(name: str, where: dict[str, Any], after: str = "") -> str:
        marked.append(is_doubtful(where[name], where[f"{name}_se"]))
        return with_error(where[name], where[f"{name}_se"], after)

    if numbers["flux"] == 0.0 and numbers["peak"] == 0.0:
        return ["no light: none of the selected rays is registered here"]
    lines = [f"peak {said('peak', numbers)} {unit}"]
    if numbers["registrations"]:
        flux = said("flux", numbers, f" {numbers['flux_unit']}")
        lines.insert(0, f"{flux}, {numbers['registrations']:,} registrations")
    for plane in numbers.get("planes", ()):
        words = [
            f"{name} {said(key, plane, '°')}"
            for name, key in (("beam (50 %)", "beam_deg"), ("field (10 %)", "field_deg"))
            if plane[key] is not None
        ]
        if words:
            lines.append(f"{plane['plane']}: {', '.join(words)}")
    if "planes" not in numbers and numbers["min_over_mean"] is not None:
        lines += [
            f"mean {said('mean', numbers)} {unit}",
            f"min/mean {said('min_over_mean', numbers)}",
            f"min/max {said('min_over_max', numbers)}",
        ]
    if any(marked):
        lines.append(FOOTNOTE)
    return lines

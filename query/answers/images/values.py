"""What pictures show: flux, its densities, rays, colours, channels; with their units."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.answers.images.lit import QUANTITIES
from query.answers.images.pictures import DetectorImage
from raymap.model.errors import RayMapError

__all__ = ["KINDS", "unit_of", "values_of"]

KINDS = ("rgb", "flux", "flux_se", "rays", "density", "density_se", *QUANTITIES, "spectral")


def values_of(image: DetectorImage, kind: str) -> NDArray[Any]:
    """(n,) or (n, m) values of one kind of picture at the cells that were met; 0 elsewhere."""
    lit = image.lit
    if kind not in KINDS:
        raise RayMapError(f"pictures are of kind {', '.join(KINDS)}, not {kind!r}")
    if kind in QUANTITIES:
        return lit.quantity(kind)[0]
    if kind == "density":
        return lit.per_measure(lit.flux)
    if kind == "density_se":
        return lit.per_measure(np.sqrt(lit.variance))
    if kind == "rgb":
        return lit.linear_rgb
    if kind == "flux_se":
        return np.sqrt(lit.variance)
    return {"spectral": lit.channels, "flux": lit.flux, "rays": lit.rays}[kind]


def unit_of(image: DetectorImage, kind: str) -> str:
    """Unit of the values of a kind of picture."""
    if kind == "rays":
        return "rays"
    if kind in ("rgb", "flux", "flux_se", "spectral"):
        return f"{image.flux_unit} per cell"
    if kind in QUANTITIES:
        return image.lit.quantity(kind)[2]
    return image.density_unit or ""

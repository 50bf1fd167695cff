"""Where an imported lens is to be looked at: the place and size of its image.

The size holds the direct light of all fields, colours and places of the pupil, not that of the
edges alone: at the focus of the edge rays those of the zones within lie furthest out.
"""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import SceneError
from raymap.model.units import length_scale
from tracer.importers.bundles import Bundles
from tracer.importers.elements import Elements
from tracer.importers.prescription import ImportWarning

__all__ = ["Image", "find_image"]

Array = NDArray[np.float64]

MARGIN = 1.2
WAVES = 40.0
"""Least half size, in wavelengths: a point would have no cells."""


@dataclass(frozen=True, kw_only=True)
class Image:
    """The image surface.

    Attributes
    ----------
    z : its vertex on the axis
    half : half the side of its detector, or the radius of a curved one
    sign : +1 where light arrives along z, else -1
    curved : it is no plane
    blocking : nothing has to pass through it on its way to the lens
    """

    z: float
    half: float
    sign: int
    curved: bool
    blocking: bool

    @property
    def face(self) -> str:
        """The face of a shell behind it that light meets."""
        return "front" if self.sign > 0 else "back"


def find_image(bundles: Bundles, elements: Elements) -> Image | None:
    """The image of a sequence; None, with a warning, where it is virtual.

    Raises
    ------
    SceneError
        where a curved image is too small for its light
    """
    prescription = bundles.sequence.prescription
    last = prescription.surfaces[-1]
    z = bundles.sequence.z
    sign = (-1) ** sum(surface.mirror for surface in prescription.surfaces[:-1])
    before = _last_that_acts(bundles)
    scale = float(np.max(np.abs(z[1:]))) + 1e-12
    if (z[-1] - z[before]) * sign < -1e-9 * scale:
        _warn(
            prescription.origin,
            f"the image lies {abs(z[-1] - z[before]):.5g} before surface "
            f"{prescription.surfaces[before].number}, where its light does not go: it is virtual, "
            "and gets no detector",
        )
        return None
    light = bundles.image_light(elements.limits)
    reach = float(np.hypot(light[:, 0], light[:, 1]).max(initial=0.0))
    if not len(light):
        _warn(prescription.origin, "no direct light gets to the image")
    least = WAVES * 1e-6 * max(prescription.wavelengths_nm) * length_scale("mm", prescription.unit)
    half = max(MARGIN * reach, least, MARGIN * (last.semi_diameter or 0.0))
    curved = bool(last.curvature) or any(last.aspheric)
    if curved:
        half = _within(last.sag, half, max(reach, least))
        if math.isnan(half):
            raise SceneError(
                f"{prescription.origin}: surface {last.number}: light meets the image at "
                f"{reach:.4g} from the axis, where its curve does not reach; flatten it"
            )
    blocking = not _in_the_way(bundles, z[-1] + np.array([0.0, last.sag(half)]), half)
    if not blocking:
        _warn(
            prescription.origin,
            "the image lies in the light on its way to the lens; its detector lets light pass, and "
            "registers what comes from the lens",
        )
    return Image(z=float(z[-1]), half=half, sign=sign, curved=curved, blocking=blocking)


def _last_that_acts(bundles: Bundles) -> int:
    """Index of the last surface at which light is bent, reflected or stopped."""
    surfaces, stop = bundles.sequence.surfaces, bundles.sequence.prescription.stop
    glass, found = None, 1
    for k in range(1, len(surfaces) - 1):
        behind = glass if surfaces[k].mirror else surfaces[k].glass
        if surfaces[k].mirror or behind != glass or k == stop:
            found = k
        glass = behind
    return found


def _within(sag: Callable[[float], float], wanted: float, least: float) -> float:
    """The largest radius from ``least`` to ``wanted`` that a curve reaches; nan if none."""
    for radius in np.linspace(wanted, least, 65):
        if math.isfinite(sag(float(radius) * 1.001)):
            return float(radius)
    return math.nan


def _in_the_way(bundles: Bundles, heights: Array, half: float) -> bool:
    """Whether light of any field crosses the image before it has passed the last surface."""
    for lit in bundles.lit:
        starts, along = bundles.launch(lit.origin, lit.pupil)
        points = bundles.trace(lit.origin, lit.pupil).points
        if lit.origin.slope is not None:
            # Parallel light comes from before everything
            starts = (
                points[1] - along * (1.0 + np.abs(heights).max() + np.abs(points[1, :, 2:])) * 2
            )
        ends = [starts, *points[1:-1]]
        for a, b in itertools.pairwise(ends):
            for z in heights:
                with np.errstate(invalid="ignore", divide="ignore"):
                    share = (z - a[:, 2]) / (b[:, 2] - a[:, 2])
                    at = a + share[:, None] * (b - a)
                    inside = (share > 1e-9) & (share < 1.0 - 1e-9)
                    inside &= (np.abs(at[:, :2]) < half).all(axis=1)
                if inside.any():
                    return True
    return False


def _warn(origin: str, message: str) -> None:
    warnings.warn(f"{origin}: {message}", ImportWarning, stacklevel=2)

"""What a check of light in crystals says, and the rays that it asks a local model about."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracer.optics.crystals.local import s_and_p
from tracer.optics.crystals.media import isotropic
from tracer.studies.crystals.local_model import OutgoingRay

__all__ = [
    "AIR",
    "LAMBDA_NM",
    "NORMAL",
    "Check",
    "ellipticity",
    "field_angle",
    "incident_ray",
    "on_side",
    "share_of",
]

Real = NDArray[np.float64]
Complex = NDArray[Any]

NORMAL = np.array([0.0, 0.0, 1.0])
LAMBDA_NM = 589.3
AIR = isotropic(1.0, name="air")


@dataclass(frozen=True, kw_only=True)
class Check:
    """One statement that was tested.

    Attributes
    ----------
    name : dotted, group first
    statement : what must hold
    deviation : largest deviation measured
    limit : largest deviation allowed
    picture : file name of a picture that shows it, or ""
    """

    name: str
    statement: str
    deviation: float
    limit: float
    picture: str = ""

    @property
    def passed(self) -> bool:
        """Whether the deviation is a number within the limit."""
        return bool(self.deviation <= self.limit)


def incident_ray(index: float, degrees: float, azimuth: float = 0.0) -> tuple[Real, Real, Real]:
    """Refraction vector, s and p of a ray towards +z."""
    angle = np.radians(degrees)
    d = np.array([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)])
    s, p = s_and_p(d, NORMAL)
    return index * d, s[0], p[0]


def on_side(rays: list[OutgoingRay], side: str) -> list[OutgoingRay]:
    """The rays that are "reflected" or "refracted"."""
    return [ray for ray in rays if ray.side == side]


def share_of(rays: list[OutgoingRay], side: str) -> float:
    """Share of the light on a side."""
    return float(sum(ray.share for ray in on_side(rays, side)))


def ellipticity(ray: OutgoingRay) -> float:
    """|Im(E x E*)| / |E|^2: 0 for linear light, 1 for circular."""
    e = ray.field
    return float(np.linalg.norm(np.cross(e, e.conj())) / np.vdot(e, e).real)


def field_angle(field: Complex, along: Real) -> float:
    """Share of a field's amplitude that is not along a unit vector."""
    e = np.asarray(field)
    rest = e - (e @ along) * along
    return float(np.linalg.norm(rest) / np.linalg.norm(e))

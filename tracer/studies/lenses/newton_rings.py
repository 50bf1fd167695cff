"""Newton's rings from traced rays: a lens that touches a flat.

Two waves meet in the air gap: one reflected inside the lens at its curved back, one that left the
lens, was reflected by the flat and came back. Both are followed through the lens as levels of its
tree, with fields and optical paths, and added as fields. The centre is dark because one of both
reflections, at the denser medium, turns the field by pi.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tracer.lens import Lens, trace_lens
from tracer.lens.forward import Mode
from tracer.optics.polarization_interference import interfere
from tracer.optics.polarization_rays import PolarizedRays

__all__ = ["newton_rings"]

Real = NDArray[np.float64]


def newton_rings(
    radius_of_curvature: float,
    r: ArrayLike,
    *,
    wavelength_nm: float,
    glass: float = 1.5,
    mode: Mode = "polarized",
    vibration: tuple[float, float, float] = (1.0, 0.0, 0.0),
) -> Real:
    """Reflected flux at distances from the contact, per flux that comes in.

    Parameters
    ----------
    radius_of_curvature : of the lens's back [mm]
    r : (n,) distances from the contact [mm]
    wavelength_nm : vacuum wavelength
    glass : refractive index of lens and flat
    vibration : of the light; x lies in the plane of incidence, y across it
    mode : "polarized", or "published" for the published phase rules, which for
        light across the plane of incidence turn dark and bright around
    """
    distance = np.atleast_1d(np.asarray(r, np.float64))
    reach = float(np.abs(distance).max()) * 1.01 + 1e-3
    thickness = 2.0 + radius_of_curvature - math.sqrt(radius_of_curvature**2 - reach**2)
    lens = Lens(
        radius_front=math.inf, radius_back=-radius_of_curvature, thickness=thickness,
        semi_aperture_front=reach, glass=glass,
    )  # fmt: skip
    flat = Lens(
        radius_front=math.inf, radius_back=math.inf, thickness=1.0, semi_aperture_front=reach,
        glass=glass, origin=(0.0, 0.0, thickness),
    )  # fmt: skip
    zero = np.zeros_like(distance)
    down = PolarizedRays.linear(
        np.stack([distance, zero, zero - 1.0], axis=1), (0.0, 0.0, 1.0), vibration,
        wavelength_nm=wavelength_nm,
    )  # fmt: skip
    upper = trace_lens(lens, down, depth=3, mode=mode)
    exits = upper.exits()
    rays = upper.exit_rays(exits)
    through, inner = exits.level == 2, exits.level == 3
    gap = exits.ray[through]
    mirrored = trace_lens(flat, rays.where(through), depth=1, mode=mode)
    turned = mirrored.exits()
    back = trace_lens(lens, mirrored.exit_rays(turned), depth=2, mode=mode)
    left = back.exits()
    up = left.level == 2

    # The rings lie in the gap: compare phases at its image, seen through the flat front
    both = PolarizedRays.join([rays.where(inner), back.exit_rays(left).where(up)])
    way = (thickness / glass - both.origin[:, 2]) / both.direction[:, 2]
    points = np.concatenate([exits.ray[inner], gap[turned.ray[left.ray[up]]]])
    seen = replace(both, optical_path=both.optical_path + way)
    return interfere(seen, points, n_points=len(distance))

"""How the light of a lens is shared among the levels of its tree.

Level 1 is the reflection at the first cap, level 2 the direct transmission, level k leaves after
k - 2 reflections inside the glass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracer.lens import Lens, LensTree, trace_lens
from tracer.lens.forward import Mode
from tracer.optics.polarization_rays import PolarizedRays

__all__ = ["LevelShares", "level_shares", "shares_by_height"]

Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class LevelShares:
    """Shares of the light that meets a lens.

    Attributes
    ----------
    share : (depth,) that leaves at levels 1, 2, …
    exits : (depth,) rays that leave there, per incoming ray
    glass, rim, remainder : absorbed in the glass, on the rim, still inside after the last level
    missed : share of the light sent that passes the lens by; the other shares leave it out
    """

    share: Real
    exits: Real
    glass: float
    rim: float
    remainder: float
    missed: float

    @classmethod
    def of(cls, tree: LensTree) -> LevelShares:
        """Shares of a tree, over all its rays."""
        incoming = tree.rays.flux
        total, met = float(incoming.sum()), float(incoming[~tree.missed].sum())
        lit = met if met > 0.0 else 1.0
        return cls(
            share=tree.level_flux / lit,
            exits=(tree.flux > 0.0).sum(axis=0) / max(1, int((~tree.missed).sum())),
            glass=float(tree.absorbed_glass.sum()) / lit,
            rim=float(tree.absorbed_rim.sum()) / lit,
            remainder=float(tree.remainder.sum()) / lit,
            missed=1.0 - met / total if total > 0.0 else 0.0,
        )


def level_shares(
    lens: Lens, rays: PolarizedRays, *, depth: int = 8, mode: Mode = "unpolarized"
) -> LevelShares:
    """Shares by level of any beam; see `tracer.studies.lenses.lens_beams`.

    Used with the rays of a backward tree (from the eye, inside the cone of
    `tracer.studies.lenses.cone`), the shares say which exits of a lens are worth following.
    """
    return LevelShares.of(trace_lens(lens, rays, depth=depth, mode=mode))


def shares_by_height(
    lens: Lens, heights: Sequence[float] | Real, *, wavelength_nm: float, depth: int = 6,
    mode: Mode = "unpolarized",
) -> Real:  # fmt: skip
    """(heights, depth) shares of rays parallel to the axis, by their distance from it [mm].

    The vibration is across the meridional plane's x, that is p light for the polarised modes.
    """
    x, _, z, place = lens.frame
    h = np.asarray(heights, np.float64)
    start = place - 2.0 * (lens.semi_aperture_front + lens.thickness) * z
    rays = PolarizedRays.linear(start + h[:, np.newaxis] * x, z, x, wavelength_nm=wavelength_nm)
    return trace_lens(lens, rays, depth=depth, mode=mode).flux

"""How much of a beam a lens loses on its rim, by field angle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracer.lens import Lens, trace_lens
from tracer.lens.shape import RIM
from tracer.studies.lenses.lens_beams import parallel_beam

__all__ = ["Vignetting", "vignetting"]

Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Vignetting:
    """What becomes of parallel beams that fill the front aperture, by field angle.

    Attributes
    ----------
    field_deg : (n,) angle to the axis
    rim_outside : (n,) share of the rays that meets the rim from outside
    rim_direct : (n,) share that enters and meets the rim before its first exit
    rim_later : (n,) share whose tree meets the rim after a reflection inside
    transmitted : (n,) share of the *rays* that is directly transmitted (level 2)
    flux : (n,) share of the flux that is directly transmitted, unpolarised
    rim_hits : (n,) hits of the rim in all
    """

    field_deg: Real
    rim_outside: Real
    rim_direct: Real
    rim_later: Real
    transmitted: Real
    flux: Real
    rim_hits: NDArray[np.int64]


def vignetting(
    lens: Lens,
    field_deg: Sequence[float] | Real,
    *,
    wavelength_nm: float,
    depth: int = 6,
    rays: int = 20_000,
) -> Vignetting:
    """Trace a parallel beam for every field angle and count what meets the rim."""
    rows = []
    for angle in np.asarray(field_deg, np.float64):
        beam = parallel_beam(lens, rays, wavelength_nm=wavelength_nm, field_deg=float(angle))
        tree = trace_lens(lens, beam, depth=depth, mode="scalar")
        on_rim = tree.face == RIM
        direct = on_rim[:, 1] if depth > 1 else np.zeros(rays, np.bool_)
        second = tree.flux[:, 1] if depth > 1 else np.zeros(rays)
        rows.append(
            (
                on_rim[:, 0].mean(),
                direct.mean(),
                on_rim[:, 2:].any(axis=1).mean() if depth > 2 else 0.0,
                (second > 0.0).mean(),
                second.sum(),
                on_rim.sum(),
            )
        )
    columns = np.array(rows, np.float64).reshape(-1, 6).T
    return Vignetting(
        field_deg=np.asarray(field_deg, np.float64),
        rim_outside=columns[0],
        rim_direct=columns[1],
        rim_later=columns[2],
        transmitted=columns[3],
        flux=columns[4],
        rim_hits=columns[5].astype(np.int64),
    )

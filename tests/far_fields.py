"""Pictures of far fields whose light is known."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query import DetectorImage
from query.answers.images.lit import LitCells
from raymap import ChannelSet, Detector
from raymap.optics.cells import cell_measure

Array = NDArray[np.float64]


def far_field(
    intensity: Callable[[Array, Array], Any],
    cells: tuple[int, int],
    last_deg: float = 90.0,
    **parameters: Any,
) -> DetectorImage:
    """A far field whose cells hold the flux of an intensity over (gamma, C) [rad] in them."""
    detector = Detector(
        name="far",
        kind="far_field",
        cells=cells,
        parameters={"gamma_deg": (0.0, last_deg)} | parameters,
    )
    gamma = np.radians((np.arange(cells[1]) + 0.5) * last_deg / cells[1])[:, None]
    c = np.radians((np.arange(cells[0]) + 0.5) * 360.0 / cells[0])[None, :]
    measure = cell_measure(detector, "mm")
    assert measure is not None
    flux = np.broadcast_to(intensity(gamma, c) * measure.values, measure.values.shape)
    return picture(detector, flux, rays=np.ones(flux.shape, np.int64), length_unit="mm")


def picture(
    detector: Detector,
    flux: Array,
    variance: Array | None = None,
    rays: NDArray[np.int64] | None = None,
    *,
    length_unit: str = "m",
) -> DetectorImage:
    """Green light of so many lumens in each cell; without variance it is known exactly."""
    channels = np.zeros((*flux.shape, 3))
    channels[:, :, 1] = flux
    return DetectorImage(
        lit=LitCells.of_arrays(
            detector=detector,
            channel_set=ChannelSet(
                kind="rgb", wavelengths_nm=(611, 549, 464), luminous=(0.2, 0.7, 0.1)
            ),
            flux_unit="lm",
            length_unit=length_unit,
            channels=channels,
            variance=np.zeros(flux.shape) if variance is None else variance,
            rays=np.zeros(flux.shape, np.int64) if rays is None else rays,
        )
    )

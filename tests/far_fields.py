"""Pictures of far fields whose light is known."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query import DetectorImage
from raymap import ChannelSet, Detector

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
    image = DetectorImage(
        detector=detector,
        channel_set=ChannelSet(
            kind="rgb", wavelengths_nm=(611, 549, 464), luminous=(0.2, 0.7, 0.1)
        ),
        flux_unit="lm",
        length_unit="mm",
        channels=np.zeros((cells[1], cells[0], 3)),
        variance=np.zeros((cells[1], cells[0])),
        rays=np.ones((cells[1], cells[0]), np.int64),
    )
    gamma = np.radians((np.arange(cells[1]) + 0.5) * last_deg / cells[1])[:, None]
    c = np.radians((np.arange(cells[0]) + 0.5) * 360.0 / cells[0])[None, :]
    assert image.measure is not None
    image.channels[:, :, 1] = intensity(gamma, c) * image.measure.values
    return image

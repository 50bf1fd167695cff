"""Group indices of the media of a map, by which pulses of light travel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raymap.laws.stored import laws_of
from raymap.model.directory import ChannelSet, Directory, Medium

__all__ = ["SPEED_OF_LIGHT", "group_indices"]

SPEED_OF_LIGHT = 299_792_458.0
"""In vacuum [m/s]; exact by the definition of the metre."""


def group_indices(directory: Directory, channel_set: ChannelSet) -> NDArray[np.float64]:
    """(n_media, n_channels) n - λ dn/dλ; NaN where the map does not say it.

    A medium of one index for all light, and vacuum, travels by that.
    """
    n = channel_set.n_channels
    index = np.array(channel_set.refractive_index, np.float64).reshape(-1, n)
    found = np.full(index.shape, np.nan)
    laws = laws_of(directory, channel_set)
    for number, medium in enumerate(directory.media[: len(index)]):
        law = None if laws is None else laws.media[number]
        if law is not None and law.group_index:
            found[number] = law.group_index
        elif _is_constant(medium, index[number]):
            found[number] = index[number]
    return found


def _is_constant(medium: Medium, index: NDArray[np.float64]) -> bool:
    """Whether it was given one index for all light, or has the index 1 of vacuum."""
    given = medium.parameters.get("index")
    if isinstance(given, dict):
        values = given.get("rgb")
        alike = isinstance(values, list | tuple) and len(set(map(str, values))) == 1
        stated = set(given) == {"rgb"} and alike
    else:
        stated = isinstance(given, int | float) and not isinstance(given, bool)
    return bool((index == index[0]).all()) and (stated or bool((index == 1.0).all()))

"""Radiance as pixels, and films of them as animated PNG."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.model.replacing import replacing
from raymap.optics.colorimetry import encode_srgb
from raymap.pictures.png import animation_bytes

__all__ = ["to_bytes", "write_animation"]


def to_bytes(linear: ArrayLike) -> NDArray[np.uint8]:
    """Linear values to 8-bit sRGB."""
    return np.round(255.0 * encode_srgb(linear)).astype(np.uint8)


def write_animation(
    path: str | Path, frames: Sequence[NDArray[np.uint8]], *, seconds_per_frame: float
) -> None:
    """Write pictures of one size as an animated PNG that repeats for ever."""
    data = animation_bytes(frames, seconds_per_frame=seconds_per_frame)
    with replacing(Path(path)) as beside:
        beside.write_bytes(data)

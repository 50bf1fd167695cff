"""Colour maps, categorical palettes and colours of wavelengths, as small tables."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raymap.optics.colorimetry import encode_srgb

__all__ = ["COLORMAPS", "PALETTE", "apply_colormap", "wavelength_rgb"]

_ANCHORS = {
    "inferno": "000004 0b0724 210c4a 3d0965 57106e 71196e 8a226a a32c61 bc3754 d24644 e45a31 "
    "f1731d f98e09 fcac11 f9cb35 f2ea69 fcffa4",
    "viridis": "440154 48186a 472d7b 424086 3b528b 33638d 2c728e 26828e 21918c 1fa088 28ae80 "
    "3fbc73 5ec962 84d44b addc30 d8e219 fde725",
    "turbo": "30123b 4040a2 466be3 4294ff 28bceb 18ddc2 32f298 6dfe62 a4fc3c cdec34 eecf3a "
    "fdac34 fb7e21 eb500e d02f05 a91601 7a0403",
    "gray": "000000 ffffff",
}
COLORMAPS = tuple(_ANCHORS)
"""Names of the colour maps."""

PALETTE = np.array(
    [
        [86, 180, 233], [230, 159, 0], [0, 168, 120], [240, 98, 146], [240, 228, 66],
        [149, 117, 205], [213, 94, 0], [77, 208, 225], [174, 213, 129], [161, 136, 127],
        [255, 138, 128], [100, 121, 255],
    ],
    np.uint8,
)  # fmt: skip
"""Colours of categories, told apart on dark and on light backgrounds."""


def _table(name: str) -> NDArray[np.float64]:
    rows = [[int(word[i : i + 2], 16) for i in (0, 2, 4)] for word in _ANCHORS[name].split()]
    return np.array(rows, np.float64)


def apply_colormap(values: NDArray[np.floating], name: str) -> NDArray[np.uint8]:
    """Colour numbers between 0 and 1.

    Parameters
    ----------
    values : any shape; beyond the range the end colours, NaN as 0
    name : one of `COLORMAPS`

    Returns
    -------
    values.shape + (3,) uint8
    """
    table = _table(name)
    # 256 steps looked up beat three interpolations of a large image
    places = np.linspace(0, 1, 256) * (len(table) - 1)
    columns = [np.interp(places, np.arange(len(table)), table[:, k]) for k in range(3)]
    steps = np.rint(np.stack(columns, -1)).astype(np.uint8)
    index = np.clip(np.nan_to_num(values, nan=0.0, posinf=1.0, neginf=0.0), 0, 1) * 255 + 0.5
    return np.asarray(steps[index.astype(np.uint8)])


def wavelength_rgb(wavelengths_nm: NDArray[np.floating]) -> NDArray[np.float64]:
    """Display colour of a single wavelength, for legends and plots.

    Multi-lobe fit of the colour matching functions (Wyman, Sloan, Shirley, J. Computer Graphics
    Techniques 2(2), 2013), in sRGB primaries, clipped and scaled to full brightness.
    """

    def lobe(center: float, below: float, above: float) -> NDArray[np.float64]:
        offset = np.asarray(wavelengths_nm, np.float64) - center
        return np.exp(-0.5 * (offset * np.where(offset < 0, below, above)) ** 2)

    x = (
        0.362 * lobe(442.0, 0.0624, 0.0374)
        + 1.056 * lobe(599.8, 0.0264, 0.0323)
        - 0.065 * lobe(501.1, 0.0490, 0.0382)
    )
    y = 0.821 * lobe(568.8, 0.0213, 0.0247) + 0.286 * lobe(530.9, 0.0613, 0.0322)
    z = 1.217 * lobe(437.0, 0.0845, 0.0278) + 0.681 * lobe(459.0, 0.0385, 0.0725)
    to_srgb = np.array(
        [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]
    )
    rgb = np.clip(np.stack([x, y, z], -1) @ to_srgb.T, 0, None)
    brightest = np.maximum(rgb.max(-1, keepdims=True), 1e-3)
    return encode_srgb(rgb / brightest)

"""Make the picture of the backlight in docs/scattering.md: python docs/scattering_pictures.py."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import raymap
from query import detector_image
from raymap.optics.colorimetry import encode_srgb
from raymap.pictures.files import write_chart
from tracer import record

ROOT = Path(__file__).parents[1]
IMAGES = Path(__file__).parent / "images"
RAYS = 300_000


def backlight_picture(path: Path) -> None:
    """What leaves the plate, in its colours, and a section through the middle row of LEDs."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    record(ROOT / "samples" / "opal" / "backlight.toml", path, rays=RAYS, force=True)
    with raymap.open(path) as map:
        image = detector_image(map, "luminance")
    lux = image.illuminance
    rgb = np.clip(image.linear_rgb, 0.0, None)
    figure, axes = pyplot.subplots(1, 2, figsize=(9.6, 4.2), layout="constrained")
    axes[0].imshow(encode_srgb(rgb / rgb.max()), origin="lower", extent=(-30, 30, -30, 30))
    axes[0].set(xlabel="x [mm]", ylabel="y [mm]", title="Light from the plate")
    middle = lux[13:17].mean(axis=0)
    place = np.linspace(-29.0, 29.0, len(middle))
    axes[1].step(place, middle, where="mid", color="#0a6e9a")
    axes[1].set(xlabel="x [mm]", ylabel="illuminance [lx]", ylim=(0.0, None), title="Middle row")
    write_chart(figure, IMAGES / "scattering-backlight.png")


if __name__ == "__main__":
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        backlight_picture(Path(folder) / "backlight.raymap")

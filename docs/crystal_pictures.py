"""Make the pictures of docs/crystals.md: ``python docs/crystal_pictures.py``."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import numpy as np

from raymap.pictures.files import write_pixels
from tracer.optics.crystals.media import biaxial, calcite, uniaxial
from tracer.render.images import to_bytes
from tracer.studies.crystals.crystal_verification import verify_crystals
from tracer.studies.microscopy.microscope import Microscope
from tracer.studies.microscopy.thin_section import random_grains, stage_animation

IMAGES = Path(__file__).parent / "images"
PICTURES = {
    "conical_refraction.png": "crystal_conical.png",
    "conoscopy_calcite.png": "crystal_conoscopy_calcite.png",
    "conoscopy_biaxial.png": "crystal_conoscopy_biaxial.png",
    "calcite_box.png": "crystal_calcite_box.png",
}


def section() -> None:
    """Grains between open and crossed polars, and the stage turning."""
    minerals = (
        uniaxial(1.5442, 1.5533, name="quartz"),
        biaxial(1.5190, 1.5235, 1.5255, name="feldspar"),
        biaxial(1.651, 1.669, 1.689, name="olivine"),
        calcite(),
    )
    rock = random_grains(minerals, count=36, pixels=128, seed=4)
    crossed = Microscope(white_samples=41)
    panels = [rock.picture(crossed, stage_deg=angle) for angle in (0.0, 22.5, 45.0)]
    write_pixels(IMAGES / "crystal_section.png", to_bytes(np.concatenate(panels, axis=1)))
    stage_animation(rock, crossed, IMAGES / "crystal_stage.png", frames=12)


def main() -> None:
    """Write all pictures."""
    section()
    with tempfile.TemporaryDirectory() as folder:
        for check in verify_crystals(numeric=False, pictures=Path(folder), width=480):
            print("pass" if check.passed else "FAIL", check.name)
        for name, target in PICTURES.items():
            shutil.copy(Path(folder) / name, IMAGES / target)


if __name__ == "__main__":
    main()

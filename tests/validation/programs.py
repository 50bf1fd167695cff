"""Files of other programs."""

from __future__ import annotations

import math
import struct
import tempfile
import warnings
from pathlib import Path

import numpy as np

from raymap import rayfiles
from raymap.rayfiles import RaySet
from tests.validation import Row, check
from tracer.light import Opening
from tracer.photometry import lm63


@check(
    what="Flux of 1,000 cos V cos H cd in LM-63 type B, steps of 5°",
    source="A cosine lamp about V = 0, H = 0: π · 1,000 lm",
)
def type_b() -> Row:
    angles = np.arange(-90.0, 91.0, 5.0)
    candela = 1000.0 * np.outer(np.cos(np.radians(angles)), np.cos(np.radians(angles)))
    said = " ".join(f"{angle:g}" for angle in angles)
    lines = [" ".join(f"{abs(value):.4f}" for value in row) for row in candela]
    head = f"IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 {len(angles)} {len(angles)} 2 2 0 0 0\n1 1 1\n"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "b.ies"
        path.write_text(head + "\n".join([said, said, *lines]) + "\n")
        found = lm63.read(path)
    # Linear between steps of 5°: a chord of the cosine misses up to (5°)²/8
    return Row(expected=1000.0 * math.pi, got=float(found.flux), tolerance=6.0, unit="lm")


@check(
    what="Ray files of 1,000 rays of 1 each whose header states 1: flux",
    source="LightTools writes relative powers: the header is the flux; the rays where asked for",
)
def header_rule() -> list[Row]:
    rays = RaySet(
        position=np.zeros((1000, 3), np.float32),
        direction=np.tile(np.array([0.0, 0.0, 1.0], np.float32), (1000, 1)),
        flux=np.ones(1000, np.float32),
        length_unit="mm",
        flux_unit="W",
    )
    rows = []
    for suffix, at, of in ((".tm25ray", 16, "TM-25"), (".sdf", 112, "Zemax")):
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            path = rayfiles.write(rays, Path(folder) / f"rays{suffix}")
            raw = bytearray(path.read_bytes())
            # Total radiant flux of the header
            struct.pack_into("<f", raw, at, 1.0)
            path.write_bytes(raw)
            header = rayfiles.read(path).total_flux
            summed = rayfiles.read(path, flux_from="rays").total_flux
        rows += [
            Row(expected=1.0, got=header, tolerance=1e-6, unit="W", of=of),
            Row(expected=1000.0, got=summed, tolerance=1e-3, unit="W", of=f"{of}, from its rays"),
        ]
    return rows


@check(
    what="Luminous opening of LM-63-2002 seen from gamma 0",
    source="LM-63-2002, table of negative sizes: sides of the tube's outline; π a b of the ellipse",
)
def openings() -> list[Row]:
    rows = []
    for of, sizes, area in (
        ("tube, −0.03 × 1.2 × −0.03 m", "-0.03 1.2 -0.03", 0.03 * 1.2),
        ("ellipse, −0.3 × −1.2 × 0 m", "-0.3 -1.2 0", math.pi * 0.15 * 0.6),
    ):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "lamp.ies"
            path.write_text(
                f"IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 2 1 1 2 {sizes}\n1 1 1\n0 90\n0\n1000 0\n"
            )
            opening = lm63.read(path).opening
        assert isinstance(opening, Opening)
        along, across, _ = opening.size
        got = along * across * (math.pi / 4.0 if opening.shape == "ellipse" else 1.0)
        rows.append(Row(expected=area, got=got, tolerance=1e-9, unit="m²", of=of))
    return rows

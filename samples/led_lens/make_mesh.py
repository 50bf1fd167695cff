"""Write lens.obj from profile.csv: python samples/led_lens/make_mesh.py

The profile is a list of radius and height [mm] from the axis to the rim of the domed face; it is
turned about the z axis and closed by a flat bottom. Groups name the faces: dome, side, bottom.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path

HERE = Path(__file__).parent
STEPS = 48


def profile() -> list[tuple[float, float]]:
    """Radius and height of the dome's rings."""
    with (HERE / "profile.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.reader(file) if row and not row[0].startswith("#")]
    return [(float(r), float(z)) for r, z in rows]


def obj() -> str:
    """The mesh as text, outward sides anticlockwise."""
    rings = profile()
    lines = ["# lens over the LED, mm; written by make_mesh.py from profile.csv"]
    lines.append(f"v 0 0 {rings[0][1]:.5f}")
    for radius, height in [*rings[1:], (rings[-1][0], 0.0)]:
        for k in range(STEPS):
            angle = 2.0 * math.pi * k / STEPS
            lines.append(
                f"v {radius * math.cos(angle):.5f} {radius * math.sin(angle):.5f} {height:.5f}"
            )
    lines.append("v 0 0 0")
    bottom = 2 + STEPS * len(rings)

    def vertex(ring: int, k: int) -> int:
        return 2 + (ring - 1) * STEPS + k % STEPS

    lines.append("g dome")
    lines += [f"f 1 {vertex(1, k)} {vertex(1, k + 1)}" for k in range(STEPS)]
    for ring in range(1, len(rings)):
        if ring == len(rings) - 1:
            lines.append("g side")
        for k in range(STEPS):
            a, b = vertex(ring, k), vertex(ring, k + 1)
            c, d = vertex(ring + 1, k), vertex(ring + 1, k + 1)
            lines += [f"f {a} {c} {d}", f"f {a} {d} {b}"]
    lines.append("g bottom")
    lines += [
        f"f {bottom} {vertex(len(rings), k + 1)} {vertex(len(rings), k)}" for k in range(STEPS)
    ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    (HERE / "lens.obj").write_text(obj(), encoding="utf-8")

"""Speed of the crystal interface: uniaxial and biaxial, into and out of crystals.

Events per second of processor time, which hold on a machine with other work, too, and events per
second by the wall clock on two threads.

Run ``python benchmarks/crystals.py [--picture]``; ``--picture`` renders the calcite box in full as
well (480 x 435 pixels, 21 wavelengths, depth 15), which takes minutes.
"""

from __future__ import annotations

import argparse
import os
import platform
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numba
import numpy as np

from tracer.optics.crystals.interface import WAVE, interface_batch
from tracer.optics.crystals.media import biaxial, isotropic, uniaxial
from tracer.render.load import load_render_scene
from tracer.render.renderer import render

EVENTS = 200_000
KINDS = 64


def media(kind: str, rng: np.random.Generator) -> np.ndarray:
    """Air and a handful of random crystals."""
    rows = [isotropic(1.0).row(589.3)]
    for _ in range(KINDS):
        n = rng.uniform(1.3, 2.5, 3)
        if kind == "uniaxial":
            crystal = uniaxial(n[0], n[1], rng.normal(size=3))
        else:
            turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
            crystal = biaxial(*n, turn * np.sign(np.linalg.det(turn)))
        rows.append(crystal.row(589.3))
    return np.array(rows)


def run(name: str, *arguments: np.ndarray) -> np.ndarray:
    """Time one batch by the processor time of one thread, and the same work on two threads."""
    out, flux = np.zeros((EVENTS, 4, WAVE)), np.zeros(EVENTS)
    rates = []
    for _ in range(3):
        start = time.thread_time()
        interface_batch(*arguments, out, flux)
        rates.append(EVENTS / (time.thread_time() - start))
    half = EVENTS // 2
    parts = [slice(0, half), slice(half, EVENTS)]

    def part(which: slice) -> None:
        interface_batch(arguments[0], *(a[which] for a in arguments[1:]), out[which], flux[which])

    with ThreadPoolExecutor(2) as pool:
        start = time.perf_counter()
        list(pool.map(part, parts))
        both = EVENTS / (time.perf_counter() - start)
    worst = np.abs(out[:, :, 12].sum(axis=1) - 1.0).max()
    print(
        f"{name:32s} {max(rates) / 1e6:6.2f} M per core-second  {both / 1e6:6.2f} M/s on two  "
        f"worst energy sum {worst:.1e}"
    )
    return out


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--picture", action="store_true", help="render the calcite box in full")
    options = parser.parse_args()
    print(
        f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, "
        f"Python {platform.python_version()}, NumPy {np.__version__}, Numba {numba.__version__}"
    )
    rng = np.random.default_rng(1)
    direction = rng.normal(size=(EVENTS, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    normal = rng.normal(size=(EVENTS, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal *= np.sign(np.einsum("ij,ij->i", direction, normal))[:, None]
    field = np.cross(direction, rng.normal(size=(EVENTS, 3))) + 0j
    air = np.zeros(EVENTS, np.int64)
    for kind in ("uniaxial", "biaxial"):
        rows = media(kind, rng)
        crystal = rng.integers(1, KINDS + 1, EVENTS)
        out = run(f"air to {kind}", rows, air, crystal, direction, field, normal)
        inner = out[:, 3, 6:9] + 1j * out[:, 3, 9:12]
        again = rng.normal(size=(EVENTS, 3))
        again /= np.linalg.norm(again, axis=1, keepdims=True)
        again *= np.sign(np.einsum("ij,ij->i", out[:, 3, 3:6], again))[:, None]
        vector = out[:, 3, :3].copy()
        run(f"{kind} to air", rows, crystal, air, vector, inner, again)
        other = rng.integers(1, KINDS + 1, EVENTS)
        run(f"{kind} to {kind}", rows, crystal, other, vector, inner, again)
    if options.picture:
        scene = load_render_scene(
            Path(__file__).parent.parent / "samples/crystals/calcite_box.toml"
        )
        picture = render(scene)
        print(
            f"calcite box {scene.camera.pixels}, {len(scene.wavelengths_nm)} wavelengths, depth "
            f"{scene.max_events}: {picture.seconds:.0f} s, pruning error at most "
            f"{picture.error_steps.max():.2f} of an 8-bit step"
        )


if __name__ == "__main__":
    main()

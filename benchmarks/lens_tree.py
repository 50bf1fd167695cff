"""Rays a second through the lens as a primitive: python benchmarks/lens_tree.py

Trees to depth 6 of random rays that fill a biconvex lens, one compiled call per chunk of a batch
on a pool of threads; timed is the whole call, from the arrays of rays to the arrays of exits.
Processor time per ray is printed beside the wall clock: it holds on a machine with other work, too.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import time

import numba
import numpy as np

from tracer.lens import Lens, trace_lens
from tracer.optics.polarization_rays import PolarizedRays

BUDGET = 1.0e6


def beam(lens: Lens, n: int, seed: int) -> PolarizedRays:
    """Rays from random points in front of a lens, up to 20 degrees from its axis."""
    rng = np.random.default_rng(seed)
    r = 0.85 * lens.semi_aperture_front * np.sqrt(rng.random(n))
    turn = 2.0 * np.pi * rng.random(n)
    target = np.stack([r * np.cos(turn), r * np.sin(turn), np.zeros(n)], axis=1)
    d = np.stack([rng.normal(0.0, 0.12, n), rng.normal(0.0, 0.12, n), np.ones(n)], axis=1)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    return PolarizedRays.linear(
        target - 20.0 * d, d, np.cross(d, [0.0, 1.0, 0.0]), wavelength_nm=587.5618
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rays", type=int, default=262_144)
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    parser.add_argument("--depth", type=int, default=6)
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    lens = Lens(
        radius_front=50.0, radius_back=-50.0, thickness=6.0, semi_aperture_front=12.5, glass=1.5168
    )
    rays = beam(lens, options.rays, options.seed)
    print(
        f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, "
        f"Python {platform.python_version()}, NumPy {np.__version__}, Numba {numba.__version__}"
    )
    print(
        f"{options.rays} rays, depth {options.depth}, {options.threads} threads, "
        f"seed {options.seed}, median of {options.repeats}"
    )
    for mode in ("polarized", "published", "scalar", "schlick"):
        trace_lens(lens, rays.where(slice(0, 64)), depth=options.depth, mode=mode)
        seconds, busy = [], []
        for _ in range(options.repeats):
            start, used = time.perf_counter(), time.process_time()
            tree = trace_lens(lens, rays, depth=options.depth, mode=mode, threads=options.threads)
            seconds.append(time.perf_counter() - start)
            busy.append(time.process_time() - used)
        rate = options.rays / statistics.median(seconds)
        exits = int((tree.flux > 0.0).sum())
        note = f"  ({rate / BUDGET:.2f} x budget)" if mode == "polarized" else ""
        per_core = options.rays / statistics.median(busy)
        print(
            f"{mode:10s} {rate / 1e6:6.2f} M rays/s, {per_core / 1e6:.2f} M per core-second  "
            f"{exits / options.rays:.2f} exits/ray{note}"
        )


if __name__ == "__main__":
    main()

"""Speed of the scattering studies: plate walk, exact model, fits.

Run: python benchmarks/scattering.py [--full]
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import time
from collections.abc import Callable
from pathlib import Path

# Matrices of fifty rows gain nothing from BLAS threads, which spin where processors are busy
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numba
import numpy as np

from tracer.scattering.fits.fit_exact import fit_wavelength
from tracer.scattering.fits.fit_material import fit_material, wavelength_problem
from tracer.scattering.fits.fit_mc import fit_monte_carlo
from tracer.scattering.measured.datafile import load_measurement
from tracer.scattering.plates.goniophotometer import AngularGrid, plate_problem
from tracer.scattering.plates.medium import ScatteringMedium
from tracer.scattering.plates.plate_exact import ExactPlates
from tracer.scattering.plates.plate_kernel import TOTALS, trace_plate

SAMPLES = Path(__file__).parent.parent / "samples" / "opal"
SEED = 1
CASES = {
    "Henyey-Greenstein, dense": (ScatteringMedium(mean_free_path_mm=0.05, g=0.7), 2.05),
    "gamma 2.5, dense": (
        ScatteringMedium(mean_free_path_mm=0.06, absorption_per_mm=0.01, g=0.5, gamma=2.5),
        1.53,
    ),
    "gamma 10, clear": (
        ScatteringMedium(mean_free_path_mm=0.35, absorption_per_mm=0.01, g=0.35, gamma=10.0),
        2.05,
    ),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--full", action="store_true", help="also fit a whole spectrum")
    full = parser.parse_args().full
    print(
        f"{platform.processor() or platform.machine()}, {os.cpu_count()} processors, "
        f"Python {platform.python_version()}, NumPy {np.__version__}, Numba {numba.__version__}, "
        f"seed {SEED}; CPU seconds of this process unless said otherwise"
    )
    for name, (medium, thickness) in CASES.items():
        for n_phi in (1, 36):
            rate = walk_rate(medium, thickness, n_phi)
            print(
                f"plate walk, {name}, {n_phi} azimuths: {rate / 1e6:.1f} M scatterings/s "
                f"per core (must: 8), ratio {rate / 8e6:.2f}"
            )
    solver = ExactPlates(index=1.49, incidence_deg=[0, 10, 20, 30, 45])
    medium = CASES["gamma 2.5, dense"][0]
    spent = median_cpu(lambda: solver.solve(medium, [1.53, 1.98, 3.15]), 200)
    print(f"exact model, 3 plates x 5 angles: {1e3 * spent:.2f} ms (must: a few ms)")
    measurement, settings = load_measurement(SAMPLES / "opal_b.toml")
    problem = wavelength_problem(measurement, settings, 550.0)
    fit = fit_wavelength(problem, 10.0)
    spent = median_cpu(lambda: fit_wavelength(problem, 10.0), 5)
    print(f"fit of one wavelength with intervals: {spent:.2f} s (must: 1), ratio {1 / spent:.1f}")
    for letter, gamma in (("a", 2.5), ("b", 10.0)):
        measured, chosen = load_measurement(SAMPLES / f"opal_{letter}.toml")
        rows = wavelength_problem(measured, chosen, 550.0)
        start = fit_wavelength(rows, gamma)
        traced = fit_monte_carlo(rows, start.medium, rays=10_000, evaluations=40, seed=SEED)
        print(
            f"Monte Carlo fit, opal {letter}, {len(traced.log)} evaluations of 10000 rays: "
            f"{traced.seconds:.1f} s wall (must: 60), objective {traced.objective:.5f} "
            f"± {traced.noise:.5f}"
        )
    if full:
        for letter in "ab":
            begin = time.process_time()
            whole = fit_material(*load_measurement(SAMPLES / f"opal_{letter}.toml"))
            spent = time.process_time() - begin
            print(
                f"whole spectrum of opal {letter}, gamma searched: {spent:.1f} s (must: 60), "
                f"gamma {whole.gamma:g}, ratio {60 / spent:.1f}"
            )
    assert fit.chi2 > 0.0


def walk_rate(medium: ScatteringMedium, thickness: float, n_phi: int) -> float:
    """Scatterings per CPU second in one thread, median of five."""
    grid = AngularGrid(n_phi=n_phi)
    problem = plate_problem(medium, thickness, 30.0, grid=grid)
    bins = np.zeros((2, grid.theta_deg.size, n_phi))
    trace_plate(problem, SEED, 0, 10, False, bins, np.zeros(TOTALS))
    rates = []
    for _ in range(5):
        totals = np.zeros(TOTALS)
        begin = time.process_time()
        trace_plate(problem, SEED, 0, 20_000, False, bins, totals)
        rates.append(totals[5] / (time.process_time() - begin))
    return statistics.median(rates)


def median_cpu(call: Callable[[], object], repetitions: int) -> float:
    """Median CPU seconds of a call."""
    spent = []
    for _ in range(repetitions):
        begin = time.process_time()
        call()
        spent.append(time.process_time() - begin)
    return statistics.median(spent)


if __name__ == "__main__":
    main()

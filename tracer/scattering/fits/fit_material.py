"""The whole fit of a material: exponent, then (m, p, g) at every wavelength.

1. Spectral averages give a rough medium for every candidate exponent.
2. Each candidate fits a handful of wavelengths, with the BTDF shape of the thinnest plate where it
   was measured; their sums of squares are the profile likelihood of the exponent.
3. At the best exponent every wavelength is fitted, started from its neighbour.
4. Because m and g trade against each other, the spectrum is fitted once more with one g for all
   wavelengths: that is what a scene uses.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracer.scattering.fits.fit_exact import WavelengthFit, fit_wavelength
from tracer.scattering.fits.identifiability import Profile, profile_along_g
from tracer.scattering.fits.problem import BOUNDS, WavelengthProblem
from tracer.scattering.measured.datafile import FitSettings
from tracer.scattering.measured.measurement import MaterialMeasurement, MeasurementError
from tracer.scattering.plates.medium import ScatteringMedium
from tracer.scattering.plates.plate_exact import enough_nodes

__all__ = ["GammaProfile", "MaterialFit", "fit_material", "wavelength_problem"]

Array = NDArray[np.float64]
_SEARCHED_WAVELENGTHS = 7
_MOST_NODES = 32


@dataclass(frozen=True, kw_only=True)
class GammaProfile:
    """Profile likelihood of the exponent.

    Attributes
    ----------
    gammas : (n,) candidates
    chi2 : (n,) smallest sums of squares, less the smallest of them
    rms : (n,) root mean square relative deviation of R and T
    """

    gammas: Array
    chi2: Array
    rms: Array

    @property
    def best(self) -> float:
        """Candidate of the smallest sum of squares."""
        return float(self.gammas[np.argmin(self.chi2)])

    def within(self, rise: float) -> Array:
        """Candidates whose sum of squares lies at most ``rise`` above the smallest."""
        return np.asarray(self.gammas[self.chi2 <= rise])


@dataclass(frozen=True, kw_only=True)
class MaterialFit:
    """Fit of a material.

    Attributes
    ----------
    name, index : of the material
    gamma : exponent used
    gamma_profile : None if the exponent was given
    average : fit of the spectral averages
    average_profile : its profile along g
    wavelengths : one fit per wavelength, m, p and g free
    profiles : their intervals
    g : one value for all wavelengths
    common : one fit per wavelength with that g
    seconds : wall time
    """

    name: str
    index: float
    gamma: float
    gamma_profile: GammaProfile | None
    average: WavelengthFit
    average_profile: Profile
    wavelengths: tuple[WavelengthFit, ...]
    profiles: tuple[Profile, ...]
    g: float
    common: tuple[WavelengthFit, ...]
    seconds: float


def wavelength_problem(
    measurement: MaterialMeasurement,
    settings: FitSettings,
    wavelength_nm: float,
    *,
    nodes: int = 16,
) -> WavelengthProblem:
    """Rows of one wavelength with the weights of the settings; 0 for averaged measurements."""
    flux = measurement.at(wavelength_nm)
    weights = np.ones(len(flux))
    for angle, weight in settings.angle_weights.items():
        try:
            weights[np.isclose(flux.incidence_deg, float(angle))] = weight
        except ValueError:
            raise MeasurementError(
                f"fit.angle_weights: {angle!r} is not an angle in degrees"
            ) from None
    return WavelengthProblem(
        flux=flux,
        index=measurement.index,
        weights=np.concatenate((weights, weights)),
        section=measurement.thinnest_section(wavelength_nm) if settings.use_btdf else None,
        nodes=nodes,
    )


def fit_material(
    measurement: MaterialMeasurement,
    settings: FitSettings | None = None,
    *,
    progress: Callable[[str], None] = lambda _: None,
) -> MaterialFit:
    """Fit all wavelengths of a material.

    Parameters
    ----------
    measurement : checked data
    settings : of the fit
    progress : called with a line of text now and then
    """
    begin = time.perf_counter()
    settings = settings or FitSettings()
    averaged = measurement.average()
    profile, start = None, None
    if settings.gamma == "search":
        profile, start = _search_gamma(measurement, averaged, settings, progress)
        gamma = profile.best
    else:
        gamma = settings.gamma
    average = fit_wavelength(wavelength_problem(averaged, settings, 0.0), gamma, start=start)
    nodes = min(_MOST_NODES, enough_nodes(average.medium))
    problem = wavelength_problem(averaged, settings, 0.0, nodes=nodes)
    average = fit_wavelength(problem, gamma, start=average.medium)
    average_profile = profile_along_g(average)
    problems = {
        float(w): wavelength_problem(measurement, settings, float(w), nodes=nodes)
        for w in measurement.wavelengths_nm
    }
    progress(f"gamma {gamma:g}: fitting {len(problems)} wavelengths")
    free = _fit_spectrum(problems, gamma, average.medium, None)
    profiles = tuple(profile_along_g(f) for f in free)
    g = _common_g(profiles)
    common = _fit_spectrum(problems, gamma, average.medium, g)
    return MaterialFit(
        name=measurement.name,
        index=measurement.index,
        gamma=gamma,
        gamma_profile=profile,
        average=average,
        average_profile=average_profile,
        wavelengths=free,
        profiles=profiles,
        g=g,
        common=common,
        seconds=time.perf_counter() - begin,
    )


def _search_gamma(
    measurement: MaterialMeasurement,
    averaged: MaterialMeasurement,
    settings: FitSettings,
    progress: Callable[[str], None],
) -> tuple[GammaProfile, ScatteringMedium]:
    wavelengths = measurement.wavelengths_nm
    chosen = wavelengths[
        np.unique(np.linspace(0, len(wavelengths) - 1, _SEARCHED_WAVELENGTHS).round().astype(int))
    ]
    problems = {float(w): wavelength_problem(measurement, settings, float(w)) for w in chosen}
    rough = wavelength_problem(averaged, settings, 0.0)
    sums, deviations, starts = [], [], []
    for gamma in settings.gammas:
        average = fit_wavelength(rough, gamma)
        fits = _fit_spectrum(problems, gamma, average.medium, None)
        sums.append(sum(f.chi2 for f in fits))
        deviations.append(math.sqrt(float(np.mean([f.rms**2 for f in fits]))))
        starts.append(average.medium)
        progress(f"gamma {gamma:g}: chi2 {sums[-1]:.2f}, rms {deviations[-1]:.3%}")
    chi2 = np.array(sums)
    profile = GammaProfile(
        gammas=np.array(settings.gammas), chi2=chi2 - chi2.min(), rms=np.array(deviations)
    )
    return profile, starts[int(np.argmin(chi2))]


def _fit_spectrum(
    problems: dict[float, WavelengthProblem],
    gamma: float,
    start: ScatteringMedium,
    g: float | None,
) -> tuple[WavelengthFit, ...]:
    """Fit wavelengths from the middle outwards, each started from its neighbour."""
    order = sorted(problems)
    middle = len(order) // 2
    fits: dict[float, WavelengthFit] = {}
    for side in (order[middle:], order[:middle][::-1]):
        medium = start if not fits else fits[order[middle]].medium
        for wavelength in side:
            fit = fit_wavelength(
                problems[wavelength], gamma, start=medium, g=g, wavelength_nm=wavelength
            )
            fits[wavelength] = fit
            # A neighbour that stands at a bound is no good place to start from
            medium = start if fit.bounds else fit.medium
    return tuple(fits[w] for w in order)


def _common_g(profiles: tuple[Profile, ...]) -> float:
    """The one g that fits all wavelengths best: their sums of squares along g, added."""
    shapes = np.linspace(math.atanh(BOUNDS.g_low), math.atanh(BOUNDS.g_high), 2000)
    total = np.zeros(shapes.size)
    for profile in profiles:
        t = np.arctanh(profile.g)
        beyond = np.where((shapes < t[0]) | (shapes > t[-1]), 10.0, 0.0)
        total += np.interp(shapes, t, profile.chi2) + beyond
    return math.tanh(float(shapes[np.argmin(total)]))

"""What a fit says, in plain words: what is known, how well, and what the data cannot separate."""

from __future__ import annotations

import numpy as np

from tracer.scattering.fits.fit_material import MaterialFit
from tracer.scattering.fits.identifiability import Interval, Profile, Sensitivity

__all__ = ["describe_fit"]


def describe_fit(fit: MaterialFit, sensitivity: Sensitivity) -> list[str]:
    """Sentences about a fit, most certain things first.

    Parameters
    ----------
    fit : of the material
    sensitivity : at the averaged fit
    """
    medium = fit.average.medium
    profile = fit.average_profile
    reduced = profile.intervals["reduced_scattering_per_mm"]
    absorption = profile.intervals["absorption_per_mm"]
    widths = [_relative(p, "reduced_scattering_per_mm") for p in fit.profiles]
    lines = [
        f"Spectral average: mu_s' = (1 - <cos theta>)/m = "
        f"{medium.reduced_scattering_per_mm:.4g} per mm ({_span(reduced)}), "
        f"p = {medium.absorption_per_mm:.4g} per mm ({_span(absorption)}).",
        f"Single wavelengths: mu_s' is known to about {np.median(widths):.1%}, p to about "
        f"{np.median([_relative(p, 'absorption_per_mm') for p in fit.profiles]):.1%} "
        "(68 % intervals, medians over wavelengths).",
        _about_g(profile),
        _about_gamma(fit),
        _about_values(sensitivity),
    ]
    rms = float(np.sqrt(np.mean([f.rms**2 for f in fit.wavelengths])))
    stated = float(np.median(fit.wavelengths[0].measured_error)) if fit.wavelengths else 0.0
    lines.append(
        f"R and T deviate from the model by {rms:.1%} (root mean square); the stated errors are "
        f"{stated:.1%}."
    )
    if stated and rms > 1.6 * stated:
        lines.append(
            "That is more than the errors explain: the model (smooth plates, one phase function) "
            "or the stated errors are wrong, and the intervals above are too narrow."
        )
    hits = [f for f in fit.wavelengths if f.bounds]
    if hits:
        lines.append(
            f"{len(hits)} of {len(fit.wavelengths)} wavelengths end at a bound of the fit "
            f"({'; '.join(sorted({b for f in hits for b in f.bounds}))}): along g the data have "
            "no minimum there."
        )
    lines.append(
        f"The material file uses one g = {fit.g:.3f} for all wavelengths; m follows from mu_s'."
    )
    return lines


def _about_g(profile: Profile) -> str:
    g, m = profile.intervals["g"], profile.intervals["mean_free_path_mm"]
    if g.open_low or g.open_high or g.high - g.low > 0.5 or m.high > 2.0 * m.low:
        return (
            f"m and g cannot be separated: every g from {g.low:.2f} to {g.high:.2f} fits within "
            f"the errors, with m from {m.low:.3g} to {m.high:.3g} mm at nearly the same mu_s'. "
            "Only a thinner plate, whose direct peak is visible, would tell."
        )
    return f"g = {g.low:.3f} .. {g.high:.3f} and m = {m.low:.3g} .. {m.high:.3g} mm."


def _about_gamma(fit: MaterialFit) -> str:
    if fit.gamma_profile is None:
        return f"gamma = {fit.gamma:g} was given, not fitted."
    near, far = fit.gamma_profile.within(1.0), fit.gamma_profile.within(4.0)
    candidates = fit.gamma_profile.gammas
    if far.size == candidates.size:
        return (
            f"gamma is not determined: all candidates from {candidates.min():g} to "
            f"{candidates.max():g} fit within the errors; {fit.gamma:g} is only the smallest of "
            "nearly equal sums of squares."
        )
    return (
        f"gamma = {fit.gamma:g} fits best; {near.min():g} to {near.max():g} are within one "
        f"standard error, {far.min():g} to {far.max():g} within two (profile likelihood)."
    )


def _about_values(sensitivity: Sensitivity) -> str:
    values = sensitivity.singular_values
    weakest = sensitivity.directions[2]
    names = ("ln m", "ln p", "g")
    parts = " ".join(f"{c:+.2f} {n}" for c, n in zip(weakest, names, strict=True))
    return (
        "Singular values of d ln(R, T) / d(ln m, ln p, g): "
        + ", ".join(f"{v:.3g}" for v in values)
        + f"; a change of 1 along the weakest direction ({parts}) moves R and T by "
        f"{values[2]:.1%} in total."
    )


def _relative(profile: Profile, name: str) -> float:
    interval = profile.intervals[name]
    return 0.5 * float(np.log(interval.high / interval.low))


def _span(interval: Interval) -> str:
    return f"68 %: {interval.low:.4g} .. {interval.high:.4g}"

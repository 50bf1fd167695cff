"""Pictures of goniograms and fits (matplotlib)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from raymap.model.doubt import marked
from raymap.model.extras import require
from raymap.pictures.files import write_chart
from tracer.scattering.fits.fit_material import MaterialFit
from tracer.scattering.plates.goniophotometer import Goniogram

__all__ = ["plot_goniogram", "plot_measured", "plot_parameters", "plot_spectrum"]

_BLUE, _ORANGE, _GREEN, _GREY = "#2b6cb0", "#c05621", "#2f855a", "#718096"
_COLORS = (_BLUE, _ORANGE, _GREEN, "#6b46c1", "#b83280", _GREY)


def _pyplot() -> Any:
    require("matplotlib")
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    return pyplot


def plot_parameters(fit: MaterialFit, path: Path) -> None:
    """mu_s', p, m, g over wavelength with 68 % intervals, and the profile of gamma."""
    plt = _pyplot()
    figure, axes = plt.subplots(2, 3, figsize=(12, 6.4), layout="constrained")
    wavelengths = [f.wavelength_nm for f in fit.wavelengths]
    panels = (
        ("reduced_scattering_per_mm", "µs' = (1 − ⟨cos θ⟩)/m  [1/mm]", axes[0, 0], "linear"),
        ("absorption_per_mm", "p  [1/mm]", axes[0, 1], "linear"),
        ("mean_free_path_mm", "m  [mm]", axes[1, 0], "log"),
        ("g", "g", axes[1, 1], "linear"),
    )
    for name, label, axis, scale in panels:
        low = [p.intervals[name].low for p in fit.profiles]
        high = [p.intervals[name].high for p in fit.profiles]
        axis.fill_between(wavelengths, low, high, color=_BLUE, alpha=0.18, lw=0, label="68 %")
        free = [getattr(f.medium, name) for f in fit.wavelengths]
        axis.plot(wavelengths, free, ".", color=_BLUE, label="each wavelength alone")
        common = [getattr(f.medium, name) for f in fit.common]
        axis.plot(wavelengths, common, color=_ORANGE, label="one g for all")
        axis.set(xlabel="wavelength [nm]", ylabel=label, yscale=scale)
        axis.grid(alpha=0.25)
        if scale == "linear" and name != "g":
            axis.set_ylim(bottom=0.0)
    axes[0, 0].legend(frameon=False, fontsize=8)
    axis = axes[0, 2]
    if fit.gamma_profile is not None:
        axis.plot(fit.gamma_profile.gammas, fit.gamma_profile.chi2, "o-", color=_BLUE)
        axis.axhline(1.0, color=_GREY, lw=0.8, ls="--")
        axis.text(fit.gamma_profile.gammas[-1], 1.0, "1 σ", ha="right", va="bottom", fontsize=8)
        axis.set_yscale("symlog", linthresh=4.0)
        axis.set_ylim(bottom=0.0)
    axis.set(xlabel="γ", ylabel="χ² above its minimum", title=f"γ = {fit.gamma:g}")
    axis.grid(alpha=0.25)
    axis = axes[1, 2]
    axis.plot(fit.average_profile.g, fit.average_profile.chi2, "o-", color=_BLUE, ms=4)
    axis.axhline(1.0, color=_GREY, lw=0.8, ls="--")
    axis.set(xlabel="g held (spectral average)", ylabel="χ² above its minimum", ylim=(0.0, 6.0))
    axis.grid(alpha=0.25)
    figure.suptitle(fit.name)
    write_chart(figure, path)
    plt.close(figure)


def plot_measured(fit: MaterialFit, path: Path) -> None:
    """Measured and computed R and T over wavelength, and over angle for the average."""
    plt = _pyplot()
    figure, axes = plt.subplots(1, 2, figsize=(11, 4.6), layout="constrained")
    first = fit.wavelengths[0]
    plates = np.unique(first.thickness_mm)
    angle = float(first.incidence_deg.min())
    wavelengths = [f.wavelength_nm for f in fit.common]
    for color, plate in zip(_COLORS, plates, strict=False):
        for half, style in ((0, "-"), (1, "--")):
            values = [_at(f, half, plate, angle) for f in fit.common]
            measured = [v[0] for v in values]
            axes[0].plot(wavelengths, measured, "o" if half == 0 else "s", color=color, ms=3)
            axes[0].plot(wavelengths, [v[1] for v in values], style, color=color, lw=1.2)
        axes[0].plot([], [], color=color, label=f"{plate:g} mm")
        rows = fit.average.thickness_mm == plate
        order = np.argsort(fit.average.incidence_deg[rows])
        angles = fit.average.incidence_deg[rows][order]
        n = rows.size
        for half, style in ((0, "-"), (1, "--")):
            part = slice(half * n, (half + 1) * n)
            measured_row = fit.average.measured[part][rows][order]
            axes[1].plot(angles, measured_row, "o" if half == 0 else "s", color=color, ms=4)
            axes[1].plot(angles, fit.average.predicted[part][rows][order], style, color=color)
    axes[0].set(xlabel="wavelength [nm]", ylabel="share of the incident flux",
                title=f"incidence {angle:g}°", ylim=(0, 1))  # fmt: skip
    axes[1].set(xlabel="angle of incidence [°]", title="spectral average", ylim=(0, 1))
    axes[0].plot([], [], "o-", color=_GREY, label="R")
    axes[0].plot([], [], "s--", color=_GREY, label="T")
    axes[0].legend(frameon=False, fontsize=8, ncols=2)
    for axis in axes:
        axis.grid(alpha=0.25)
    figure.suptitle(f"{fit.name}: measured (points) and computed (lines)")
    write_chart(figure, path)
    plt.close(figure)


def _at(fit: Any, half: int, plate: float, angle: float) -> tuple[float, float]:
    row = int(np.argmax((fit.thickness_mm == plate) & (fit.incidence_deg == angle)))
    row += half * fit.thickness_mm.size
    return float(fit.measured[row]), float(fit.predicted[row])


def plot_goniogram(light: Goniogram, path: Path, *, title: str = "") -> None:
    """Section in the plane of incidence, and the lobes in 3D."""
    plt = _pyplot()
    figure = plt.figure(figsize=(12, 5.2), layout="constrained")
    axis = figure.add_subplot(1, 2, 1, projection="polar")
    theta = np.radians(light.grid.theta_deg)
    back = light.grid.n_phi // 2
    ahead = np.concatenate((-theta[::-1], theta))
    bulk = []
    for values, sign, color, label in (
        (light.brdf, 1.0, _BLUE, "BRDF"),
        (light.btdf, -1.0, _ORANGE, "BTDF"),
    ):
        smooth = _smoothed(values)
        radius = np.concatenate((smooth[::-1, back % smooth.shape[1]], smooth[:, 0]))
        radius[radius <= 0.0] = np.nan
        bulk.append(np.nanquantile(radius, 0.1))
        axis.plot(ahead if sign > 0 else np.pi - ahead, radius, color=color, label=label)
    axis.set_theta_zero_location("N")
    axis.set_theta_direction(-1)
    axis.set_rscale("log")
    axis.set_rmin(0.1 * min(bulk))
    axis.set_rlabel_position(100)
    axis.tick_params(axis="y", labelsize=7)
    axis.annotate(
        "", xy=(-np.radians(light.incidence_deg), axis.get_rmin() * 3.0),
        xytext=(-np.radians(light.incidence_deg), axis.get_rmax()),
        arrowprops={"arrowstyle": "->", "color": _GREY},
    )  # fmt: skip
    axis.legend(frameon=False, loc="lower left", bbox_to_anchor=(-0.12, -0.05))
    axis.set_title("section in the plane of incidence [1/sr]", fontsize=10)
    solid = figure.add_subplot(1, 2, 2, projection="3d")
    _lobes(solid, light)
    figure.suptitle(
        (title + ": " if title else "")
        + f"incidence {light.incidence_deg:g}°, "
        + (f"{light.wavelength_nm:g} nm, " if light.wavelength_nm else "")
        + f"R = {_share(light.reflectance, light.reflectance_se)}, "
        + f"T = {_share(light.transmittance, light.transmittance_se)}"
    )
    write_chart(figure, path)
    plt.close(figure)


def _share(value: float, se: float) -> str:
    return marked(f"{value:.4f} ± {se:.4f}", value, se)


def _smoothed(values: Any) -> Any:
    """Mean of each cell and its neighbours in azimuth; peaks that stand out are left alone."""
    if values.shape[1] < 6:
        return values
    around = (np.roll(values, 1, axis=1) + values + np.roll(values, -1, axis=1)) / 3.0
    ring = np.median(values, axis=1, keepdims=True)
    peak = values > 3.0 * ring
    beside = np.roll(peak, 1, axis=1) | np.roll(peak, -1, axis=1)
    return np.where(peak | beside, values, around)


def _lobes(axis: Any, light: Goniogram) -> None:
    """Radius = value^(1/2) x cosine of the scattered part; peaks are cut at 1.5 times the bulk."""
    theta = np.radians(np.concatenate(([0.0], light.grid.theta_deg, [90.0])))
    phi = np.radians(np.append(light.grid.phi_deg, 360.0))
    for values, sign, color in ((light.brdf, 1.0, _BLUE), (light.btdf, -1.0, _ORANGE)):
        table = _smoothed(values)
        table = np.hstack((table, table[:, :1]))
        table = np.vstack((table[:1].mean(axis=1, keepdims=True).repeat(phi.size, 1), table,
                           np.zeros((1, phi.size))))  # fmt: skip
        radius = np.minimum(table, 1.5 * np.quantile(table, 0.97) + 1e-9)
        t, f = np.meshgrid(theta, phi, indexing="ij")
        axis.plot_surface(
            radius * np.sin(t) * np.cos(f), radius * np.sin(t) * np.sin(f),
            sign * radius * np.cos(t), color=color, alpha=0.75, lw=0.2, edgecolor="white",
            rstride=1, cstride=1,
        )  # fmt: skip
    axis.set_box_aspect(None, zoom=1.2)
    axis.set_aspect("equal")
    axis.set_title("lobes [1/sr]; reflection up, transmission down", fontsize=10)
    axis.tick_params(labelsize=7)


def plot_spectrum(spectrum: Sequence[Goniogram], path: Path, *, title: str = "") -> None:
    """R and T over wavelength with standard errors."""
    plt = _pyplot()
    figure, axis = plt.subplots(figsize=(7, 4.2), layout="constrained")
    wavelengths = [g.wavelength_nm or 0.0 for g in spectrum]
    for name, color in (("reflectance", _BLUE), ("transmittance", _ORANGE)):
        axis.errorbar(
            wavelengths,
            [getattr(g, name) for g in spectrum],
            [getattr(g, f"{name}_se") for g in spectrum],
            fmt="o-", ms=3, capsize=2, color=color, label=name,
        )  # fmt: skip
    axis.set(xlabel="wavelength [nm]", ylabel="share of the incident flux", ylim=(0, 1),
             title=title)  # fmt: skip
    axis.grid(alpha=0.25)
    axis.legend(frameon=False)
    write_chart(figure, path)
    plt.close(figure)

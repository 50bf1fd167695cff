"""A fitted material as scenes use it, and as a table of everything found.

A scene knows one phase function per medium, while m and g trade against each other at every
wavelength. So the file takes the fit with one g for all wavelengths: coefficients by wavelength,
one g, one gamma.
"""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path

import numpy as np

from raymap.model.replacing import replacing
from tracer.scattering.fits.fit_material import MaterialFit
from tracer.scattering.plates.goniophotometer import Goniogram

__all__ = ["goniogram_csv", "material_toml", "result_csv", "write_result"]


def material_toml(fit: MaterialFit, *, millimetres_per_unit: float = 1.0) -> str:
    """Tables ``[media.NAME]`` of a scene file.

    Parameters
    ----------
    fit : of the material
    millimetres_per_unit : length unit of the scene; coefficients are per that unit
    """
    key = _key(fit.name)
    wavelengths = [f.wavelength_nm for f in fit.common]
    absorption = [f.medium.absorption_per_mm * millimetres_per_unit for f in fit.common]
    scattering = [f.medium.scattering_per_mm * millimetres_per_unit for f in fit.common]
    grid = _list(wavelengths, "g")
    lines = [
        f"# {fit.name}: fitted to measured plates, one g for all wavelengths; coefficients are",
        "# per length unit of the scene"
        + ("" if millimetres_per_unit == 1.0 else f" ({millimetres_per_unit:g} mm)")
        + ". What the data leave open stands in the report.",
        f"[media.{key}]",
        f"index = {fit.index:g}",
        f"absorption = {{ wavelength_nm = {grid}, value = {_list(absorption, '.5g')} }}",
        "",
        f"[media.{key}.scattering]",
        f"coefficient = {{ wavelength_nm = {grid}, value = {_list(scattering, '.5g')} }}",
        f'phase = {{ kind = "generalized", g = {fit.g:.5f}, gamma = {fit.gamma:g} }}',
        "",
    ]
    return "\n".join(lines)


def result_csv(fit: MaterialFit) -> str:
    """One row per wavelength: values, 68 % intervals, quality."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    names = ("reduced_scattering_per_mm", "absorption_per_mm", "mean_free_path_mm", "g")
    header = ["wavelength_nm"]
    for name in names:
        header += [name, f"{name}_low", f"{name}_high"]
    writer.writerow([*header, "gamma", "rms", "chi2", "values", "bounds"])
    for found, profile in zip(fit.wavelengths, fit.profiles, strict=True):
        medium = found.medium
        row = [f"{found.wavelength_nm:g}"]
        for name in names:
            interval = profile.intervals[name]
            row += [_number(getattr(medium, name)), _number(interval.low), _number(interval.high)]
        row += [
            f"{fit.gamma:g}",
            f"{found.rms:.5f}",
            f"{found.chi2:.3f}",
            str(found.values),
            "; ".join(found.bounds),
        ]
        writer.writerow(row)
    return out.getvalue()


def goniogram_csv(light: Goniogram) -> str:
    """One row per cell: BRDF and BTDF with standard errors."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(
        ["wavelength_nm", "incidence_deg", "theta_deg", "phi_deg", "brdf", "brdf_se", "btdf",
         "btdf_se"]
    )  # fmt: skip
    for i, theta in enumerate(light.grid.theta_deg):
        for k, phi in enumerate(light.grid.phi_deg):
            values = (light.brdf, light.brdf_se, light.btdf, light.btdf_se)
            place = (light.wavelength_nm or math.nan, light.incidence_deg, theta, phi)
            writer.writerow([f"{v:g}" for v in place] + [f"{table[i, k]:.6g}" for table in values])
    return out.getvalue()


def write_result(path: Path, text: str) -> None:
    """Write a text beside its place and rename it."""
    with replacing(path) as beside:
        beside.write_text(text, encoding="utf-8")


def _key(name: str) -> str:
    plain = name.replace("_", "").replace("-", "").isalnum() and name.isascii()
    return name if plain else '"' + name.replace("\\", "").replace('"', "") + '"'


def _list(values: list[float], style: str) -> str:
    return "[" + ", ".join(format(float(v), style) for v in values) + "]"


def _number(value: float) -> str:
    return f"{value:.6g}" if math.isfinite(value) else str(np.inf)

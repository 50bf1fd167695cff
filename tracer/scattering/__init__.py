"""Volume scattering: what plates of a medium show, and which medium a set of plates is.

Names are imported on first use, because the plate walk carries compiled code.
"""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    "AngularGrid": "plates.goniophotometer",
    "ExactPlates": "plates.plate_exact",
    "FitSettings": "measured.datafile",
    "Goniogram": "plates.goniophotometer",
    "MaterialFit": "fits.fit_material",
    "ScatteringMedium": "plates.medium",
    "fit_monte_carlo": "fits.fit_mc",
    "fit_wavelength": "fits.fit_exact",
    "gaussian_tilt": "plates.tilt",
    "load_measurement": "measured.datafile",
    "material_toml": "fits.material_file",
    "measure_plate": "plates.goniophotometer",
    "measure_scene": "scene_goniophotometer",
    "measure_spectrum": "plates.goniophotometer",
    "profile_along_g": "fits.identifiability",
    "reflectance_transmittance": "plates.plate_exact",
    "sensitivity": "fits.identifiability",
    "surface_tilt": "fits.surface",
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)

"""Volume scattering: what plates of a medium show, and which medium a set of plates is.

Names are imported on first use, because the plate walk carries compiled code.
"""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    "AngularGrid": "goniophotometer",
    "ExactPlates": "plate_exact",
    "FitSettings": "datafile",
    "Goniogram": "goniophotometer",
    "MaterialFit": "fit_material",
    "ScatteringMedium": "medium",
    "fit_monte_carlo": "fit_mc",
    "fit_wavelength": "fit_exact",
    "gaussian_tilt": "tilt",
    "load_measurement": "datafile",
    "material_toml": "material_file",
    "measure_plate": "goniophotometer",
    "measure_scene": "scene_goniophotometer",
    "measure_spectrum": "goniophotometer",
    "profile_along_g": "identifiability",
    "reflectance_transmittance": "plate_exact",
    "sensitivity": "identifiability",
    "surface_tilt": "surface",
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)

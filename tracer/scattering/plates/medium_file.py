"""Scattering media of a scene or material file, at single wavelengths."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from raymap.model.errors import SceneError
from raymap.model.givenfile import given_text
from tracer.description.channels import RGB_NM
from tracer.media.model import MediumModel
from tracer.scattering.plates.medium import ScatteringMedium
from tracer.scene.media import refractive_index

__all__ = ["load_media"]

_EXPONENTS = {"isotropic": 1.5, "henyey_greenstein": 1.5}


def load_media(
    path: Path, name: str | None, wavelengths_nm: Sequence[float]
) -> dict[float, ScatteringMedium]:
    """One medium of a file with tables ``[media.NAME]``, at each wavelength; lengths in mm.

    Parameters
    ----------
    path : a material file of `raymap fit-scattering`, or a scene whose unit is the millimetre
    name : of the medium; the first that scatters otherwise
    wavelengths_nm : where it is wanted [nm]
    """
    try:
        tables = tomllib.loads(given_text(path, "material file", SceneError)).get("media", {})
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"{path}: not a TOML file: {error}") from None
    scattering = [key for key, table in tables.items() if "scattering" in table]
    chosen = name or (scattering[0] if scattering else "")
    if chosen not in scattering:
        known = ", ".join(scattering) or "none"
        raise SceneError(f"{path.name}: no scattering medium {chosen!r}; there is {known}")
    place = f"{path.name}: media.{chosen}"
    try:
        model = MediumModel.model_validate(tables[chosen])
    except ValidationError as error:
        raise SceneError(f"{place}: {error.errors()[0]['msg']}") from None
    wanted = np.array(wavelengths_nm, np.float64)
    rgb = np.array(RGB_NM)
    index = refractive_index(model, wanted, place)
    zero = np.zeros(wanted.size)
    absorption = zero if model.absorption is None else model.absorption.at(wanted, rgb)
    given = model.scattering
    if given is None or given.phase.kind not in (*_EXPONENTS, "generalized"):
        raise SceneError(
            f"{place}: the plate kernel knows isotropic, henyey_greenstein and generalized "
            "scattering; trace other phase functions in a scene"
        )
    if given.coefficient is not None:
        coefficient = given.coefficient.at(wanted, rgb)
    else:
        coefficient = zero + 1.0 / (given.mean_free_path or 1.0)
    if given.albedo is not None:
        absorption = absorption + coefficient * (1.0 - given.albedo)
        coefficient = coefficient * given.albedo
    g = 0.0 if given.phase.kind == "isotropic" else given.phase.g
    return {
        float(wanted[k]): ScatteringMedium(
            mean_free_path_mm=float(1.0 / coefficient[k]),
            absorption_per_mm=float(absorption[k]),
            g=g,
            gamma=_EXPONENTS.get(given.phase.kind, given.phase.gamma),
            index=float(index[k]),
        )
        for k in range(wanted.size)
    }

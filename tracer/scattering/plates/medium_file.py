"""Scattering media of a scene or material file, at single wavelengths."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from raymap.model.errors import SceneError
from raymap.model.givenfile import given_text
from raymap.model.giventext import toml_tables
from tracer.media.keys.key import At
from tracer.media.model import medium_model
from tracer.scattering.plates.medium import ScatteringMedium
from tracer.scene.media import absorption_coefficient, refractive_index

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
    text = given_text(path, "material file", SceneError)
    tables = toml_tables(text, str(path), SceneError).get("media", {})
    scattering = [key for key, table in tables.items() if "scattering" in table]
    chosen = name or (scattering[0] if scattering else "")
    if chosen not in scattering:
        known = ", ".join(scattering) or "none"
        raise SceneError(f"{path.name}: no scattering medium {chosen!r}; there is {known}")
    where = f"{path.name}: media.{chosen}"
    try:
        model = medium_model(tables[chosen])
    except ValidationError as error:
        raise SceneError(f"{where}: {error.errors()[0]['msg']}") from None
    wanted = np.array(wavelengths_nm, np.float64)
    index = refractive_index(model, wanted, where)
    at = At(wavelengths_nm=wanted, length_unit="mm", place=where)
    zero = np.zeros(wanted.size)
    absorption = absorption_coefficient(model, at)
    given = model.scattering
    law = None if given is None else given.phase.stated()
    if given is None or law is None or law.kind not in (*_EXPONENTS, "generalized"):
        raise SceneError(
            f"{where}: the plate kernel knows isotropic, henyey_greenstein and generalized "
            "scattering; trace other phase functions in a scene"
        )
    if given.coefficient is not None:
        coefficient = at.values(given.coefficient, "scattering.coefficient")
    else:
        coefficient = zero + 1.0 / (given.mean_free_path or 1.0)
    if given.albedo is not None:
        absorption = absorption + coefficient * (1.0 - given.albedo)
        coefficient = coefficient * given.albedo
    return {
        float(wanted[k]): ScatteringMedium(
            mean_free_path_mm=float(1.0 / coefficient[k]),
            absorption_per_mm=float(absorption[k]),
            g=law.g,
            gamma=_EXPONENTS.get(law.kind, law.gamma),
            index=float(index[k]),
        )
        for k in range(wanted.size)
    }

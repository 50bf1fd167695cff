"""Media of a scene by number, with their coefficients at the channels of the trace."""

from __future__ import annotations

import json
import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raymap.laws.medium import MediumLaw
from raymap.laws.phase import PHASE_ROW, PhaseLaw
from raymap.model.directory import Medium
from raymap.model.errors import RayMapError, SceneError
from raymap.model.names import nearest_names
from raymap.model.units import length_scale
from tracer.description.channels import RGB_NM
from tracer.description.fields import ByWavelength
from tracer.media.model import MediumModel
from tracer.optics import dispersion
from tracer.optics.glasses import Glass, find_glass
from tracer.scene.model import Scene

__all__ = ["MediumTable", "MissingAbsorption", "medium_table", "refractive_index"]

Array = NDArray[np.float64]

"""Millimetres in a scene unit."""

_BUILT_IN = {"air": MediumModel(index=1.0), "vacuum": MediumModel(index=1.0)}  # type: ignore[arg-type]


class MissingAbsorption(UserWarning):
    """A material of the catalogue that comes without absorption: it is traced as if clear."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MediumTable:
    """Media by number: arrays for the engine, entries and laws for the map, phase functions."""

    names: tuple[str, ...]
    integers: NDArray[np.int64]
    numbers: Array
    index: Array
    absorption: Array
    entries: tuple[Medium, ...]
    tables: Array
    laws: tuple[MediumLaw, ...]
    origin: str

    def number(self, name: str, place: str = "world.medium") -> int:
        """Index of a medium by name.

        Raises
        ------
        SceneError
            if the scene has no such medium
        """
        if name not in self.names:
            known = dict.fromkeys(self.names, 0)
            if _is_glass(name):
                raise SceneError(
                    f"{self.origin}: {place}: there is no medium {name!r}; it is a glass of the "
                    f"catalogue: add [media.{name}] glass = {name!r}"
                )
            raise SceneError(
                f"{self.origin}: {place}: there is no medium {name!r}{nearest_names(name, known)} "
                f"(or add [media.{name}])"
            )
        return self.names.index(name)


def _is_glass(name: str) -> bool:
    try:
        find_glass(name)
    except RayMapError:
        return False
    return True


def medium_table(scene: Scene, wavelengths_nm: Array) -> MediumTable:
    """Number the media of a scene; air and vacuum are always there."""
    models = {**_BUILT_IN, **scene.media}
    n, channels = len(models), len(wavelengths_nm)
    index = np.empty((n, channels))
    absorption, scattering = np.zeros((n, channels)), np.zeros((n, channels))
    phases = np.zeros((n, PHASE_ROW))
    tables: list[Array] = []
    laws = [MediumLaw()] * n
    for k, (name, model) in enumerate(models.items()):
        place = f"{scene.origin}: media.{name}"
        index[k] = refractive_index(model, wavelengths_nm, place)
        if model.glass is not None:
            glass = _glass(model, place)
            absorption[k] = glass.absorption(wavelengths_nm) * length_scale(scene.length_unit, "mm")
        if model.absorption is not None:
            absorption[k] = _at(model.absorption, wavelengths_nm, f"{place}.absorption")
        if model.scattering is not None:
            given = model.scattering
            if given.coefficient is not None:
                key = f"{place}.scattering.coefficient"
                scattering[k] = _at(given.coefficient, wavelengths_nm, key)
            else:
                scattering[k] = 1.0 / (given.mean_free_path or 1.0)
            if given.albedo is not None:
                absorption[k] += scattering[k] * (1.0 - given.albedo)
                scattering[k] *= given.albedo
            law = PhaseLaw(**given.phase.model_dump(exclude_unset=True))
            phases[k], table = law.row(first=sum(map(len, tables)), name=name)
            tables.append(table)
            laws[k] = MediumLaw(scattering=tuple(scattering[k].tolist()), phase=law)
        if min(absorption[k].min(), scattering[k].min()) < 0.0:
            raise SceneError(f"{place}: absorption and scattering must not be negative")
    _warn_of_missing_absorption(scene)
    extinction = absorption + scattering
    varied = (np.ptp(absorption, axis=1) > 0.0) | (np.ptp(scattering, axis=1) > 0.0)
    return MediumTable(
        names=tuple(models),
        integers=np.column_stack(
            [
                np.ptp(index, axis=1) > 0.0,
                np.where(np.any(extinction > 0.0, axis=1), np.where(varied, 2, 1), 0),
            ]
        ).astype(np.int64),
        numbers=np.hstack([index, absorption, scattering, phases]),
        index=index,
        absorption=absorption,
        entries=tuple(
            Medium(
                name=name,
                kind=_kind(model),
                parameters=json.loads(model.model_dump_json(exclude_unset=True)),
            )
            for name, model in models.items()
        ),
        tables=np.concatenate([*tables, np.zeros(1)]),
        laws=tuple(laws),
        origin=scene.origin,
    )


def _warn_of_missing_absorption(scene: Scene) -> None:
    """Name the media, as far as bodies consist of them, whose absorption nobody has said."""
    used = {scene.world.medium, *(body.medium for body in scene.bodies.values())}
    silent = [
        f"{name!r} ({model.glass})"
        for name, model in scene.media.items()
        if name in used
        and model.glass is not None
        and model.absorption is None
        and not _glass(model, f"{scene.origin}: media.{name}").transmittance.size
    ]
    if silent:
        warnings.warn(
            f"{scene.origin}: there are no data of the absorption of {', '.join(silent)}: light "
            "loses nothing inside; give the medium an absorption (absorption = 0 where none is "
            "meant)",
            MissingAbsorption,
            stacklevel=5,
        )


def _kind(model: MediumModel) -> str:
    for kind in ("sellmeier", "cauchy", "glass"):
        if getattr(model, kind) is not None:
            return kind
    return "index"


def refractive_index(model: MediumModel, wavelengths_nm: Array, place: str) -> Array:
    """Index of a medium at wavelengths [nm]."""
    if model.crystal is not None:
        raise SceneError(f"{place}: a crystal has no single index; raymap record traces crystals")
    if model.sellmeier is not None:
        law = dispersion.sellmeier(model.sellmeier.b, model.sellmeier.c, name=place)
        values = law.index(wavelengths_nm)
    elif model.cauchy is not None:
        values = dispersion.cauchy(model.cauchy, name=place).index(wavelengths_nm)
    elif model.index is not None:
        values = _at(model.index, wavelengths_nm, f"{place}.index")
    else:
        values = _glass(model, place).index(wavelengths_nm)
    if values.min() <= 0.0:
        raise SceneError(f"{place}: the refractive index must be positive, it is {values.min():g}")
    return np.asarray(values)


def _at(given: ByWavelength, wavelengths_nm: Array, place: str) -> Array:
    """Values at the channels; what is wrong is said with its place."""
    try:
        return given.at(wavelengths_nm, np.array(RGB_NM))
    except SceneError as error:
        raise SceneError(f"{place}: {error}") from None


def _glass(model: MediumModel, place: str) -> Glass:
    try:
        return find_glass(model.glass or "")
    except SceneError as error:
        raise SceneError(f"{place}.glass: {error}") from None

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
from tracer.description.asking import asking
from tracer.media.keys.glass import catalogue_glass
from tracer.media.keys.key import MEDIUM_KEYS, At
from tracer.media.model import MediumModel, medium_model
from tracer.media.phases.phase import Phase
from tracer.optics.glasses import find_glass
from tracer.scene.model import Scene

__all__ = [
    "MediumTable",
    "MissingAbsorption",
    "absorption_coefficient",
    "group_index",
    "medium_table",
    "refractive_index",
]

Array = NDArray[np.float64]

_STEP = 1e-4
"""Relative step of wavelengths for derivatives: rounding and curvature stay below 1e-8."""
_BUILT_IN = ("air", "vacuum")
"""Media that every scene has, of index 1 unless it says another."""


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
    models = {name: medium_model({"index": 1.0}) for name in _BUILT_IN} | scene.media
    n, channels = len(models), len(wavelengths_nm)
    index = np.empty((n, channels))
    absorption, scattering = np.zeros((n, channels)), np.zeros((n, channels))
    phases = np.zeros((n, PHASE_ROW))
    tables: list[Array] = []
    laws: list[MediumLaw] = []
    for k, (name, model) in enumerate(models.items()):
        place = f"{scene.origin}: media.{name}"
        index[k] = _index(model, wavelengths_nm, place)
        at = At(wavelengths_nm=wavelengths_nm, length_unit=scene.length_unit, place=place)
        absorption[k] = absorption_coefficient(model, at)
        group: tuple[float, ...] = ()
        if not model.splits:
            group = tuple(group_index(model, wavelengths_nm, index[k]).tolist())
        laws.append(MediumLaw(group_index=group))
        if model.scattering is not None:
            given = model.scattering
            if given.coefficient is not None:
                scattering[k] = at.values(given.coefficient, "scattering.coefficient")
            else:
                scattering[k] = 1.0 / (given.mean_free_path or 1.0)
            if given.albedo is not None:
                absorption[k] += scattering[k] * (1.0 - given.albedo)
                scattering[k] *= given.albedo
            law = _phase_law(given.phase, place)
            phases[k], table = law.row(first=sum(map(len, tables)), name=name)
            tables.append(table)
            laws[k] = MediumLaw(
                scattering=tuple(scattering[k].tolist()), phase=law, group_index=group
            )
        if scattering[k].min() < 0.0:
            raise SceneError(f"{place}.scattering: scattering must not be negative")
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
                kind=model.formula,
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
    silent = []
    for name, model in scene.media.items():
        if name in used and model.formula == "glass" and len(model.given) == 1:
            glass = catalogue_glass(model.key("glass"), f"{scene.origin}: media.{name}")
            if not glass.transmittance.size:
                silent.append(f"{name!r} ({model.key('glass')})")
    if silent:
        warnings.warn(
            f"{scene.origin}: there are no data of the absorption of {', '.join(silent)}: light "
            "loses nothing inside; give the medium an absorption (absorption = 0 where none is "
            "meant)",
            MissingAbsorption,
            stacklevel=5,
        )


def refractive_index(model: MediumModel, wavelengths_nm: Array, place: str) -> Array:
    """Index of a medium at wavelengths [nm].

    Raises
    ------
    SceneError
        the index is no positive number, or the medium has no single one
    """
    if model.splits:
        raise SceneError(f"{place}: a crystal has no single index")
    return _index(model, wavelengths_nm, place)


def _index(model: MediumModel, wavelengths_nm: Array, place: str) -> Array:
    """As `refractive_index`; of crystals the mean of the principal ones."""
    at = At(wavelengths_nm=np.asarray(wavelengths_nm, np.float64), length_unit="mm", place=place)
    formula = MEDIUM_KEYS[model.formula]
    assert formula.index is not None
    with asking(formula.index, place):
        found = np.asarray(formula.index(model.key(formula.word), at), np.float64)
        values = np.broadcast_to(found, at.wavelengths_nm.shape)
    wrong = ~(np.isfinite(values) & (values > 0.0))
    if np.any(wrong):
        raise SceneError(
            f"{place}: the refractive index must be positive, it is {values[wrong][0]:g} "
            f"at {at.wavelengths_nm[wrong][0]:g} nm"
        )
    return values.copy()


def group_index(model: MediumModel, wavelengths_nm: Array, index: Array) -> Array:
    """n - λ dn/dλ of a medium, by which pulses travel, from differences of its index.

    Empty where its index is not known beside the channels, as of one that is given by them.
    """
    steps = ((-_STEP, _STEP), (0.0, _STEP), (-_STEP, 0.0))
    slopes = np.full(index.shape, np.nan)
    for low, high in steps:
        # All at once; one by one where the index of some ends at its channel
        missing = np.flatnonzero(np.isnan(slopes))
        for part in (missing, *missing[:, None]):
            part = part[np.isnan(slopes[part])]
            at = wavelengths_nm[part] * (1.0 + np.array([[low], [high]]))
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    values = refractive_index(model, at.ravel(), "").reshape(at.shape)
            except (RayMapError, ValueError):
                continue
            slopes[part] = (values[1] - values[0]) / (at[1] - at[0])
    if np.isnan(slopes).any() or (not slopes.any() and np.ptp(index) > 0.0):
        return np.empty(0)
    found: Array = index - wavelengths_nm * slopes
    return found


def absorption_coefficient(model: MediumModel, at: At) -> Array:
    """Absorption of a medium [1 / scene unit]: what it is given, else what its index brings along.

    Raises
    ------
    SceneError
        it is negative, or no number
    """
    keys = [MEDIUM_KEYS[word] for word in model.given]
    saying = [key for key in keys if key.absorption is not None]
    values = np.zeros(at.wavelengths_nm.shape)
    for key in sorted(saying, key=lambda key: key.index is None):
        assert key.absorption is not None
        with asking(key.absorption, at.place):
            values = np.asarray(key.absorption(model.key(key.word), at), np.float64)
        values = np.broadcast_to(values, at.wavelengths_nm.shape).copy()
        if np.any(np.isnan(values)) or values.min() < 0.0:
            raise SceneError(f"{at.place}.{key.word}: absorption must not be negative")
    return values


def _phase_law(phase: Phase, place: str) -> PhaseLaw:
    try:
        return phase.stated()
    except SceneError as error:
        raise SceneError(f"{place}.scattering.{error}") from None

"""Surfaces of a scene by number: parameter rows, and tables for the samplers."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import SceneError
from tracer.compiled import (
    ABSORBER,
    DIELECTRIC,
    FILTER,
    LAMBERTIAN,
    MIRROR,
    RETROREFLECTOR,
    ROUGH_DIELECTRIC,
    ROUGH_MIRROR,
    S_KIND,
    S_METAL,
    S_MODEL,
    S_STRIDE,
    S_TABLE,
    S_TRANSMITTED,
    SURFACE_ROW,
    TABULATED,
)
from tracer.description.fields import ByWavelength
from tracer.optics import abg, bsdf, coatings, microfacet_losses
from tracer.scene.media import MediumTable
from tracer.scene.model import RGB_NM, CoatingLayer, MeasuredScatter, SurfaceModel

__all__ = ["SurfaceTable"]

Array = NDArray[np.float64]

_KINDS = {
    "absorber": ABSORBER,
    "dielectric": DIELECTRIC,
    "lambertian": LAMBERTIAN,
    "mirror": MIRROR,
    "rough_dielectric": ROUGH_DIELECTRIC,
    "rough_mirror": ROUGH_MIRROR,
    "filter": FILTER,
    "retroreflector": RETROREFLECTOR,
    "tabulated": TABULATED,
}


class SurfaceTable:
    """Compiles surfaces one by one; tables go to the flat pool behind those of the media."""

    def __init__(self, media: MediumTable, wavelengths_nm: Array, origin: str) -> None:
        self.media = media
        self.wavelengths = wavelengths_nm
        self.origin = origin
        self.pool: list[Array] = [media.tables]
        self.size = len(media.tables)

    def compile(
        self, models: Sequence[tuple[str, SurfaceModel]]
    ) -> tuple[NDArray[np.int64], Array, Array]:
        """Integers (n, 6), numbers (n, SURFACE_ROW + 2 C) and the flat pool of all tables."""
        n_channels = len(self.wavelengths)
        integers = np.full((len(models), 6), -1, np.int64)
        numbers = np.zeros((len(models), SURFACE_ROW + 2 * n_channels))
        for k, (name, model) in enumerate(models):
            row = numbers[k]
            reflectance = row[SURFACE_ROW : SURFACE_ROW + n_channels]
            transmittance = row[SURFACE_ROW + n_channels :]
            place = f"{self.origin}: surfaces.{name}"
            for values, given in (
                (reflectance, model.reflectance),
                (transmittance, model.transmittance),
            ):
                if given is not None:
                    values[:] = self._at(given, place)
            total = reflectance + transmittance
            if total.max() > 1.0 + 1e-12 or min(reflectance.min(), transmittance.min()) < 0.0:
                raise SceneError(
                    f"{place}: reflectance + transmittance is {total.max():g}; it must lie "
                    "between 0 and 1 in every channel"
                )
            integers[k, S_KIND] = _KINDS[model.kind]
            integers[k, S_MODEL] = 0
            self._details(model, name, place, integers[k], row)
        return integers, numbers, np.concatenate(self.pool)

    def _details(
        self, model: SurfaceModel, name: str, place: str, integers: NDArray[np.int64], row: Array
    ) -> None:
        n_channels = len(self.wavelengths)
        reflectance = row[SURFACE_ROW : SURFACE_ROW + n_channels]
        if model.kind == "dielectric" and model.reflectance is not None:
            integers[S_MODEL] = 1 if np.ptp(reflectance) == 0.0 else 3
        if model.coating is not None:
            table = self._coating(model, name, place)
            integers[S_MODEL] = 2
            integers[S_METAL] = self._add(table.ravel())
            integers[S_TRANSMITTED] = table.shape[1]
        if model.metal is not None:
            n, k = self._at(model.metal.n, place), self._at(model.metal.k, place)
            integers[S_METAL] = self._add(np.column_stack([n, k]).ravel())
        if model.roughness is not None:
            row[0] = model.roughness
            if model.kind == "rough_dielectric":
                integers[S_METAL] = self._add(microfacet_losses.dielectric_table(model.roughness))
            else:
                table = microfacet_losses.conductor_table(model.roughness)
                integers[S_MODEL] = self._add(table)
                row[SURFACE_ROW + n_channels :] = self._multiple(model, place, table)
        if model.kind == "filter":
            row[0] = model.index or 1.5
        if model.kind == "retroreflector":
            row[0] = math.cos(math.radians(model.spread_deg or 0.0))
        if model.scatter is not None:
            integers[S_TABLE], integers[S_STRIDE] = self._scatter(model, name)
        if model.kind == "tabulated":
            self._measured(model, name, integers)

    def _add(self, table: Array) -> int:
        first = self.size
        self.pool.append(np.asarray(table, np.float64))
        self.size += len(table)
        return first

    def _at(self, given: ByWavelength, place: str) -> Array:
        try:
            return given.at(self.wavelengths, np.array(RGB_NM))
        except SceneError as error:
            raise SceneError(f"{place}: {error}") from None

    def _multiple(self, model: SurfaceModel, place: str, table: Array) -> Array:
        """Survival of light that meets several facets, per channel."""
        if model.metal is None:
            assert model.reflectance is not None
            averages = self._at(model.reflectance, place)
        else:
            n, k = self._at(model.metal.n, place), self._at(model.metal.k, place)
            averages = np.array(
                [
                    microfacet_losses.average_conductor_reflectance(1.0, float(a), float(b))
                    for a, b in zip(n, k, strict=True)
                ]
            )
        return np.array([microfacet_losses.multiple_reflectance(float(a), table) for a in averages])

    def _coating(self, model: SurfaceModel, name: str, place: str) -> Array:
        given = model.coating
        assert given is not None
        if given.between is not None:
            first, second = (
                self.media.index[self.media.number(item, f"surfaces.{name}.coating.between")]
                for item in given.between
            )
            layers = [
                coatings.Layer(
                    index=self._complex(layer, place),
                    thickness_nm=layer.thickness_nm,
                )
                for layer in given.layers
            ]
            return coatings.layer_coating(first, second, layers, self.wavelengths, name=name)
        return coatings.tabulated_coating(
            self.wavelengths,
            given.wavelength_nm,
            given.angle_deg,
            given.reflectance,
            given.transmittance,
            name=name,
        )

    def _complex(self, layer: CoatingLayer, place: str) -> NDArray[np.complex128]:
        index = np.asarray(self._at(layer.index, place), np.complex128)
        if layer.extinction is not None:
            index = index + 1j * self._at(layer.extinction, place)
        return index

    def _scatter(self, model: SurfaceModel, name: str) -> tuple[int, int]:
        """Place of the tables of scatter, and the step per channel (0: one table for all)."""
        given = model.scatter
        assert given is not None
        reference = given.reference_nm or 0.0
        wavelengths = self.wavelengths if given.reference_nm else self.wavelengths[:1]
        tables = []
        for wavelength in wavelengths:
            at = float(wavelength) if reference else 0.0
            if given.abg is not None:
                law = abg.abg(*given.abg, wavelength_nm=at, reference_nm=reference)
            else:
                assert given.harvey_shack is not None
                law = abg.harvey_shack(
                    *given.harvey_shack, wavelength_nm=at, reference_nm=reference
                )
            tables.append(abg.radial_table(law, name=name))
        first = self._add(np.concatenate(tables))
        return first, len(tables[0]) if reference else 0

    def _measured(self, model: SurfaceModel, name: str, integers: NDArray[np.int64]) -> None:
        places: list[tuple[int, MeasuredScatter | None]] = [
            (S_TABLE, model.reflected),
            (S_TRANSMITTED, model.transmitted),
        ]
        shares = []
        for column, given in places:
            if given is None:
                continue
            table = bsdf.tabulated_bsdf(
                given.theta_i_deg, given.theta_o_deg, given.phi_deg, given.values, name=name
            )
            integers[column] = self._add(table)
            shares.append(table)
        bsdf.check_energy(
            lambda cosine: sum(float(bsdf.tabulated_share(t, 0, cosine)) for t in shares),
            name=name,
        )

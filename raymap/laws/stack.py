"""A stack of layers on an interface, evaluated as a table of reflectance and transmittance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import FailFast, Field

from raymap.laws.jones import LAYERS, JonesRow
from raymap.laws.law import InChannels, Law, Part, Shares
from raymap.laws.radial import RadialScatter, scatter_tables
from raymap.laws.table import COATING_ANGLES, COATING_SIZE, shares_of_tables
from raymap.model.errors import SceneError
from raymap.optics.stacks import Layer, layer_numbers, stack_shares

__all__ = ["StackLaw", "StoredLayer", "layer_coating"]

F64 = NDArray[np.float64]


class StoredLayer(Part):
    """A layer: thickness [nm], and index n + i k by channel; no ``k`` where it is clear."""

    thickness_nm: Annotated[float, Field(ge=0.0)]
    n: Annotated[tuple[float, ...], FailFast()]
    k: Annotated[tuple[float, ...], FailFast()] = ()

    def layer(self) -> Layer:
        """For `raymap.optics.stacks`."""
        index = np.asarray(self.n, np.complex128)
        if self.k:
            index = index + 1j * np.asarray(self.k)
        return Layer(index=index, thickness_nm=self.thickness_nm)


class StackLaw(Law):
    """Layers on a smooth interface.

    Attributes
    ----------
    between : numbers of the media that it lies between
    layers : from the first of them to the second
    scatter : takes its share of the specular light
    """

    law: Literal["stack"] = "stack"
    between: tuple[int, int]
    layers: Annotated[tuple[StoredLayer, ...], FailFast()]
    scatter: RadialScatter | None = None

    def tables(self, channels: InChannels, name: str = "") -> F64:
        """(n_channels, COATING_SIZE) for `raymap.laws.table.coating_share`."""
        first, second = (channels.refractive_index[medium] for medium in self.between)
        layers = [layer.layer() for layer in self.layers]
        return layer_coating(first, second, layers, channels.wavelengths_nm, name=name)

    def _shares(self, channels: InChannels, n_i: F64, n_o: F64, cos_i: F64) -> Shares:
        return shares_of_tables(self.tables(channels), n_i, n_o, cos_i)

    def jones(self, channels: InChannels) -> JonesRow | None:
        first, second = (channels.refractive_index[medium] for medium in self.between)
        layers = [layer.layer() for layer in self.layers]
        rows = []
        for channel, nm in enumerate(channels.wavelengths_nm):
            # From the rarer medium to the denser, as the table
            ordered = layers[::-1] if first[channel] > second[channel] else layers
            flat = [
                number for item in ordered for number in layer_numbers(item, channel, float(nm))
            ]
            rows.append([float(len(layers)), *flat])
        numbers = np.hstack([self.tables(channels), np.array(rows)])
        return JonesRow(
            form=LAYERS,
            numbers=numbers,
            scatter=scatter_tables(self.scatter, channels.wavelengths_nm),
        )


def layer_coating(
    n_1: ArrayLike,
    n_2: ArrayLike,
    layers: Sequence[Layer],
    wavelengths_nm: ArrayLike,
    *,
    name: str = "",
) -> F64:
    """Tables of a stack of layers between two media, for the flat pool of tables.

    Parameters
    ----------
    n_1, n_2 : (n_channels,) real indices of both media
    layers : from medium 1 to medium 2
    wavelengths_nm : (n_channels,)
    name : of the surface, for messages

    Returns
    -------
    tables : (n_channels, size) one row per channel
    """
    wavelengths = np.atleast_1d(np.asarray(wavelengths_nm, np.float64))
    first, second = (np.broadcast_to(np.asarray(n, float), wavelengths.shape) for n in (n_1, n_2))
    for number, layer in enumerate(layers):
        if np.shape(layer.index) != wavelengths.shape:
            raise SceneError(
                f"surface {name!r}: layer {number + 1} needs its index at {len(wavelengths)} "
                f"wavelengths, got {np.shape(layer.index)}"
            )
        if np.any(np.imag(layer.index) < 0.0) or np.any(np.real(layer.index) <= 0.0):
            raise SceneError(
                f"surface {name!r}: layer {number + 1} has an index n + i k with n <= 0 or k < 0; "
                "absorption is a positive k"
            )
        if not (math.isfinite(layer.thickness_nm) and layer.thickness_nm >= 0.0):
            raise SceneError(f"surface {name!r}: layer {number + 1} has no sound thickness")
    if not (np.all(first > 0.0) and np.all(second > 0.0)):
        raise SceneError(f"surface {name!r}: its layers lie between media without an index above 0")
    with np.errstate(all="ignore"):
        table = _stack_tables(first, second, layers, wavelengths)
    if not np.all(np.isfinite(table)):
        raise SceneError(
            f"surface {name!r}: nothing can be computed of layers of such indices and thicknesses"
        )
    return table


def _stack_tables(first: F64, second: F64, layers: Sequence[Layer], wavelengths: F64) -> F64:
    """As `layer_coating`, of numbers that are in order."""
    table = np.zeros((len(wavelengths), COATING_SIZE))
    x = np.linspace(0.0, 1.0, COATING_ANGLES)
    for channel, wavelength in enumerate(wavelengths):
        single = [
            Layer(index=np.asarray(layer.index)[[channel]], thickness_nm=layer.thickness_nm)
            for layer in layers
        ]
        turned = first[channel] > second[channel]
        rare, dense = sorted((first[channel], second[channel]))
        to_dense = single[::-1] if turned else single
        sine = np.sqrt(1.0 - x**2)
        at = [wavelength]
        r_rare, through = stack_shares([rare], [dense], to_dense, at, sine)
        r_dense, _ = stack_shares([dense], [rare], to_dense[::-1], at, sine * rare / dense)
        # Beyond the critical angle, as laid out in coating_share
        critical = math.sqrt(max(0.0, 1.0 - (rare / dense) ** 2))
        beyond = np.sqrt(1.0 - ((1.0 - x) * critical) ** 2)
        r_total, _ = stack_shares([dense], [rare], to_dense[::-1], at, beyond)
        parts = (r_rare[0], r_dense[0], through[0], r_total[0])
        table[channel] = np.clip(np.concatenate(parts), 0.0, 1.0)
    # What bends the table's straight lines above 1 is rounding
    a = COATING_ANGLES
    over = np.maximum(table[:, :a], table[:, a : 2 * a]) + table[:, 2 * a : 3 * a]
    table[:, 2 * a : 3 * a] -= np.maximum(0.0, over - 1.0)
    return table

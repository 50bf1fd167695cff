"""What every surface of the scene description has, and the row that it fills for the engine."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.laws.law import Law as StoredLaw
from raymap.model.errors import SceneError
from raymap.model.unfinished import Unfinished
from tracer.compiled import S_COLUMNS, S_MEET, S_MODEL, S_OWN, S_OWN_SIZE, SURFACE_ROW
from tracer.description.channels import RGB_NM
from tracer.description.fields import ByWavelength, Node
from tracer.surfaces.law import Law

__all__ = ["Surface", "SurfaceRow", "TablePool", "axis_of"]

Array = NDArray[np.float64]

_BEFORE_KINDS = (
    "reflectance", "transmittance", "metal", "roughness", "coating", "scatter", "index",
    "spread_deg", "reflected", "transmitted",
)  # fmt: skip
"""Keys that every surface once had; scenes keep the fingerprints of that time."""


class TablePool:
    """The flat pool of all sampled functions, behind the tables of the media."""

    def __init__(self, tables: Array) -> None:
        self._tables = [tables]
        self._size = len(tables)

    def add(self, table: ArrayLike) -> int:
        """Put a table into the pool; its place."""
        first = self._size
        self._tables.append(np.asarray(table, np.float64).ravel())
        self._size += len(self._tables[-1])
        return first

    def joined(self) -> Array:
        """All of it."""
        return np.concatenate(self._tables)


class SurfaceRow:
    """The place of one surface in the tables of the engine.

    Parameters
    ----------
    name : of the surface
    origin : names the scene in messages
    wavelengths_nm : of the channels
    pool : for tables
    refractive_index : of the media of the scene at the channels
    medium : number of a medium by its name; takes the key that names it as well, for messages

    Attributes
    ----------
    place : of the surface, for messages
    integers : row of ``surface_i``
    numbers : row of ``surface_f``: the kind's own `SURFACE_ROW` numbers, then what follows
    reflectance, transmittance : per channel
    """

    def __init__(
        self,
        name: str,
        origin: str,
        wavelengths_nm: Array,
        pool: TablePool,
        refractive_index: Array,
        medium: Callable[[str, str], int],
    ) -> None:
        n = len(wavelengths_nm)
        self.name = name
        self.place = f"{origin}: surfaces.{name}"
        self.wavelengths_nm = wavelengths_nm
        self.pool = pool
        self.integers = np.full(S_COLUMNS, -1, np.int64)
        self.integers[S_MODEL] = 0
        self.integers[S_MEET:] = 0
        self.numbers = np.zeros(SURFACE_ROW + 2 * n)
        self.reflectance = self.numbers[SURFACE_ROW : SURFACE_ROW + n]
        self.transmittance = self.numbers[SURFACE_ROW + n :]
        self.refractive_index = refractive_index
        self._medium = medium

    def at(self, given: ByWavelength) -> Array:
        """A quantity at the channels.

        Raises
        ------
        SceneError
        """
        try:
            return given.at(self.wavelengths_nm, np.array(RGB_NM))
        except SceneError as error:
            raise SceneError(f"{self.place}: {error}") from None

    def index_of(self, medium: str, key: str) -> Array:
        """Refractive index of a medium of the scene at the channels.

        Raises
        ------
        SceneError
            there is no such medium
        """
        index: Array = self.refractive_index[self.medium(medium, key)]
        return index

    def medium(self, name: str, key: str) -> int:
        """Number of a medium of the scene.

        Raises
        ------
        SceneError
            there is no such medium
        """
        return self._medium(name, f"surfaces.{self.name}.{key}")

    def listed(self, given: ByWavelength | None) -> tuple[float, ...]:
        """A quantity at the channels as a stored law lists it; empty where it is not given."""
        return () if given is None else tuple(self.at(given).tolist())

    def set_own(self, numbers: ArrayLike) -> None:
        """Set the numbers that a kind's law is handed."""
        own = np.asarray(numbers, np.float64).ravel()
        self.integers[S_OWN] = self.pool.add(own)
        self.integers[S_OWN_SIZE] = len(own)

    def set_shares(
        self, reflectance: ByWavelength | None, transmittance: ByWavelength | None
    ) -> None:
        """Set reflectance and transmittance by channel, 0 where they are not given.

        Raises
        ------
        SceneError
            where they do not lie between 0 and 1 together
        """
        if reflectance is not None:
            self.reflectance[:] = self.at(reflectance)
        if transmittance is not None:
            self.transmittance[:] = self.at(transmittance)
        total = self.reflectance + self.transmittance
        if total.max() > 1.0 + 1e-12 or min(self.reflectance.min(), self.transmittance.min()) < 0.0:
            raise SceneError(
                f"{self.place}: reflectance + transmittance is {total.max():g}; it must lie "
                "between 0 and 1 in every channel"
            )


def axis_of(given: Sequence[float] | None, where: str) -> tuple[float, float, float]:
    """The unit vector along a given one.

    Raises
    ------
    SceneError
        of length zero
    """
    x, y, z = map(float, given or (0.0, 0.0, 0.0))
    length = math.hypot(x, y, z)
    if not (0.0 < length < math.inf):
        raise SceneError(f"{where}: an axis needs three numbers that are not all zero")
    return x / length, y / length, z / length


class Surface(Node):
    """Optical properties of faces: what all kinds share.

    A kind is a class in a file of its own. It declares its keys, fills its row of the engine's
    tables (`compile`), and says with which compiled functions light meets it: ``law``, or ``meet``
    and those beside it.
    """

    kind: str

    number: ClassVar[int] = -1
    """Of a built-in kind, in ``surface_i``; others get one that is made of their word."""
    meet: ClassVar[Any] = None
    towards: ClassVar[Any] = None
    draw: ClassVar[Any] = None
    weigh: ClassVar[Any] = None
    """Compiled functions for `tracer.surfaces.interaction.MEET`, ``TOWARDS``, ``DRAW`` and
    ``WEIGH``; without the last two, light that is to be weighed is met as any other."""
    law: ClassVar[Law | None] = None
    """Instead of these: what they are made of (`tracer.surfaces.law`)."""

    def compile(self, row: SurfaceRow) -> None:
        """Fill the row.

        Raises
        ------
        SceneError
        """
        raise Unfinished(self, "compile")

    def stated(self, row: SurfaceRow) -> StoredLaw | None:
        """Its law as maps store it, of a row that is filled; None: maps do not say it."""
        return None

    def transmits(self) -> bool:
        """Whether light goes through a sheet that has the surface."""
        return False

    def aimed_sides(self) -> int:
        """To how many sides scattered light may be aimed; 0 where it keeps to a narrow cone."""
        return 2 if self.law is not None or self.transmits() else 1

    def needs_polarised_light(self) -> bool:
        """Whether natural light is all but what it is made for."""
        return False

    def fingerprint(self) -> dict[str, Any]:
        """All keys with their values, the same for a surface of any version."""
        return dict.fromkeys(_BEFORE_KINDS) | self.model_dump(mode="json")

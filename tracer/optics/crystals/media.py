"""Media of crystals: principal indices, orientation, absorption.

A crystal is described in its own axes (the principal axes of its real dielectric tensor) and
turned into the world by a rotation. Absorption has principal values too, along the same axes or,
in monoclinic and triclinic crystals, along its own. ``Crystal.row(wavelength_nm)`` gives the
numbers that compiled functions take.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.model.errors import SceneError
from tracer.optics.crystals.rows import (
    AXIS,
    BIAXIAL,
    EPS,
    EPS_ABSORPTION,
    EPS_EXTRAORDINARY,
    EPS_ORDINARY,
    ISOTROPIC,
    KIND,
    ROW,
    UNIAXIAL,
)

__all__ = ["Crystal", "biaxial", "calcite", "isotropic", "rotation_between", "uniaxial"]

Law = float | Callable[[float], Any]
"""A number, or a function of the vacuum wavelength [nm]."""

Matrix = NDArray[np.float64]


def _value(law: Law, wavelength_nm: float) -> float:
    return float(law(wavelength_nm)) if callable(law) else float(law)


def _rotation(matrix: ArrayLike, name: str, what: str) -> Matrix:
    rotation = np.array(matrix, np.float64)
    if rotation.shape != (3, 3) or not np.all(np.isfinite(rotation)):
        raise SceneError(
            f"crystal {name!r}: {what} must be a 3 x 3 matrix whose columns are the axes"
        )
    if np.abs(rotation.T @ rotation - np.eye(3)).max() > 1e-9:
        raise SceneError(
            f"crystal {name!r}: {what} has axes that are not orthogonal unit vectors; give three "
            "perpendicular axes of length 1"
        )
    # Polish to rounding, so that equal indices give an isotropic tensor exactly
    u, _, vt = np.linalg.svd(rotation)
    polished: Matrix = u @ vt
    return polished


@dataclass(frozen=True, kw_only=True)
class Crystal:
    """A homogeneous medium: isotropic, uniaxial or biaxial, lossless or weakly absorbing.

    Attributes
    ----------
    name : for messages
    indices : three principal indices, numbers or functions of the wavelength [nm]; two equal ones
        make the crystal uniaxial (the third is n_e), three an isotropic medium
    orientation : (3, 3), columns are the principal axes in world coordinates
    absorption : three principal kappa (imaginary parts of the index), numbers or functions
    absorption_orientation : (3, 3), axes of the absorption; None = those of the indices

    Raises
    ------
    SceneError
        for axes that are not orthogonal; on use, for indices that are not positive and for
        negative kappa (a gaining medium)
    """

    name: str = "crystal"
    indices: tuple[Law, Law, Law]
    orientation: ArrayLike = field(default_factory=lambda: np.eye(3))
    absorption: tuple[Law, Law, Law] = (0.0, 0.0, 0.0)
    absorption_orientation: ArrayLike | None = None

    def __post_init__(self) -> None:
        if len(self.indices) != 3:
            raise SceneError(f"crystal {self.name!r}: indices must be three principal values")
        if len(self.absorption) != 3:
            raise SceneError(f"crystal {self.name!r}: absorption must be three principal values")
        object.__setattr__(
            self, "orientation", _rotation(self.orientation, self.name, "orientation")
        )
        if self.absorption_orientation is not None:
            axes = _rotation(self.absorption_orientation, self.name, "absorption_orientation")
            object.__setattr__(self, "absorption_orientation", axes)
        for number, law in enumerate(self.indices):
            if not callable(law):
                self._check_index(number, float(law), None)
        for number, law in enumerate(self.absorption):
            if not callable(law):
                self._check_kappa(number, float(law), None)

    def _check_index(self, number: int, value: float, wavelength_nm: float | None) -> None:
        if not (value > 0.0 and math.isfinite(value)):
            at = "" if wavelength_nm is None else f" at {wavelength_nm:g} nm"
            raise SceneError(
                f"crystal {self.name!r}: indices[{number}] is {value:g}{at}; "
                "a principal index must be a positive number"
            )

    def _check_kappa(self, number: int, value: float, wavelength_nm: float | None) -> None:
        if not (value >= 0.0 and math.isfinite(value)):
            at = "" if wavelength_nm is None else f" at {wavelength_nm:g} nm"
            raise SceneError(
                f"crystal {self.name!r}: absorption[{number}] is {value:g}{at}; a negative kappa "
                "would amplify light, give kappa >= 0"
            )

    def principal_indices(self, wavelength_nm: float) -> Matrix:
        """(3,) principal indices at a vacuum wavelength [nm]."""
        values = [_value(law, wavelength_nm) for law in self.indices]
        for number, value in enumerate(values):
            self._check_index(number, value, wavelength_nm)
        return np.array(values)

    def principal_kappa(self, wavelength_nm: float) -> Matrix:
        """(3,) principal imaginary indices at a vacuum wavelength [nm]."""
        values = [_value(law, wavelength_nm) for law in self.absorption]
        for number, value in enumerate(values):
            self._check_kappa(number, value, wavelength_nm)
        return np.array(values)

    def tensor(self, wavelength_nm: float) -> Matrix:
        """(3, 3) real dielectric tensor in world coordinates."""
        axes = np.asarray(self.orientation)
        eps: Matrix = (axes * self.principal_indices(wavelength_nm) ** 2) @ axes.T
        return 0.5 * (eps + eps.T)

    def absorption_tensor(self, wavelength_nm: float) -> Matrix:
        """(3, 3) imaginary part of the dielectric tensor, 2 n kappa along its principal axes."""
        kappa = self.principal_kappa(wavelength_nm)
        if self.absorption_orientation is None:
            axes = np.asarray(self.orientation)
            n = self.principal_indices(wavelength_nm)
        else:
            axes = np.asarray(self.absorption_orientation)
            n = np.sqrt(np.einsum("ij,ik,kj->j", axes, self.tensor(wavelength_nm), axes))
        eps: Matrix = (axes * (2.0 * n * kappa)) @ axes.T
        return 0.5 * (eps + eps.T)

    def complex_tensor(self, wavelength_nm: float) -> NDArray[np.complex128]:
        """(3, 3) dielectric tensor with absorption, in the world.

        (n + i kappa)² along common axes of both; where the axes differ the parts are
        eps' - kappa² and eps'', each in its own axes.
        """
        given = self.absorption_orientation
        axes = np.asarray(self.orientation if given is None else given, np.float64)
        squares = axes @ np.diag(self.principal_kappa(wavelength_nm) ** 2) @ axes.T
        real = self.tensor(wavelength_nm) - squares
        return np.asarray(real + 1j * self.absorption_tensor(wavelength_nm))

    def optic_axis(self, wavelength_nm: float) -> Matrix | None:
        """Unit optic axis of a uniaxial crystal, else None."""
        row = self.row(wavelength_nm)
        return row[AXIS : AXIS + 3].copy() if row[KIND] == UNIAXIAL else None

    def binormals(self, wavelength_nm: float) -> tuple[Matrix, Matrix]:
        """Two unit binormals (axes of equal wave velocity) of a biaxial crystal.

        They lie in the plane of the smallest and largest index, at V from the latter's axis with
        tan V = sqrt((1/n_x^2 - 1/n_y^2) / (1/n_y^2 - 1/n_z^2)).
        """
        n = self.principal_indices(wavelength_nm)
        order = np.argsort(n)
        x, y, z = (1.0 / n[order]) ** 2
        if not x > y > z:
            raise SceneError(f"crystal {self.name!r} is not biaxial at {wavelength_nm:g} nm")
        v = math.atan(math.sqrt((x - y) / (y - z)))
        axes = np.asarray(self.orientation)
        fast, slow = axes[:, order[0]], axes[:, order[2]]
        return (
            math.cos(v) * slow + math.sin(v) * fast,
            math.cos(v) * slow - math.sin(v) * fast,
        )

    def turned(self, rotation: ArrayLike) -> Crystal:
        """The same crystal turned by a rotation of the world."""
        turn = _rotation(rotation, self.name, "rotation")
        own = self.absorption_orientation
        return replace(
            self,
            orientation=turn @ np.asarray(self.orientation),
            absorption_orientation=None if own is None else turn @ np.asarray(own),
        )

    def row(self, wavelength_nm: float) -> Matrix:
        """(ROW,) float64, the medium at one wavelength for compiled functions."""
        n = self.principal_indices(wavelength_nm)
        axes = np.asarray(self.orientation)
        row = np.zeros(ROW)
        same = [math.isclose(n[i], n[j], rel_tol=4e-15) for i, j in ((0, 1), (1, 2), (0, 2))]
        eps = self.tensor(wavelength_nm)
        if all(same):
            row[KIND] = ISOTROPIC
            row[EPS_ORDINARY] = row[EPS_EXTRAORDINARY] = n[0] ** 2
            eps = np.eye(3) * n[0] ** 2
        elif any(same):
            third = (2, 0, 1)[same.index(True)]
            row[KIND] = UNIAXIAL
            row[EPS_ORDINARY] = n[(third + 1) % 3] ** 2
            row[EPS_EXTRAORDINARY] = n[third] ** 2
            row[AXIS : AXIS + 3] = axes[:, third]
        else:
            row[KIND] = BIAXIAL
        row[EPS : EPS + 6] = _six(eps)
        row[EPS_ABSORPTION : EPS_ABSORPTION + 6] = _six(self.absorption_tensor(wavelength_nm))
        return row


def _six(tensor: Matrix) -> Matrix:
    return np.array(
        [tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[0, 1], tensor[0, 2], tensor[1, 2]]
    )


def rotation_between(start: ArrayLike, end: ArrayLike) -> Matrix:
    """The smallest rotation that takes one direction into another."""
    a = np.asarray(start, np.float64) / np.linalg.norm(start)
    b = np.asarray(end, np.float64) / np.linalg.norm(end)
    v = np.cross(a, b)
    cosine = float(a @ b)
    if cosine < -1.0 + 1e-12:
        across = np.eye(3)[np.argmin(np.abs(a))]
        across = across - (across @ a) * a
        across /= np.linalg.norm(across)
        turned: Matrix = 2.0 * np.outer(across, across) - np.eye(3)
        return turned
    k = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    rotation: Matrix = np.eye(3) + k + k @ k / (1.0 + cosine)
    return rotation


def isotropic(n: Law, *, name: str = "isotropic", kappa: Law = 0.0) -> Crystal:
    """An isotropic medium."""
    return Crystal(name=name, indices=(n, n, n), absorption=(kappa, kappa, kappa))


def uniaxial(
    n_o: Law,
    n_e: Law,
    axis: ArrayLike = (0.0, 0.0, 1.0),
    *,
    name: str = "uniaxial",
    kappa_o: Law = 0.0,
    kappa_e: Law = 0.0,
) -> Crystal:
    """A uniaxial crystal with its optic axis along ``axis``."""
    direction = np.asarray(axis, np.float64)
    if direction.shape != (3,) or not np.linalg.norm(direction) > 0.0:
        raise SceneError(f"crystal {name!r}: axis must be three numbers, not all zero")
    return Crystal(
        name=name,
        indices=(n_o, n_o, n_e),
        orientation=rotation_between((0.0, 0.0, 1.0), direction),
        absorption=(kappa_o, kappa_o, kappa_e),
    )


def biaxial(
    n_x: Law, n_y: Law, n_z: Law, orientation: ArrayLike | None = None, *, name: str = "biaxial"
) -> Crystal:
    """A biaxial crystal; the columns of ``orientation`` are its principal axes."""
    return Crystal(
        name=name,
        indices=(n_x, n_y, n_z),
        orientation=np.eye(3) if orientation is None else orientation,
    )


def _calcite_ordinary(wavelength_nm: float) -> float:
    square = (wavelength_nm * 1e-3) ** 2
    return math.sqrt(2.69705 + 0.0192064 / (square - 0.01820) - 0.0151624 * square)


def _calcite_extraordinary(wavelength_nm: float) -> float:
    square = (wavelength_nm * 1e-3) ** 2
    return math.sqrt(2.18438 + 0.0087309 / (square - 0.01018) - 0.0024411 * square)


def calcite(axis: ArrayLike = (0.0, 0.0, 1.0)) -> Crystal:
    """Calcite by the Sellmeier formula that optics vendors print (n_D = 1.6584, 1.4864)."""
    return uniaxial(_calcite_ordinary, _calcite_extraordinary, axis, name="calcite")

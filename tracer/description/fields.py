"""Small building blocks of the scene description: vectors, values by wavelength, placement."""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from raymap.model.errors import SceneError
from raymap.optics.frames import turn_to

__all__ = [
    "ByWavelength",
    "Finite",
    "Length",
    "Node",
    "Placed",
    "Positive",
    "Share",
    "Spectral",
    "Vector",
    "is_direction",
]

Array = NDArray[np.float64]
LARGEST = 1e12
"""What is larger, or smaller than its inverse, is a slip of the pen."""


def _not_tiny(value: float) -> float:
    if value < 1.0 / LARGEST:
        raise ValueError(f"must be at least {1.0 / LARGEST:g}")
    return value


Finite = Annotated[float, Field(allow_inf_nan=False)]
Length = Annotated[float, Field(ge=-LARGEST, le=LARGEST, allow_inf_nan=False)]
Vector = tuple[Length, Length, Length]
Positive = Annotated[float, Field(gt=0, le=LARGEST, allow_inf_nan=False), AfterValidator(_not_tiny)]
Share = Annotated[float, Field(ge=0, le=1)]


class Node(BaseModel):
    """A table of the scene file: immutable, unknown keys refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class ByWavelength(Node):
    """A quantity that depends on colour: a table over wavelengths, or three values R, G, B."""

    wavelength_nm: tuple[Positive, ...] = ()
    value: tuple[float, ...] = ()
    rgb: tuple[float, float, float] | None = None

    def model_post_init(self, context: Any) -> None:
        for values in (self.wavelength_nm, self.value, self.rgb or ()):
            for index, number in enumerate(values):
                if not math.isfinite(number):
                    raise ValueError(
                        f"entry {index + 1} is {number}: a gap; fill it in, or leave the entry out"
                    )
        if self.rgb is None:
            if len(self.wavelength_nm) < 2 or len(self.wavelength_nm) != len(self.value):
                raise ValueError(
                    "a table needs two or more wavelength_nm and as many value entries (or rgb)"
                )
            if any(
                b <= a for a, b in zip(self.wavelength_nm, self.wavelength_nm[1:], strict=False)
            ):
                raise ValueError("wavelength_nm must rise")
        elif self.wavelength_nm or self.value:
            raise ValueError("give either rgb or a table of wavelength_nm and value")

    def at(self, wavelengths_nm: Array, rgb_nm: Array) -> Array:
        """Values at the channels; R, G, B stand for three wavelengths between which is drawn."""
        if self.rgb is not None:
            order = np.argsort(rgb_nm)
            return np.asarray(np.interp(wavelengths_nm, rgb_nm[order], np.array(self.rgb)[order]))
        table = np.array(self.wavelength_nm)
        if wavelengths_nm.min() < table[0] or wavelengths_nm.max() > table[-1]:
            raise SceneError(
                f"a table covers {table[0]:g} to {table[-1]:g} nm, the trace needs "
                f"{wavelengths_nm.min():g} to {wavelengths_nm.max():g} nm; extend the table"
            )
        return np.asarray(np.interp(wavelengths_nm, table, np.array(self.value)))


def _wrap(value: Any) -> Any:
    return {"rgb": (value, value, value)} if isinstance(value, int | float) else value


Spectral = Annotated[ByWavelength, BeforeValidator(_wrap)]
"""A number, or a table by wavelength or R, G, B."""


class Placed(Node):
    """Where something stands: its origin and how its own z axis lies.

    ``axis`` turns the local z axis there the short way; ``rotation`` turns about x, then y, then z
    of the scene [deg].
    """

    position: Vector = (0.0, 0.0, 0.0)
    axis: Vector | None = None
    rotation: Vector | None = None

    def model_post_init(self, context: Any) -> None:
        if self.axis is not None and self.rotation is not None:
            raise ValueError("give axis or rotation, not both")
        if self.axis is not None and not is_direction(self.axis):
            raise ValueError("axis must not be the zero vector")

    def frame(self) -> tuple[Array, Array]:
        """Origin, and the rotation whose columns are the local axes."""
        origin = np.array(self.position, float)
        if self.rotation is not None:
            return origin, _rotation(self.rotation)
        if self.axis is not None:
            return origin, _rounded(turn_to(self.axis))
        return origin, np.eye(3)


def is_direction(vector: Vector) -> bool:
    """Whether a vector is long enough to point somewhere."""
    return math.hypot(*vector) > 1e-9


def _rotation(angles_deg: Vector) -> Array:
    a, b, c = (math.radians(angle) for angle in angles_deg)
    about_x = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
    about_y = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    about_z = np.array([[math.cos(c), -math.sin(c), 0], [math.sin(c), math.cos(c), 0], [0, 0, 1]])
    turned: Array = about_z @ about_y @ about_x
    return _rounded(turned)


def _rounded(matrix: Array) -> Array:
    """Exact zeros and ones where rounding only just missed them (right angles stay right)."""
    for value in (-1.0, 0.0, 1.0):
        matrix = np.where(np.abs(matrix - value) < 1e-15, value, matrix)
    return matrix

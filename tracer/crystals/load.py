"""Crystals from tables of a TOML file; errors name the key.

Lengths in mm, angles in degrees, wavelengths in nm.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from raymap.model.errors import SceneError
from raymap.model.givenfile import given_text
from raymap.model.giventext import toml_tables
from tracer.crystals.media import Crystal, calcite, rotation_between

__all__ = [
    "MediumModel",
    "Model",
    "Number",
    "Sellmeier",
    "Vector",
    "checked",
    "medium_of",
    "parse_toml",
    "read_text",
]

Vector = tuple[float, float, float]
Number = Annotated[float, Field(allow_inf_nan=False)]


class Model(BaseModel):
    """Unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Sellmeier(Model):
    """n^2 = a + sum b / (L - c) - d L with L = lambda^2 in um^2."""

    a: Number
    b: tuple[Number, ...] = ()
    c: tuple[Number, ...] = ()
    d: Number = 0.0

    def __call__(self, wavelength_nm: float) -> float:
        square = (wavelength_nm * 1e-3) ** 2
        terms = sum(b / (square - c) for b, c in zip(self.b, self.c, strict=True))
        value = self.a + terms - self.d * square
        return math.sqrt(value) if value > 0.0 else math.nan


class MediumModel(Model):
    """A named crystal: ``calcite``, or principal indices with axes."""

    material: Literal["calcite"] | None = None
    indices: tuple[Number | Sellmeier, Number | Sellmeier, Number | Sellmeier] | None = None
    axes: tuple[Vector, Vector, Vector] | None = None
    optic_axis: Vector | None = None
    absorption: tuple[Number, Number, Number] = (0.0, 0.0, 0.0)


def medium_of(name: str, model: MediumModel, axis: NDArray[np.float64] | None) -> Crystal:
    """The crystal that a table describes; ``axis`` counts where the table gives no optic axis."""
    where = f"media.{name}"
    if (model.material is None) == (model.indices is None):
        raise SceneError(f"{where}: give either material or indices")
    direction = model.optic_axis if model.optic_axis is not None else axis
    if model.material == "calcite":
        medium = calcite((0.0, 0.0, 1.0) if direction is None else direction)
        return Crystal(
            name=name,
            indices=medium.indices,
            orientation=medium.orientation,
            absorption=model.absorption,
        )
    if model.axes is not None and model.optic_axis is not None:
        raise SceneError(f"{where}: give either axes or optic_axis, not both")
    orientation = np.eye(3)
    if model.axes is not None:
        orientation = np.array(model.axes, np.float64).T
    elif direction is not None:
        orientation = rotation_between((0.0, 0.0, 1.0), direction)
    assert model.indices is not None
    return Crystal(
        name=name, indices=model.indices, orientation=orientation, absorption=model.absorption
    )


Description = TypeVar("Description", bound=BaseModel)


def parse_toml(kind: type[Description], text: str, source: str) -> Description:
    """A validated description.

    Raises
    ------
    SceneError
        naming the key that is wrong
    """
    return checked(kind, toml_tables(text, source, SceneError), source)


def checked(kind: type[Description], tables: Any, source: str) -> Description:
    """As `parse_toml`, from tables that are read already."""
    try:
        return kind.model_validate(tables)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise SceneError(f"{source}: {key}: {first['msg']}") from None


def read_text(path: Path) -> str:
    """The text of a scene file."""
    return given_text(path, "scene file", SceneError)

"""Media and bodies of crystals from tables of a TOML file; errors name the key.

Lengths in mm, angles in degrees, wavelengths in nm.
"""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from raymap.errors import MissingExtra, SceneError
from tracer.crystals.bodies import CrystalBody, box, calcite_rhomb, convex_body, mesh_body
from tracer.crystals.media import Crystal, calcite, rotation_between

__all__ = [
    "BodyModel",
    "MediumModel",
    "Model",
    "Number",
    "Sellmeier",
    "Vector",
    "bodies_of",
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


class BodyModel(Model):
    """A body: calcite rhomb, box, convex polyhedron or mesh file."""

    name: str
    medium: str
    shape: Literal["rhomb", "box", "planes", "mesh"]
    edge: Number = 30.0
    base: Vector = (0.0, 0.0, 0.01)
    turn: Number = 0.0
    centre: Vector = (0.0, 0.0, 0.0)
    size: Vector = (10.0, 10.0, 10.0)
    planes: tuple[tuple[Number, Number, Number, Number], ...] = ()
    file: str = ""
    scale: Number = 1.0


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


def _mesh(body: BodyModel, medium: Crystal, folder: Path) -> CrystalBody:
    try:
        import trimesh
    except ImportError as error:
        raise MissingExtra(
            f"body {body.name!r} is a mesh file, which needs trimesh: pip install 'raymap[mesh]'"
        ) from error
    path = folder / body.file
    try:
        mesh: Any = trimesh.load(path, force="mesh")
        vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    except (OSError, ValueError, AttributeError) as error:
        raise SceneError(
            f"body {body.name!r}: cannot read the mesh {str(path)!r}: {error}"
        ) from None
    points = vertices * body.scale + np.asarray(body.base)
    return mesh_body(body.name, medium, points, faces)


def _body(body: BodyModel, media: dict[str, MediumModel], folder: Path) -> CrystalBody:
    if body.medium not in media:
        known = ", ".join(sorted(media)) or "none"
        raise SceneError(
            f"body {body.name!r}: medium {body.medium!r} is not defined; media: {known}"
        )
    model = media[body.medium]
    if body.shape == "rhomb":
        return calcite_rhomb(
            body.name,
            lambda axis: medium_of(body.medium, model, axis),
            body.edge,
            body.base,
            turn_deg=body.turn,
        )
    medium = medium_of(body.medium, model, None)
    if body.shape == "box":
        return box(body.name, medium, body.centre, body.size)
    if body.shape == "planes":
        return convex_body(body.name, medium, np.array(body.planes, np.float64).reshape(-1, 4))
    return _mesh(body, medium, folder)


def bodies_of(
    models: tuple[BodyModel, ...], media: dict[str, MediumModel], folder: Path
) -> tuple[CrystalBody, ...]:
    """Bodies with their media; file names are relative to ``folder``."""
    names = [body.name for body in models]
    if len(set(names)) != len(names):
        raise SceneError("bodies: two bodies have the same name")
    return tuple(_body(body, media, folder) for body in models)


Description = TypeVar("Description", bound=BaseModel)


def parse_toml(kind: type[Description], text: str, source: str) -> Description:
    """A validated description.

    Raises
    ------
    SceneError
        naming the key that is wrong
    """
    try:
        return kind.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"{source}: not TOML: {error}") from None
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise SceneError(f"{source}: {key}: {first['msg']}") from None


def read_text(path: Path) -> str:
    """The text of a scene file."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError(f"scene {str(path)!r} cannot be read: {error}") from None

"""Read a rendering scene from TOML; errors name the key.

Lengths in mm, angles in degrees, wavelengths in nm, colours in sRGB as on a screen (0 .. 1).
"""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from raymap.colorimetry import decode_srgb
from raymap.errors import MissingExtra, SceneError
from tracer.crystals.bodies import CrystalBody, box, calcite_rhomb, convex_body, mesh_body
from tracer.crystals.media import Crystal, calcite, rotation_between
from tracer.render.camera import Camera
from tracer.render.renderer import RenderScene
from tracer.render.room import WALLS, Room, checker_board, uniform
from tracer.render.spectra import visible_wavelengths

__all__ = ["load_render_scene", "load_render_text"]

Vector = tuple[float, float, float]
Number = Annotated[float, Field(allow_inf_nan=False)]


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Sellmeier(_Model):
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


class MediumModel(_Model):
    """A named crystal: ``calcite``, or principal indices with axes."""

    material: Literal["calcite"] | None = None
    indices: tuple[Number | Sellmeier, Number | Sellmeier, Number | Sellmeier] | None = None
    axes: tuple[Vector, Vector, Vector] | None = None
    optic_axis: Vector | None = None
    absorption: tuple[Number, Number, Number] = (0.0, 0.0, 0.0)


class BodyModel(_Model):
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


class BoardModel(_Model):
    """Coloured squares in a border."""

    squares: Annotated[int, Field(ge=1)] = 8
    square: Annotated[float, Field(gt=0)] = 6.0
    border_squares: Annotated[int, Field(ge=0)] = 3
    border: Vector = (0.55, 0.55, 0.55)
    colours: tuple[Vector, ...]


class WallModel(_Model):
    """One colour, a board, or a picture file."""

    color: Vector | None = None
    board: BoardModel | None = None
    picture: str | None = None


class RoomModel(_Model):
    """The emitting box."""

    low: Vector
    high: Vector
    all: Vector | None = None
    walls: dict[str, WallModel] = {}


class CameraModel(_Model):
    """Fields of `Camera`, angles in degrees."""

    position: Vector
    target: Vector
    up: Vector = (0.0, 1.0, 0.0)
    sensor: tuple[Number, Number]
    focal_length: Number
    pixels: tuple[int, int]
    samples: int = 1
    aperture_radius: Number = 0.0
    focus_distance: Number | None = None
    analyser: Number | None = None


class SpectrumModel(_Model):
    """Wavelengths of the picture."""

    count: Annotated[int, Field(ge=1)] = 21
    wavelengths: tuple[Number, ...] | None = None


class RenderModel(_Model):
    """Depth of the tree and what may be left out."""

    depth: Annotated[int, Field(ge=1)] = 15
    pruning_error: Annotated[float, Field(ge=0)] = 0.5


class SceneModel(_Model):
    """The whole file."""

    name: str = "scene"
    media: dict[str, MediumModel] = {}
    bodies: tuple[BodyModel, ...] = ()
    contacts: tuple[tuple[str, str], ...] = ()
    room: RoomModel
    camera: CameraModel
    spectrum: SpectrumModel = SpectrumModel()
    render: RenderModel = RenderModel()


def _medium(name: str, model: MediumModel, axis: NDArray[np.float64] | None) -> Crystal:
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
            lambda axis: _medium(body.medium, model, axis),
            body.edge,
            body.base,
            turn_deg=body.turn,
        )
    medium = _medium(body.medium, model, None)
    if body.shape == "box":
        return box(body.name, medium, body.centre, body.size)
    if body.shape == "planes":
        return convex_body(body.name, medium, np.array(body.planes, np.float64).reshape(-1, 4))
    return _mesh(body, medium, folder)


def _picture(path: Path) -> NDArray[np.float64]:
    try:
        from PIL import Image
    except ImportError as error:
        raise MissingExtra(
            f"wall picture {str(path)!r} needs pillow: pip install 'raymap[view]'"
        ) from error
    try:
        with Image.open(path) as image:
            pixels = np.asarray(image.convert("RGB"), np.float64) / 255.0
    except OSError as error:
        raise SceneError(f"wall picture {str(path)!r} cannot be read: {error}") from None
    return decode_srgb(pixels)


def _room(model: RoomModel, folder: Path) -> Room:
    walls: dict[str, NDArray[np.float64]] = {}
    if model.all is not None:
        walls = {name: uniform(decode_srgb(model.all)) for name in WALLS}
    sides = np.subtract(model.high, model.low)
    for name, wall in model.walls.items():
        given = [wall.color is not None, wall.board is not None, wall.picture is not None]
        if sum(given) != 1:
            raise SceneError(f"room.walls.{name}: give one of color, board, picture")
        if wall.color is not None:
            walls[name] = uniform(decode_srgb(wall.color))
        elif wall.picture is not None:
            walls[name] = _picture(folder / wall.picture)
        elif wall.board is not None:
            axes = {"x": (1, 2), "y": (0, 2), "z": (0, 1)}.get(name[:1], (0, 1))
            walls[name] = checker_board(
                decode_srgb(np.array(wall.board.colours)),
                squares=wall.board.squares,
                border_squares=wall.board.border_squares,
                border=decode_srgb(np.array(wall.board.border)),
                square_mm=wall.board.square,
                size_mm=(float(sides[axes[0]]), float(sides[axes[1]])),
            )
    return Room(low=model.low, high=model.high, walls=walls)


def load_render_text(text: str, *, folder: Path = Path(), source: str = "scene") -> RenderScene:
    """A scene from TOML text; file names in it are relative to ``folder``.

    Raises
    ------
    SceneError
        naming the key that is wrong
    """
    try:
        model = SceneModel.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"{source}: not TOML: {error}") from None
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise SceneError(f"{source}: {key}: {first['msg']}") from None
    try:
        names = [body.name for body in model.bodies]
        if len(set(names)) != len(names):
            raise SceneError("bodies: two bodies have the same name")
        bodies = tuple(_body(body, model.media, folder) for body in model.bodies)
        camera = model.camera.model_dump()
        camera["analyser_deg"] = camera.pop("analyser")
        spectrum = model.spectrum
        wavelengths = (
            np.array(spectrum.wavelengths)
            if spectrum.wavelengths is not None
            else visible_wavelengths(spectrum.count)
        )
        return RenderScene(
            name=model.name,
            bodies=bodies,
            room=_room(model.room, folder),
            camera=Camera(**camera),
            wavelengths_nm=wavelengths,
            max_events=model.render.depth,
            pruning_error=model.render.pruning_error,
            contacts=model.contacts,
        )
    except SceneError as error:
        raise SceneError(f"{source}: {error}") from None


def load_render_scene(path: str | Path) -> RenderScene:
    """A scene from a TOML file."""
    file = Path(path)
    try:
        text = file.read_text(encoding="utf-8")
    except OSError as error:
        raise SceneError(f"scene {str(file)!r} cannot be read: {error.strerror}") from None
    return load_render_text(text, folder=file.parent, source=str(file))

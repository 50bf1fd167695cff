"""Read what a picture is rendered of: a scene as `raymap record` takes it, a room, a camera.

Media, bodies, contacts and world are those of the scene; its sources and detectors have no part.
Lengths in mm, angles in degrees, wavelengths in nm, colours in sRGB as on a screen (0 .. 1).
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from raymap.model.errors import MissingExtra, SceneError
from raymap.model.givenfile import check_given
from raymap.model.giventext import toml_tables
from raymap.optics.colorimetry import decode_srgb
from tracer.description.named_files import named_file
from tracer.render.camera import Camera
from tracer.render.language import Model, Number, Vector, checked, read_text
from tracer.render.renderer import RenderScene
from tracer.render.room import WALLS, Room, checker_board, uniform
from tracer.render.scenes import bodies_of, world_of
from tracer.render.spectra import visible_wavelengths
from tracer.scene.load import parse_scene
from tracer.scene.model import Scene
from tracer.scene.supported import refuse_weighting
from tracer.sources.pictures import open_image

__all__ = ["load_render_scene", "load_render_text"]

_TABLES = ("room", "camera", "render")


class BoardModel(Model):
    """Coloured squares in a border."""

    squares: Annotated[int, Field(ge=1)] = 8
    square: Annotated[float, Field(gt=0)] = 6.0
    border_squares: Annotated[int, Field(ge=0)] = 3
    border: Vector = (0.55, 0.55, 0.55)
    colours: tuple[Vector, ...]


class WallModel(Model):
    """One colour, a board, or a picture file."""

    color: Vector | None = None
    board: BoardModel | None = None
    picture: str | None = None


class RoomModel(Model):
    """The emitting box."""

    low: Vector
    high: Vector
    all: Vector | None = None
    walls: dict[str, WallModel] = {}


class CameraModel(Model):
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


class RenderModel(Model):
    """Depth of the tree, what may be left out, and how many wavelengths where none are given."""

    depth: Annotated[int, Field(ge=1)] = 15
    pruning_error: Annotated[float, Field(ge=0)] = 0.5
    wavelengths: Annotated[int, Field(ge=1)] = 21


class PictureModel(Model):
    """The tables beside those of the scene."""

    room: RoomModel
    camera: CameraModel
    render: RenderModel = RenderModel()


def _picture(path: Path) -> NDArray[np.float64]:
    check_given(path, "picture", SceneError)
    try:
        with open_image(path) as image:
            pixels = np.asarray(image.convert("RGB"), np.float64) / 255.0
    except SceneError:
        raise
    except ImportError as error:
        raise MissingExtra(
            f"wall picture {str(path)!r} needs pillow: pip install 'raymap[view]'"
        ) from error
    except Exception as error:  # readers of foreign files may raise anything
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
            walls[name] = _picture(named_file(folder, wall.picture))
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
    scene = parse_scene(text, origin=source, folder=folder)
    given_tables = toml_tables(text, source, SceneError)
    tables = {key: value for key, value in given_tables.items() if key in _TABLES}
    if "room" not in tables or "camera" not in tables:
        raise SceneError(
            f"{source}: a picture needs [room] and [camera] beside the bodies; "
            "raymap record traces a scene without them"
        )
    refuse_weighting(scene, "raymap render")
    model = checked(PictureModel, tables, source)
    bodies = bodies_of(scene)
    given = scene.spectrum.kind == "spectral"
    _refuse_idle(scene, model, source)
    count = model.render.wavelengths
    wavelengths = scene.spectrum.channels() if given else visible_wavelengths(count)
    try:
        camera = model.camera.model_dump()
        camera["analyser_deg"] = camera.pop("analyser")
        return RenderScene(
            name=scene.title or source,
            bodies=bodies,
            room=_room(model.room, folder),
            camera=Camera(**camera),
            wavelengths_nm=wavelengths,
            max_events=model.render.depth,
            pruning_error=model.render.pruning_error,
            world=world_of(scene),
            contacts=scene.contacts,
        )
    except SceneError as error:
        raise SceneError(_placed(error, source)) from None


def _refuse_idle(scene: Scene, model: PictureModel, source: str) -> None:
    """Refuse keys that a picture would not heed."""
    trace = sorted(scene.trace.model_fields_set - {"mode"})
    for idle, key, why in (
        (trace, f"trace.{''.join(trace[:1])}", "crystals are rendered in polarised light; drop it"),
        (
            "depth" in scene.limits.model_fields_set,
            "limits.depth",
            "pictures have a depth of their own: render.depth",
        ),
        (
            scene.spectrum.kind == "spectral" and "wavelengths" in model.render.model_fields_set,
            "render.wavelengths",
            "the spectrum names its wavelengths; drop either",
        ),
        (
            model.camera.focus_distance is not None and not model.camera.aperture_radius,
            "camera.focus_distance",
            "a pinhole is sharp everywhere; give an aperture_radius, or drop it",
        ),
    ):
        if idle:
            raise SceneError(f"{source}: {key}: has no effect: {why}")


def _placed(error: SceneError, source: str) -> str:
    """The message, naming its file once."""
    return str(error) if str(error).startswith(f"{source}:") else f"{source}: {error}"


def load_render_scene(path: str | Path) -> RenderScene:
    """A scene from a TOML file."""
    file = Path(path)
    return load_render_text(read_text(file), folder=file.parent, source=str(file))

"""A scene of crystals to record, from TOML; errors name the key."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from raymap.errors import SceneError
from tracer.crystals.load import (
    BodyModel,
    MediumModel,
    Model,
    Number,
    Vector,
    bodies_of,
    parse_toml,
    read_text,
)
from tracer.crystals.media import isotropic
from tracer.crystals.recorder import CrystalScene, Pencil, PlaneDetector

__all__ = ["load_crystal_scene", "load_crystal_text"]


class SourceModel(Model):
    """Fields of `Pencil`, angles in degrees."""

    name: str
    centre: Vector
    direction: Vector
    radius: Number = 0.0
    cone: Number = 0.0
    polarisation: Vector | None = None
    flux: Number = 1.0


class DetectorModel(Model):
    """Fields of `PlaneDetector`."""

    name: str
    centre: Vector
    axis_u: Vector = (1.0, 0.0, 0.0)
    axis_v: Vector = (0.0, 1.0, 0.0)
    size: tuple[Number, Number] = (10.0, 10.0)
    cells: tuple[int, int] = (64, 64)
    blocking: bool = True


class SceneModel(Model):
    """The whole file."""

    name: str = "crystals"
    media: dict[str, MediumModel] = {}
    bodies: tuple[BodyModel, ...] = ()
    contacts: tuple[tuple[str, str], ...] = ()
    sources: tuple[SourceModel, ...]
    detectors: tuple[DetectorModel, ...] = ()
    wavelengths: tuple[Number, ...] = (589.3,)
    world_index: Number = Field(default=1.0, gt=0.0)
    depth: int = 30


def load_crystal_text(text: str, *, folder: Path = Path(), source: str = "scene") -> CrystalScene:
    """A scene from TOML text; file names in it are relative to ``folder``."""
    model = parse_toml(SceneModel, text, source)
    try:
        pencils = []
        for item in model.sources:
            values = item.model_dump()
            values["cone_deg"] = values.pop("cone")
            pencils.append(Pencil(**values))
        return CrystalScene(
            name=model.name,
            bodies=bodies_of(model.bodies, model.media, folder),
            sources=tuple(pencils),
            detectors=tuple(PlaneDetector(**item.model_dump()) for item in model.detectors),
            wavelengths_nm=model.wavelengths,
            world=isotropic(model.world_index, name="world"),
            contacts=model.contacts,
            depth=model.depth,
            text=text,
        )
    except SceneError as error:
        raise SceneError(f"{source}: {error}") from None


def load_crystal_scene(path: str | Path) -> CrystalScene:
    """A scene from a TOML file."""
    file = Path(path)
    return load_crystal_text(read_text(file), folder=file.parent, source=str(file))

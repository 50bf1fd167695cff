"""The verification suite for light in crystals: numbers first, then scenes.

Numeric checks run against any local model given as a Python function; the scenes use Raymap's own
tracing. Each check prints pass or fail with the deviation measured, scenes write their picture.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar, cast

from pydantic import BaseModel

from raymap.model.errors import SceneError
from tracer.render.language import parse_toml
from tracer.render.load import load_render_text
from tracer.render.renderer import RenderScene
from tracer.studies.crystals.calcite_box import (
    Progress,
    box_checks,
    double_image_checks,
    furnace_checks,
)
from tracer.studies.crystals.conical_refraction import ConicalScene, conical_checks
from tracer.studies.crystals.conoscopy_figures import ConoscopyScene, biaxial_checks, calcite_checks
from tracer.studies.crystals.crystal_checks import local_checks
from tracer.studies.crystals.crystal_statements import Check
from tracer.studies.crystals.local_model import LocalModel, raymap_model

__all__ = ["SCENES", "find_model", "scene_text", "verify_crystals"]

SCENES = (
    "conical_refraction",
    "conoscopy_calcite",
    "conoscopy_biaxial",
    "double_image",
    "white_furnace",
    "calcite_box",
)
"""Names of the scenes, in the order in which they run."""

Description = TypeVar("Description", bound=BaseModel)


def find_model(name: str) -> LocalModel:
    """A local model by ``module:function``, looked up from the current folder too.

    Raises
    ------
    SceneError
        if there is no such function
    """
    module_name, _, function_name = name.partition(":")
    if not function_name:
        raise SceneError(f"model {name!r}: write module:function, such as my_model:refract")
    sys.path.insert(0, str(Path.cwd()))
    try:
        model = getattr(importlib.import_module(module_name), function_name)
    except (ImportError, AttributeError) as error:
        raise SceneError(f"model {name!r} cannot be imported: {error}") from None
    finally:
        sys.path.pop(0)
    if not callable(model):
        raise SceneError(f"model {name!r} is not a function")
    return cast(LocalModel, model)


def scene_text(name: str, folder: Path | None = None) -> str:
    """The configuration of a scene: from ``folder`` if it has one, else the one supplied."""
    file = f"{name}.toml"
    if folder is not None and (folder / file).is_file():
        return (folder / file).read_text(encoding="utf-8")
    return (
        resources.files("tracer.studies.crystals.crystal_scenes")
        .joinpath(file)
        .read_text(encoding="utf-8")
    )


def _description(kind: type[Description], name: str, folder: Path | None) -> Description:
    return parse_toml(kind, scene_text(name, folder), f"{name}.toml")


def _render_scene(name: str, folder: Path | None) -> RenderScene:
    return load_render_text(
        scene_text(name, folder), folder=folder or Path(), source=f"{name}.toml"
    )


def _scene_checks(
    name: str,
    pictures: Path | None,
    folder: Path | None,
    width: int,
    threads: int | None,
    progress: Progress | None,
) -> Iterator[Check]:
    if name == "conical_refraction":
        yield from conical_checks(_description(ConicalScene, name, folder), pictures)
    elif name == "conoscopy_calcite":
        yield from calcite_checks(_description(ConoscopyScene, name, folder), pictures)
    elif name == "conoscopy_biaxial":
        yield from biaxial_checks(_description(ConoscopyScene, name, folder), pictures)
    elif name == "double_image":
        yield from double_image_checks()
    elif name == "white_furnace":
        yield from furnace_checks(_render_scene(name, folder), pictures, threads=threads)
    else:
        yield from box_checks(
            _render_scene(name, folder), pictures, width=width, threads=threads, progress=progress
        )


def verify_crystals(
    model: LocalModel | None = None,
    *,
    numeric: bool = True,
    scenes: tuple[str, ...] = SCENES,
    pictures: Path | None = None,
    scene_folder: Path | None = None,
    width: int = 120,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Iterator[Check]:
    """Run the suite, check by check.

    Parameters
    ----------
    model : the local model for the numeric checks; None = Raymap's own
    numeric : run the numeric checks
    scenes : names from `SCENES`
    pictures : folder for pictures; None = none are written
    scene_folder : configuration files that replace the ones supplied
    width : of the picture of the calcite box; its configuration asks for 480
    progress : of the calcite box, tiles done and in all
    """
    for name in scenes:
        if name not in SCENES:
            raise SceneError(f"scene {name!r} does not exist; scenes: {', '.join(SCENES)}")
    if width < 8:
        raise SceneError(f"width is {width}; the picture needs 8 pixels or more")
    if pictures is not None:
        pictures.mkdir(parents=True, exist_ok=True)
    if numeric:
        yield from local_checks(model if model is not None else raymap_model)
    for name in scenes:
        yield from _scene_checks(name, pictures, scene_folder, width, threads, progress)


def as_json(check: Check) -> dict[str, Any]:
    """A check as JSON."""
    return {
        "name": check.name,
        "passed": check.passed,
        "deviation": check.deviation,
        "limit": check.limit,
        "statement": check.statement,
        "picture": check.picture or None,
    }

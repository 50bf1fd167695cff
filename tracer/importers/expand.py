"""Scenes that name files of other programs, and such files opened as scenes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from raymap.model.errors import SceneError
from tracer.description.fields import Placed
from tracer.description.named_files import named_file
from tracer.importers.lens_format import LENS_FORMATS
from tracer.importers.lens_scene import import_lens
from tracer.importers.toml_text import toml_text
from tracer.scene.files import FileTable

__all__ = ["LENS_FILES", "LensFileModel", "merge_lens_file", "scene_text_of"]


class LensFileModel(Placed):
    """``[lens_files.NAME]``: the bodies of a lens file, under names that start with ``NAME.``.

    ``glasses`` says what names of the file mean (a glass, or a medium of the scene); with
    ``sources`` and ``image`` the light of its fields and a detector at its image come along.
    """

    file: str
    glasses: dict[str, str] = {}
    sources: bool = False
    image: bool = False


def scene_text_of(path: Path) -> str:
    """A lens file as the text of a scene.

    Raises
    ------
    SceneError
        what is wrong with the file, and what to do
    """
    return toml_text(import_lens(path).scene_tables())


def merge_lens_file(
    tree: dict[str, Any], name: str, model: LensFileModel, folder: Path, origin: str
) -> None:
    """Add what a lens file brings to the tables of a scene.

    Raises
    ------
    SceneError
        where the file cannot be taken, or a name stands twice
    """
    lens = import_lens(
        named_file(folder, model.file),
        glasses=model.glasses,
        media=tree.get("media", {}),
        length_unit=tree.get("length_unit", "mm"),
        prefix=f"{name}.",
        placed=model,
    )
    tree["media"] = lens.media() | tree.get("media", {})
    tree["surfaces"] = lens.surfaces() | tree.get("surfaces", {})
    image = lens.image_parts() if model.image else {"bodies": {}, "detectors": {}}
    parts = {"bodies": lens.bodies() | image["bodies"], "detectors": image["detectors"]}
    if model.sources:
        parts["sources"] = lens.sources()
    for table, entries in parts.items():
        present = tree.setdefault(table, {})
        for key, entry in entries.items():
            if key in present:
                raise SceneError(
                    f"{origin}: {table}.{key}: stands in the scene and comes from {model.file} "
                    "too; rename one of them"
                )
            present[key] = entry


LENS_FILES = FileTable(
    name="lens_files",
    title="lenses of other programs",
    model=LensFileModel,
    merge=merge_lens_file,
    scene_suffixes=tuple(LENS_FORMATS),
    scene_text=scene_text_of,
)

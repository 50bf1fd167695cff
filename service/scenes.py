"""Scenes of requests: a file of the served folder, or text; read with what they name confined."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from raymap.errors import SceneError
from service.confine import ServedFolder
from service.requests import BadRequest, Request

if TYPE_CHECKING:
    from tracer.scene.compile import Compilation

__all__ = ["SceneRequest", "describe_scene"]


class SceneRequest:
    """Which scene a request means; ``compile`` makes it ready to trace."""

    def __init__(self, request: Request, folder: ServedFolder) -> None:
        self.folder, self.limits = folder, request.limits
        self.name = request.text("scene", None)
        self.text = request.text("text", None)
        self.options: dict[str, Any] = {
            "variants": request.texts("variants"),
            "simulation": request.text("simulation", None),
        }
        if (self.name is None) == (self.text is None):
            raise BadRequest(
                f"{request.what}: give either 'scene' (a file of the served folder) or 'text'"
            )

    def compile(self) -> Compilation:
        """Read, check and compile.

        Raises
        ------
        OutsideFolder, SceneError
        """
        from tracer.importers.expand import SCENE_SUFFIXES
        from tracer.scene.compile import compile_scene
        from tracer.scene.load import OTHER_FILES, load_scene, parse_scene

        if self.name is None:
            self.folder.check_scene(self.text, self.folder.root, "scene")
            scene = parse_scene(self.text, folder=self.folder.root, **self.options)
            return compile_scene(scene)
        path = self.folder.path(self.name)
        self._check_size(path)
        if path.suffix.lower() in (*SCENE_SUFFIXES, *OTHER_FILES):
            return compile_scene(load_scene(path, **self.options))
        # Whatever else it is called, it is read as TOML, and what it names is looked at before
        text = self._read(path)
        self.folder.check_scene(text, path.parent, self.name)
        scene = parse_scene(text, origin=path.name, folder=path.parent, **self.options)
        return compile_scene(scene)

    def _check_size(self, path: Path) -> None:
        try:
            size = path.stat().st_size
        except OSError:
            raise SceneError(f"there is no scene file {self.name!r}") from None
        if size > self.limits.scene_bytes:
            raise SceneError(
                f"{self.name} has more than the {self.limits.scene_bytes} bytes that a scene may "
                "have here"
            )

    def _read(self, path: Path) -> str:
        try:
            return path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise SceneError(f"{self.name} cannot be read as a scene: {error}") from None


def describe_scene(compilation: Compilation) -> dict[str, Any]:
    """Names and units of a scene that was not traced yet."""
    directory = compilation.directory
    return {
        "title": directory.title,
        **names_of(directory),
        "channels": [compilation.channel_set.labels],
        "scene_hash": directory.scene_hash,
    }


def names_of(directory: Any) -> dict[str, Any]:
    """Sources, objects, faces, media and detectors, as scenes and maps list them."""
    return {
        "sources": [item.name for item in directory.sources],
        "objects": [item.name for item in directory.objects],
        "faces": list(directory.faces.names),
        "media": [item.name for item in directory.media],
        "detectors": [item.name for item in directory.detectors],
        "detector_grids": {
            item.name: {
                "kind": item.kind,
                "cells": list(item.cells),
                "size": list(item.size),
                "center": list(item.center),
                "axis_u": list(item.axis_u),
                "axis_v": list(item.axis_v),
                "blocking": item.blocking,
            }
            for item in directory.detectors
        },
        "source_fluxes": {item.name: item.flux for item in directory.sources},
        "units": {"length": directory.length_unit, "flux": directory.flux_unit},
    }

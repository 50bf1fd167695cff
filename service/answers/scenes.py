"""Scenes of requests: a file of the served folder, or text; worker processes read them."""

from __future__ import annotations

from typing import Any

from raymap.model.errors import SceneError
from service.answers.requests import BadRequest, Request
from service.files.confine import ServedFolder

__all__ = ["SceneRequest"]


class SceneRequest:
    """Which scene a request means."""

    def __init__(self, request: Request, folder: ServedFolder) -> None:
        self.folder, self.limits = folder, request.limits
        self.name = request.text("scene", None)
        self.text = request.text("text", None)
        self.selected: dict[str, Any] = {
            "variants": request.texts("variants"),
            "simulation": request.text("simulation", None),
        }
        if (self.name is None) == (self.text is None):
            raise BadRequest(
                f"{request.what}: give either 'scene' (a file of the served folder) or 'text'"
            )

    def job(self) -> dict[str, Any]:
        """What a worker process is told of it.

        Raises
        ------
        OutsideFolder, SceneError
        """
        if self.name is not None:
            self._check_size()
        return {
            "folder": str(self.folder.root),
            "scene": self.name,
            "text": self.text,
            "selected": self.selected,
            "scene_files_bytes": self.limits.scene_files_bytes,
        }

    def _check_size(self) -> None:
        try:
            size = self.folder.path(self.name).stat().st_size
        except OSError:
            raise SceneError(f"there is no scene file {self.name!r}") from None
        if size > self.limits.scene_bytes:
            raise SceneError(
                f"{self.name} has more than the {self.limits.scene_bytes} bytes that a scene may "
                "have here"
            )

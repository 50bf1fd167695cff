"""What is under a pixel: one picker for every renderer, from camera and pixel alone.

It computes in float64 from what the map stores, so that page, window and painted pictures give the
same ray and face for the same look at the scene.
"""

from __future__ import annotations

from dataclasses import dataclass

from raymap.model.directory import Directory
from viewer.drawn.state import Camera, ViewState
from viewer.paint.painter import Painter, Shown

__all__ = ["Picked", "Sight", "pick"]


@dataclass(frozen=True, kw_only=True)
class Sight:
    """A line of sight: a pixel of a picture, counted from its upper left corner."""

    camera: Camera
    x: float
    y: float
    width: int
    height: int


@dataclass(frozen=True, kw_only=True)
class Picked:
    """What a line of sight meets.

    Attributes
    ----------
    ray : (number of the ray, step of the nearer point), or None
    body, face_name : of the foremost face; None and "" where there is none
    words : the same for people, in lines
    """

    ray: tuple[int, int] | None
    body: str | None
    face_name: str
    words: str

    @property
    def face(self) -> str | None:
        """ "object.face" of the foremost face."""
        return f"{self.body}.{self.face_name}" if self.body and self.face_name else self.body


def pick(painter: Painter, state: ViewState, shown: Shown, sight: Sight) -> Picked:
    """What is drawn at a pixel."""
    at = (sight.camera, sight.x, sight.y, sight.width, sight.height)
    found = painter.pick_ray(shown, *at)
    body, face = painter.pick_body(state, *at) or (None, "")
    words = [_of_ray(painter.directory, shown, *found)] if found is not None else []
    if body is not None:
        words.append(f"{body}.{face}" if face else body)
    ray = None if found is None else (int(shown.rays.ray_ids[found[0]]), found[1])
    return Picked(ray=ray, body=body, face_name=face, words="\n".join(words))


def _of_ray(directory: Directory, shown: Shown, index: int, step: int) -> str:
    rays = shown.rays
    text = f"ray {int(rays.ray_ids[index])} from {directory.sources[int(rays.source[index])].name}"
    item = int(rays.object[int(rays.offsets[index]) + step])
    if 0 <= item < len(directory.objects):
        text += f", at {directory.objects[item].name}"
    return text

"""The scene as it stands now: its parts, what changed of them, and their bytes in chunks.

Whoever draws the scene says which revision of each part it holds and gets those that differ. So a
renderer that was away, or a second one, needs no history, and what comes too late is known by its
revision and dropped.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.directory import Directory
from viewer.drawn.bodies import Body
from viewer.drawn.rays import DrawnRays
from viewer.drawn.state import Camera, ViewState
from viewer.paint.painter import Colored
from viewer.shown import parts as made
from viewer.shown.parts import PARTS, Part

__all__ = ["CHUNK_BYTES", "LiveScene", "Snapshot", "pack"]

CHUNK_BYTES = 1 << 20
"""Of geometry in one message; parts that are smaller come with the list of what changed."""

_WORDS = {"float32": "f4", "int8": "i1", "uint8": "u1", "uint16": "u2"}


@dataclass(frozen=True, kw_only=True, eq=False)
class Snapshot:
    """All that the scene is made from at one moment.

    Attributes
    ----------
    colored : the drawn rays with their colours
    chosen : the ray of the report
    """

    state: ViewState
    colored: Colored
    camera: Camera
    chosen: DrawnRays | None = None


def pack(part: Part) -> tuple[list[dict[str, Any]], bytes]:
    """Where the arrays of a part lie in its bytes, and these bytes.

    Returns
    -------
    list of name, kind (f4, i1, u1, u2), shape and offset [bytes, a multiple of 4]; bytes
    """
    listed, pieces, offset = [], [], 0
    for name, array in part.arrays.items():
        kind = _WORDS[array.dtype.name]
        listed.append({"name": name, "kind": kind, "shape": list(array.shape), "offset": offset})
        data = array.astype(array.dtype.newbyteorder("<"), copy=False).tobytes()
        pieces.append(data + bytes(-len(data) % 4))
        offset += len(pieces[-1])
    return listed, b"".join(pieces)


class LiveScene:
    """The parts of one scene with their revisions; safe to use from several threads.

    Parameters
    ----------
    bodies : all bodies of the scene
    directory : of the map

    Attributes
    ----------
    center : what places of parts are relative to [scene units]
    revision : of the newest part
    """

    def __init__(self, bodies: Sequence[Body], directory: Directory) -> None:
        self.bodies = list(bodies)
        self.center: NDArray[np.float64] = made.scene_center(bodies, directory)
        self.unit = directory.length_unit
        self.revision = 0
        self._parts: dict[str, tuple[int, Part]] = {}
        self._keys: dict[str, tuple[object, ...]] = {}
        self._packed: tuple[str, int, bytes] | None = None
        self._lock = threading.RLock()

    def update(self, now: Snapshot) -> None:
        """Take over what the session shows; only what differs becomes a new revision."""
        state, center, bodies = now.state, self.center, self.bodies
        rays = now.colored.rays
        opacities = tuple(sorted(state.opacities.items()))
        with self._lock:
            self._take("bodies", (), lambda: made.body_triangles(bodies, center))
            self._take("edges", (), lambda: made.body_edges(bodies, center))
            self._take("outlines", (), lambda: made.smooth_edges(bodies, center))
            self._take("rays", (rays,), lambda: made.ray_points(rays, center))
            self._take("looks", (state.hidden, opacities, state.body_opacity),
                       lambda: made.body_looks(bodies, state))  # fmt: skip
            self._take("colors", (now.colored,), lambda: made.ray_colors(now.colored.rgba))
            self._take("section", (state.section,), lambda: made.cut_plane(state.section, center))
            self._take("cut", (state.section,),
                       lambda: made.cut_outline(bodies, state.section, center))  # fmt: skip
            self._take("chosen", (now.chosen, state.point),
                       lambda: made.chosen_ray(now.chosen, state.point, center))  # fmt: skip
            self._take("style", (state.dark, state.width, state.names),
                       lambda: made.style(state, center, self.unit))  # fmt: skip
            self._take("camera", (now.camera,), lambda: made.camera_part(now.camera))

    def _take(self, name: str, key: tuple[object, ...], make: Callable[[], Part]) -> None:
        if name not in self._keys or self._keys[name] != key:
            part = make()
            self.revision += 1
            self._keys[name], self._parts[name] = key, (self.revision, part)

    def told_camera(self, camera: Camera) -> None:
        """A renderer moved the camera by itself: it need not be told."""
        with self._lock:
            if "camera" in self._parts:
                self._keys["camera"] = (camera,)
                revision = self._parts["camera"][0]
                self._parts["camera"] = (revision, made.camera_part(camera))

    def part(self, name: str) -> Part:
        """One part as it stands."""
        with self._lock:
            return self._parts[name][1]

    def changed(self, have: Mapping[str, int]) -> dict[str, int]:
        """Parts of which another revision is held, and the revision that holds.

        Parameters
        ----------
        have : revision of each part that a renderer holds
        """
        with self._lock:
            return {
                name: self._parts[name][0]
                for name in PARTS
                if name in self._parts and have.get(name) != self._parts[name][0]
            }

    def message(self, have: Mapping[str, int]) -> dict[str, Any]:
        """What a page needs to catch up.

        Returns
        -------
        ``revision`` and ``parts``: each with name, revision, header, arrays (`pack`), bytes in all,
        and its data, or None where they are too many: those come by `chunk`
        """
        with self._lock:
            listed = []
            for name, revision in self.changed(have).items():
                part = self._parts[name][1]
                arrays, data = self._bytes(name)
                listed.append(
                    {
                        "name": name,
                        "revision": revision,
                        "header": dict(part.header),
                        "arrays": arrays,
                        "bytes": len(data),
                        "data": data if len(data) <= CHUNK_BYTES else None,
                    }
                )
            return {"revision": self.revision, "parts": listed}

    def chunk(self, name: str, revision: int, start: int) -> bytes | None:
        """Up to `CHUNK_BYTES` of a part from ``start`` on; None where another revision holds."""
        with self._lock:
            if name not in self._parts or self._parts[name][0] != revision or start < 0:
                return None
            if self._packed is None or self._packed[:2] != (name, revision):
                self._packed = (name, revision, self._bytes(name)[1])
            return self._packed[2][start : start + CHUNK_BYTES]

    def _bytes(self, name: str) -> tuple[list[dict[str, Any]], bytes]:
        return pack(self._parts[name][1])

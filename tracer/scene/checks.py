"""What can be said about a scene before a ray is traced: bodies that overlap."""

from __future__ import annotations

import itertools

import numpy as np

from raymap.errors import SceneError
from tracer.geometry.body import Body
from tracer.geometry.lens_body import LensBody

__all__ = ["check_lenses", "on_common_axis"]

_STEPS = 128


def on_common_axis(a: Body, b: Body) -> bool:
    """Whether two bodies are turned about one axis, in the same sense."""
    origin_a, frame_a = a.frame()
    origin_b, frame_b = b.frame()
    axis = frame_a[:, 2]
    apart = origin_b - origin_a
    across = apart - (apart @ axis) * axis
    return bool(np.linalg.norm(across) < 1e-9 and frame_b[:, 2] @ axis > 1.0 - 1e-12)


def check_lenses(bodies: dict[str, Body], origin: str) -> None:
    """Refuse lenses on one axis that overlap.

    Raises
    ------
    SceneError
        names both lenses, where they overlap and by how much
    """
    lenses = [(name, body) for name, body in bodies.items() if isinstance(body, LensBody)]
    for (name_a, a), (name_b, b) in itertools.combinations(lenses, 2):
        if a.priority != b.priority or not on_common_axis(a, b):
            continue
        origin_a, frame = a.frame()
        shift = float((b.frame()[0] - origin_a) @ frame[:, 2])
        (first, name_1), (second, name_2) = (a, name_a), (b, name_b)
        if shift < 0.0:
            (first, name_1), (second, name_2) = (b, name_b), (a, name_a)
            shift = -shift
        reach = min(first.outer_radius(), second.outer_radius())
        inside = max(first.hole_radius, second.hole_radius)
        if reach <= inside:
            continue
        for r in np.linspace(inside, reach, _STEPS + 1):
            gap = shift + second.height_of_front(float(r)) - first.height_of_back(float(r))
            if gap < -1e-9:
                raise SceneError(
                    f"{origin}: bodies.{name_2}: overlaps {name_1!r} by {-gap:.4g} at {r:.4g} "
                    f"from the axis; move it, or give one of them a higher priority"
                )

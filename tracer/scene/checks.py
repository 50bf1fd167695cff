"""What can be said about a scene before a ray is traced: bodies that overlap."""

from __future__ import annotations

import numpy as np

from raymap.model.errors import SceneError
from tracer.bodies.body import Body
from tracer.bodies.lens import LensBody
from tracer.scene.box_pairs import overlapping_boxes

__all__ = ["check_lenses", "on_common_axis"]

_STEPS = 128
_TILT = 2e-6
"""More than the sine of an angle whose cosine `on_common_axis` takes for 1."""


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
    for number_a, number_b in _side_by_side([body for _, body in lenses]):
        (name_a, a), (name_b, b) = lenses[number_a], lenses[number_b]
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


def _side_by_side(lenses: list[LensBody]) -> list[tuple[int, int]]:
    """Pairs of lenses that may share an axis, and a stretch along it, in order."""
    if not lenses:
        return []
    frames = [lens.frame() for lens in lenses]
    place = np.array([origin for origin, _ in frames])
    axis = np.array([frame[:, 2] for _, frame in frames])
    # Two lenses of one axis differ in direction by rounding, and the more in place the farther off
    along = (place * axis).sum(axis=1)
    span = np.array([lens.surely_between() for lens in lenses])
    mark = np.column_stack([axis, place - along[:, None] * axis])
    loose = 1e-8 + 1e-5 * np.abs(place).max()
    width = np.repeat([_TILT, loose], 3)
    low = np.column_stack([mark - width, along + span[:, 0] - loose])
    high = np.column_stack([mark + width, along + span[:, 1] + loose])
    pairs = [np.column_stack(pair) for pair in overlapping_boxes(low, high)]
    return sorted((a, b) for part in pairs for a, b in part.tolist())

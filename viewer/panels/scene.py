"""The 3D panel: the picture, its tools and legend, and the column of controls beside it."""

from __future__ import annotations

from raymap.model.directory import Directory
from viewer.drawn.state import Section, ViewState

__all__ = ["section_fields", "section_of"]

SIDES = ("+x", "-x", "+y", "-y", "+z", "-z")


def section_of(side: str, place: float, *, on: bool, rays: bool) -> Section:
    """The section that the controls describe."""
    if side not in SIDES:
        side = "-x"
    sign = 1.0 if side[0] == "+" else -1.0
    normal = [0.0, 0.0, 0.0]
    normal["xyz".index(side[1])] = sign
    vector = (normal[0], normal[1], normal[2])
    return Section(on=on, normal=vector, offset=sign * place, rays=rays)


def section_fields(state: ViewState, directory: Directory) -> dict[str, object]:
    """What the controls of the section show; a slanted plane shows its main axis."""
    section = state.section
    axis = max(range(3), key=lambda k: abs(section.normal[k]))
    sign = 1.0 if section.normal[axis] > 0 else -1.0
    sphere = directory.bounding_sphere
    return {
        "section_on": section.on,
        "section_side": ("+" if sign > 0 else "-") + "xyz"[axis],
        "section_place": round(sign * section.offset, 6),
        "section_rays": section.rays,
        "section_low": sphere.center[axis] - sphere.radius,
        "section_high": sphere.center[axis] + sphere.radius,
    }

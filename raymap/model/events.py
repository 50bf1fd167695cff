"""What can happen to a ray at a point: stable bits, their names, and families of them.

Bits are part of the file format: a bit is never renumbered and never reused. A point can carry
several (a ray that is refracted into another medium carries ``SPECULAR_REFRACTION`` and
``MEDIUM_CHANGED``). The last record of a ray carries exactly one *ending* event.
"""

from __future__ import annotations

from enum import IntFlag

__all__ = ["ENDINGS", "FAMILIES", "Event", "event_names"]


class Event(IntFlag):
    """Event bits of a segment record."""

    EMITTED = 1 << 0
    SPECULAR_REFLECTION = 1 << 1
    SPECULAR_REFRACTION = 1 << 2
    DIFFUSE_REFLECTION = 1 << 3
    DIFFUSE_TRANSMISSION = 1 << 4
    GLOSSY_REFLECTION = 1 << 5
    TIR = 1 << 6
    """Total internal reflection; does not also set ``SPECULAR_REFLECTION``."""
    SURFACE_ABSORPTION = 1 << 7
    VOLUME_SCATTER = 1 << 8
    VOLUME_ABSORPTION = 1 << 9
    LEFT_SCENE = 1 << 10
    DETECTOR_CROSSED = 1 << 11
    DETECTOR_REGISTERED = 1 << 12
    POLARISER = 1 << 13
    BIREFRINGENT_SPLIT = 1 << 14
    ORDINARY = 1 << 15
    EXTRAORDINARY = 1 << 16
    DEPTH_LIMIT = 1 << 17
    ROULETTE_KILL = 1 << 18
    DISPERSIVE_SELECT = 1 << 19
    """The wavelength of the ray was chosen here."""
    RIM_HIT = 1 << 20
    """Informative: the point lies on a lens rim or an aperture stop; never an ending."""
    CONICAL_REFRACTION = 1 << 21
    FLUORESCENCE = 1 << 22
    GEOMETRY_ERROR = 1 << 23
    MEDIUM_CHANGED = 1 << 24
    GLOSSY_TRANSMISSION = 1 << 25


ENDINGS = (
    Event.SURFACE_ABSORPTION
    | Event.VOLUME_ABSORPTION
    | Event.LEFT_SCENE
    | Event.DEPTH_LIMIT
    | Event.ROULETTE_KILL
    | Event.GEOMETRY_ERROR
)
"""Events that end a ray; the last record of a ray carries exactly one of them."""

_REFLECTED = (
    Event.SPECULAR_REFLECTION | Event.TIR | Event.DIFFUSE_REFLECTION | Event.GLOSSY_REFLECTION
)
_TRANSMITTED = Event.SPECULAR_REFRACTION | Event.DIFFUSE_TRANSMISSION | Event.GLOSSY_TRANSMISSION
_SCATTERED = (
    Event.DIFFUSE_REFLECTION
    | Event.DIFFUSE_TRANSMISSION
    | Event.GLOSSY_REFLECTION
    | Event.GLOSSY_TRANSMISSION
    | Event.VOLUME_SCATTER
)

FAMILIES: dict[str, Event] = {
    "reflected": _REFLECTED,
    "refracted": Event.SPECULAR_REFRACTION,
    "transmitted": _TRANSMITTED,
    "scattered": _SCATTERED,
    "absorbed": Event.SURFACE_ABSORPTION | Event.VOLUME_ABSORPTION,
    "emitted": Event.EMITTED,
    "specular_reflection": Event.SPECULAR_REFLECTION,
    "tir": Event.TIR,
    "diffuse_reflection": Event.DIFFUSE_REFLECTION,
    "diffuse_transmission": Event.DIFFUSE_TRANSMISSION,
    "glossy_reflection": Event.GLOSSY_REFLECTION,
    "glossy_transmission": Event.GLOSSY_TRANSMISSION,
    "surface_absorption": Event.SURFACE_ABSORPTION,
    "volume_scatter": Event.VOLUME_SCATTER,
    "volume_absorption": Event.VOLUME_ABSORPTION,
    "left": Event.LEFT_SCENE,
    "detector_crossed": Event.DETECTOR_CROSSED,
    "detector_registered": Event.DETECTOR_REGISTERED,
    "polariser": Event.POLARISER,
    "birefringent_split": Event.BIREFRINGENT_SPLIT,
    "ordinary": Event.ORDINARY,
    "extraordinary": Event.EXTRAORDINARY,
    "depth_limit": Event.DEPTH_LIMIT,
    "roulette_kill": Event.ROULETTE_KILL,
    "dispersive_select": Event.DISPERSIVE_SELECT,
    "rim": Event.RIM_HIT,
    "conical_refraction": Event.CONICAL_REFRACTION,
    "fluorescence": Event.FLUORESCENCE,
    "geometry_error": Event.GEOMETRY_ERROR,
    "medium_changed": Event.MEDIUM_CHANGED,
}
"""Words of the criteria language, reports and exports: every single event and the families."""

_SINGLE_NAMES = {int(event): name for name, event in FAMILIES.items() if event.bit_count() == 1}


def event_names(bits: int) -> list[str]:
    """Names of the events set in ``bits``, lowest bit first; unknown bits as ``bit_NN``."""
    set_bits = [position for position in range(32) if bits >> position & 1]
    return [_SINGLE_NAMES.get(1 << position, f"bit_{position}") for position in set_bits]

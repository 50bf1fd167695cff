"""What light does at a surface: the words in which kinds of surfaces are asked, and their doors.

Dielectrics, mirrors, absorbers and Lambertian surfaces are compiled into the loop over rays. Every
other kind is compiled alone, and called by its address in ``surface_i`` with bundles of what it may
need to know.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from raymap.jit.compiling import Door
from raymap.jit.types import F64, I64
from raymap.model.events import Event

__all__ = [
    "ABSORBED",
    "GLOSSY_REFLECTION",
    "GLOSSY_TRANSMISSION",
    "MEET",
    "TOWARDS",
    "Hit",
    "Light",
    "Optics",
    "Outcome",
]

ABSORBED = int(Event.SURFACE_ABSORPTION)
GLOSSY_REFLECTION = int(Event.GLOSSY_REFLECTION)
GLOSSY_TRANSMISSION = int(Event.GLOSSY_TRANSMISSION)


class Optics(NamedTuple):
    """What a scene says of surfaces and media, as in `tracer.compiled.CompiledScene`."""

    surface_i: I64
    surface_f: F64
    medium_f: F64
    tables: F64


class Hit(NamedTuple):
    """Where light arrives: its surface, its medium, the one beyond, and the unit vector w back
    along the light in a frame whose z axis is the normal on the light's side."""

    surface: int
    medium: int
    other: int
    wx: float
    wy: float
    wz: float


class Light(NamedTuple):
    """A ray that arrives: its colour code, the mixed colours with their counters
    (`tracer.rays.colors`), the state of its stream of random numbers."""

    code: int
    colors: F64
    counters: I64
    state: np.uint64


Outcome = tuple[int, float, float, float, int, np.uint64]
"""Event, the unit vector along which light goes on in the frame of the hit (z below 0: to the other
side; all 0: straight on), colour code, state."""

_ROWS = np.zeros((1, 1), np.int64), np.zeros((1, 1)), np.zeros((1, 1)), np.zeros(1)
_OPTICS = Optics(*_ROWS)
_HIT = Hit(0, 0, 0, 0.0, 0.0, 1.0)
_LIGHT = Light(0, np.zeros((1, 1)), np.zeros(1, np.int64), np.uint64(0))

MEET = Door((0, 0.0, 0.0, 0.0, 0, np.uint64(0)), (_OPTICS, _HIT, _LIGHT))
"""``meet(optics, hit, light) -> Outcome``: what happens to light that arrives."""

TOWARDS = Door(True, (_OPTICS, _HIT, 0.0, 0.0, 0.0, np.zeros(1)))
"""``towards(optics, hit, x, y, z, out) -> bool``: light of unit flux that goes to the unit vector
(x, y, z) in the frame of the hit, per solid angle: ``out[k]`` is the BSDF times |z| in channel k.
False where there is none."""

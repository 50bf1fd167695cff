"""What light does at a surface: the words in which kinds of surfaces are asked, and their doors.

Dielectrics, mirrors, absorbers and Lambertian surfaces are compiled into the loop over rays. Every
other kind is compiled alone, and called by its address in ``surface_i`` with bundles of what it may
need to know. Bundles cost nothing: compiled code takes them apart where it hands them over.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from raymap.jit.compiling import Door
from raymap.jit.kernels import inline_kernel
from raymap.jit.types import F64, I64
from raymap.model.events import Event
from tracer.compiled import CompiledScene

__all__ = [
    "ABSORBED",
    "DIFFUSE_REFLECTION",
    "DIFFUSE_TRANSMISSION",
    "DRAW",
    "GLOSSY_REFLECTION",
    "GLOSSY_TRANSMISSION",
    "MEET",
    "SELECT",
    "SPECULAR_REFLECTION",
    "SPECULAR_REFRACTION",
    "TIR",
    "TOWARDS",
    "WEIGH",
    "Hit",
    "Interface",
    "Light",
    "Interaction",
    "Optics",
    "Outcome",
    "Way",
    "optics_of",
    "reflected_way",
]

ABSORBED = int(Event.SURFACE_ABSORPTION)
DIFFUSE_REFLECTION = int(Event.DIFFUSE_REFLECTION)
DIFFUSE_TRANSMISSION = int(Event.DIFFUSE_TRANSMISSION)
GLOSSY_REFLECTION = int(Event.GLOSSY_REFLECTION)
GLOSSY_TRANSMISSION = int(Event.GLOSSY_TRANSMISSION)
SPECULAR_REFLECTION = int(Event.SPECULAR_REFLECTION)
SPECULAR_REFRACTION = int(Event.SPECULAR_REFRACTION)
TIR = int(Event.TIR)
SELECT = int(Event.DISPERSIVE_SELECT)


class Optics(NamedTuple):
    """What a scene says of surfaces and media, as in `tracer.compiled.CompiledScene`.

    ``tables`` are None in scenes that need none: these have no kinds that use them.
    """

    surface_i: I64
    surface_f: F64
    medium_i: I64
    medium_f: F64
    tables: F64


@inline_kernel
def optics_of(scene: CompiledScene) -> Optics:
    """The optics of a scene."""
    return Optics(
        scene.surface_i, scene.surface_f, scene.medium_i, scene.medium_f,
        scene.tables,  # type: ignore[arg-type]
    )  # fmt: skip


class Interface(NamedTuple):
    """A surface between two media: its number, the medium of the light, the one beyond, and the
    cosine of the angle at which the light arrives."""

    surface: int
    medium: int
    other: int
    cos_i: float


class Way(NamedTuple):
    """A unit direction d of light at a surface, and a unit normal n there: against light that
    arrives, on the side of light that leaves."""

    dx: float
    dy: float
    dz: float
    nx: float
    ny: float
    nz: float


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


Interaction = tuple[int, bool, float, float, float, int, np.uint64]
"""Event, whether light goes to the other side, its direction, colour code, state."""


@inline_kernel
def reflected_way(at: Interface, way: Way) -> Way:
    """Where light goes that is reflected."""
    along = 2.0 * at.cos_i
    return Way(
        way.dx + along * way.nx, way.dy + along * way.ny, way.dz + along * way.nz,
        way.nx, way.ny, way.nz,
    )  # fmt: skip


Outcome = tuple[int, float, float, float, int, np.uint64]
"""Event, the unit vector along which light goes on in the frame of the hit (z below 0: to the other
side; all 0: straight on), colour code, state."""

_I, _F = np.zeros((1, 1), np.int64), np.zeros((1, 1))
_OPTICS = Optics(_I, _F, _I, _F, np.zeros(1))
_HIT = Hit(0, 0, 0, 0.0, 0.0, 1.0)
_LIGHT = Light(0, np.zeros((1, 1)), np.zeros(1, np.int64), np.uint64(0))

MEET = Door((0, 0.0, 0.0, 0.0, 0, np.uint64(0)), (_OPTICS, _HIT, _LIGHT))
"""``meet(optics, hit, light) -> Outcome``: what happens to light that arrives."""

DRAW = Door((0, 0.0, 0.0, 0.0, 0, np.uint64(0)), (_OPTICS, _HIT, _LIGHT))
"""``draw(optics, hit, light) -> Outcome``: a direction of light that is scattered. Nothing is lost
here; absorbed is only light of which nothing is ever scattered."""

WEIGH = Door(0.0, (_OPTICS, _HIT, _LIGHT, 0.0, 0.0, 0.0, 0))
"""``weigh(optics, hit, light, x, y, z, row) -> density`` [1/sr] with which ``draw`` gives light of
this colour the direction (x, y, z). ``light.colors[row, k]`` takes what goes on of channel k: the
BSDF times |z| over the density."""

TOWARDS = Door(True, (_OPTICS, _HIT, 0.0, 0.0, 0.0, np.zeros(1)))
"""``towards(optics, hit, x, y, z, out) -> bool``: light of unit flux that goes to the unit vector
(x, y, z) in the frame of the hit, per solid angle: ``out[k]`` is the BSDF times |z| in channel k.
False where there is none."""

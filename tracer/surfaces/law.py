"""Surfaces that are described by a law of three functions: draw, evaluate, density.

Everything that light does at such a surface is made of them here, once: analog light, light that is
aimed, what a pinhole sees. The functions are compiled alone and called by address, so a new law
compiles nothing else.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from raymap.jit.compiling import Door
from raymap.jit.kernels import inner_kernel, number, stage_kernel
from raymap.jit.types import F64
from raymap.model.errors import SceneError
from tracer.compiled import S_EVALUATE, S_MODEL, S_OWN, S_OWN_SIZE, S_PDF, S_SAMPLE
from tracer.rays.colors import COLORS, mean_of, recolor, recolor_lost
from tracer.rays.random import five_uniform
from tracer.surfaces.interaction import (
    ABSORBED,
    DIFFUSE_REFLECTION,
    DIFFUSE_TRANSMISSION,
    GLOSSY_REFLECTION,
    GLOSSY_TRANSMISSION,
    Hit,
    Light,
    Optics,
    Outcome,
)

__all__ = [
    "EVALUATE",
    "PDF",
    "SAMPLE",
    "Law",
    "check_law",
    "draw_by_law",
    "meet_by_law",
    "towards_by_law",
    "weigh_by_law",
]

_OWN = np.zeros(1)
_WAY = (0.0, 0.0, 1.0)

SAMPLE = Door(_WAY, (_OWN, *_WAY, 1.0, 1.0, 0.0, 0.0, 0.0))
"""``sample(own, wx, wy, wz, n1, n2, u1, u2, u3) -> x, y, z``: draw a direction."""

EVALUATE = Door(0.0, (_OWN, *_WAY, *_WAY, 1.0, 1.0, 0))
"""``evaluate(own, wx, wy, wz, x, y, z, n1, n2, channel) -> BSDF`` [1/sr]."""

PDF = Door(0.0, (_OWN, *_WAY, *_WAY, 1.0, 1.0))
"""``pdf(own, wx, wy, wz, x, y, z, n1, n2) -> density`` of `SAMPLE` [1/sr]."""

_sample, _evaluate, _pdf = SAMPLE.call, EVALUATE.call, PDF.call


@dataclass(frozen=True, kw_only=True)
class Law:
    """A BSDF and how it is sampled.

    All directions are unit vectors away from the surface in a frame whose z axis is the normal on
    the side of the light that arrives, w back along that light. ``n1`` and ``n2`` are the indices
    on its side and beyond, of the light's first channel; ``own`` are the numbers that the kind set
    with `SurfaceRow.set_own`.

    sample : see `SAMPLE`; always draws a direction, with three uniform numbers. z below 0 goes to
        the other side
    evaluate : see `EVALUATE`; the BSDF itself in a channel
    pdf : see `PDF`; the density per solid angle with which ``sample`` draws a direction
    diffuse : whether what it does is called diffuse, not glossy

    BSDF |z| / density must be at most 1 in every channel: the light that it leaves is absorbed.
    """

    sample: Any
    evaluate: Any
    pdf: Any
    diffuse: bool = False


@inner_kernel
def _direction(
    optics: Optics, hit: Hit, u1: float, u2: float, u3: float
) -> tuple[float, float, float]:
    """A direction from the law."""
    first = optics.surface_i[hit.surface, S_OWN]
    own = optics.tables[first : first + optics.surface_i[hit.surface, S_OWN_SIZE]]
    x, y, z = _sample(
        optics.surface_i[hit.surface, S_SAMPLE],
        (
            own, hit.wx, hit.wy, hit.wz, optics.medium_f[hit.medium, 0],
            optics.medium_f[hit.other, 0], u1, u2, u3,
        ),
    )  # fmt: skip
    return x, y, z


@inner_kernel
def _density(optics: Optics, hit: Hit, x: float, y: float, z: float) -> float:
    """Density with which the law draws a direction."""
    first = optics.surface_i[hit.surface, S_OWN]
    own = optics.tables[first : first + optics.surface_i[hit.surface, S_OWN_SIZE]]
    density: float = _pdf(
        optics.surface_i[hit.surface, S_PDF],
        (
            own, hit.wx, hit.wy, hit.wz, x, y, z,
            optics.medium_f[hit.medium, 0], optics.medium_f[hit.other, 0],
        ),
    )  # fmt: skip
    return density


@inner_kernel
def _bsdf(optics: Optics, hit: Hit, x: float, y: float, z: float, channel: int) -> float:
    first = optics.surface_i[hit.surface, S_OWN]
    own = optics.tables[first : first + optics.surface_i[hit.surface, S_OWN_SIZE]]
    value: float = _evaluate(
        optics.surface_i[hit.surface, S_EVALUATE],
        (
            own, hit.wx, hit.wy, hit.wz, x, y, z,
            optics.medium_f[hit.medium, channel], optics.medium_f[hit.other, channel], channel,
        ),
    )  # fmt: skip
    return value


@inner_kernel
def _weigh(optics: Optics, hit: Hit, x: float, y: float, z: float, colors: F64, row: int) -> float:
    """The density of a direction, and the share of the light of each channel that goes on."""
    density = _density(optics, hit, x, y, z)
    for k in range(colors.shape[1]):
        share = 0.0
        if density > 0.0:
            share = min(1.0, _bsdf(optics, hit, x, y, z, number(k)) * abs(z) / density)
        colors[row, k] = share
    return density


@inner_kernel
def _event(optics: Optics, hit: Hit, z: float) -> int:
    """What is said to have happened."""
    if optics.surface_i[hit.surface, S_MODEL] == 1:
        return DIFFUSE_REFLECTION if z > 0.0 else DIFFUSE_TRANSMISSION
    return GLOSSY_REFLECTION if z > 0.0 else GLOSSY_TRANSMISSION


@stage_kernel
def meet_by_law(optics: Optics, hit: Hit, light: Light) -> Outcome:
    """Draw a direction; go on with the share that the law gives, or be absorbed."""
    colors, counters, code = light.colors, light.counters, light.code
    u, state = five_uniform(light.state)
    x, y, z = _direction(optics, hit, u[0], u[1], u[2])
    spare = counters[COLORS] + 1
    _weigh(optics, hit, x, y, z, colors, spare)
    if u[3] >= mean_of(colors, code, colors, spare, np.int64(0)):
        code = recolor_lost(colors, code, colors, spare, np.int64(0), counters)
        return ABSORBED, 0.0, 0.0, 1.0, code, state
    code = recolor(colors, code, colors, spare, np.int64(0), counters)
    return _event(optics, hit, z), x, y, z, code, state


@stage_kernel
def draw_by_law(optics: Optics, hit: Hit, light: Light) -> Outcome:
    """A direction from the law."""
    u, state = five_uniform(light.state)
    x, y, z = _direction(optics, hit, u[0], u[1], u[2])
    return _event(optics, hit, z), x, y, z, light.code, state


@stage_kernel
def weigh_by_law(
    optics: Optics, hit: Hit, light: Light, x: float, y: float, z: float, row: int
) -> float:
    """Its density, and what goes on of each channel."""
    return _weigh(optics, hit, x, y, z, light.colors, row)


@stage_kernel
def towards_by_law(optics: Optics, hit: Hit, x: float, y: float, z: float, out: F64) -> bool:
    """Light that the law sends from w to a direction."""
    found = False
    for k in range(len(out)):
        out[k] = _bsdf(optics, hit, x, y, z, number(k)) * abs(z)
        found |= out[k] > 0.0
    return found


def check_law(
    law: Law, own: F64, n1: float, n2: float, channels: int, where: str, *, draws: int = 64
) -> None:
    """Refuse a law that sends on more light than arrives, or whose functions do not fit together.

    Raises
    ------
    SceneError
        naming the angle of incidence, the channel and what it gives
    """
    sample, evaluate, pdf = (f.py_func for f in (law.sample, law.evaluate, law.pdf))
    points = np.random.default_rng(0).random((draws, 3))
    for angle in (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 85.0):
        w = math.sin(math.radians(angle)), 0.0, math.cos(math.radians(angle))
        for u in points:
            x, y, z = sample(own, *w, n1, n2, *u)
            if abs(x * x + y * y + z * z - 1.0) > 1e-6:
                raise SceneError(f"{where}: its law draws ({x:g}, {y:g}, {z:g}), no unit vector")
            density = pdf(own, *w, x, y, z, n1, n2)
            if not density > 0.0:
                raise SceneError(
                    f"{where}: its law draws a direction at {angle:g} degrees of incidence that "
                    f"has the density {density:g}"
                )
            for channel in range(channels):
                share = evaluate(own, *w, x, y, z, n1, n2, channel) * abs(z) / density
                if not 0.0 <= share <= 1.0 + 1e-9:
                    raise SceneError(
                        f"{where}: at {angle:g} degrees of incidence its law sends on {share:.4g} "
                        f"times the light of channel {channel}; BSDF cos / density must lie "
                        "between 0 and 1"
                    )

"""What a surface does with a ray that meets it: one door, one branch per kind of surface.

A branch returns the event, whether the ray goes to the other side, its new direction, its colour
code and its random state. The ray's direction and the outward normal are as they stand; ``cosine``
is their product (negative where the ray comes from outside).
"""

from __future__ import annotations

import math

import numpy as np

from raymap.events import Event
from raymap.kernels import inline_kernel, inner_kernel
from tracer.engine.buffers import COLORS
from tracer.engine.colors import mean_of, pick_channel, recolor
from tracer.engine.directions import about, sample_cosine_cone
from tracer.engine.random import advance, uniform
from tracer.geometry.kinds import F64, I64
from tracer.optics.fresnel import fresnel_reflectance
from tracer.scene.arrays import (
    ABSORBER,
    DIELECTRIC,
    LAMBERTIAN,
    M_DISPERSIVE,
    S_KIND,
    S_MODEL,
    SURFACE_ROW,
)

__all__ = ["meet_surface"]

Outcome = tuple[int, bool, float, float, float, int, np.uint64]

_ABSORBED = int(Event.SURFACE_ABSORPTION)
_REFLECTED = int(Event.SPECULAR_REFLECTION)
_REFRACTED = int(Event.SPECULAR_REFRACTION)
_TIR = int(Event.TIR)
_DIFFUSE_REFLECTION = int(Event.DIFFUSE_REFLECTION)
_DIFFUSE_TRANSMISSION = int(Event.DIFFUSE_TRANSMISSION)
_SELECT = int(Event.DISPERSIVE_SELECT)


@inline_kernel
def meet_surface(
    surface_i: I64, surface_f: F64, medium_i: I64, medium_f: F64, surface: int, medium: int,
    other: int, dx: float, dy: float, dz: float,
    nx: float, ny: float, nz: float, cosine: float, code: int, colors: F64, counters: I64,
    state: np.uint64, follow: int,
) -> Outcome:  # fmt: skip
    """Let a ray in ``medium`` meet a surface with ``other`` beyond it."""
    # Turn the normal against the ray
    if cosine > 0.0:
        nx, ny, nz = -nx, -ny, -nz
    cos_i = min(1.0, abs(cosine))
    kind = surface_i[surface, S_KIND]
    if kind == DIELECTRIC:
        return _meet_dielectric(
            surface_i, surface_f, medium_i, medium_f, surface, medium, other, dx, dy, dz, nx, ny,
            nz, cos_i, code, colors, counters, state, follow,
        )  # fmt: skip
    if kind == ABSORBER:
        return _ABSORBED, False, dx, dy, dz, code, state
    if kind == LAMBERTIAN:
        return _meet_lambertian(
            surface_f, surface, dx, dy, dz, nx, ny, nz, code, colors, counters, state
        )
    return _meet_mirror(
        surface_f, surface, dx, dy, dz, nx, ny, nz, cos_i, code, colors, counters, state
    )


@inline_kernel
def _meet_dielectric(
    surface_i: I64, surface_f: F64, medium_i: I64, medium_f: F64, surface: int, medium: int,
    other: int, dx: float, dy: float, dz: float,
    nx: float, ny: float, nz: float, cos_i: float, code: int, colors: F64, counters: I64,
    state: np.uint64, follow: int,
) -> Outcome:  # fmt: skip
    """Smooth interface, bare or coated: reflection or refraction by roulette.

    Where the index depends on the channel, a channel is drawn first. If the ray is refracted it
    goes on in that channel alone; if it is reflected, all channels are, each with its reflectance.
    """
    n_channels = colors.shape[1]
    select = code >= n_channels and (
        medium_i[medium, M_DISPERSIVE] | medium_i[other, M_DISPERSIVE] != 0
    )
    k = code if code < n_channels else 0
    if select:
        state = advance(state)
        k = pick_channel(colors, code, uniform(state))
    n1, n2 = medium_f[medium, k], medium_f[other, k]
    eta = n1 / n2
    cos2_t = 1.0 - eta * eta * (1.0 - cos_i * cos_i)
    if cos2_t > 0.0:
        state = advance(state)
        cos_t = math.sqrt(cos2_t)
        if surface_i[surface, S_MODEL] == 1:
            reflectance = surface_f[surface, SURFACE_ROW + k]
        else:
            reflectance = _fresnel(n1, n2, cos_i, cos_t)
        if uniform(state) >= reflectance or follow == 1:
            event = _REFRACTED
            if select:
                event |= _SELECT
                code = k
            along = eta * cos_i - cos_t
            return event, True, eta * dx + along * nx, eta * dy + along * ny, eta * dz + along * nz, code, state  # fmt: skip # noqa: E501
        event = _REFLECTED
    else:
        event = _TIR
    if select:
        code = _recolor_reflected(
            surface_i, surface_f, medium_f, surface, medium, other, cos_i, code, colors, counters
        )
    along = 2.0 * cos_i
    return event, False, dx + along * nx, dy + along * ny, dz + along * nz, code, state


@inline_kernel
def _fresnel(n1: float, n2: float, cos_i: float, cos_t: float) -> float:
    """Reflectance for unpolarised light, with one division (see `tracer.optics.fresnel`)."""
    a, b = n1 * cos_i, n2 * cos_t
    c, d = n2 * cos_i, n1 * cos_t
    s, p = (a - b) * (c + d), (c - d) * (a + b)
    below = (a + b) * (c + d)
    return 0.5 * (s * s + p * p) / (below * below)


@inner_kernel
def _recolor_reflected(
    surface_i: I64, surface_f: F64, medium_f: F64, surface: int, medium: int, other: int,
    cos_i: float, code: int, colors: F64, counters: I64,
) -> int:  # fmt: skip
    """Colour after reflection where each channel has its own reflectance; total stays total."""
    spare = counters[COLORS] + 1
    for j in range(colors.shape[1]):
        reflectance = fresnel_reflectance(medium_f[medium, j], medium_f[other, j], cos_i)
        if reflectance < 1.0 and surface_i[surface, S_MODEL] == 1:
            reflectance = surface_f[surface, SURFACE_ROW + j]
        colors[spare, j] = reflectance
    return recolor(colors, code, colors, spare, np.int64(0), counters)


@inner_kernel
def _meet_lambertian(
    surface_f: F64, surface: int, dx: float, dy: float, dz: float, nx: float, ny: float,
    nz: float, code: int, colors: F64, counters: I64, state: np.uint64,
) -> Outcome:  # fmt: skip
    """Diffuse reflection, diffuse transmission or absorption."""
    reflectance = np.int64(SURFACE_ROW)
    transmittance = reflectance + colors.shape[1]
    state = advance(state)
    u = uniform(state)
    back = mean_of(colors, code, surface_f, surface, reflectance)
    if u < back:
        code = recolor(colors, code, surface_f, surface, reflectance, counters)
        dx, dy, dz, state = _diffuse(nx, ny, nz, state)
        return _DIFFUSE_REFLECTION, False, dx, dy, dz, code, state
    if u < back + mean_of(colors, code, surface_f, surface, transmittance):
        code = recolor(colors, code, surface_f, surface, transmittance, counters)
        dx, dy, dz, state = _diffuse(-nx, -ny, -nz, state)
        return _DIFFUSE_TRANSMISSION, True, dx, dy, dz, code, state
    return _ABSORBED, False, dx, dy, dz, code, state


@inner_kernel
def _diffuse(
    nx: float, ny: float, nz: float, state: np.uint64
) -> tuple[float, float, float, np.uint64]:
    state = advance(state)
    cosine = sample_cosine_cone(uniform(state), 0.0)
    state = advance(state)
    dx, dy, dz = about(nx, ny, nz, cosine, 2.0 * math.pi * uniform(state))
    return dx, dy, dz, state


@inner_kernel
def _meet_mirror(
    surface_f: F64, surface: int, dx: float, dy: float, dz: float, nx: float, ny: float,
    nz: float, cos_i: float, code: int, colors: F64, counters: I64, state: np.uint64,
) -> Outcome:  # fmt: skip
    """Specular reflection or absorption."""
    state = advance(state)
    if uniform(state) >= mean_of(colors, code, surface_f, surface, np.int64(SURFACE_ROW)):
        return _ABSORBED, False, dx, dy, dz, code, state
    code = recolor(colors, code, surface_f, surface, np.int64(SURFACE_ROW), counters)
    along = 2.0 * cos_i
    return _REFLECTED, False, dx + along * nx, dy + along * ny, dz + along * nz, code, state

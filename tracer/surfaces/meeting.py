"""What a surface does with a ray that meets it: one door, one branch per kind of surface.

A branch returns the event, whether the ray goes to the other side, its new direction, its colour
code and its random state. The ray's direction and the outward normal are as they stand; ``cosine``
is their product (negative where the ray comes from outside).
"""

from __future__ import annotations

import math

import numpy as np

from raymap.jit.kernels import inline_kernel, inner_kernel, unsigned
from raymap.jit.types import F64, I64
from raymap.model.events import Event
from tracer.compiled import (
    ABSORBER,
    DIELECTRIC,
    LAMBERTIAN,
    M_DISPERSIVE,
    S_KIND,
    S_METAL,
    S_MODEL,
    S_TABLE,
    S_TRANSMITTED,
    SURFACE_ROW,
)
from tracer.optics.coatings import coating_share
from tracer.optics.fresnel import fresnel_reflectance
from tracer.rays.colors import COLORS, mean_of, pick_channel, recolor, recolor_lost
from tracer.rays.directions import about
from tracer.rays.random import advance, uniform
from tracer.surfaces.scattering import Outcome, meet_scatterer, scatter_specular

__all__ = ["coating", "meet_surface"]

_ABSORBED = int(Event.SURFACE_ABSORPTION)
_REFLECTED = int(Event.SPECULAR_REFLECTION)
_REFRACTED = int(Event.SPECULAR_REFRACTION)
_TIR = int(Event.TIR)
_DIFFUSE_REFLECTION = int(Event.DIFFUSE_REFLECTION)
_DIFFUSE_TRANSMISSION = int(Event.DIFFUSE_TRANSMISSION)
_SELECT = int(Event.DISPERSIVE_SELECT)
_GLOSSY_REFLECTION = int(Event.GLOSSY_REFLECTION)
_GLOSSY_TRANSMISSION = int(Event.GLOSSY_TRANSMISSION)
_SPECULAR = _REFLECTED | _REFRACTED | _TIR


@inline_kernel
def meet_surface(
    surface_i: I64, surface_f: F64, medium_i: I64, medium_f: F64, tables: F64 | None,
    surface: int, medium: int, other: int, dx: float, dy: float, dz: float,
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
        happened, crosses, dx, dy, dz, code, state = _meet_dielectric(
            surface_i, surface_f, medium_i, medium_f, tables, surface, medium, other, dx, dy, dz,
            nx, ny, nz, cos_i, code, colors, counters, state, follow,
        )  # fmt: skip
        if tables is not None:
            happened, dx, dy, dz, code, state = _scatter_if_specular(
                surface_i, surface_f, medium_f, tables, surface, medium, other, cos_i, happened,
                crosses, nx, ny, nz, dx, dy, dz, code, colors, counters, state,
            )  # fmt: skip
        return happened, crosses, dx, dy, dz, code, state
    if kind == ABSORBER:
        return _ABSORBED, False, dx, dy, dz, code, state
    if kind == LAMBERTIAN:
        return _meet_lambertian(
            surface_f, surface, dx, dy, dz, nx, ny, nz, code, colors, counters, state
        )
    if tables is None:
        return _ABSORBED, False, dx, dy, dz, code, state
    return meet_scatterer(
        surface_i, surface_f, medium_f, tables, surface, medium, other, dx, dy, dz, nx, ny, nz,
        cos_i, code, colors, counters, state,
    )  # fmt: skip


@inline_kernel
def _meet_dielectric(
    surface_i: I64, surface_f: F64, medium_i: I64, medium_f: F64, tables: F64 | None,
    surface: int, medium: int, other: int, dx: float, dy: float, dz: float,
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
        or surface_i[surface, S_MODEL] >= 2
    )
    k = code if code < n_channels else 0
    if select:
        state = advance(state)
        k = pick_channel(colors, code, uniform(state))
    channel = unsigned(k)
    n1, n2 = medium_f[medium, channel], medium_f[other, channel]
    eta = n1 / n2
    cos2_t = 1.0 - eta * eta * (1.0 - cos_i * cos_i)
    if cos2_t > 0.0:
        state = advance(state)
        cos_t = math.sqrt(cos2_t)
        u = uniform(state)
        model = surface_i[surface, S_MODEL]
        if model == 0:
            reflectance = _fresnel(n1, n2, cos_i, cos_t)
        elif model != 2:
            reflectance = surface_f[surface, SURFACE_ROW + channel]
        else:
            place = surface_i[surface, S_METAL] + k * surface_i[surface, S_TRANSMITTED]
            reflectance, transmittance = coating(tables, place, n1, n2, cos_i)
            if u >= reflectance + transmittance and follow == 0:
                return _ABSORBED, False, dx, dy, dz, k if select else code, state
        if u >= reflectance or follow == 1:
            event = _REFRACTED
            if select:
                event |= _SELECT
                code = k
            along = eta * cos_i - cos_t
            return event, True, eta * dx + along * nx, eta * dy + along * ny, eta * dz + along * nz, code, state  # fmt: skip # noqa: E501
        event = _REFLECTED
    else:
        event = _TIR
        if surface_i[surface, S_MODEL] == 2:
            # A coating that absorbs frustrates total reflection
            state = advance(state)
            place = surface_i[surface, S_METAL] + k * surface_i[surface, S_TRANSMITTED]
            reflectance, _ = coating(tables, place, n1, n2, cos_i)
            if uniform(state) >= reflectance:
                return _ABSORBED, False, dx, dy, dz, k if select else code, state
    if select:
        code = _recolor_reflected(
            surface_i,
            surface_f,
            medium_f,
            tables,
            surface,
            medium,
            other,
            cos_i,
            code,
            colors,
            counters,
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
    surface_i: I64, surface_f: F64, medium_f: F64, tables: F64 | None, surface: int, medium: int,
    other: int, cos_i: float, code: int, colors: F64, counters: I64,
) -> int:  # fmt: skip
    """Colour after reflection where each channel has its own reflectance; total stays total."""
    spare = counters[COLORS] + 1
    for j in range(colors.shape[1]):
        reflectance = fresnel_reflectance(medium_f[medium, j], medium_f[other, j], cos_i)
        if surface_i[surface, S_MODEL] == 2:
            place = surface_i[surface, S_METAL] + j * surface_i[surface, S_TRANSMITTED]
            reflectance, _ = coating(tables, place, medium_f[medium, j], medium_f[other, j], cos_i)
        elif reflectance < 1.0 and surface_i[surface, S_MODEL] != 0:
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
        dx, dy, dz, state = diffuse(nx, ny, nz, state)
        return _DIFFUSE_REFLECTION, False, dx, dy, dz, code, state
    if u < back + mean_of(colors, code, surface_f, surface, transmittance):
        code = recolor(colors, code, surface_f, surface, transmittance, counters)
        dx, dy, dz, state = diffuse(-nx, -ny, -nz, state)
        return _DIFFUSE_TRANSMISSION, True, dx, dy, dz, code, state
    code = recolor_diffuse_lost(colors, code, surface_f, surface, counters)
    return _ABSORBED, False, dx, dy, dz, code, state


@inner_kernel
def recolor_diffuse_lost(
    colors: F64, code: int, surface_f: F64, surface: int, counters: I64
) -> int:
    """Colour of what a diffuse surface neither reflects nor transmits."""
    n_channels: int = colors.shape[1]
    if code < n_channels:
        return code
    spare = counters[COLORS] + 1
    for k in range(n_channels):
        back = surface_f[surface, SURFACE_ROW + k]
        colors[spare, k] = back + surface_f[surface, SURFACE_ROW + n_channels + k]
    return recolor_lost(colors, code, colors, spare, np.int64(0), counters)


@inner_kernel
def diffuse(
    nx: float, ny: float, nz: float, state: np.uint64
) -> tuple[float, float, float, np.uint64]:
    """A direction about n with density cos / pi per solid angle, and the state of the stream."""
    state = advance(state)
    u = uniform(state)
    state = advance(state)
    # The square of the sine is uniform
    dx, dy, dz = about(nx, ny, nz, math.sqrt(1.0 - u), math.sqrt(u), uniform(state))
    return dx, dy, dz, state


@inline_kernel
def coating(
    tables: F64 | None, place: int, n1: float, n2: float, cos_i: float
) -> tuple[float, float]:
    """Reflectance and transmittance from a coating's table."""
    if tables is None:
        return 0.0, 1.0
    return coating_share(tables, place, n1, n2, cos_i)


@inner_kernel
def _scatter_if_specular(
    surface_i: I64, surface_f: F64, medium_f: F64, tables: F64, surface: int, medium: int,
    other: int, cos_i: float, happened: int, crosses: bool, nx: float, ny: float, nz: float,
    dx: float, dy: float, dz: float, code: int, colors: F64, counters: I64, state: np.uint64,
) -> tuple[int, float, float, float, int, np.uint64]:  # fmt: skip
    """Give the surface's scatter its share of light that was reflected or refracted."""
    if surface_i[surface, S_TABLE] < 0 or happened & _SPECULAR == 0:
        return happened, dx, dy, dz, code, state
    side = -1.0 if crosses else 1.0
    scattered, dx, dy, dz, code, state = scatter_specular(
        surface_i, surface_f, medium_f, tables, surface, medium, other, cos_i, crosses, side * nx,
        side * ny, side * nz, dx, dy, dz, code, colors, counters, state,
    )  # fmt: skip
    if scattered:
        glossy = _GLOSSY_TRANSMISSION if crosses else _GLOSSY_REFLECTION
        happened = (happened & _SELECT) | glossy
    return happened, dx, dy, dz, code, state

"""The weighted mode: what happens at a surface, and with which weight the ray goes on.

Nothing here changes a flux: an outcome that is chosen with another probability than light has
carries the ratio of both as a factor of its weight.

- A reflection at a smooth interface, a scatter by a law of ABg or Harvey-Shack, and light that a
  diffuse surface sends on are chosen with at least the probability ``settings[R_LEAST]``.
- Where the ray may still split (`tracer.engine.splitting`), the reflected part becomes a ray of its
  own and the other part goes on, each with its share.
- Scattered light is aimed with the probability q = ``settings[R_AIM]``: its direction comes from
  the mixture q p_aim + (1 - q) f of the density of aiming and the law's own density f, and its
  factor is f over that mixture, at most 1 / (1 - q) (the balance heuristic).

References
----------
E. Veach, L. J. Guibas, Optimally combining sampling techniques for Monte Carlo rendering, SIGGRAPH
1995. J. Arvo, D. Kirk, Particle transport and image synthesis, SIGGRAPH 1990 (roulette, splitting).
"""

from __future__ import annotations

import math

import numpy as np

from raymap.events import Event
from raymap.kernels import inline_kernel, inner_kernel
from tracer.engine.aiming import aim_at, count_targets, pdf_aim
from tracer.engine.buffers import COLORS
from tracer.engine.colors import mean_of, pick_channel, recolor
from tracer.engine.directions import about, sample_cosine_cone
from tracer.engine.random import advance, uniform
from tracer.engine.scattering import (
    meet_filter,
    metal_reflectance,
    sample_measured,
    sample_retroreflector,
    survive_metal,
)
from tracer.engine.splitting import T_CODE, T_EVENT, T_PENDING, Twins, keep_twin
from tracer.engine.surfaces import coating, meet_surface
from tracer.geometry.kinds import F64, I64
from tracer.optics.abg import pdf_radial, sample_radial, scatter_share
from tracer.optics.bsdf import pdf_tabulated
from tracer.optics.fresnel import fresnel_reflectance
from tracer.optics.microfacet import (
    eval_rough_conductor,
    pdf_rough_dielectric,
    sample_rough_conductor,
    sample_rough_dielectric,
)
from tracer.optics.phase import pdf_phase
from tracer.scene.arrays import (
    DIELECTRIC,
    FILTER,
    LAMBERTIAN,
    M_DISPERSIVE,
    MIRROR,
    R_AIM,
    R_FAINT,
    R_LEAST,
    RETROREFLECTOR,
    ROUGH_DIELECTRIC,
    ROUGH_MIRROR,
    S_KIND,
    S_METAL,
    S_MODEL,
    S_STRIDE,
    S_TABLE,
    S_TRANSMITTED,
    SURFACE_ROW,
    TABULATED,
    RareLight,
)

__all__ = ["aim_in_volume", "end_faint_ray", "meet"]

Weighted = tuple[int, bool, float, float, float, int, np.uint64, float]
Directed = tuple[float, float, float, float, np.uint64]

_ABSORBED = int(Event.SURFACE_ABSORPTION)
_REFLECTED = int(Event.SPECULAR_REFLECTION)
_REFRACTED = int(Event.SPECULAR_REFRACTION)
_TIR = int(Event.TIR)
_SPECULAR = _REFLECTED | _REFRACTED | _TIR
_SELECT = int(Event.DISPERSIVE_SELECT)
_DIFFUSE_REFLECTION = int(Event.DIFFUSE_REFLECTION)
_DIFFUSE_TRANSMISSION = int(Event.DIFFUSE_TRANSMISSION)
_GLOSSY_REFLECTION = int(Event.GLOSSY_REFLECTION)
_GLOSSY_TRANSMISSION = int(Event.GLOSSY_TRANSMISSION)
_VOLUME_SCATTER = int(Event.VOLUME_SCATTER)
_RIM_HIT = int(Event.RIM_HIT)
_KILL = int(Event.ROULETTE_KILL)
_ENDING = int(
    Event.SURFACE_ABSORPTION
    | Event.VOLUME_ABSORPTION
    | Event.LEFT_SCENE
    | Event.DEPTH_LIMIT
    | Event.GEOMETRY_ERROR
)


@inline_kernel
def meet(
    rare: RareLight | None, twins: Twins | None, ray: int, deep: bool, x: float, y: float, z: float,
    weight: float, surface_i: I64, surface_f: F64, medium_i: I64, medium_f: F64,
    tables: F64 | None, surface: int, medium: int, other: int, dx: float, dy: float, dz: float,
    nx: float, ny: float, nz: float, cosine: float, code: int, colors: F64, counters: I64,
    state: np.uint64, follow: int,
) -> Weighted:  # fmt: skip
    """Let a ray meet a surface: as `meet_surface` in the analog mode, where its weight stays."""
    if rare is None:
        happened, crosses, dx, dy, dz, code, state = meet_surface(
            surface_i, surface_f, medium_i, medium_f, tables, surface, medium, other, dx, dy, dz,
            nx, ny, nz, cosine, code, colors, counters, state, follow,
        )  # fmt: skip
        return happened, crosses, dx, dy, dz, code, state, weight
    return _meet_weighted(
        rare, twins, ray, deep, x, y, z, weight, surface_i, surface_f, medium_i, medium_f, tables,
        surface, medium, other, dx, dy, dz, nx, ny, nz, cosine, code, colors, counters, state,
    )  # fmt: skip


@inline_kernel
def aim_in_volume(
    rare: RareLight | None, event: int, x: float, y: float, z: float, ux: float, uy: float,
    uz: float, dx: float, dy: float, dz: float, weight: float, medium_f: F64, tables: F64 | None,
    medium: int, n_channels: int, state: np.uint64,
) -> Directed:  # fmt: skip
    """Aim light that a medium has scattered at (x, y, z) from the direction u to d."""
    if rare is None or tables is None:
        return dx, dy, dz, weight, state
    if event != _VOLUME_SCATTER:
        return dx, dy, dz, weight, state
    return _aim_in_volume(
        rare, x, y, z, ux, uy, uz, dx, dy, dz, weight, medium_f, tables, medium, n_channels, state
    )


@inline_kernel
def end_faint_ray(
    rare: RareLight | None, event: int, weight: float, state: np.uint64
) -> tuple[int, float, np.uint64]:
    """Roulette for rays of little weight: one in a few goes on and carries the light of all."""
    if rare is None:
        return event, weight, state
    return _end_faint_ray(rare, event, weight, state)


@inner_kernel
def _end_faint_ray(
    rare: RareLight, event: int, weight: float, state: np.uint64
) -> tuple[int, float, np.uint64]:
    faint = rare.settings[R_FAINT]
    if event & _ENDING != 0 or (weight > 0.0 and weight >= faint):
        return event, weight, state
    state = advance(state)
    if uniform(state) * faint < weight:
        return event, faint, state
    return (event & _RIM_HIT) | _KILL, 0.0, state


@inner_kernel
def _meet_weighted(
    rare: RareLight, twins: Twins | None, ray: int, deep: bool, x: float, y: float, z: float,
    weight: float, surface_i: I64, surface_f: F64, medium_i: I64, medium_f: F64,
    tables: F64 | None, surface: int, medium: int, other: int, dx: float, dy: float, dz: float,
    nx: float, ny: float, nz: float, cosine: float, code: int, colors: F64, counters: I64,
    state: np.uint64,
) -> Weighted:  # fmt: skip
    if cosine > 0.0:
        nx, ny, nz = -nx, -ny, -nz
    cos_i = min(1.0, abs(cosine))
    kind = surface_i[surface, S_KIND]
    if kind == DIELECTRIC:
        return _meet_dielectric(
            rare, twins, ray, deep, x, y, z, weight, surface_i, surface_f, medium_i, medium_f,
            tables, surface, medium, other, dx, dy, dz, nx, ny, nz, cos_i, code, colors, counters,
            state,
        )  # fmt: skip
    if kind == LAMBERTIAN:
        return _meet_lambertian(
            rare, x, y, z, weight, surface_f, surface, dx, dy, dz, nx, ny, nz, code, colors,
            counters, state,
        )  # fmt: skip
    if tables is None:
        return _ABSORBED, False, dx, dy, dz, code, state, weight
    return _meet_scatterer(
        rare, x, y, z, weight, surface_i, surface_f, medium_i, medium_f, tables, surface, medium,
        other, dx, dy, dz, nx, ny, nz, cos_i, code, colors, counters, state,
    )  # fmt: skip


@inner_kernel
def _meet_scatterer(
    rare: RareLight, x: float, y: float, z: float, weight: float, surface_i: I64, surface_f: F64,
    medium_i: I64, medium_f: F64, tables: F64, surface: int, medium: int, other: int, dx: float,
    dy: float, dz: float, nx: float, ny: float, nz: float, cos_i: float, code: int, colors: F64,
    counters: I64, state: np.uint64,
) -> Weighted:  # fmt: skip
    kind = surface_i[surface, S_KIND]
    if kind == MIRROR:
        state = advance(state)
        reflected, code = survive_metal(
            surface_i, surface_f, medium_f, tables, surface, medium, cos_i, code, colors, counters,
            uniform(state),
        )  # fmt: skip
        if not reflected:
            return _ABSORBED, False, dx, dy, dz, code, state, weight
        along = 2.0 * cos_i
        scattered, dx, dy, dz, code, state, weight = _scatter(
            rare, x, y, z, weight, surface_i, tables, surface, nx, ny, nz, dx + along * nx,
            dy + along * ny, dz + along * nz, code, colors, counters, state,
        )  # fmt: skip
        event = _GLOSSY_REFLECTION if scattered else _REFLECTED
        return event, False, dx, dy, dz, code, state, weight
    if kind in (ROUGH_DIELECTRIC, ROUGH_MIRROR):
        return _meet_rough(
            rare, x, y, z, weight, surface_i, surface_f, medium_i, medium_f, tables, surface,
            medium, other, dx, dy, dz, nx, ny, nz, cos_i, code, colors, counters, state,
        )  # fmt: skip
    if kind == FILTER:
        happened, crosses, dx, dy, dz, code, state = meet_filter(
            surface_f, medium_f, surface, medium, dx, dy, dz, cos_i, code, colors, counters, state
        )
        return happened, crosses, dx, dy, dz, code, state, weight
    if kind in (TABULATED, RETROREFLECTOR):
        return _meet_measured(
            rare, x, y, z, weight, surface_i, surface_f, tables, surface, dx, dy, dz, nx, ny, nz,
            cos_i, code, colors, counters, state,
        )  # fmt: skip
    return _ABSORBED, False, dx, dy, dz, code, state, weight


# -- smooth interfaces ---------------------------------------------------------------------------


@inner_kernel
def _shares(
    surface_i: I64, surface_f: F64, medium_f: F64, tables: F64 | None, surface: int, medium: int,
    other: int, cos_i: float, k: int,
) -> tuple[float, float]:  # fmt: skip
    """Reflectance and transmittance of a smooth interface in channel k; total stays total."""
    n1, n2 = medium_f[medium, k], medium_f[other, k]
    if surface_i[surface, S_MODEL] == 2:
        place = surface_i[surface, S_METAL] + k * surface_i[surface, S_TRANSMITTED]
        return coating(tables, place, n1, n2, cos_i)
    reflectance = fresnel_reflectance(n1, n2, cos_i)
    if reflectance < 1.0 and surface_i[surface, S_MODEL] != 0:
        reflectance = float(surface_f[surface, SURFACE_ROW + k])
    return reflectance, 1.0 - reflectance


@inner_kernel
def _chosen(share: float, least: float) -> float:
    """Probability of an outcome that light has with ``share``: at least ``least``, 0 stays 0."""
    if share <= 0.0:
        return 0.0
    return share if share >= 1.0 else max(share, least)


@inner_kernel
def _meet_dielectric(
    rare: RareLight, twins: Twins | None, ray: int, deep: bool, x: float, y: float, z: float,
    weight: float, surface_i: I64, surface_f: F64, medium_i: I64, medium_f: F64,
    tables: F64 | None, surface: int, medium: int, other: int, dx: float, dy: float, dz: float,
    nx: float, ny: float, nz: float, cos_i: float, code: int, colors: F64, counters: I64,
    state: np.uint64,
) -> Weighted:  # fmt: skip
    """Smooth interface: reflection with at least the set probability, or both parts."""
    n_channels = colors.shape[1]
    select = code >= n_channels and (
        medium_i[medium, M_DISPERSIVE] | medium_i[other, M_DISPERSIVE] != 0
        or surface_i[surface, S_MODEL] >= 2
    )
    least = rare.settings[R_LEAST]
    # Sum up over the channels what is reflected, and with which probability that is chosen
    first, last = (0, n_channels) if select else (code, code + 1)
    if not select and code >= n_channels:
        first, last = 0, 1
    back, chance = 0.0, 0.0
    for j in range(first, last):
        share = colors[code - n_channels, j] if select else 1.0
        r, _ = _shares(surface_i, surface_f, medium_f, tables, surface, medium, other, cos_i, j)
        back += share * r
        chance += share * _chosen(r, least)
    splits = not deep and 0.0 < back < 1.0 and keep_twin(rare, twins, ray)
    # Draw the channel in which light would cross: all that crosses where the ray splits
    state = advance(state)
    u = uniform(state)
    k = first
    if select:
        if splits:
            u *= 1.0 - back
            for j in range(n_channels):
                r, _ = _shares(
                    surface_i, surface_f, medium_f, tables, surface, medium, other, cos_i, j
                )
                u -= colors[code - n_channels, j] * (1.0 - r)
                k = j
                if u < 0.0:
                    break
        else:
            k = pick_channel(colors, code, u)
    r, t = _shares(surface_i, surface_f, medium_f, tables, surface, medium, other, cos_i, k)
    n1, n2 = medium_f[medium, k], medium_f[other, k]
    eta = n1 / n2
    cos2_t = 1.0 - eta * eta * (1.0 - cos_i * cos_i)
    state = advance(state)
    reflects = not splits and uniform(state) < _chosen(r, least)
    turned = 2.0 * cos_i
    if splits and twins is not None:
        # The reflected part becomes a ray of its own
        twin_code = code
        if select:
            twin_code = _recolor(
                surface_i, surface_f, medium_f, tables, surface, medium, other, cos_i, code,
                colors, counters,
            )  # fmt: skip
        scattered, rx, ry, rz, twin_code, state, twin_weight = _scatter(
            rare, x, y, z, weight * back, surface_i, tables, surface, nx, ny, nz, dx + turned * nx,
            dy + turned * ny, dz + turned * nz, twin_code, colors, counters, state,
        )  # fmt: skip
        happened, twin_weight, state = _end_faint_ray(rare, 0, twin_weight, state)
        if happened == 0:
            state = advance(state)
            twins.direction[0], twins.direction[1], twins.direction[2] = rx, ry, rz
            twins.direction[3] = twin_weight
            twins.outcome[T_PENDING] = 1
            twins.outcome[T_EVENT] = _GLOSSY_REFLECTION if scattered else _REFLECTED
            twins.outcome[T_CODE] = twin_code
    if reflects:
        event = _REFLECTED
        if cos2_t <= 0.0:
            event = _TIR
        if select:
            code = _recolor(
                surface_i, surface_f, medium_f, tables, surface, medium, other, cos_i, code,
                colors, counters,
            )  # fmt: skip
        weight *= back / chance
        scattered, dx, dy, dz, code, state, weight = _scatter(
            rare, x, y, z, weight, surface_i, tables, surface, nx, ny, nz, dx + turned * nx,
            dy + turned * ny, dz + turned * nz, code, colors, counters, state,
        )  # fmt: skip
        return _GLOSSY_REFLECTION if scattered else event, False, dx, dy, dz, code, state, weight
    weight *= 1.0 - back if splits else (1.0 - r) / (1.0 - _chosen(r, least))
    # What neither goes back nor through is absorbed
    state = advance(state)
    if uniform(state) * (1.0 - r) >= t or cos2_t <= 0.0:
        return _ABSORBED, False, dx, dy, dz, code, state, weight
    event = _REFRACTED
    if select:
        event |= _SELECT
        code = k
    along = eta * cos_i - math.sqrt(cos2_t)
    scattered, dx, dy, dz, code, state, weight = _scatter(
        rare, x, y, z, weight, surface_i, tables, surface, -nx, -ny, -nz, eta * dx + along * nx,
        eta * dy + along * ny, eta * dz + along * nz, code, colors, counters, state,
    )  # fmt: skip
    if scattered:
        event = (event & _SELECT) | _GLOSSY_TRANSMISSION
    return event, True, dx, dy, dz, code, state, weight


@inner_kernel
def _recolor(
    surface_i: I64, surface_f: F64, medium_f: F64, tables: F64 | None, surface: int, medium: int,
    other: int, cos_i: float, code: int, colors: F64, counters: I64,
) -> int:  # fmt: skip
    """Colour after reflection where each channel has its own reflectance."""
    spare = counters[COLORS] + 1
    for j in range(colors.shape[1]):
        colors[spare, j], _ = _shares(
            surface_i, surface_f, medium_f, tables, surface, medium, other, cos_i, j
        )
    return recolor(colors, code, colors, spare, np.int64(0), counters)


# -- scatter -------------------------------------------------------------------------------------


@inner_kernel
def _aim(
    rare: RareLight, x: float, y: float, z: float, nx: float, ny: float, nz: float, horizon: bool,
    dx: float, dy: float, dz: float, state: np.uint64,
) -> tuple[float, float, float, float, int, np.uint64]:  # fmt: skip
    """Keep the direction drawn from a law, or take an aimed one.

    Returns
    -------
    d : the direction
    q : probability with which light is aimed from here, 0 where there is no target
    count : candidates
    """
    q = rare.settings[R_AIM]
    count = count_targets(rare.targets, x, y, z, nx, ny, nz, horizon) if q > 0.0 else 0
    if count == 0:
        return dx, dy, dz, 0.0, 0, state
    state = advance(state)
    if uniform(state) < q:
        a = advance(state)
        b = advance(a)
        state = advance(b)
        dx, dy, dz = aim_at(
            rare.targets, x, y, z, nx, ny, nz, horizon, count, uniform(a), uniform(b),
            uniform(state),
        )  # fmt: skip
    return dx, dy, dz, q, count, state


@inner_kernel
def _balance(
    rare: RareLight, x: float, y: float, z: float, nx: float, ny: float, nz: float, horizon: bool,
    dx: float, dy: float, dz: float, q: float, count: int, density: float,
) -> float:  # fmt: skip
    """Factor of the weight: the law's density over that of the mixture."""
    if count == 0:
        return 1.0
    if density <= 0.0:
        return 0.0
    aimed = pdf_aim(rare.targets, x, y, z, nx, ny, nz, horizon, count, dx, dy, dz)
    return density / (q * aimed + (1.0 - q) * density)


@inline_kernel
def _scatter(
    rare: RareLight, x: float, y: float, z: float, weight: float, surface_i: I64,
    tables: F64 | None, surface: int, nx: float, ny: float, nz: float, dx: float, dy: float,
    dz: float, code: int, colors: F64, counters: I64, state: np.uint64,
) -> tuple[bool, float, float, float, int, np.uint64, float]:  # fmt: skip
    """Scatter specular light (direction d, normal on its side) by the surface's law, if any."""
    if tables is None or surface_i[surface, S_TABLE] < 0:
        return False, dx, dy, dz, code, state, weight
    return _scatter_by_law(
        rare, x, y, z, weight, surface_i, tables, surface, nx, ny, nz, dx, dy, dz, code, colors,
        counters, state,
    )  # fmt: skip


@inner_kernel
def _scatter_by_law(
    rare: RareLight, x: float, y: float, z: float, weight: float, surface_i: I64, tables: F64,
    surface: int, nx: float, ny: float, nz: float, dx: float, dy: float, dz: float, code: int,
    colors: F64, counters: I64, state: np.uint64,
) -> tuple[bool, float, float, float, int, np.uint64, float]:  # fmt: skip
    first, stride = surface_i[surface, S_TABLE], surface_i[surface, S_STRIDE]
    n_channels = colors.shape[1]
    mixed = stride > 0 and code >= n_channels
    k = 0
    if stride > 0:
        state = advance(state)
        k = pick_channel(colors, code, uniform(state))
    along = dx * nx + dy * ny + dz * nz
    beta = math.sqrt(max(0.0, 1.0 - along * along))
    table = first + k * stride
    share = scatter_share(tables, table, beta)
    least = rare.settings[R_LEAST]
    state = advance(state)
    if uniform(state) >= _chosen(share, least):
        # Unscattered: every channel keeps what its law leaves
        left, chance = 1.0 - share, 1.0 - _chosen(share, least)
        if mixed:
            left, chance = 0.0, 0.0
            spare = counters[COLORS] + 1
            for j in range(n_channels):
                s = scatter_share(tables, first + j * stride, beta)
                colors[spare, j] = 1.0 - s
                left += colors[code - n_channels, j] * (1.0 - s)
                chance += colors[code - n_channels, j] * (1.0 - _chosen(s, least))
            code = recolor(colors, code, colors, spare, np.int64(0), counters)
        return False, dx, dy, dz, code, state, weight * left / chance
    weight *= share / _chosen(share, least)
    if stride > 0:
        code = k
    # Frame with x along the projection of the specular direction
    if beta > 1e-12:
        ux, uy, uz = (dx - along * nx) / beta, (dy - along * ny) / beta, (dz - along * nz) / beta
    else:
        ux, uy, uz, _, _, _ = _frame(nx, ny, nz)
    vx, vy, vz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
    a = advance(state)
    state = advance(a)
    px, py, pz = sample_radial(tables, table, beta, 0.0, uniform(a), uniform(state))
    dx, dy, dz = px * ux + py * vx + pz * nx, px * uy + py * vy + pz * ny, px * uz + py * vz + pz * nz  # fmt: skip # noqa: E501
    dx, dy, dz, q, count, state = _aim(rare, x, y, z, nx, ny, nz, True, dx, dy, dz, state)
    if count > 0:
        px, py = dx * ux + dy * uy + dz * uz, dx * vx + dy * vy + dz * vz
        pz = dx * nx + dy * ny + dz * nz
        density = pdf_radial(tables, table, beta, 0.0, px, py, pz)
        weight *= _balance(rare, x, y, z, nx, ny, nz, True, dx, dy, dz, q, count, density)
    return True, dx, dy, dz, code, state, weight


@inner_kernel
def _meet_lambertian(
    rare: RareLight, x: float, y: float, z: float, weight: float, surface_f: F64, surface: int,
    dx: float, dy: float, dz: float, nx: float, ny: float, nz: float, code: int, colors: F64,
    counters: I64, state: np.uint64,
) -> Weighted:  # fmt: skip
    """Diffuse reflection or transmission, chosen with at least the set probability."""
    column = np.int64(SURFACE_ROW)
    beyond = column + colors.shape[1]
    back = mean_of(colors, code, surface_f, surface, column)
    through = mean_of(colors, code, surface_f, surface, beyond)
    share = min(1.0, back + through)
    chance = _chosen(share, rare.settings[R_LEAST])
    state = advance(state)
    u = uniform(state)
    if u >= chance:
        return _ABSORBED, False, dx, dy, dz, code, state, weight * (1.0 - share) / (1.0 - chance)
    weight *= share / chance
    crosses = u * share >= back * chance
    if crosses:
        nx, ny, nz = -nx, -ny, -nz
        column = beyond
    code = recolor(colors, code, surface_f, surface, column, counters)
    a = advance(state)
    state = advance(a)
    dx, dy, dz = about(
        nx, ny, nz, sample_cosine_cone(uniform(a), 0.0), 2.0 * math.pi * uniform(state)
    )
    dx, dy, dz, q, count, state = _aim(rare, x, y, z, nx, ny, nz, True, dx, dy, dz, state)
    density = (dx * nx + dy * ny + dz * nz) / math.pi
    weight *= _balance(rare, x, y, z, nx, ny, nz, True, dx, dy, dz, q, count, density)
    event = _DIFFUSE_TRANSMISSION if crosses else _DIFFUSE_REFLECTION
    return event, crosses, dx, dy, dz, code, state, weight


@inner_kernel
def _meet_measured(
    rare: RareLight, x: float, y: float, z: float, weight: float, surface_i: I64, surface_f: F64,
    tables: F64, surface: int, dx: float, dy: float, dz: float, nx: float, ny: float, nz: float,
    cos_i: float, code: int, colors: F64, counters: I64, state: np.uint64,
) -> Weighted:  # fmt: skip
    """Measured scatter: its side and its losses by roulette, its direction aimed. Also a
    retroreflector, which nothing is aimed from."""
    ux, uy, uz, vx, vy, vz = _frame(nx, ny, nz)
    ix, iy = -(dx * ux + dy * uy + dz * uz), -(dx * vx + dy * vy + dz * vz)
    measured = surface_i[surface, S_KIND] == TABULATED
    if measured:
        happened, px, py, pz, code, state = sample_measured(
            surface_i, tables, surface, ix, iy, cos_i, code, colors, state
        )
    else:
        happened, px, py, pz, code, state = sample_retroreflector(
            surface_f, surface, ix, iy, cos_i, code, colors, counters, state
        )
    if happened == _ABSORBED:
        return happened, False, dx, dy, dz, code, state, weight
    crosses = pz < 0.0
    ox, oy, oz = px * ux + py * vx + pz * nx, px * uy + py * vy + pz * ny, px * uz + py * vz + pz * nz  # fmt: skip # noqa: E501
    if not measured:
        return happened, crosses, ox, oy, oz, code, state, weight
    side = -1.0 if crosses else 1.0
    table = surface_i[surface, S_TRANSMITTED] if crosses else surface_i[surface, S_TABLE]
    hx, hy, hz = side * nx, side * ny, side * nz
    ox, oy, oz, q, count, state = _aim(rare, x, y, z, hx, hy, hz, True, ox, oy, oz, state)
    if count > 0:
        density = pdf_tabulated(
            tables, table, ix, iy, cos_i, ox * ux + oy * uy + oz * uz,
            ox * vx + oy * vy + oz * vz, ox * nx + oy * ny + oz * nz, side,
        )  # fmt: skip
        weight *= _balance(rare, x, y, z, hx, hy, hz, True, ox, oy, oz, q, count, density)
    return happened, crosses, ox, oy, oz, code, state, weight


@inner_kernel
def _meet_rough(
    rare: RareLight, x: float, y: float, z: float, weight: float, surface_i: I64, surface_f: F64,
    medium_i: I64, medium_f: F64, tables: F64, surface: int, medium: int, other: int, dx: float,
    dy: float, dz: float, nx: float, ny: float, nz: float, cos_i: float, code: int, colors: F64,
    counters: I64, state: np.uint64,
) -> Weighted:  # fmt: skip
    """Facets of a rough interface or metal; both sides of an interface are aimed at together."""
    n_channels = colors.shape[1]
    interface = surface_i[surface, S_KIND] == ROUGH_DIELECTRIC
    event = _GLOSSY_REFLECTION
    k = code if code < n_channels else 0
    dispersive = medium_i[medium, M_DISPERSIVE] | medium_i[other, M_DISPERSIVE] != 0
    if interface and dispersive and code >= n_channels:
        state = advance(state)
        k = pick_channel(colors, code, uniform(state))
        code = k
        event |= _SELECT
    ux, uy, uz, vx, vy, vz = _frame(nx, ny, nz)
    ix, iy = -(dx * ux + dy * uy + dz * uz), -(dx * vx + dy * vy + dz * vz)
    alpha = surface_f[surface, 0]
    n1, n2 = medium_f[medium, k], medium_f[other, k]
    s1 = advance(state)
    s2 = advance(s1)
    s3 = advance(s2)
    s4 = advance(s3)
    state = advance(s4)
    if interface:
        px, py, pz, _ = sample_rough_dielectric(
            tables, surface_i[surface, S_METAL], ix, iy, cos_i, alpha, n1, n2, uniform(s1),
            uniform(s2), uniform(s3), uniform(s4), uniform(state),
        )  # fmt: skip
    else:
        px, py, pz, _ = sample_rough_conductor(
            tables, surface_i[surface, S_MODEL], ix, iy, cos_i, alpha, uniform(s1), uniform(s2),
            uniform(s3), uniform(s4), uniform(state),
        )  # fmt: skip
    ox, oy, oz = px * ux + py * vx + pz * nx, px * uy + py * vy + pz * ny, px * uz + py * vz + pz * nz  # fmt: skip # noqa: E501
    horizon = not interface
    ox, oy, oz, q, count, state = _aim(rare, x, y, z, nx, ny, nz, horizon, ox, oy, oz, state)
    if count > 0:
        px, py = ox * ux + oy * uy + oz * uz, ox * vx + oy * vy + oz * vz
        pz = ox * nx + oy * ny + oz * nz
    if interface:
        if count > 0:
            density = pdf_rough_dielectric(
                tables, surface_i[surface, S_METAL], ix, iy, cos_i, px, py, pz, alpha, n1, n2
            )
            weight *= _balance(rare, x, y, z, nx, ny, nz, horizon, ox, oy, oz, q, count, density)
        if pz < 0.0:
            event = (event & _SELECT) | _GLOSSY_TRANSMISSION
        return event, pz < 0.0, ox, oy, oz, code, state, weight
    # A metal: weigh by a law of reflectance 1, then survive with the reflectance there
    single, multiple, cos_m = eval_rough_conductor(
        tables, surface_i[surface, S_MODEL], ix, iy, cos_i, px, py, pz, alpha
    )
    density = (single + multiple) * max(0.0, pz)
    weight *= _balance(rare, x, y, z, nx, ny, nz, horizon, ox, oy, oz, q, count, density)
    if density <= 0.0:
        return event, False, ox, oy, oz, code, state, weight
    state = advance(state)
    often = multiple / (single + multiple)
    spare = counters[COLORS] + 1
    for j in range(n_channels):
        colors[spare, j] = (1.0 - often) * metal_reflectance(
            surface_i, surface_f, medium_f, tables, surface, medium, j, cos_m
        ) + often * surface_f[surface, SURFACE_ROW + n_channels + j]
    if uniform(state) >= mean_of(colors, code, colors, spare, np.int64(0)):
        return _ABSORBED, False, dx, dy, dz, code, state, weight
    code = recolor(colors, code, colors, spare, np.int64(0), counters)
    return event, False, ox, oy, oz, code, state, weight


@inner_kernel
def _aim_in_volume(
    rare: RareLight, x: float, y: float, z: float, ux: float, uy: float, uz: float, dx: float,
    dy: float, dz: float, weight: float, medium_f: F64, tables: F64, medium: int, n_channels: int,
    state: np.uint64,
) -> Directed:  # fmt: skip
    dx, dy, dz, q, count, state = _aim(rare, x, y, z, 0.0, 0.0, 1.0, False, dx, dy, dz, state)
    if count > 0:
        mu = max(-1.0, min(1.0, ux * dx + uy * dy + uz * dz))
        density = pdf_phase(medium_f[medium, 3 * n_channels :], tables, mu)
        weight *= _balance(rare, x, y, z, 0.0, 0.0, 1.0, False, dx, dy, dz, q, count, density)
    return dx, dy, dz, weight, state


@inner_kernel
def _frame(nx: float, ny: float, nz: float) -> tuple[float, float, float, float, float, float]:
    """Two unit vectors across a normal."""
    sign = 1.0 if nz >= 0.0 else -1.0
    a = -1.0 / (sign + nz)
    b = nx * ny * a
    return 1.0 + sign * nx * nx * a, sign * b, -sign * nx, b, sign + ny * ny * a, -ny

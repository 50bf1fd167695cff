"""Rays that carry their state of polarisation: every ray of a scene with crystals does.

A ray is one linear or elliptic wave; natural light draws the azimuth of each. In a crystal the wave
has a refraction vector N beside the direction in which its energy runs. What happens at a face is
drawn by the shares of the wave as it is, so rays keep equal weights; where a surface scatters, or
the mode is weighted, outcomes are drawn by the shares of natural light and the ray's weight takes
the ratio (`raymap.laws.amplitudes`). On a binormal of a biaxial crystal one ray of the cone is
drawn.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from raymap.jit.compiling import Door, Task, address_of
from raymap.jit.kernels import inline_kernel, inner_kernel, number, stage_kernel
from raymap.jit.types import F64, I64
from raymap.laws.amplitudes import Amplitudes, Met, meet_waves, shares_of_state
from raymap.laws.phase import RAYLEIGH
from raymap.model.events import Event
from raymap.optics.angles import turned
from raymap.optics.fresnel import cos2_refracted
from raymap.optics.waves import Turn, normalise_waves, project_waves, start_waves
from tracer.compiled import (
    ABSORBER,
    DIELECTRIC,
    POLARISER,
    R_LEAST,
    S_KIND,
    S_MODEL,
    S_SCATTER,
    Carried,
    VarianceReduction,
)
from tracer.optics.crystals.interface import interface_event
from tracer.optics.crystals.rows import BIAXIAL, EPS, ISOTROPIC, KIND, ROW
from tracer.optics.crystals.waves import ray_absorption
from tracer.rays.random import advance, uniform
from tracer.surfaces.interaction import ABSORBED, Interface, Light, Optics, Way
from tracer.transport.buffers import CarriedRays
from tracer.transport.medium_stack import top_body
from tracer.transport.splitting import SplitRays
from tracer.transport.weighted.balance import likely_enough
from tracer.transport.weighted.outcomes import meet
from tracer.transport.weighted.ray import Weighted, WeightedRay

__all__ = [
    "carried_tasks",
    "carry_scattered",
    "fly_in_crystal",
    "keep_state",
    "link_carried",
    "meet_as_carried",
    "plane_normal",
    "start_state",
    "take_state",
]

_ABSORBED = int(Event.VOLUME_ABSORPTION)
_SCATTERED = int(Event.VOLUME_SCATTER)
_REFLECTED = int(Event.SPECULAR_REFLECTION)
_REFRACTED = int(Event.SPECULAR_REFRACTION)
_PASSED = int(Event.SPECULAR_REFRACTION | Event.POLARISER)
_TIR = int(Event.TIR)
_SPLIT = int(Event.BIREFRINGENT_SPLIT)
_ORDINARY = int(Event.ORDINARY)
_EXTRAORDINARY = int(Event.EXTRAORDINARY)
_CONICAL = int(Event.CONICAL_REFRACTION)
_ERROR = int(Event.GEOMETRY_ERROR)


class Sides(NamedTuple):
    """The bodies before and behind a face, as a ray meets it; -1 is the world."""

    before: int
    behind: int


@inline_kernel
def start_state(
    carried: Carried | None, rays: CarriedRays | None, i: int, source: int, dx: float, dy: float,
    dz: float, state: np.uint64,
) -> np.uint64:  # fmt: skip
    """Give a new ray in slot ``i`` the vibration of its source, -1 none, or one that is drawn."""
    if carried is None or rays is None:
        return state
    waves = rays.waves
    state = advance(state)
    start_waves(waves, dx, dy, dz, False, 2.0 * math.pi * uniform(state))
    if source >= 0:
        bx, by, bz = (
            carried.vibration[source, 0],
            carried.vibration[source, 1],
            carried.vibration[source, 2],
        )
        along = bx * dx + by * dy + bz * dz
        across = bx * bx + by * by + bz * bz - along * along
        if across > 1e-12:
            scale = 1.0 / math.sqrt(across)
            waves[0, 0] = scale * (bx - along * dx)
            waves[0, 1] = scale * (by - along * dy)
            waves[0, 2] = scale * (bz - along * dz)
    keep_state(rays, i)
    return state


@inline_kernel
def take_state(rays: CarriedRays | None, i: int) -> None:
    """Lay out the state of the ray in slot ``i``."""
    if rays is None:
        return
    for k in range(3):
        rays.refraction[k] = rays.states[k, i]
    for k in range(6):
        rays.waves[0, k] = rays.states[3 + k, i]


@inline_kernel
def keep_state(rays: CarriedRays | None, i: int) -> None:
    """Put the state at hand into slot ``i``."""
    if rays is None:
        return
    for k in range(3):
        rays.states[k, i] = rays.refraction[k]
    for k in range(6):
        rays.states[3 + k, i] = rays.waves[0, k]


@inline_kernel
def fly_in_crystal(
    carried: Carried | None, rays: CarriedRays | None, body_i: I64, channel: int, stack: int,
    t: float, state: np.uint64,
) -> tuple[int, float, np.uint64]:  # fmt: skip
    """How far light gets, at most ``t``; the event is absorption where a crystal ends it."""
    if carried is None or rays is None:
        return 0, t, state
    body = top_body(stack, body_i)
    if carried.rows[channel, body, KIND] == ISOTROPIC:
        return 0, t, state
    return _fly_in_crystal(carried.rows[channel, body], carried.k0[channel], rays, t, state)


@inner_kernel
def _fly_in_crystal(
    row: F64, k0: float, rays: CarriedRays, t: float, state: np.uint64
) -> tuple[int, float, np.uint64]:
    waves, big_n = rays.waves, rays.refraction
    rate = ray_absorption(
        row, big_n[0], big_n[1], big_n[2], complex(waves[0, 0], waves[0, 3]),
        complex(waves[0, 1], waves[0, 4]), complex(waves[0, 2], waves[0, 5]),
    )  # fmt: skip
    if rate <= 0.0:
        return 0, t, state
    state = advance(state)
    flight = -math.log(1.0 - uniform(state)) / (rate * k0)
    return (_ABSORBED, flight, state) if flight < t else (0, t, state)


@inline_kernel
def carry_scattered(
    rays: CarriedRays | None, event: int, phase: float, way: Turn, weight: float, state: np.uint64
) -> tuple[float, np.uint64]:
    """Weight and state of light that a medium may have scattered."""
    if rays is None or event != _SCATTERED:
        return weight, state
    return _carry_scattered(rays, phase, way, weight, state)


@inner_kernel
def _carry_scattered(
    rays: CarriedRays, phase: float, way: Turn, weight: float, state: np.uint64
) -> tuple[float, np.uint64]:
    """Light that a medium has scattered from d to o: its weight and state.

    Rayleigh: the density of the angle was 3 / 16 pi (1 + cos²), that of the wave is 3 / 8 pi times
    the power across the new direction. Other phase functions leave light unpolarised.
    """
    if phase == RAYLEIGH:
        mu = way.dx * way.ox + way.dy * way.oy + way.dz * way.oz
        power = project_waves(rays.waves, way.ox, way.oy, way.oz)
        normalise_waves(rays.waves, power)
        return weight * (2.0 * power / (1.0 + mu * mu)), state
    state = advance(state)
    start_waves(rays.waves, way.ox, way.oy, way.oz, False, 2.0 * math.pi * uniform(state))
    return weight, state


@inline_kernel
def plane_normal(
    carried: Carried | None, channel: int, sides: Sides, nx: float, ny: float, nz: float,
    cosine: float, sx: float, sy: float, sz: float,
) -> tuple[float, float, float]:  # fmt: skip
    """The normal against the ray: of the face itself where a crystal is, else s that shades it."""
    if carried is None:
        return sx, sy, sz
    if not _splits_light(carried, channel, sides):
        return sx, sy, sz
    return (nx, ny, nz) if cosine < 0.0 else (-nx, -ny, -nz)


@inline_kernel
def _splits_light(carried: Carried, channel: int, sides: Sides) -> bool:
    """Whether the medium of either body is a crystal."""
    return bool(
        carried.rows[channel, sides.before, KIND] != ISOTROPIC
        or carried.rows[channel, sides.behind, KIND] != ISOTROPIC
    )


@inline_kernel
def meet_as_carried(
    carried: Carried | None, rays: CarriedRays | None, sides: Sides,
    reduction: VarianceReduction | None, split: SplitRays | None, ray: WeightedRay, optics: Optics,
    tables: F64 | None, at: Interface, way: Way, light: Light, follow: int,
) -> Weighted:  # fmt: skip
    """Let a ray meet a surface, with its wave where rays carry theirs."""
    if carried is None or rays is None:
        return meet(reduction, split, ray, optics, tables, at, way, light, follow)
    return _meet_carried(carried, rays, sides, reduction, ray, optics, tables, at, way, light)


@inline_kernel
def _meet_carried(
    carried: Carried, rays: CarriedRays, sides: Sides, reduction: VarianceReduction | None,
    ray: WeightedRay, optics: Optics, tables: F64 | None, at: Interface, way: Way, light: Light,
) -> Weighted:  # fmt: skip
    """Let a ray with its wave meet a surface between the media of two bodies."""
    kind = optics.surface_i[at.surface, S_KIND]
    channel = light.code
    n1, n2 = optics.medium_f[at.medium, channel], optics.medium_f[at.other, channel]
    dx, dy, dz, state, weight = way.dx, way.dy, way.dz, light.state, ray.weight
    if _splits_light(carried, channel, sides):
        if kind == ABSORBER:
            return ABSORBED, False, dx, dy, dz, channel, state, weight
        bare = optics.surface_i[at.surface, S_MODEL] == 0
        if kind != DIELECTRIC or not bare or optics.surface_i[at.surface, S_SCATTER] >= 0:
            # A sheet inside of a crystal: no law is known of it
            return _ERROR, False, dx, dy, dz, channel, state, weight
        happened, dx, dy, dz, factor, state = _meet_crystal(
            carried.calls[_CRYSTAL],
            (
                rays, carried.rows[channel, sides.before], carried.rows[channel, sides.behind], way,
                n1, least_of(reduction), state,
            ),
        )  # fmt: skip
        return happened, happened & _REFRACTED != 0, dx, dy, dz, channel, state, weight * factor
    met = Met(number(at.surface), number(channel), n1, n2)
    if reduction is None:
        happened, dx, dy, dz, state = _meet_smooth(
            carried.calls[_SMOOTH], (carried.laws, rays, met, number(kind), at.cos_i, way, state)
        )
        if happened != 0:
            return happened, happened & _REFRACTED != 0, dx, dy, dz, channel, state, weight
    happened, crosses, dx, dy, dz, code, state, weight = meet(
        reduction, None, ray, optics, tables, at, way, light, 0
    )
    factor, state = _follow(
        carried.calls[_FOLLOW],
        (
            carried.laws, rays, met, number(happened),
            Turn(way.dx, way.dy, way.dz, dx, dy, dz, way.nx, way.ny, way.nz), state,
        ),
    )  # fmt: skip
    return happened, crosses, dx, dy, dz, code, state, weight * factor


@inline_kernel
def least_of(reduction: VarianceReduction | None) -> float:
    """The probability with which a reflection is chosen at least."""
    if reduction is None:
        return 0.0
    return float(reduction.settings[R_LEAST])


@stage_kernel
def follow_natural(
    laws: Amplitudes, rays: CarriedRays, met: Met, happened: int, turn: Turn, state: np.uint64
) -> tuple[float, np.uint64]:
    """Take the wave along with what was drawn for natural light; the factor of the weight."""
    state = advance(state)
    u = uniform(state)
    state = advance(state)
    v = uniform(state)
    factor, lost = meet_waves(laws, rays.waves, happened, met, turn, u, v)
    if lost:
        state = advance(state)
        start_waves(rays.waves, turn.ox, turn.oy, turn.oz, False, 2.0 * math.pi * uniform(state))
    return factor, state


@stage_kernel
def meet_smooth_face(
    laws: Amplitudes, rays: CarriedRays, met: Met, kind: int, cos_i: float, way: Way,
    state: np.uint64,
) -> tuple[int, float, float, float, np.uint64]:  # fmt: skip
    """Draw what happens to the wave as it is; 0 where more can happen than back and through."""
    arrives = Turn(way.dx, way.dy, way.dz, way.dx, way.dy, way.dz, way.nx, way.ny, way.nz)
    back, through = shares_of_state(laws, rays.waves, rays.copy, met, arrives)
    if back < 0.0:
        return 0, way.dx, way.dy, way.dz, state
    state = advance(state)
    u = uniform(state)
    eta = met.n1 / met.n2
    cos2_t = cos2_refracted(eta, cos_i)
    if kind == DIELECTRIC and cos2_t <= 0.0:
        through = 0.0
    if u < back:
        happened = _TIR if kind == DIELECTRIC and cos2_t <= 0.0 else _REFLECTED
        along = 2.0 * cos_i
        ox, oy, oz = way.dx + along * way.nx, way.dy + along * way.ny, way.dz + along * way.nz
    elif u < back + through:
        happened, ox, oy, oz = _PASSED, way.dx, way.dy, way.dz
        if kind != POLARISER:
            happened = _REFRACTED
            along = eta * cos_i - math.sqrt(cos2_t)
            ox, oy, oz = (
                eta * way.dx + along * way.nx,
                eta * way.dy + along * way.ny,
                eta * way.dz + along * way.nz,
            )
    else:
        return ABSORBED, way.dx, way.dy, way.dz, state
    turn = Turn(way.dx, way.dy, way.dz, ox, oy, oz, way.nx, way.ny, way.nz)
    meet_waves(laws, rays.waves, happened, met, turn, 0.5, 0.5)
    return happened, ox, oy, oz, state


@stage_kernel
def meet_crystal_face(
    rays: CarriedRays, row_1: F64, row_2: F64, way: Way, n1: float, least: float, state: np.uint64
) -> tuple[int, float, float, float, float, np.uint64]:
    """Draw one of the waves that leave an interface with a crystal on either side.

    Reflection is drawn with at least the probability ``least``: event, direction, factor of the
    weight, state.
    """
    waves, big_n, field, out = rays.waves, rays.refraction, rays.field, rays.out
    if row_1[KIND] == ISOTROPIC:
        big_n[0], big_n[1], big_n[2] = n1 * way.dx, n1 * way.dy, n1 * way.dz
    for k in range(3):
        field[k] = complex(waves[0, k], waves[0, 3 + k])
    interface_event(
        row_1, row_2, big_n[0], big_n[1], big_n[2], field, -way.nx, -way.ny, -way.nz, out,
        rays.at_interface,
    )  # fmt: skip
    back, through = out[0, 12] + out[1, 12], out[2, 12] + out[3, 12]
    share = back / (back + through)
    chance = likely_enough(share, least)
    state = advance(state)
    u = uniform(state)
    if u < chance:
        factor, first, draw, row = share / chance, 0, u / chance * back, row_1
        happened = _REFLECTED if through > 0.0 else _TIR
    else:
        factor = (1.0 - share) / (1.0 - chance)
        first, draw, row = 2, (u - chance) / (1.0 - chance) * through, row_2
        happened = _REFRACTED
    chosen = first if draw < out[first, 12] or out[first + 1, 12] <= 0.0 else first + 1
    for k in range(3):
        field[k] = complex(out[chosen, 6 + k], out[chosen, 9 + k])
    dx, dy, dz = out[chosen, 3], out[chosen, 4], out[chosen, 5]
    big_n[0], big_n[1], big_n[2] = out[chosen, 0], out[chosen, 1], out[chosen, 2]
    if row[KIND] != ISOTROPIC:
        happened |= _ORDINARY if out[chosen, 15] == 2.0 else _EXTRAORDINARY
        if out[first, 15] > 0.0 and out[first + 1, 15] > 0.0:
            happened |= _SPLIT
            gap = 0.0
            for k in range(3):
                gap = max(gap, abs(out[first, k] - out[first + 1, k]))
            if row[KIND] == BIAXIAL and gap < 1e-9:
                happened = (happened & ~(_ORDINARY | _EXTRAORDINARY)) | _CONICAL
                dx, dy, dz, state = _draw_from_cone(row, out[first], out[first + 1], state, rays)
    size = 0.0
    for k in range(3):
        size += field[k].real ** 2 + field[k].imag ** 2
    scale = 1.0 / math.sqrt(size)
    for k in range(3):
        waves[0, k], waves[0, 3 + k] = scale * field[k].real, scale * field[k].imag
    return happened, dx, dy, dz, factor, state


@inner_kernel
def _draw_from_cone(
    row: F64, wave: F64, other: F64, state: np.uint64, rays: CarriedRays
) -> tuple[float, float, float, np.uint64]:
    """Draw one ray of the cone of a wave on a binormal: a D by the square of its component."""
    n = math.sqrt(wave[0] ** 2 + wave[1] ** 2 + wave[2] ** 2)
    kx, ky, kz = wave[0] / n, wave[1] / n, wave[2] / n
    e11, e22, e33 = row[EPS], row[EPS + 1], row[EPS + 2]
    e12, e13, e23 = row[EPS + 3], row[EPS + 4], row[EPS + 5]
    tx = complex(wave[6] + other[6], wave[9] + other[9])
    ty = complex(wave[7] + other[7], wave[10] + other[10])
    tz = complex(wave[8] + other[8], wave[11] + other[11])
    dx = e11 * tx + e12 * ty + e13 * tz
    dy = e12 * tx + e22 * ty + e23 * tz
    dz = e13 * tx + e23 * ty + e33 * tz
    power = (dx * dx.conjugate() + dy * dy.conjugate() + dz * dz.conjugate()).real
    if abs(kx) < 0.7:
        ux, uy, uz = 0.0, kz, -ky
    else:
        ux, uy, uz = -kz, 0.0, kx
    length = math.sqrt(ux * ux + uy * uy + uz * uz)
    ux, uy, uz = ux / length, uy / length, uz / length
    vx, vy, vz = ky * uz - kz * uy, kz * ux - kx * uz, kx * uy - ky * ux
    a = b = 0.0
    for _ in range(200):
        state = advance(state)
        a, b = turned(0.5 * uniform(state))
        part = dx * (a * ux + b * vx) + dy * (a * uy + b * vy) + dz * (a * uz + b * vz)
        state = advance(state)
        if uniform(state) * power < (part * part.conjugate()).real:
            break
    ox, oy, oz = a * ux + b * vx, a * uy + b * vy, a * uz + b * vz
    # E is the inverse tensor, up to a factor its adjugate, times D
    ex = (e22 * e33 - e23 * e23) * ox + (e13 * e23 - e12 * e33) * oy + (e12 * e23 - e13 * e22) * oz
    ey = (e13 * e23 - e12 * e33) * ox + (e11 * e33 - e13 * e13) * oy + (e12 * e13 - e11 * e23) * oz
    ez = (e12 * e23 - e13 * e22) * ox + (e12 * e13 - e11 * e23) * oy + (e11 * e22 - e12 * e12) * oz
    size = math.sqrt(ex * ex + ey * ey + ez * ez)
    ex /= size
    ey /= size
    ez /= size
    field = rays.field
    field[0], field[1], field[2] = complex(ex, 0.0), complex(ey, 0.0), complex(ez, 0.0)

    # The ray of D: E x (k x E)
    along = ex * kx + ey * ky + ez * kz
    square = ex * ex + ey * ey + ez * ez
    sx, sy, sz = square * kx - along * ex, square * ky - along * ey, square * kz - along * ez
    length = math.sqrt(sx * sx + sy * sy + sz * sz)
    return sx / length, sy / length, sz / length, state


_WAY = Way(0.0, 0.0, 1.0, 0.0, 0.0, -1.0)
_STATE = np.uint64(0)
_RAYS = CarriedRays.create(2)
_LAWS = Amplitudes(np.zeros((1, 1), np.int64), np.zeros(1), np.zeros(1))
_MET = Met(0, 0, 1.0, 1.0)
_CRYSTAL, _SMOOTH, _FOLLOW = range(3)
_DOORS = (
    Door(
        (0, 0.0, 0.0, 0.0, 0.0, _STATE),
        (_RAYS, np.zeros(ROW), np.zeros(ROW), _WAY, 1.0, 0.0, _STATE),
    ),
    Door((0, 0.0, 0.0, 0.0, _STATE), (_LAWS, _RAYS, _MET, 0, 1.0, _WAY, _STATE)),
    Door((0.0, _STATE), (_LAWS, _RAYS, _MET, 0, Turn(*[0.0] * 9), _STATE)),
)
"""What happens to a wave is compiled alone, once for scenes of all kinds."""
_meet_crystal, _meet_smooth, _follow = (door.call for door in _DOORS)


def carried_tasks(carried: Carried | None) -> list[Task]:
    """What is to be compiled where rays carry their state."""
    if carried is None:
        return []
    functions = (meet_crystal_face, meet_smooth_face, follow_natural)
    return [door.task(function) for door, function in zip(_DOORS, functions, strict=True)]


def link_carried(carried: Carried | None) -> None:
    """Fill in the addresses of what happens to waves."""
    for k, task in enumerate(carried_tasks(carried)):
        if carried is not None:
            carried.calls[k] = address_of(task)

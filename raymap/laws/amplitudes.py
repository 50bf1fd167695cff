"""What surfaces do to polarised light: one step of a ray, and the factor of its weight.

Who traces chooses what happens at a face by the shares of natural light. For light of a known state
the share is another one; the ratio of both is a factor of the ray's weight, so that sums of weights
are fluxes of polarised light.

- Smooth interfaces, stacks, metals and facets: complex amplitudes of s and p.
- Scatter about the specular light takes as much of the reflected (refracted) light as its law says,
  at most all of it, and leaves it unpolarised.
- Rough surfaces: amplitudes at the facet between both directions; light that met several facets is
  unpolarised.
- Interfaces of given shares treat s and p alike unless tables are given for each; phases are those
  of the bare interface at total reflection, else of a perfect mirror.

References
----------
Born & Wolf, Principles of Optics, 7th ed., 1.5 and 1.6. Facets: R. G. Priest, S. R. Meier,
Opt. Eng. 41, 988 (2002).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from raymap.jit.kernels import inline_kernel, inner_kernel
from raymap.jit.types import F64, I64
from raymap.laws.jones import (
    BARE,
    DEPOLARISES,
    EVEN,
    EVEN_MIRROR,
    LAYERS,
    METAL,
    POLARISER,
    RETARDER,
    STRAIGHT,
    TABLES,
    JonesRow,
)
from raymap.laws.law import InChannels, Law
from raymap.laws.microfacet import eval_rough_conductor, rough_dielectric_parts
from raymap.laws.microfacet_losses import conductor_table, dielectric_table, side_loss
from raymap.laws.radial import scatter_share
from raymap.laws.table import COATING_SIZE, coating_share
from raymap.model.events import Event
from raymap.optics.frames import frame_about
from raymap.optics.fresnel import cos2_refracted, dielectric_amplitudes, fresnel_amplitudes
from raymap.optics.ggx import ggx_masking, sample_ggx_normal
from raymap.optics.stacks import stack_amplitudes
from raymap.optics.waves import (
    Turn,
    normalise_waves,
    part_along_s,
    polarise_waves,
    retard_waves,
    turn_waves,
)

__all__ = ["Amplitudes", "Met", "all_drawn", "amplitudes_of_laws", "meet_waves", "shares_of_state"]

_THROUGH = int(Event.SPECULAR_REFRACTION)
_SPECULAR = int(Event.SPECULAR_REFLECTION | Event.TIR) | _THROUGH
_TOTAL = int(Event.TIR)
_GLOSSY_THROUGH = int(Event.GLOSSY_TRANSMISSION)
_GLOSSY = int(Event.GLOSSY_REFLECTION) | _GLOSSY_THROUGH
_ABSORBED = int(Event.SURFACE_ABSORPTION)

_SMOOTH = (BARE, EVEN, EVEN_MIRROR, METAL, LAYERS, TABLES)

_F, _FIRST, _STEP, _SCATTER, _SCATTER_STEP, _FACETS = range(6)


class Amplitudes(NamedTuple):
    """Laws of all surfaces as plain tables.

    rows (n_surfaces, 6) : form, place and step by channel of its numbers, the same of a scatter law
        (-1 none), place of a table of facets (-1 smooth)
    roughness (n_surfaces,)
    numbers : flat
    """

    rows: I64
    roughness: F64
    numbers: F64


class Met(NamedTuple):
    """Where light meets a surface: its number (-1 none is known), the channel, indices before and
    beyond."""

    surface: int
    channel: int
    n1: float
    n2: float


def amplitudes_of_laws(laws: Sequence[Law | None], channels: InChannels) -> Amplitudes:
    """Tables of laws; None, a law that is not known, leaves light unpolarised.

    Raises
    ------
    SceneError
        a stack of which nothing can be computed
    """
    rows = np.full((len(laws), 6), -1, np.int64)
    roughness = np.zeros(len(laws))
    pool: list[F64] = []
    size = 0

    def add(numbers: F64) -> int:
        nonlocal size
        pool.append(np.ascontiguousarray(numbers, np.float64).ravel())
        size += pool[-1].size
        return size - pool[-1].size

    for index, law in enumerate(laws):
        row = None if law is None else law.jones(channels)
        row = row or JonesRow(form=DEPOLARISES, numbers=np.zeros((0, 0)))
        rows[index, _F] = row.form
        rows[index, _FIRST], rows[index, _STEP] = add(row.numbers), row.numbers.shape[-1]
        if row.scatter is not None:
            rows[index, _SCATTER] = add(row.scatter)
            rows[index, _SCATTER_STEP] = row.scatter.shape[1] if len(row.scatter) > 1 else 0
        if row.roughness > 0.0:
            facets = dielectric_table if row.form == BARE else conductor_table
            rows[index, _FACETS] = add(facets(row.roughness))
            roughness[index] = row.roughness
    return Amplitudes(rows, roughness, np.concatenate(pool) if pool else np.zeros(0))


@inline_kernel
def meet_waves(
    a: Amplitudes, waves: F64, event: int, met: Met, turn: Turn, u: float, v: float
) -> tuple[float, bool]:
    """What a surface does to the state of a ray, and the factor of its weight.

    Parameters
    ----------
    waves : (2, 6) `raymap.optics.waves`; total power 1 before and, but for a factor of 0, after
    event : what happened, as recorded
    turn : where light ends, both directions are one
    u, v : uniform numbers

    Returns
    -------
    factor, and whether the light that leaves has lost its state: ``waves`` is then to be set anew
    """
    if met.surface < 0:
        turn_waves(waves, turn, -1.0 + 0j if event & _THROUGH == 0 else 1.0 + 0j, 1.0 + 0j)
        return 1.0, False
    form = a.rows[met.surface, _F]
    if form in (POLARISER, RETARDER):
        return _meet_sheet(a, waves, event, met, turn), False
    if form == STRAIGHT:
        return 1.0, False
    if form == DEPOLARISES:
        return 1.0, True
    if event & _ABSORBED != 0:
        return _absorbed(a, waves, met, turn), False
    if a.rows[met.surface, _FACETS] >= 0:
        return _meet_facets(a, waves, event, met, turn, u, v)
    if event & (_SPECULAR | _GLOSSY) == 0:
        return 1.0, True
    through = event & (_THROUGH | _GLOSSY_THROUGH) != 0
    r_s, r_p, t_s, t_p, back, beyond = _amplitudes(a, met, _cosine(turn))
    share = beyond if through else back
    if a.rows[met.surface, _SCATTER] < 0:
        if event & _SPECULAR == 0:
            return 1.0, True
        power = turn_waves(waves, turn, t_s if through else r_s, t_p if through else r_p)
        normalise_waves(waves, power)
        if event & _TOTAL != 0 and share == 1.0:
            return 1.0, False
        return power / share if share > 0.0 else 1.0, False
    # What the law scatters is taken from the specular light
    scattered = _scattered(a, met, through, _cosine(turn))
    taken = min(scattered, share)
    if event & _GLOSSY != 0:
        part = part_along_s(waves, turn)
        s, p = (t_s, t_p) if through else (r_s, r_p)
        power = abs(s) ** 2 * part + abs(p) ** 2 * (1.0 - part)
        if share <= scattered:
            return power / share if share > 0.0 else 1.0, True
        return min(scattered, power) / taken if taken > 0.0 else 1.0, True
    power = turn_waves(waves, turn, t_s if through else r_s, t_p if through else r_p)
    normalise_waves(waves, power)
    left = max(0.0, power - scattered)
    return left / (share - taken) if share > taken else 1.0, False


def all_drawn(a: Amplitudes) -> bool:
    """Whether no surface changes weights of rays that are drawn by `shares_of_state`: each is
    smooth, or sends light on whatever its state."""
    free = np.isin(a.rows[:, _F], (*_SMOOTH, POLARISER, RETARDER, STRAIGHT, DEPOLARISES))
    return bool(np.all(free & (a.rows[:, _FACETS] < 0) & (a.rows[:, _SCATTER] < 0)))


@inner_kernel
def shares_of_state(
    a: Amplitudes, waves: F64, copy: F64, met: Met, turn: Turn
) -> tuple[float, float]:
    """Shares of light in this state that a surface sends back, and through; back is -1 where more
    than these can happen, so that it has none.

    Parameters
    ----------
    waves : (2, 6), stay as they are;  copy : (2, 6) scratch
    turn : direction d of the light, and the normal
    """
    if met.surface < 0:
        return -1.0, 0.0
    form = a.rows[met.surface, _F]
    if form == POLARISER:
        place = a.rows[met.surface, _FIRST] + met.channel * a.rows[met.surface, _STEP]
        for k in range(2):
            for i in range(6):
                copy[k, i] = waves[k, i]
        power = polarise_waves(
            copy, turn.dx, turn.dy, turn.dz, a.numbers[place], a.numbers[place + 1],
            a.numbers[place + 2], math.sqrt(a.numbers[place + 3]),
        )  # fmt: skip
        return 0.0, a.numbers[place + 4] * power
    smooth = form in _SMOOTH
    if not smooth or a.rows[met.surface, _FACETS] >= 0 or a.rows[met.surface, _SCATTER] >= 0:
        return -1.0, 0.0
    r_s, r_p, t_s, t_p, _, _ = _amplitudes(a, met, _cosine(turn))
    s = part_along_s(waves, turn)
    return (
        abs(r_s) ** 2 * s + abs(r_p) ** 2 * (1.0 - s),
        abs(t_s) ** 2 * s + abs(t_p) ** 2 * (1.0 - s),
    )


@inner_kernel
def _cosine(turn: Turn) -> float:
    return min(1.0, max(0.0, -(turn.dx * turn.nx + turn.dy * turn.ny + turn.dz * turn.nz)))


@inner_kernel
def _scattered(a: Amplitudes, met: Met, through: bool, cos_i: float) -> float:
    """Total integrated scatter about the light that is reflected, or refracted."""
    beta = math.sqrt(max(0.0, 1.0 - cos_i * cos_i))
    if through:
        beta = min(1.0, beta * met.n1 / met.n2)
    table = a.rows[met.surface, _SCATTER] + met.channel * a.rows[met.surface, _SCATTER_STEP]
    return scatter_share(a.numbers, table, beta)


@inner_kernel
def _amplitudes(
    a: Amplitudes, met: Met, cos_i: float
) -> tuple[complex, complex, complex, complex, float, float]:
    """r_s, r_p, t_s, t_p as roots of shares of flux; shares of natural light back and through, as
    they are drawn by."""
    form = a.rows[met.surface, _F]
    start = a.rows[met.surface, _FIRST] + met.channel * a.rows[met.surface, _STEP]
    n1, n2 = met.n1, met.n2
    if form == METAL:
        index = complex(a.numbers[start], a.numbers[start + 1])
        r_s, r_p, _, _, _ = fresnel_amplitudes(n1 + 0j, index, cos_i)
        return r_s, r_p, 0j, 0j, 0.5 * (abs(r_s) ** 2 + abs(r_p) ** 2), 0.0
    if form == EVEN_MIRROR:
        root = math.sqrt(a.numbers[start])
        return complex(-root), complex(root), 0j, 0j, a.numbers[start], 0.0
    if form == LAYERS:
        count = int(a.numbers[start + COATING_SIZE])
        first, step = start + COATING_SIZE + 1, 3
        if n1 > n2:
            first, step = first + 3 * (count - 1), -3
        sine = math.sqrt(max(0.0, 1.0 - cos_i * cos_i))
        r_s, r_p, t_s, t_p = stack_amplitudes(n1, n2, sine, a.numbers, first, count, step)
        back, through = coating_share(a.numbers, start, n1, n2, cos_i)
        return r_s, r_p, t_s, t_p, back, through
    r_s, r_p, q_s, q_p, cos_t = dielectric_amplitudes(n1, n2, cos_i)
    if form == BARE:
        root = math.sqrt(n2 * cos_t / (n1 * cos_i)) if cos_t > 0.0 and cos_i > 0.0 else 0.0
        back = 0.5 * (abs(r_s) ** 2 + abs(r_p) ** 2) if cos_t > 0.0 else 1.0
        return r_s, r_p, complex(root * q_s), complex(root * q_p), back, 1.0 - back
    # Shares of a table: both alike, or of each
    back, through = coating_share(a.numbers, start, n1, n2, cos_i)
    s_back, s_through, p_back, p_through = back, through, back, through
    if form == TABLES:
        s_back, s_through = coating_share(a.numbers, start + COATING_SIZE, n1, n2, cos_i)
        p_back, p_through = coating_share(a.numbers, start + 2 * COATING_SIZE, n1, n2, cos_i)
    total = cos_t <= 0.0
    return (
        math.sqrt(s_back) * (r_s if total else -1.0 + 0j),
        math.sqrt(p_back) * (r_p if total else 1.0 + 0j),
        complex(math.sqrt(s_through)), complex(math.sqrt(p_through)), back, through,
    )  # fmt: skip


@inner_kernel
def _absorbed(a: Amplitudes, waves: F64, met: Met, turn: Turn) -> float:
    """Factor of light that is absorbed; where facets are rough, as at their mean plane."""
    if a.rows[met.surface, _F] == EVEN_MIRROR:
        return 1.0
    r_s, r_p, t_s, t_p, back, through = _amplitudes(a, met, _cosine(turn))
    natural = 1.0 - back - through
    if natural <= 1e-9:
        return 1.0
    part = part_along_s(waves, turn)
    s = 1.0 - abs(r_s) ** 2 - abs(t_s) ** 2
    p = 1.0 - abs(r_p) ** 2 - abs(t_p) ** 2
    return max(0.0, part * s + (1.0 - part) * p) / natural


@inner_kernel
def _meet_sheet(a: Amplitudes, waves: F64, event: int, met: Met, turn: Turn) -> float:
    """Polarisers and retarders, which light crosses as it comes."""
    first = a.rows[met.surface, _FIRST] + met.channel * a.rows[met.surface, _STEP]
    bx, by, bz = a.numbers[first], a.numbers[first + 1], a.numbers[first + 2]
    last = a.numbers[first + 3]
    dx, dy, dz = turn.dx, turn.dy, turn.dz
    if a.rows[met.surface, _F] == RETARDER:
        if event & _ABSORBED == 0:
            retard_waves(waves, dx, dy, dz, bx, by, bz, last)
        return 1.0
    # Shares of natural light: half of what vibrates across the axis, and what leaks
    natural, clear = 0.5 * (1.0 + last), a.numbers[first + 4]
    power = polarise_waves(waves, dx, dy, dz, bx, by, bz, math.sqrt(last))
    normalise_waves(waves, power)
    if event & _ABSORBED != 0:
        return float((1.0 - clear * power) / (1.0 - clear * natural))
    return float(power / natural)


@inner_kernel
def _meet_facets(
    a: Amplitudes, waves: F64, event: int, met: Met, turn: Turn, u: float, v: float
) -> tuple[float, bool]:
    """Rough surfaces: one facet, or several, after which light is unpolarised."""
    dx, dy, dz, ox, oy, oz, nx, ny, nz = turn
    through = event & _GLOSSY_THROUGH != 0
    # Directions in a frame of the surface: only angles to its normal and to each other matter
    wi_z = _cosine(turn)
    wo_z = ox * nx + oy * ny + oz * nz
    sine_i = math.sqrt(max(0.0, 1.0 - wi_z * wi_z))
    sine_o = math.sqrt(max(0.0, 1.0 - wo_z * wo_z))
    both = -(dx * ox + dy * oy + dz * oz)
    cosine = 1.0
    if sine_i > 0.0 and sine_o > 0.0:
        cosine = max(-1.0, min(1.0, (both - wi_z * wo_z) / (sine_i * sine_o)))
    wo_x, wo_y = sine_o * cosine, sine_o * math.sqrt(max(0.0, 1.0 - cosine * cosine))
    table, alpha = a.rows[met.surface, _FACETS], a.roughness[met.surface]
    if a.rows[met.surface, _F] == BARE:
        single, several = rough_dielectric_parts(
            a.numbers, table, sine_i, 0.0, wi_z, wo_x, wo_y, wo_z, alpha, met.n1, met.n2
        )
    else:
        single, several, cos_m = eval_rough_conductor(
            a.numbers, table, sine_i, 0.0, wi_z, wo_x, wo_y, wo_z, alpha
        )
        _, _, _, _, back, _ = _amplitudes(a, met, min(1.0, cos_m))
        single *= back
        last = a.rows[met.surface, _FIRST] + (met.channel + 1) * a.rows[met.surface, _STEP] - 1
        several *= a.numbers[last]
    chosen = u * (single + several) - single
    if chosen >= 0.0:
        if a.rows[met.surface, _F] != BARE:
            return 1.0, True
        return _lost_facet(a, waves, met, turn, chosen / several, v), True
    # The facet that turns the one direction into the other
    if through:
        hx, hy, hz = met.n2 * ox - met.n1 * dx, met.n2 * oy - met.n1 * dy, met.n2 * oz - met.n1 * dz
    else:
        hx, hy, hz = ox - dx, oy - dy, oz - dz
    length = math.sqrt(hx * hx + hy * hy + hz * hz)
    if length < 1e-9:
        return 1.0, False
    scale = -1.0 / length if dx * hx + dy * hy + dz * hz > 0.0 else 1.0 / length
    facet = Turn(dx, dy, dz, ox, oy, oz, hx * scale, hy * scale, hz * scale)
    r_s, r_p, t_s, t_p, back, beyond = _amplitudes(a, met, _cosine(facet))
    power = turn_waves(waves, facet, t_s if through else r_s, t_p if through else r_p)
    normalise_waves(waves, power)
    share = beyond if through else back
    return power / share if share > 0.0 else 1.0, False


@inner_kernel
def _lost_facet(a: Amplitudes, waves: F64, met: Met, turn: Turn, u: float, v: float) -> float:
    """Factor of light that met several facets of an interface: of this state as much is sent into
    a second facet as the others leave, of natural light the loss of the table.

    An unbiased estimate, from one facet that the light may have met first.
    """
    dx, dy, dz, _, _, _, nx, ny, nz = turn
    ux, uy, uz, vx, vy, vz = frame_about(nx, ny, nz)
    wi_x, wi_y = -(dx * ux + dy * uy + dz * uz), -(dx * vx + dy * vy + dz * vz)
    wi_z, alpha = _cosine(turn), a.roughness[met.surface]
    mx, my, mz = sample_ggx_normal(wi_x, wi_y, wi_z, alpha, u, v)
    facet = Turn(
        dx, dy, dz, dx, dy, dz, mx * ux + my * vx + mz * nx, mx * uy + my * vy + mz * ny,
        mx * uz + my * vz + mz * nz,
    )  # fmt: skip
    cos_m = _cosine(facet)
    r_s, r_p, _, _, _, _ = _amplitudes(a, met, cos_m)
    part = part_along_s(waves, facet)
    back = abs(r_s) ** 2 * part + abs(r_p) ** 2 * (1.0 - part)
    # Cosines at which light would leave the facet's surroundings, on either side
    up = 2.0 * cos_m * mz - wi_z
    lost = back * (1.0 - (ggx_masking(alpha, up) if up > 0.0 else 0.0))
    eta = met.n1 / met.n2
    square = cos2_refracted(eta, cos_m)
    if square > 0.0:
        down = -((eta * cos_m - math.sqrt(square)) * mz - eta * wi_z)
        lost += (1.0 - back) * (1.0 - (ggx_masking(alpha, down) if down > 0.0 else 0.0))
    loss = side_loss(a.numbers, a.rows[met.surface, _FACETS], eta, wi_z)
    return lost / loss if loss > 0.0 else 1.0

"""One path through crystals per ray, chosen by flux: the kernel behind recorded maps.

At every boundary one of the rays that leave is drawn with its share of the flux, so every ray of a
source carries equal flux. The polarisation is carried along as a field vector, in crystals and in
the world between them. On a binormal of a biaxial crystal one ray of the cone is drawn.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from raymap.jit.kernels import inner_kernel, kernel
from raymap.model.events import Event
from raymap.optics.angles import turned
from tracer.crystals.bodies import BodyArrays
from tracer.crystals.interface import InterfaceScratch, interface_event
from tracer.crystals.rows import BIAXIAL, EPS, EPS_ORDINARY, ISOTROPIC, KIND
from tracer.crystals.tree import body_behind, next_boundary, tree_scratch
from tracer.crystals.waves import ray_absorption
from tracer.rays.directions import sine_of
from tracer.rays.random import advance, stream_state, uniform

__all__ = ["DETECTOR_ROW", "SOURCE_ROW", "CompiledCrystals", "trace_paths"]

Array = np.ndarray[Any, np.dtype[Any]]

SOURCE_ROW = 14
"""Columns of a source: centre (3), axis (3), radius, cosine of the half cone, polarisation (3,
zero = natural light), first axis of the disc (3)."""

DETECTOR_ROW = 14
"""Columns of a detector: centre (3), u (3), v (3), normal (3), width, height."""

_EMITTED = int(Event.EMITTED)
_REFLECTED = int(Event.SPECULAR_REFLECTION)
_REFRACTED = int(Event.SPECULAR_REFRACTION)
_TIR = int(Event.TIR)
_SPLIT = int(Event.BIREFRINGENT_SPLIT)
_ORDINARY = int(Event.ORDINARY)
_EXTRAORDINARY = int(Event.EXTRAORDINARY)
_CONICAL = int(Event.CONICAL_REFRACTION)
_CHANGED = int(Event.MEDIUM_CHANGED)
_SURFACE = int(Event.SURFACE_ABSORPTION)
_VOLUME = int(Event.VOLUME_ABSORPTION)
_LEFT = int(Event.LEFT_SCENE)
_DEPTH = int(Event.DEPTH_LIMIT)
_ERROR = int(Event.GEOMETRY_ERROR)
_CROSSED = int(Event.DETECTOR_CROSSED)
_REGISTERED = int(Event.DETECTOR_REGISTERED)


@inner_kernel
def _emit(source: Array, state: np.uint64, p: Array, d: Array, field: Array) -> np.uint64:
    """A point of the disc, a direction of the cone, a polarisation across it."""
    ux, uy, uz = source[11], source[12], source[13]
    ax, ay, az = source[3], source[4], source[5]
    vx = ay * uz - az * uy
    vy = az * ux - ax * uz
    vz = ax * uy - ay * ux
    state = advance(state)
    radius = source[6] * math.sqrt(uniform(state))
    state = advance(state)
    c, s = turned(uniform(state))
    a, b = radius * c, radius * s
    p[0] = source[0] + a * ux + b * vx
    p[1] = source[1] + a * uy + b * vy
    p[2] = source[2] + a * uz + b * vz

    # Even over the solid angle of the cone
    state = advance(state)
    cosine = 1.0 - uniform(state) * (1.0 - source[7])
    sine = sine_of(cosine)
    state = advance(state)
    c, s = turned(uniform(state))
    a, b = sine * c, sine * s
    d[0] = cosine * ax + a * ux + b * vx
    d[1] = cosine * ay + a * uy + b * vy
    d[2] = cosine * az + a * uz + b * vz

    # Natural light: a random azimuth
    ex, ey, ez = source[8], source[9], source[10]
    state = advance(state)
    if ex == 0.0 and ey == 0.0 and ez == 0.0:
        a, b = turned(0.5 * uniform(state))
        ex, ey, ez = a * ux + b * vx, a * uy + b * vy, a * uz + b * vz
    along = ex * d[0] + ey * d[1] + ez * d[2]
    ex -= along * d[0]
    ey -= along * d[1]
    ez -= along * d[2]
    size = math.sqrt(ex * ex + ey * ey + ez * ez)
    field[0] = complex(ex / size, 0.0)
    field[1] = complex(ey / size, 0.0)
    field[2] = complex(ez / size, 0.0)
    return state


@inner_kernel
def _draw_from_cone(
    row: Array, wave: Array, other: Array, state: np.uint64, field: Array, d: Array
) -> np.uint64:
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
    field[0], field[1], field[2] = complex(ex, 0.0), complex(ey, 0.0), complex(ez, 0.0)

    # The ray of D: E x (k x E)
    along = ex * kx + ey * ky + ez * kz
    square = ex * ex + ey * ey + ez * ez
    sx, sy, sz = square * kx - along * ex, square * ky - along * ey, square * kz - along * ez
    length = math.sqrt(sx * sx + sy * sy + sz * sz)
    d[0], d[1], d[2] = sx / length, sy / length, sz / length
    return state


@inner_kernel
def _cross_detectors(
    detectors: Array,
    blocking: Array,
    p: Array,
    d: Array,
    limit: float,
) -> tuple[float, int]:
    """Nearest blocking detector before ``limit``: distance and number, else limit and -1."""
    best = limit
    found = -1
    for k in range(detectors.shape[0]):
        if blocking[k]:
            t, u, _, _ = _meet_plane(detectors[k], p, d)
            if u >= 0.0 and t < best:
                best = t
                found = k
    return best, found


@inner_kernel
def _meet_plane(s: Array, p: Array, d: Array) -> tuple[float, float, float, float]:
    """Distance, u, v and cosine against the looking direction; u = -1 for a miss."""
    slope = d[0] * s[9] + d[1] * s[10] + d[2] * s[11]
    if slope == 0.0:
        return 0.0, -1.0, 0.0, 0.0
    t = ((s[0] - p[0]) * s[9] + (s[1] - p[1]) * s[10] + (s[2] - p[2]) * s[11]) / slope
    if t <= 0.0:
        return 0.0, -1.0, 0.0, 0.0
    x = p[0] + t * d[0] - s[0]
    y = p[1] + t * d[1] - s[1]
    z = p[2] + t * d[2] - s[2]
    u = (x * s[3] + y * s[4] + z * s[5]) / s[12] + 0.5
    v = (x * s[6] + y * s[7] + z * s[8]) / s[13] + 0.5
    if u < 0.0 or u > 1.0 or v < 0.0 or v > 1.0:
        return 0.0, -1.0, 0.0, 0.0
    return t, u, v, -slope


class CompiledCrystals(NamedTuple):
    """A scene of crystals as tables.

    media : (n_channels, n_bodies + 1, ROW), the world last
    body_medium : (n_bodies,) medium numbers of the map, 0 = world
    k0 : (n_channels,) 2 pi / wavelength [1/mm]
    sources : (n, SOURCE_ROW);  detectors : (n, DETECTOR_ROW), with blocking, cells, object number
    sphere : (4,) centre and radius
    """

    bodies: BodyArrays
    media: Array
    body_medium: Array
    k0: Array
    sources: Array
    detectors: Array
    blocking: Array
    cells: Array
    detector_object: Array
    sphere: Array


@kernel
def trace_paths(
    scene: CompiledCrystals,
    seed: int,
    first_ray: int,
    n_rays: int,
    depth: int,
    counts: Array,
    reals: Array,
    words: Array,
    meetings: Array,
) -> tuple[int, int]:
    """Trace rays one by one and write their records in ray order.

    Parameters
    ----------
    depth : most records of a ray after its first
    counts : (n_rays,) records per ray
    reals : (n_records, 6) position and normal;  words : (n_records, 6) object, triangle, event,
        medium, channel, number of descriptors
    meetings : (n, 7) detector, cell u, cell v, cosine x 1e9 (> 0: registered), u x 65535,
        v x 65535, distance x 1e9

    Returns
    -------
    numbers of records and meetings; -1 where an array was too small
    """
    bodies, media, body_medium, k0 = scene.bodies, scene.media, scene.body_medium, scene.k0
    sources, detectors, blocking = scene.sources, scene.detectors, scene.blocking
    cells, detector_object, sphere = scene.cells, scene.detector_object, scene.sphere
    scratch = tree_scratch(2)
    at_interface = InterfaceScratch(scratch[0], scratch[1], scratch[2], scratch[3])
    out = scratch[4][0]
    field = scratch[8]
    stack = scratch[9]
    p = np.zeros(3)
    d = np.zeros(3)
    n_channels = media.shape[0]
    world = media.shape[1] - 1
    n_detectors = detectors.shape[0]
    r = 0
    m = 0
    for i in range(n_rays):
        if r + depth + 2 > words.shape[0] or m + n_detectors * (depth + 2) > meetings.shape[0]:
            return -1, -1
        ray = first_ray + i
        source = ray % sources.shape[0]
        channel = (ray // sources.shape[0]) % n_channels
        state = _emit(sources[source], stream_state(seed, ray), p, d, field)
        start = r
        n = math.sqrt(media[channel, world, EPS_ORDINARY])
        big_n = (n * d[0], n * d[1], n * d[2])
        body = -1
        left = -1
        _write(reals, words, r, p, sources[source, 3:6], 1.0, -1, -1, _EMITTED, 0, channel)
        r += 1
        while True:
            # Find the end of the segment: boundary, blocking detector, absorption, or nothing
            t, met, nx, ny, nz, primitive = next_boundary(
                bodies, p, d[0], d[1], d[2], body, left, stack
            )
            stop = -1
            if body < 0:
                t, stop = _cross_detectors(detectors, blocking, p, d, t)
            event = 0
            row_1 = media[channel, body] if body >= 0 else media[channel, world]
            if body >= 0:
                rate = ray_absorption(
                    row_1, big_n[0], big_n[1], big_n[2], field[0], field[1], field[2]
                )
                if rate > 0.0:
                    state = advance(state)
                    flight = -math.log(1.0 - uniform(state)) / (rate * k0[channel])
                    if flight < t:
                        t = flight
                        event = _VOLUME
            if event == 0 and met < 0 and stop < 0:
                event = _LEFT if body < 0 else _ERROR
                t = 0.0 if event == _ERROR else _to_sphere(sphere, p, d)

            # Note the detectors on the way, in the order of their distance
            first = m
            for k in range(n_detectors):
                if blocking[k] and k != stop:
                    continue
                s, u, v, facing = _meet_plane(detectors[k], p, d)
                if u < 0.0 or s > t * (1.0 + 1e-12):
                    continue
                meetings[m, 0] = k
                meetings[m, 1] = min(cells[k, 0] - 1, int(u * cells[k, 0]))
                meetings[m, 2] = min(cells[k, 1] - 1, int(v * cells[k, 1]))
                meetings[m, 3] = int(facing * 1e9)
                meetings[m, 4] = int(u * 65535.0 + 0.5)
                meetings[m, 5] = int(v * 65535.0 + 0.5)
                meetings[m, 6] = int(s * 1e9)
                j = m
                while j > first and meetings[j - 1, 6] > meetings[j, 6]:
                    for c in range(7):
                        swap = meetings[j, c]
                        meetings[j, c] = meetings[j - 1, c]
                        meetings[j - 1, c] = swap
                    j -= 1
                m += 1
                words[r - 1, 5] += 1
                words[r - 1, 2] |= _CROSSED | (_REGISTERED if facing > 0.0 else 0)
            for c in range(3):
                p[c] += t * d[c]
            if event == _LEFT:
                _write(reals, words, r, p, d, 1.0, -1, -1, event, 0, channel)
            elif event != 0:
                _write(reals, words, r, p, d, 0.0, -1, -1, event, body_medium[body], channel)
            elif stop >= 0:
                _, _, _, facing = _meet_plane(detectors[stop], p - d, d)
                event = _SURFACE | (_REGISTERED if facing > 0.0 else 0)
                _write(
                    reals, words, r, p, detectors[stop, 9:12], 1.0, detector_object[stop], 0,
                    event, 0, channel,
                )  # fmt: skip
            if event != 0:
                r += 1
                break

            # Meet the boundary and draw one of the rays that leave
            behind = met
            flip = -1.0
            if body >= 0:
                behind = -1
                flip = 1.0
                if bodies.contacts:
                    behind = body_behind(bodies, body, p[0], p[1], p[2], nx, ny, nz)
            row_2 = media[channel, behind] if behind >= 0 else media[channel, world]
            interface_event(
                row_1, row_2, big_n[0], big_n[1], big_n[2], field, flip * nx, flip * ny, flip * nz,
                out, at_interface,
            )  # fmt: skip
            state = advance(state)
            draw = uniform(state) * (out[0, 12] + out[1, 12] + out[2, 12] + out[3, 12])
            chosen = -1
            for j in range(4):
                if out[j, 12] > 0.0:
                    chosen = j
                    draw -= out[j, 12]
                    if draw < 0.0:
                        break
            through = chosen >= 2
            target = behind if through else body
            row = row_2 if through else row_1
            if through:
                event = _REFRACTED | _CHANGED
            elif out[2, 12] + out[3, 12] > 0.0:
                event = _REFLECTED
            else:
                event = _TIR
            reals[r, 3], reals[r, 4], reals[r, 5] = nx, ny, nz
            for c in range(3):
                field[c] = complex(out[chosen, 6 + c], out[chosen, 9 + c])
                d[c] = out[chosen, 3 + c]
            big_n = (out[chosen, 0], out[chosen, 1], out[chosen, 2])
            if row[KIND] != ISOTROPIC:
                pair = 2 if through else 0
                event |= _ORDINARY if out[chosen, 15] == 2.0 else _EXTRAORDINARY
                if out[pair, 15] > 0.0 and out[pair + 1, 15] > 0.0:
                    event |= _SPLIT
                    gap = 0.0
                    for c in range(3):
                        gap = max(gap, abs(out[pair, c] - out[pair + 1, c]))
                    if row[KIND] == BIAXIAL and gap < 1e-9:
                        event = (event & ~(_ORDINARY | _EXTRAORDINARY)) | _CONICAL
                        state = _draw_from_cone(row, out[pair], out[pair + 1], state, field, d)
            size = 0.0
            for c in range(3):
                size += (field[c] * field[c].conjugate()).real
            for c in range(3):
                field[c] *= 1.0 / math.sqrt(size)
            left = body if through and body >= 0 else (met if body < 0 and not through else -1)
            if r - start >= depth:
                event = _DEPTH
            medium = body_medium[target] if target >= 0 else 0
            _write_words(reals, words, r, p, met, primitive, event, medium, channel)
            r += 1
            body = target
            if event == _DEPTH:
                break
        counts[i] = r - start
    return r, m


@inner_kernel
def _to_sphere(sphere: Array, p: Array, d: Array) -> float:
    """Distance to the far side of the bounding sphere."""
    b = 0.0
    c = -sphere[3] * sphere[3]
    for k in range(3):
        w = p[k] - sphere[k]
        b += w * d[k]
        c += w * w
    return max(0.0, -b + math.sqrt(max(0.0, b * b - c)))


@inner_kernel
def _write(
    reals: Array,
    words: Array,
    r: int,
    p: Array,
    normal: Array,
    scale: float,
    item: int,
    triangle: int,
    event: int,
    medium: int,
    channel: int,
) -> None:
    for c in range(3):
        reals[r, 3 + c] = scale * normal[c]
    _write_words(reals, words, r, p, item, triangle, event, medium, channel)


@inner_kernel
def _write_words(
    reals: Array,
    words: Array,
    r: int,
    p: Array,
    item: int,
    triangle: int,
    event: int,
    medium: int,
    channel: int,
) -> None:
    for c in range(3):
        reals[r, c] = p[c]
    words[r, 0] = item
    words[r, 1] = triangle
    words[r, 2] = event
    words[r, 3] = medium
    words[r, 4] = channel
    words[r, 5] = 0

"""What happens to rays at the end of their way: absorption, scattering, surfaces, records.

One loop over the live rays: it finishes the segment of each ray (detectors passed, free flight in
the medium, the face met), writes the record of the point reached, and packs the rays that go on to
the front of the columns.
"""

from __future__ import annotations

import math

import numpy as np

from raymap.jit.kernels import (
    inline_kernel,
    inner_kernel,
    lean_kernel,
    number,
    stage_kernel,
    unsigned,
)
from raymap.jit.types import F64, I64
from raymap.model.events import Event
from raymap.optics.frames import unit_factor
from raymap.optics.waves import Turn
from tracer.compiled import (
    B_MEDIUM,
    DEPTH,
    F_AXIS,
    F_DETECTOR,
    F_EVENT,
    F_INSIDE,
    F_KIND,
    F_OBJECT,
    F_SURFACE,
    F_TRIANGLE,
    L_MEDIUM,
    L_STACK,
    M_PARTICIPATING,
    SINGLE,
    SOURCE_ROW,
    VIRTUAL,
    WORLD,
    CompiledScene,
)
from tracer.geometry.kinds import MESH
from tracer.geometry.normals import face_normal
from tracer.media.volumes import fly_freely, passes_surely
from tracer.rays.colors import COLORS, pick_channel
from tracer.rays.random import advance, stream_state, uniform
from tracer.sources.lights import emit_light
from tracer.surfaces.interaction import Interface, Light, Way, optics_of
from tracer.transport.buffers import (
    CODE,
    DESCRIPTORS,
    HIT,
    IGNORED,
    KEY,
    LAST,
    LIVE,
    MEDIUM,
    MESH_BODY,
    MESH_NORMAL,
    MESH_POINT,
    MESH_SHADING,
    MESH_TRIANGLE,
    N_RECORDS,
    OWN,
    OWN_BODY,
    OWN_TRIANGLE,
    RAY,
    RECORDS,
    RNG,
    STACK,
    WEIGHT,
    Buffers,
    T,
)
from tracer.transport.carried import (
    Sides,
    carry_scattered,
    fly_in_crystal,
    keep_state,
    meet_as_carried,
    plane_normal,
    start_state,
    take_state,
)
from tracer.transport.cross_face import any_coincident, cross_face, left_together
from tracer.transport.medium_stack import top_body
from tracer.transport.records import ENDING, Record, RecordColumns, write_record
from tracer.transport.register_crossings import (
    Descriptors,
    Detectors,
    Segment,
    near_planes,
    pass_planes,
    pass_views,
    register_on_face,
)
from tracer.transport.splitting import (
    Fork,
    SplitRays,
    gather_split_rays,
    release_split_ray,
    split_code,
    split_event,
)
from tracer.transport.streams import DONE
from tracer.transport.weighted.balance import Flight
from tracer.transport.weighted.outcomes import aim_in_volume, end_faint_ray
from tracer.transport.weighted.ray import WeightedRay

__all__ = ["emit_block", "interact", "place_block"]

EMITTED = int(Event.EMITTED)
LEFT_SCENE = int(Event.LEFT_SCENE)
DEPTH_LIMIT = int(Event.DEPTH_LIMIT)
GEOMETRY_ERROR = int(Event.GEOMETRY_ERROR)
RIM_HIT = int(Event.RIM_HIT)
MEDIUM_CHANGED = int(Event.MEDIUM_CHANGED)

_AT_EDGE = 1e-9
"""Share of the scene's radius below which a hit from the wrong side is rounding at an edge."""
_OFF = 1e-13
"""Share of the scene's radius that takes a ray off a face: more than rounding, far below the above,
so that it counts as rounding at all but grazing incidence."""
_ROUNDING, _STEP = 1e-12, 1e-15
"""The same for scenes far from the origin, as shares of its distance: rounding grows with it."""


@stage_kernel
def emit_block(scene: CompiledScene, seed: int, first_ray: int, n: int, b: Buffers) -> None:
    """Start the rays ``first_ray`` to ``first_ray + n`` and write their first records."""
    source_i, source_f, pattern = scene.source_i, scene.source_f, scene.pattern
    live_f, live_i, ray_i, counters = b.live_f, b.live_i, b.ray_i, b.counters
    columns, exact, colors = RecordColumns(b.words, b.real, b.owners), b.exact, b.colors
    n_sources, n_channels = len(source_i), colors.shape[1]
    for source in range(n_sources):
        for channel in range(n_channels):
            colors[source, channel] = source_f[source, SOURCE_ROW + channel]
    counters[LIVE] = n
    counters[RECORDS] = 0
    counters[DESCRIPTORS] = 0
    counters[COLORS] = n_sources
    first_key = 2 * len(scene.face_i)
    pool, rays = scene.light_pool, scene.light_rays
    for i in range(n):
        source, x, y, z, dx, dy, dz, nx, ny, nz, code, state = emit_light(
            source_i, source_f, pattern, pool, rays, colors, counters, seed, first_ray + i
        )
        if scene.limits[SINGLE] != 0 and code >= n_channels:
            state = advance(state)
            code = pick_channel(colors, code, uniform(state))
        live_f[0, i], live_f[1, i], live_f[2, i] = x, y, z
        live_f[3, i], live_f[4, i], live_f[5, i] = dx, dy, dz
        live_f[WEIGHT, i] = 1.0
        live_i[OWN, i] = -1
        live_i[KEY, i] = first_key + source
        if len(live_f) > MESH_POINT:
            live_i[OWN_BODY, i] = -1
        live_i[STACK, i] = source_i[source, L_STACK]
        live_i[MEDIUM, i] = source_i[source, L_MEDIUM]
        live_i[CODE, i] = code
        state = start_state(scene.carried, b.carried, i, source, dx, dy, dz, state)
        live_i[RNG, i] = np.int64(state)
        live_i[RAY, i] = i
        live_i[LAST, i] = i
        start = Record(x, y, z, nx, ny, nz, -1, -1, EMITTED, source_i[source, L_MEDIUM], code, i)
        write_record(columns, i, start)
        if len(exact) > 0:
            exact[i, 0], exact[i, 1], exact[i, 2] = x, y, z
        ray_i[N_RECORDS, i] = 1
    counters[RECORDS] = n


@lean_kernel
def place_block(
    scene: CompiledScene, seed: int, first: int, n: int, origins: F64, directions: F64, b: Buffers
) -> None:
    """Start given rays, rows ``first`` to ``first + n``, as light of the first channel."""
    live_f, live_i, counters = b.live_f, b.live_i, b.counters
    world = scene.limits[WORLD]
    for i in range(n):
        for k in range(3):
            live_f[k, i] = origins[first + i, k]
            live_f[3 + k, i] = directions[first + i, k]
        live_f[WEIGHT, i] = 1.0
        live_i[OWN, i] = -1
        live_i[KEY, i] = 2 * len(scene.face_i) + len(scene.source_i)
        if len(live_f) > MESH_POINT:
            live_i[OWN_BODY, i] = -1
        live_i[STACK, i] = 0
        live_i[MEDIUM, i] = world
        live_i[CODE, i] = 0
        dx, dy, dz = live_f[3, i], live_f[4, i], live_f[5, i]
        state = stream_state(seed, first + i)
        state = start_state(scene.carried, b.carried, i, -1, dx, dy, dz, state)
        live_i[RNG, i] = np.int64(state)
        live_i[RAY, i] = i
        live_i[LAST, i] = i
        x, y, z = live_f[0, i], live_f[1, i], live_f[2, i]
        start = Record(x, y, z, 0.0, 0.0, 0.0, -1, -1, EMITTED, world, 0, i)
        write_record(RecordColumns(b.words, b.real, b.owners), i, start)
        if len(b.exact) > 0:
            b.exact[i, 0], b.exact[i, 1], b.exact[i, 2] = x, y, z
        b.ray_i[N_RECORDS, i] = 1
    counters[LIVE] = n
    counters[RECORDS] = n
    counters[DESCRIPTORS] = 0
    counters[COLORS] = len(scene.source_i)


@stage_kernel
def interact(scene: CompiledScene, b: Buffers, split: SplitRays | None, follow: int) -> None:
    """Bring every live ray to the end of its segment; keep those that go on.

    ``follow`` = 0 chooses at random; 1 takes the transmitted ray wherever there is one. Rays split
    with room for them in ``split``.
    """
    face_i, face_f, body_i = scene.face_i, scene.face_f, scene.body_i
    medium_i, medium_f, tables = scene.medium_i, scene.medium_f, scene.tables
    optics = optics_of(scene)
    detectors = Detectors(scene.detector_i, scene.detector_f)
    sphere, world, depth = scene.sphere, scene.limits[WORLD], scene.limits[DEPTH]
    virtual, reduction, views = scene.limits[VIRTUAL], scene.reduction, scene.views
    live_f, live_i, ray_i, ray_f = b.live_f, b.live_i, b.ray_i, b.ray_f
    exact, colors, counters = b.exact, b.colors, b.counters
    columns = RecordColumns(b.words, b.real, b.owners)
    descriptors = Descriptors(b.words, b.crossings, b.crossing_t, b.counters)
    n_channels = colors.shape[1]
    volume_key = 2 * len(face_i) + len(scene.source_i)
    far = max(abs(sphere[0]), abs(sphere[1]), abs(sphere[2]))
    tiny = max(_AT_EDGE * sphere[3], _ROUNDING * far)
    off = max(_OFF * sphere[3], _STEP * far)
    meshed = len(live_f) > MESH_POINT
    kept = number(0)
    r = counters[RECORDS]
    for slot in range(counters[LIVE]):
        i = unsigned(slot)
        if live_i[HIT, i] == DONE:
            if kept != slot:
                _pack(live_f, live_i, i, unsigned(kept))
            kept += 1
            continue
        x, y, z = live_f[0, i], live_f[1, i], live_f[2, i]
        dx, dy, dz = live_f[3, i], live_f[4, i], live_f[5, i]
        t, face = live_f[T, i], live_i[HIT, i]
        stack, medium, code = live_i[STACK, i], live_i[MEDIUM, i], live_i[CODE, i]
        state = np.uint64(live_i[RNG, i])
        ray, last, weight = live_i[RAY, i], live_i[LAST, i], live_f[WEIGHT, i]
        ux, uy, uz = dx, dy, dz
        nx, ny, nz = 0.0, 0.0, 0.0
        obj, triangle, event = -1, -1, 0
        key, own = volume_key, -1
        own_body, own_triangle = -1, -1
        ignored = False
        cosine, stack_before, medium_before = 0.0, stack, medium
        take_state(b.carried, i)
        event, t, state = fly_in_crystal(scene.carried, b.carried, body_i, code, stack, t, state)
        # Fly freely through a medium that absorbs or scatters
        participating = medium_i[unsigned(medium), M_PARTICIPATING]
        if participating != 0 and passes_surely(
            participating, medium_f, unsigned(medium), t, code, n_channels, state
        ):
            state = advance(state)
        elif participating != 0:
            event, t, dx, dy, dz, code, state = fly_freely(
                medium_i, medium_f, tables, medium, t, dx, dy, dz, code, colors, counters, state
            )
            dx, dy, dz, weight, state = aim_in_volume(
                reduction, event,
                Flight(x + t * ux, y + t * uy, z + t * uz, ux, uy, uz, dx, dy, dz),
                medium_f, tables, medium, n_channels, weight, state,
            )  # fmt: skip
            weight, state = carry_scattered(
                b.carried, event, medium_f[unsigned(medium), 3 * n_channels],
                Turn(ux, uy, uz, dx, dy, dz, 0.0, 0.0, 0.0), weight, state,
            )  # fmt: skip
        if event == 0 and face < 0:
            event = LEFT_SCENE
            t = _to_sphere(sphere, x, y, z, dx, dy, dz)
        segment = Segment(last, x, y, z, ux, uy, uz, t)
        if virtual != 0 and near_planes(sphere, x, y, z, ux, uy, uz, t):
            pass_planes(detectors, segment, tiny, descriptors)
        pass_views(views, detectors, segment, event == LEFT_SCENE, descriptors)
        x += t * ux
        y += t * uy
        z += t * uz
        if event == LEFT_SCENE:
            nx, ny, nz = dx, dy, dz
        elif event == 0:
            # Meet the face: find out where the ray goes if it crosses
            met = unsigned(face)
            if face_i[met, F_KIND] == MESH:
                x, y, z = (
                    live_f[MESH_POINT, i],
                    live_f[MESH_POINT + 1, i],
                    live_f[MESH_POINT + 2, i],
                )
                nx, ny, nz = (
                    live_f[MESH_NORMAL, i],
                    live_f[MESH_NORMAL + 1, i],
                    live_f[MESH_NORMAL + 2, i],
                )
                own_body, own_triangle = live_i[MESH_BODY, i], live_i[MESH_TRIANGLE, i]
            else:
                nx, ny, nz = face_normal(face_i[met, F_KIND], face_f, met, scene.pool, x, y, z)
            cosine = dx * nx + dy * ny + dz * nz
            beyond, counting = cross_face(
                scene.coincident, face_i, face_f, scene.pool, body_i, met, stack, cosine, x, y, z
            )
            if any_coincident(scene.coincident) and counting != face:
                # Another face lies here and counts: it gives normal, name and surface
                met = unsigned(counting)
                nx, ny, nz = face_normal(face_i[met, F_KIND], face_f, met, scene.pool, x, y, z)
                cosine = dx * nx + dy * ny + dz * nz
            if t < tiny and left_together(scene.coincident, face_i, live_i[OWN, i], face):
                beyond = -1
            if beyond < 0 and t < tiny:
                # Rounding at an edge: the ray is on the right side already; get it off the face
                ignored = True
                counters[IGNORED] += 1
                x, y, z = x + off * dx, y + off * dy, z + off * dz
            elif (
                beyond >= 0
                and top_body(beyond, body_i) == top_body(stack, body_i)
                and face_i[met, F_INSIDE] >= 0
            ):
                ignored = True
                stack = beyond
            own = int(met)
            if not ignored:
                obj, triangle = face_i[met, F_OBJECT], face_i[met, F_TRIANGLE]
                sx, sy, sz, shading = nx, ny, nz, cosine
                if own_body >= 0:
                    triangle = own_triangle
                    # Use the interpolated normal where it sees the ray from the same side
                    ax, ay, az = (
                        live_f[MESH_SHADING, i],
                        live_f[MESH_SHADING + 1, i],
                        live_f[MESH_SHADING + 2, i],
                    )
                    along = dx * ax + dy * ay + dz * az
                    if along * cosine > 0.0:
                        sx, sy, sz, shading = ax, ay, az, along
                event = face_i[met, F_EVENT]
                if beyond < 0:
                    event |= GEOMETRY_ERROR
                else:
                    body = top_body(beyond, body_i)
                    other = body_i[unsigned(body), B_MEDIUM] if body >= 0 else world
                    arrives = WeightedRay(
                        ray, ray_i[N_RECORDS, unsigned(ray)] >= depth, x, y, z, weight
                    )
                    at = Interface(
                        unsigned(face_i[met, F_SURFACE]), unsigned(medium), unsigned(other),
                        min(1.0, abs(shading)),
                    )  # fmt: skip
                    # Turn the normal against the ray
                    if shading > 0.0:
                        sx, sy, sz = -sx, -sy, -sz
                    sides = Sides(top_body(stack, body_i), body)
                    sx, sy, sz = plane_normal(
                        scene.carried, code, sides, nx, ny, nz, cosine, sx, sy, sz
                    )
                    happened, crosses, dx, dy, dz, code, state, weight = meet_as_carried(
                        scene.carried, b.carried, sides, reduction, split, arrives,
                        optics, tables, at, Way(dx, dy, dz, sx, sy, sz),
                        Light(code, colors, counters, state), follow,
                    )  # fmt: skip
                    event |= happened
                    if own_body >= 0:
                        # Keep to the side of the triangle on which the ray goes on
                        along = dx * nx + dy * ny + dz * nz
                        if (along * cosine < 0.0) == crosses:
                            dx -= 2.0 * along * nx
                            dy -= 2.0 * along * ny
                            dz -= 2.0 * along * nz
                    scale = unit_factor(dx, dy, dz)
                    dx, dy, dz = scale * dx, scale * dy, scale * dz
                    if crosses:
                        stack = beyond
                        if other != medium:
                            event |= MEDIUM_CHANGED
                        medium = other
                    if face_i[met, F_DETECTOR] >= 0:
                        event |= register_on_face(
                            views, detectors, face_i[met, F_DETECTOR], segment, x, y, z, cosine,
                            triangle, descriptors,
                        )  # fmt: skip
            axis = face_i[met, F_AXIS]
            along = dx if axis == 0 else (dy if axis == 1 else dz)
            key = 2 * face + (1 if along >= 0.0 else 0)
        if not ignored:
            if ray_i[N_RECORDS, unsigned(ray)] >= depth and event & ENDING == 0:
                event = (event & RIM_HIT) | DEPTH_LIMIT
            turned_off = split_event(split, event)
            event, weight, state = end_faint_ray(reduction, event, weight, state)
            point = Record(x, y, z, nx, ny, nz, obj, triangle, event, medium, code, ray)
            write_record(columns, r, point)
            if len(exact) > 0:
                exact[r, 0], exact[r, 1], exact[r, 2] = x, y, z
            last = r
            r += 1
            ray_i[N_RECORDS, unsigned(ray)] += 1
            if turned_off != 0:
                fork = Fork(
                    x, y, z, nx, ny, nz, cosine, face, face_i[face, F_AXIS], own_body, own_triangle
                )
                split_ray = release_split_ray(
                    split, b, ray, r, fork, stack_before, medium_before, state
                )
                point = Record(
                    x, y, z, nx, ny, nz, obj, triangle, turned_off, medium_before,
                    split_code(split), split_ray,
                )  # fmt: skip
                write_record(columns, r, point)
                if len(exact) > 0:
                    exact[r, 0], exact[r, 1], exact[r, 2] = x, y, z
                r += 1
            if event & ENDING != 0:
                ray_f[unsigned(ray)] = weight
                continue
        # Go on
        k = unsigned(kept)
        live_f[0, k], live_f[1, k], live_f[2, k] = x, y, z
        live_f[3, k], live_f[4, k], live_f[5, k] = dx, dy, dz
        live_f[WEIGHT, k] = weight
        keep_state(b.carried, k)
        live_i[OWN, k], live_i[KEY, k] = own, key
        if meshed:
            live_i[OWN_BODY, k], live_i[OWN_TRIANGLE, k] = own_body, own_triangle
        live_i[STACK, k], live_i[MEDIUM, k], live_i[CODE, k] = stack, medium, code
        live_i[RNG, k] = np.int64(state)
        live_i[RAY, k], live_i[LAST, k] = ray, last
        kept += 1
    counters[LIVE] = gather_split_rays(split, b, kept)
    counters[RECORDS] = r


@inner_kernel
def _pack(live_f: F64, live_i: I64, i: int, k: int) -> None:
    """Move a ray to a slot before its own."""
    for row in range(6):
        live_f[row, k] = live_f[row, i]
    live_f[WEIGHT, k] = live_f[WEIGHT, i]
    for row in (OWN, KEY, STACK, MEDIUM, CODE, RNG, RAY, LAST):
        live_i[row, k] = live_i[row, i]


@inline_kernel
def _to_sphere(sphere: F64, x: float, y: float, z: float, dx: float, dy: float, dz: float) -> float:
    """Distance to the far side of the bounding sphere, 0 outside it."""
    wx, wy, wz = x - sphere[0], y - sphere[1], z - sphere[2]
    b = wx * dx + wy * dy + wz * dz
    c = wx * wx + wy * wy + wz * wz - sphere[3] * sphere[3]
    return float(max(0.0, -b + math.sqrt(max(0.0, b * b - c))))

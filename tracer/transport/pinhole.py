"""Pictures through a point: every place where light starts or scatters is connected with it.

A ray of flux w that scatters at the distance r sends w f cos / r² through a small opening, per area
across the way; summed over rays that is radiance times the solid angle of a pixel. No ray ever
meets a point, so nothing of this stands in the rays of a map: the picture is a detector result of
its own.

A ray's weight and, in polarised light, its state go into the connection: the weight that the ray
has in the end is on average the one with which it came to the place, whatever happened afterwards,
and what a surface sends towards the opening follows from the state with which light arrives.

A connection is a straight line through the world's medium: what is seen in mirrors and through
lenses stays dark. A camera with a lens shows that too.

References
----------
P. Dutré, E. P. Lafortune, Y. D. Willems, Monte Carlo light tracing with direct computation of pixel
intensities, Compugraphics 1993.
"""

from __future__ import annotations

import math
import threading
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inner_kernel, lean_kernel
from raymap.jit.types import F64, I64
from raymap.laws.amplitudes import Amplitudes, Met, meet_waves
from raymap.laws.phase import RAYLEIGH, eval_phase
from raymap.model.events import Event
from raymap.model.portion import Portion
from raymap.optics.cells import is_pinhole
from raymap.optics.photometry import Photometry
from raymap.optics.waves import Turn, project_waves, restore_state
from tracer.compiled import (
    B_MEDIUM,
    F_INSIDE,
    F_KIND,
    F_OUTSIDE,
    F_SURFACE,
    FROM_RING,
    L_AREA,
    LAMBERTIAN,
    M_PARTICIPATING,
    S_KIND,
    SOURCE_ROW,
    WORLD,
    CompiledScene,
)
from tracer.geometry.mesh_arrays import MeshArrays, MeshScratch, mesh_scratch
from tracer.geometry.mesh_hits import nearest_on_meshes
from tracer.geometry.other_shapes import link_shapes
from tracer.rays.random import advance, stream_state, uniform
from tracer.sources.linking import link_sources
from tracer.sources.towards import Place, emitted_towards
from tracer.surfaces.interaction import Interface, Way, optics_of
from tracer.surfaces.linking import link_surfaces
from tracer.surfaces.towards import scattered_towards
from tracer.transport.buffers import (
    KEY,
    MESH_BODY,
    MESH_NORMAL,
    MESH_POINT,
    MESH_SHADING,
    MESH_TRIANGLE,
    OWN,
    OWN_BODY,
    OWN_TRIANGLE,
    Buffers,
    T,
    Workspace,
)
from tracer.transport.counts import Count, DetectorCount
from tracer.transport.intersect import nearest_hits

if TYPE_CHECKING:
    from tracer.scene.compile import Compilation

__all__ = ["Pinholes"]

_VOLUME = int(Event.VOLUME_SCATTER)
_ERROR = int(Event.GEOMETRY_ERROR)
_REFLECTED = int(Event.DIFFUSE_REFLECTION), int(Event.GLOSSY_REFLECTION)
_TRANSMITTED = int(Event.DIFFUSE_TRANSMISSION), int(Event.GLOSSY_TRANSMISSION)
_SALT = 0x0B5C_E7A1
"""Sets the numbers of connections apart from those that rays are traced with."""
_BATCH = 4096
_NEAR = 1e-6
"""Share of the scene's radius by which connections leave the triangles of a mesh."""


class _Objects(NamedTuple):
    """Where the faces of an object stand: its first face, and for meshes the face per triangle."""

    first_face: I64
    first_triangle: I64
    face: I64
    body: I64


class _Found(NamedTuple):
    """Connections of a batch: (n,) each, light (n, C)."""

    cell: I64
    ray: I64
    light: F64
    distance: F64


class _Rays(NamedTuple):
    """Columns of a portion that connections are made from."""

    position: NDArray[np.float32]
    normal: NDArray[np.int16]
    object: NDArray[np.int16]
    triangle: NDArray[np.int32]
    event: NDArray[np.int32]
    medium: NDArray[np.int16]
    code: NDArray[np.int32]
    colors: NDArray[np.uint16]
    ray: I64
    source: NDArray[np.int16]


class _States(NamedTuple):
    """States of polarisation of a portion's segments, and what surfaces do to them.

    stokes (n_records, 3) : of the segment that starts at a record
    ids (n_rays,), number (n_records,) : of the rays, and of the records within them
    waves (2, 6) : scratch
    """

    laws: Amplitudes
    stokes: NDArray[np.float32]
    ids: I64
    number: I64
    waves: F64


class Pinholes:
    """The pinhole detectors of a scene; safe to call from many threads.

    ``laws`` are those of the surfaces for polarised light, None for natural light. `see` makes the
    connections of a portion, `take` adds them up; portions are taken in the order of their rays, so
    that the sums do not depend on the threads.
    """

    def __init__(self, compilation: Compilation, laws: Amplitudes | None = None) -> None:
        self.compilation = compilation
        self.laws = laws
        arrays = compilation.arrays
        self.scene = arrays._replace(
            reduction=None, surface_i=arrays.surface_i.copy(), source_i=arrays.source_i.copy()
        )
        directory = compilation.directory
        self.detectors = [k for k, d in enumerate(directory.detectors) if is_pinhole(d)]
        self.n_channels = compilation.channel_set.n_channels
        self.rows = [self._row(k) for k in self.detectors]
        self.sums = {
            k: np.zeros((2, *directory.detectors[k].cells[::-1], self.n_channels))
            for k in self.detectors
        }
        # Squares of the light of all channels, by cell, and in the last place of the whole picture
        self.squares = {k: np.zeros(sums[0, ..., 0].size + 1) for k, sums in self.sums.items()}
        self.objects = self._objects()
        self.share = _relative_flux(compilation)
        self.radiant, self.worth = _common_light(compilation)
        self.arrived = dict.fromkeys(self.detectors, 0)
        self._seen: dict[int, list[tuple[I64, I64, F64]]] = {}
        self._local = threading.local()

    def _row(self, k: int) -> tuple[F64, tuple[int, int]]:
        detector = self.compilation.directory.detectors[k]
        half = detector.parameters["half_field"]
        looks = detector.parameters["looks"]
        row = [*detector.center, *detector.axis_u, *detector.axis_v, *looks, *half]
        return np.array(row, np.float64), detector.cells

    def _objects(self) -> _Objects:
        objects = self.compilation.directory.objects
        first_face, first_triangle, faces, bodies = [], [], [], []
        row, body, count = 0, 0, 0
        for item in objects:
            primitives = [face.primitive_count for face in item.faces]
            meshed = item.kind == "mesh"
            first_face.append(row)
            first_triangle.append(count if meshed else -1)
            bodies.append(body if meshed else -1)
            if meshed:
                faces.append(np.repeat(np.arange(len(primitives)), primitives))
                count += sum(primitives)
                body += 1
            row += len(primitives) if meshed else sum(primitives)
        return _Objects(
            np.array(first_face, np.int64),
            np.array(first_triangle, np.int64),
            np.concatenate([np.zeros(0, np.int64), *faces]).astype(np.int64),
            np.array(bodies, np.int64),
        )

    # -- portions ------------------------------------------------------------------------------

    def see(self, first_ray: int, portion: Portion) -> None:
        """Make the connections of a portion (a worker's thread)."""
        n_rays = portion.n_rays
        rays = _Rays(
            position=portion.position,
            normal=portion.normal,
            object=portion.object,
            triangle=portion.triangle,
            event=portion.event,
            medium=portion.medium,
            code=portion.color_code,
            colors=portion.color_table,
            ray=np.repeat(np.arange(n_rays), portion.records_per_ray),
            source=portion.source,
        )
        states = self._states(first_ray, portion)
        weight, emission = portion.weight, portion.emission
        seen = []
        for row in self.rows:
            cell, ray, light = self._connections(rays, states, *row)
            if weight is not None:
                light *= weight[ray, None]
            # What splits off one emission is one sample
            seen.append((cell, ray if emission is None else emission[ray], light))
        self._seen[first_ray] = seen

    def _states(self, first_ray: int, portion: Portion) -> _States | None:
        if self.laws is None:
            return None
        n, counts = portion.n_records, portion.records_per_ray
        ids = portion.ray_ids
        return _States(
            self.laws,
            np.asarray(portion.extra["stokes"], np.float32),
            np.arange(first_ray, first_ray + portion.n_rays)
            if ids is None
            else ids.astype(np.int64),
            np.arange(n) - np.repeat(np.cumsum(counts) - counts, counts),
            np.empty((2, 6)),
        )

    def _connections(
        self, rays: _Rays, states: _States | None, row: F64, cells: tuple[int, int]
    ) -> tuple[I64, I64, F64]:
        """Cells, rays and light of all connections that nothing blocks."""
        found = _Found(
            np.empty(_BATCH, np.int64),
            np.empty(_BATCH, np.int64),
            np.empty((_BATCH, self.n_channels)),
            np.empty(_BATCH),
        )
        buffers, scratch = self._workspace()
        kept = []
        record = 0
        while record < len(rays.ray):
            record, n = _connect(
                self.scene, self.objects, rays, states, record, row, cells[0], cells[1], self.share,
                found, buffers.live_f, buffers.live_i,
            )  # fmt: skip
            if n == 0:
                continue
            nearest_hits(self.scene.faces, buffers, n, False)
            if self.compilation.solids is not None and scratch is not None:
                _nearest_mesh(self.compilation.solids.arrays, buffers, scratch, n)
            free = buffers.live_f[T, :n] >= found.distance[:n] * (1.0 - 1e-9)
            kept.append((found.cell[:n][free], found.ray[:n][free], found.light[:n][free]))
        if not kept:
            return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, self.n_channels))
        parts = list(zip(*kept, strict=True))
        return np.concatenate(parts[0]), np.concatenate(parts[1]), np.concatenate(parts[2])

    def take(self, first_ray: int) -> None:
        """Add the connections of a portion to the pictures."""
        for k, (cell, ray, light) in zip(self.detectors, self._seen.pop(first_ray), strict=True):
            sums = self.sums[k].reshape(2, -1, self.n_channels)
            last = np.full(len(sums[0]) + 1, -1, np.int64)
            partial = np.zeros((len(last), self.n_channels))
            squares = self.squares[k]
            self.arrived[k] += len(np.unique(ray))
            _add_up(cell, ray, light, self.worth[0], sums[0], sums[1], squares, last, partial)

    def counts(self, emitted: I64) -> dict[str, DetectorCount]:
        """What the pinholes have seen of so many rays per source, by name."""
        directory = self.compilation.directory
        lit = _lit_sources(self.compilation)
        flux = np.array([sum(directory.sources[k].flux for k in lit.tolist())])
        rays = np.array([float(emitted.sum())])
        found = {}
        for k in self.detectors:
            sums, sums2 = self.sums[k].copy()
            squares = self.squares[k].copy()
            cells = Count(
                source_flux=flux,
                emitted=rays,
                sums=(sums @ self.worth[0])[None],
                squares=squares[:-1].reshape(1, *sums.shape[:2]),
            )
            whole = Count(
                source_flux=flux,
                emitted=rays,
                sums=cells.sums.sum().reshape(1),
                squares=squares[-1:],
            )
            found[directory.detectors[k].name] = DetectorCount(
                cells=cells,
                whole=whole,
                by_channel=sums[None],
                squares_by_channel=sums2[None],
                worth=self.worth,
                radiant=self.radiant,
                arrived=self.arrived[k],
            )
        return found

    def _workspace(self) -> tuple[Buffers, MeshScratch | None]:
        if not hasattr(self._local, "buffers"):
            self._local.buffers = Workspace.create(self.scene, _BATCH).buffers
            link_surfaces(self.scene.surface_i, towards=True)
            link_sources(self.scene.source_i, towards=True)
            link_shapes(self.scene.face_i[:, F_KIND], self.scene.face_f)
            meshed = self.compilation.solids is not None
            self._local.scratch = mesh_scratch() if meshed else None
        return self._local.buffers, self._local.scratch


def _common_light(compilation: Compilation) -> tuple[F64, F64]:
    """Radiant flux of all lit sources, (1,); worth of each channel's light, (1, n_channels)."""
    light = Photometry(compilation.directory, compilation.channel_set)
    lit = _lit_sources(compilation)
    total = light.radiant_fluxes[lit].sum()
    by_channel = light.flux_by_channel(np.ones(len(light.efficacy)))
    return np.array([total]), (by_channel * (total / light.fluxes[lit].sum()))[None]


def _lit_sources(compilation: Compilation) -> I64:
    """Sources that send rays: those that are switched off have no part in what is seen."""
    return np.unique(compilation.arrays.pattern).astype(np.int64)


def _relative_flux(compilation: Compilation) -> F64:
    """Radiant flux of a ray of each source over the mean of all rays."""
    pattern = compilation.arrays.pattern
    fluxes = Photometry(compilation.directory, compilation.channel_set).radiant_fluxes
    turns = np.bincount(pattern, minlength=len(fluxes))
    mean = fluxes[turns > 0].sum() / len(pattern)
    return np.asarray(np.where(turns > 0, fluxes / np.maximum(turns, 1) / mean, 0.0))


@lean_kernel
def _connect(
    scene: CompiledScene, objects: _Objects, rays: _Rays, states: _States | None, start: int,
    eye: F64, n_u: int, n_v: int, share: F64, found: _Found, live_f: F64, live_i: I64,
) -> tuple[int, int]:  # fmt: skip
    """Connections of the records from ``start`` on until a batch is full: next record, count."""
    world = scene.limits[WORLD]
    n_channels = scene.source_f.shape[1] - SOURCE_ROW
    key = 2 * len(scene.face_i) + len(scene.source_i)
    foggy = scene.medium_i[world, M_PARTICIPATING] != 0
    optics = optics_of(scene)
    n = 0
    for r in range(start, len(rays.ray)):
        if n == len(found.cell):
            return r, n
        # See whether the place lies in the picture
        x, y, z = (
            np.float64(rays.position[r, 0]),
            np.float64(rays.position[r, 1]),
            np.float64(rays.position[r, 2]),
        )
        wx, wy, wz = x - eye[0], y - eye[1], z - eye[2]
        depth = wx * eye[9] + wy * eye[10] + wz * eye[11]
        if depth <= 0.0:
            continue
        u = 0.5 + 0.5 * (wx * eye[3] + wy * eye[4] + wz * eye[5]) / (depth * eye[12])
        v = 0.5 + 0.5 * (wx * eye[6] + wy * eye[7] + wz * eye[8]) / (depth * eye[13])
        if not (0.0 <= u < 1.0 and 0.0 <= v < 1.0):
            continue
        square = wx * wx + wy * wy + wz * wz
        distance = math.sqrt(square)
        ox, oy, oz = -wx / distance, -wy / distance, -wz / distance
        nx, ny, nz = (
            rays.normal[r, 0] / 32767.0,
            rays.normal[r, 1] / 32767.0,
            rays.normal[r, 2] / 32767.0,
        )
        ray = rays.ray[r]
        begins = r == 0 or rays.ray[r - 1] != ray
        light = found.light[n]
        own, own_body, own_triangle, lift = -1, -1, -1, 0.0
        before = r
        if begins:
            source = rays.source[ray]
            area = scene.source_i[source, L_AREA]
            if area != FROM_RING:
                nx, ny, nz = (
                    scene.source_f[source, 3],
                    scene.source_f[source, 4],
                    scene.source_f[source, 5],
                )
            density = emitted_towards(
                scene.source_i, scene.source_f, scene.light_pool, source,
                Place(x, y, z, nx, ny, nz), ox, oy, oz,
            )  # fmt: skip
            if density <= 0.0:
                continue
            for k in range(n_channels):
                light[k] = density
        else:
            # Find the way on which the light came
            dx = x - rays.position[r - 1, 0]
            dy = y - rays.position[r - 1, 1]
            dz = z - rays.position[r - 1, 2]
            length = math.sqrt(dx * dx + dy * dy + dz * dz)
            if length == 0.0:
                continue
            dx, dy, dz = dx / length, dy / length, dz / length
            obj = rays.object[r]
            if rays.event[r] & _VOLUME != 0:
                if rays.medium[r] != world:
                    continue
                mu = max(-1.0, min(1.0, dx * ox + dy * oy + dz * oz))
                phase = scene.medium_f[world, 3 * n_channels :]
                density = _phase(phase, scene.tables, mu)
                if states is not None and phase[0] == RAYLEIGH:
                    density *= _sent_by_volume(states, r, dx, dy, dz, ox, oy, oz)
                for k in range(n_channels):
                    light[k] = density
            elif obj >= 0 and rays.event[r] & _ERROR == 0:
                triangle = rays.triangle[r]
                own = objects.first_face[obj] + triangle
                if objects.body[obj] >= 0:
                    own_body, own_triangle = objects.body[obj], triangle
                    own = objects.first_face[obj]
                    own += objects.face[objects.first_triangle[obj] + triangle]
                    lift = _NEAR * scene.sphere[3]
                before = r - 1
                # Light that crosses inwards is hidden by other faces, as is light sent back inside
                cosine = dx * nx + dy * ny + dz * nz
                side = -1.0 if cosine > 0.0 else 1.0
                other = _beyond(scene, own, cosine, rays.medium[r - 1])
                at = Interface(
                    scene.face_i[own, F_SURFACE], rays.medium[r - 1], other, min(1.0, abs(cosine))
                )
                way = Way(dx, dy, dz, side * nx, side * ny, side * nz)
                if not scattered_towards(optics, scene.tables, at, way, ox, oy, oz, light):
                    continue
                if states is not None:
                    code = rays.code[before]
                    light[code] *= _sent_by_surface(
                        scene, states, rays.ray[r], r, code, at, way, ox, oy, oz
                    )
            else:
                continue
        # Give the light its colour, and what is left of it at the opening
        code = rays.code[before]
        scale = share[rays.source[ray]] / square
        total = 0.0
        for k in range(n_channels):
            color = 1.0 if code == k else 0.0
            if code >= n_channels:
                color = rays.colors[code - n_channels, k] / 65535.0
            light[k] *= color * scale
            if foggy:
                a = (
                    scene.medium_f[world, n_channels + k]
                    + scene.medium_f[world, 2 * n_channels + k]
                )
                light[k] *= math.exp(-a * distance)
            total += light[k]
        if not total > 0.0:
            continue
        found.cell[n] = min(n_v - 1, int(v * n_v)) * n_u + min(n_u - 1, int(u * n_u))
        found.ray[n] = ray
        found.distance[n] = distance
        if lift > 0.0 and ox * nx + oy * ny + oz * nz < 0.0:
            lift = -lift
        live_f[0, n], live_f[1, n], live_f[2, n] = x + lift * nx, y + lift * ny, z + lift * nz
        live_f[3, n], live_f[4, n], live_f[5, n] = ox, oy, oz
        live_i[KEY, n] = key
        live_i[OWN, n] = own
        if len(live_f) > MESH_POINT:
            live_i[OWN_BODY, n], live_i[OWN_TRIANGLE, n] = own_body, own_triangle
            live_i[MESH_BODY, n] = -1
        n += 1
    return len(rays.ray), n


@inner_kernel
def _beyond(scene: CompiledScene, face: int, cosine: float, before: int) -> int:
    """Medium on the other side of a face for light that arrives with the cosine to its normal."""
    inside, outside = scene.face_i[face, F_INSIDE], scene.face_i[face, F_OUTSIDE]
    if inside < 0:
        return before
    body = inside if cosine < 0.0 else outside
    found: int = scene.body_i[body, B_MEDIUM] if body >= 0 else scene.limits[WORLD]
    return found


@inner_kernel
def _restore(states: _States, r: int, dx: float, dy: float, dz: float) -> None:
    """Set the fields with which light arrives at a record."""
    s = states.stokes[r - 1]
    restore_state(
        states.waves, dx, dy, dz, np.float64(s[0]), np.float64(s[1]), np.float64(s[2])
    )  # fmt: skip


@inner_kernel
def _sent_by_volume(
    states: _States, r: int, dx: float, dy: float, dz: float, ox: float, oy: float, oz: float
) -> float:
    """What Rayleigh scattering sends along o of light in its state, over that of natural light."""
    _restore(states, r, dx, dy, dz)
    mu = dx * ox + dy * oy + dz * oz
    return float(2.0 * project_waves(states.waves, ox, oy, oz) / (1.0 + mu * mu))


@inner_kernel
def _sent_by_surface(
    scene: CompiledScene, states: _States, ray: int, r: int, code: int, at: Interface, way: Way,
    ox: float, oy: float, oz: float,
) -> float:  # fmt: skip
    """What a surface sends along o of light in its state, over that of natural light."""
    dx, dy, dz, nx, ny, nz = way
    _restore(states, r, dx, dy, dz)
    diffuse = scene.surface_i[at.surface, S_KIND] == LAMBERTIAN
    events = _REFLECTED if ox * nx + oy * ny + oz * nz > 0.0 else _TRANSMITTED
    state = stream_state(_SALT + states.number[r], states.ids[ray])
    state = advance(state)
    u = uniform(state)
    v = uniform(advance(state))
    met = Met(at.surface, code, scene.medium_f[at.medium, code], scene.medium_f[at.other, code])
    factor, _ = meet_waves(
        states.laws, states.waves, events[0] if diffuse else events[1], met,
        Turn(dx, dy, dz, ox, oy, oz, nx, ny, nz), u, v,
    )  # fmt: skip
    return float(factor)


@inner_kernel
def _phase(row: F64, tables: F64 | None, mu: float) -> float:
    if tables is None:
        return 0.0
    return eval_phase(row, tables, mu)


@lean_kernel
def _nearest_mesh(mesh: MeshArrays, b: Buffers, scratch: MeshScratch, n: int) -> None:
    nearest_on_meshes(
        mesh, b.live_f, b.live_i[OWN_BODY], b.live_i[OWN_TRIANGLE], b.live_f[T],
        b.live_i[MESH_BODY], b.live_i[MESH_TRIANGLE], b.live_f[MESH_POINT:MESH_NORMAL],
        b.live_f[MESH_NORMAL:MESH_SHADING], n, scratch,
    )  # fmt: skip


@lean_kernel
def _add_up(
    cell: I64, ray: I64, light: F64, worth: F64, sums: F64, sums2: F64, squares: F64, last: I64,
    partial: F64,
) -> None:  # fmt: skip
    """Add light to cells; squares are those of all that one ray sends to a cell, to all cells."""
    whole = len(sums)
    for i in range(len(cell)):
        for c in (cell[i], whole):
            if last[c] != ray[i]:
                last[c] = ray[i]
                for k in range(light.shape[1]):
                    partial[c, k] = 0.0
            before, added = 0.0, 0.0
            for k in range(light.shape[1]):
                value = light[i, k]
                old = partial[c, k]
                if c < whole:
                    sums[c, k] += value
                    sums2[c, k] += value * (2.0 * old + value)
                partial[c, k] = old + value
                before += old * worth[k]
                added += value * worth[k]
            squares[c] += added * (2.0 * before + added)

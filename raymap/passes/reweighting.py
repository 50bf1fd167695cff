"""What recorded rays weigh under other laws of surfaces and media, and other colours of sources.

A ray of weight w whose light ends with the shares c_i of its channels counts w c_i f'_i / f_i in
channel i, f being the product of the likelihoods of all that happened to it (`likelihoods`). So
paths are drawn once, and what they carry is computed. It holds for each channel by itself, whatever
the tracer drew by: w c_i holds the likelihood of the path in channel i over that of drawing it.

References
----------
C. K. Hayakawa et al., Opt. Lett. 26, 1335 (2001): the same for volumes of tissue.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.encoding.paths import PathDictionary
from raymap.file.stored import StoredPortion
from raymap.file.views import Unseen
from raymap.jit.kernels import lean_kernel
from raymap.laws.law import Law
from raymap.laws.medium import MediumLaw
from raymap.laws.phase import eval_phase
from raymap.model.directory import ChannelSet, Directory
from raymap.model.errors import FormatError, RayMapError
from raymap.model.events import Event
from raymap.model.schema import COLOR_SCALE, NONE, NORMAL_SCALE
from raymap.optics.frames import frame_about
from raymap.passes.branches import (
    ABSORBED,
    BACK,
    BRANCHES,
    SCATTERED_BACK,
    SCATTERED_THROUGH,
    THROUGH,
    TOTAL,
    Partners,
    branch_of_events,
    media_before,
)
from raymap.passes.likelihoods import (
    Incidence,
    Likelihoods,
    is_even,
    is_total,
    needs_index,
    same_facets,
)

__all__ = ["ChangedLaws", "MediumChange", "Hit", "Read", "Reweighting"]

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
_BEYOND = (THROUGH, SCATTERED_THROUGH)
_VAGUE = 0.1
"""Share of the width of a lobe that the direction of scattered light is known to."""
_ROUNDED = 2.0**-23
"""Of a coordinate in float32, at both ends of a segment."""
_NORMAL_ERROR = math.sqrt(3.0) / NORMAL_SCALE
"""Of the difference of two projections, by rounded components of the normal."""


class MediumChange(NamedTuple):
    """Absorption and scattering by channel [1 / length unit], before and after, and phases."""

    absorption: tuple[F64, F64]
    scattering: tuple[F64, F64]
    laws: tuple[MediumLaw, MediumLaw]


@dataclass(frozen=True, kw_only=True, eq=False)
class ChangedLaws:
    """What is different, in the channels of one channel set.

    Attributes
    ----------
    faces : by face index, the law of the recording and the new one
    media : by number of the medium
    sources : (n_sources, n_channels) new over old share of the light that a source emits, or None
    """

    faces: Mapping[int, tuple[Law, Law]] = field(default_factory=dict)
    media: Mapping[int, MediumChange] = field(default_factory=dict)
    sources: F64 | None = None

    def opens(self, channels: ChannelSet) -> bool:
        """Whether new laws may send light where the old ones sent none; False where surely not."""
        return any(_may_open(old, new, channels) for old, new in self.faces.values())


class Hit(NamedTuple):
    """One thing that happens: at a face, from a medium into one, by a branch."""

    face: int
    before: int
    after: int
    branch: int


class Reweighting:
    """Factors by which the rays of a map count differently.

    Parameters
    ----------
    directory, channels : of the map, and its channel set
    changed : what is different
    partners : which media lie beyond faces (`Partners.learn` was told all paths)
    """

    def __init__(
        self, directory: Directory, channels: ChannelSet, changed: ChangedLaws, partners: Partners
    ) -> None:
        self.directory, self.channels, self.changed = directory, channels, changed
        self.partners = partners
        self.n_channels = channels.n_channels
        self._is_changed = np.zeros(len(directory.faces) + 1, np.bool_)
        self._is_changed[list(changed.faces)] = True
        self._laws = {
            id(law): Likelihoods(law, channels) for pair in changed.faces.values() for law in pair
        }
        self._classes: dict[Hit, tuple[F64, F64]] = {}
        self._lock = threading.Lock()
        self.impossible = 0
        self.vague = 0

    # -- what happens --------------------------------------------------------------------------

    def _points(self, paths: PathDictionary) -> tuple[I64, list[Hit], NDArray[np.int32]]:
        """Points of paths where a changed face decided, the classes there, and whose is which."""
        branch = branch_of_events(paths.event)
        points = np.flatnonzero(self._is_changed[paths.face] & (branch != NONE))
        # Light comes from somewhere, and what is scattered goes somewhere: not so at the first
        # point, nor where a limit ended the ray as it was scattered
        outside = np.zeros(len(paths.event), np.bool_)
        outside[paths.offsets[:-1]] = True
        last = paths.offsets[1:] - 1
        outside[last] |= branch[last] >= SCATTERED_BACK
        points = points[~outside[points]]
        before, after = media_before(paths), np.full(len(paths.event), NONE, np.int16)
        through = np.isin(branch, _BEYOND)
        after[through] = paths.medium[through]
        keys = np.stack(
            [column[points].astype(np.int64) for column in (paths.face, before, after, branch)], 1
        )
        distinct, own = np.unique(keys, axis=0, return_inverse=True)
        return points, [Hit(*row) for row in distinct.tolist()], own.ravel().astype(np.int32)

    def _is_even(self, kind: Hit) -> bool:
        old, new = self.changed.faces[kind.face]
        return is_even(old, kind.branch) and is_even(new, kind.branch)

    def indices(self, kind: Hit) -> tuple[F64, F64]:
        """Refractive indices before and beyond, by channel."""
        known = self._classes.get(kind)
        if known is None:
            with self._lock:
                known = self._classes[kind] = self._find_indices(kind)
        return known

    def _find_indices(self, kind: Hit) -> tuple[F64, F64]:
        ones = np.ones(self.n_channels)
        laws = self.changed.faces[kind.face]
        if not any(needs_index(law) or _is_metal(law) for law in laws):
            return ones, ones
        index = np.asarray(self.channels.refractive_index, np.float64)
        name = self.directory.faces.names[kind.face]
        if not 0 <= kind.before < len(index):
            raise RayMapError(
                f"the map does not say in which medium light arrives at {name!r}, so that its law "
                "cannot be evaluated there"
            )
        if not any(needs_index(law) for law in laws):
            return index[kind.before], ones
        beyond: tuple[int, ...] = (kind.after,)
        if kind.branch not in _BEYOND:
            faces = self.directory.faces
            owner = faces.object[kind.face]
            others = range(faces.first_face[owner], faces.first_face[owner + 1])
            beyond = self.partners.beyond(kind.face, kind.before, others)
        found = np.unique(index[[m for m in beyond if 0 <= m < len(index)]], axis=0)
        if len(found) != 1:
            media = ", ".join(self.directory.media[m].name for m in beyond)
            raise RayMapError(
                f"which medium lies beyond {name!r} where light is {BRANCHES[kind.branch]} "
                + (f"is not told apart ({media})" if media else "is shown by no ray")
                + ": record more rays, or change faces between two media only"
            )
        return index[kind.before], found[0]

    # -- factors -------------------------------------------------------------------------------

    def of_paths(self, paths: PathDictionary) -> tuple[F64, NDArray[np.bool_]]:
        """(n_paths, n_channels) factors by what happens alike at every angle.

        Returns
        -------
        factors, whole : and for each path whether that is all of it
        """
        factors = np.ones((paths.n_paths, self.n_channels))
        whole = np.ones(paths.n_paths, np.bool_)
        points, kinds, own = self._points(paths)
        path_of = np.repeat(np.arange(paths.n_paths), np.diff(paths.offsets))
        for number, kind in enumerate(kinds):
            here = path_of[points[own == number]]
            if not self._is_even(kind):
                whole[here] = False
                continue
            ratio = self.ratios(kind, _nowhere(1))[:, 0]
            times = np.bincount(here, minlength=paths.n_paths)[:, None]
            factors *= np.where(times > 0, ratio[None, :] ** times, 1.0)
        if self.changed.media:
            whole &= ~self._touches_media(paths, path_of)
        if self.changed.sources is not None:
            factors *= self.changed.sources[paths.source]
        return factors, whole

    def _touches_media(self, paths: PathDictionary, path_of: I64) -> NDArray[np.bool_]:
        inside = np.isin(paths.medium, list(self.changed.media))
        inside[paths.offsets[1:] - 1] = False
        found = np.zeros(paths.n_paths, np.bool_)
        found[path_of[inside]] = True
        return found

    def of_rays(self, portion: StoredPortion, rays: NDArray[np.bool_] | None = None) -> F64:
        """(n_rays, n_channels) factors of the rays of a portion.

        Parameters
        ----------
        rays : (n_rays,) of which; those of the others are of no use. None: of all
        """
        of_path, whole = self.of_paths(portion.paths())
        factors: F64 = of_path[portion.path_numbers()]
        if not whole.all():
            read = Read(portion)
            for kind, records, met_by, met in self.hits(read, even=False, rays=rays):
                del records
                _multiply(factors, met_by, self.ratios(kind, met))
            for records, ratios in self._in_media(read):
                _multiply(factors, read.ray_of[records], ratios)
        return factors

    def along_rays(self, portion: StoredPortion) -> F64:
        """(n_records, n_channels) factors of what happened up to each record, it included."""
        return self._along(Read(portion))

    def _along(self, read: Read) -> F64:
        factors = np.ones((read.portion.n_records, self.n_channels))
        if self.changed.sources is not None:
            factors[read.offsets[:-1]] = self.changed.sources[read.portion.column("source")]
        for kind, records, _, met in self.hits(read, even=True):
            factors[records] *= self.ratios(kind, met).T
        for records, ratios in self._in_media(read):
            factors[records] *= ratios.T
        _accumulate(read.offsets, factors)
        return factors

    def hits(
        self, read: Read, *, even: bool, rays: NDArray[np.bool_] | None = None
    ) -> Iterator[tuple[Hit, I64, I64, Incidence]]:
        """What happened at changed faces: records, rays and angles by class.

        Parameters
        ----------
        even : also what is as likely at every angle
        rays : (n_rays,) of which; None: of all
        """
        points, kinds, own = self._points(read.paths)
        wanted = np.array([even or not self._is_even(kind) for kind in kinds], np.bool_)
        if not wanted.any():
            return
        class_of = np.full(len(read.paths.event), NONE, np.int32)
        chosen = wanted[own]
        class_of[points[chosen]] = own[chosen]
        records, met_by, ends = _records_of(class_of, len(kinds), read, rays)
        faces = np.repeat([kind.face for kind in kinds], np.diff(ends))
        normal = read.portion.normals_at(records, faces, read.position)
        for number, kind in enumerate(kinds):
            part = slice(int(ends[number]), int(ends[number + 1]))
            if wanted[number]:
                met = _incidence(read.position, normal[part], records[part], kind)
                yield kind, records[part], met_by[part], met

    def ratios(self, kind: Hit, met: Incidence) -> F64:
        """(n_channels, n) new over old likelihood; 0 where the old law never did this."""
        old, new = self.changed.faces[kind.face]
        if kind.branch == TOTAL and is_total(old) and is_total(new):
            return np.ones((self.n_channels, len(met.cos_i)))
        if kind.branch in (SCATTERED_BACK, SCATTERED_THROUGH) and not same_facets(old, new):
            raise RayMapError(
                f"the roughness of {self.directory.faces.names[kind.face]!r} cannot be changed "
                "after the trace: what it scattered says nothing of where else light would go"
            )
        n_i, n_o = self.indices(kind)
        met = met._replace(n_i=n_i, n_o=n_o)
        before = self._laws[id(old)].of(kind.branch, met)
        after = self._laws[id(new)].of(kind.branch, met)
        width = min(self._laws[id(law)].half_width for law in (old, new))
        if len(met.error) and old != new and width < np.inf:
            # Densities say nothing where the direction is not known as well as the lobe is narrow
            vague = met.error > _VAGUE * width
            self.vague += int(vague.sum())
            after = np.where(vague[None, :], before, after)
        impossible = ~(before > 0.0).any(axis=0)
        if impossible.any():
            self.impossible += int(impossible.sum())
        return np.divide(after, before, out=np.zeros_like(after), where=before > 0.0)

    def _in_media(self, read: Read) -> Iterator[tuple[I64, F64]]:
        """Records at the end of ways in changed media, and factors of these, by medium."""
        if not self.changed.media:
            return
        portion = read.portion
        medium, event = portion.column("medium"), portion.column("event")
        starts = np.ones(portion.n_records, np.bool_)
        starts[read.offsets[1:] - 1] = False
        position = read.position.astype(np.float64)
        for number, change in self.changed.media.items():
            begin = np.flatnonzero((medium == number) & starts)
            records = begin + 1
            way = np.linalg.norm(position[records] - position[begin], axis=1)
            more = sum(new - old for old, new in (change.absorption, change.scattering))
            ratios = np.exp(-np.asarray(more)[:, None] * way)
            for bit, (old, new) in (
                (Event.VOLUME_ABSORPTION, change.absorption),
                (Event.VOLUME_SCATTER, change.scattering),
            ):
                here = (event[records] & int(bit)) != 0
                part = np.divide(new, old, out=np.zeros_like(new), where=old > 0.0)
                ratios[:, here] *= part[:, None]
            goes_on = starts[np.minimum(records, portion.n_records - 1)]
            turned = np.flatnonzero(((event[records] & int(Event.VOLUME_SCATTER)) != 0) & goes_on)
            old_law, new_law = change.laws
            if len(turned) and old_law.phase != new_law.phase:
                ratios[:, turned] *= _phase_ratio(change.laws, position, records[turned])
            yield records, ratios

    # -- what was never drawn ------------------------------------------------------------------

    def unseen(self, portion: StoredPortion) -> list[Unseen]:
        """Branches of changed faces that the old law never took and the new one does."""
        if not self.changed.faces:
            return []
        read = Read(portion)
        along = self._along(read)
        weight, source = portion.column("weight"), portion.column("source")
        codes = portion.column("color_code")
        found: dict[tuple[int, int], F64] = {}
        for kind, records, rays, met in self.hits(read, even=True):
            if kind.branch == TOTAL and all(map(is_total, self.changed.faces[kind.face])):
                continue
            before = records - 1
            arriving = along[before] * (portion.color_codes(codes[before]).colors() / COLOR_SCALE)
            arriving *= weight[rays, None]
            for branch in (BACK, THROUGH, ABSORBED, SCATTERED_BACK, SCATTERED_THROUGH):
                share = self._opened(kind, branch, met)
                if share.any():
                    flux = (arriving * share.T).sum(axis=1)
                    key = kind.face, branch
                    more = np.bincount(source[rays], flux, len(self.directory.sources))
                    found[key] = found.get(key, np.zeros(len(more))) + more
        return [Unseen(face, branch, sums) for (face, branch), sums in found.items() if sums.any()]

    def _opened(self, kind: Hit, branch: int, met: Incidence) -> F64:
        """(n_channels, n) new share of a branch where the old share is 0."""
        n_i, n_o = self.indices(kind)
        met = met._replace(n_i=n_i, n_o=n_o)
        before, after = (
            self._laws[id(law)].share(branch, met) for law in self.changed.faces[kind.face]
        )
        return np.where(before > 0.0, 0.0, after)


class Read:
    """What one computation asks a portion more than once."""

    def __init__(self, portion: StoredPortion) -> None:
        self.portion = portion
        self.paths, self.numbers = portion.paths(), portion.path_numbers()
        self.offsets = portion.record_offsets()

    @cached_property
    def position(self) -> NDArray[np.float32]:
        column: NDArray[np.float32] = self.portion.column("position")
        return column

    @cached_property
    def ray_of(self) -> I64:
        """(n_records,) the ray of each record."""
        return np.repeat(np.arange(self.portion.n_rays), np.diff(self.offsets))


def _incidence(
    position: NDArray[np.float32], normal: NDArray[np.int16], records: I64, kind: Hit
) -> Incidence:
    cos_i = np.empty(len(records))
    if len(records) and not 0 < int(records.min()) <= int(records.max()) < len(position):
        raise FormatError("a record of a changed face has none before it")
    scattered = kind.branch in (SCATTERED_BACK, SCATTERED_THROUGH)
    if scattered and len(records) and int(records.max()) + 1 >= len(position):
        raise FormatError("a record where light was scattered has none behind it")
    wi, wo = np.empty((2, len(records) if scattered else 0, 3))
    _meet(position, normal, records, cos_i, wi, wo)
    error = np.zeros(0)
    if scattered and len(records):
        # Of rounded ends over the way between them, and of the normal that both projections lean on
        error = np.full(len(records), _NORMAL_ERROR)
        for side in (-1, 1):
            ends = position[records].astype(np.float64), position[records + side].astype(np.float64)
            way = np.maximum(np.linalg.norm(ends[1] - ends[0], axis=1), 1e-300)
            error += _ROUNDED * np.abs(ends).max(axis=(0, 2)) / way
    return Incidence(np.zeros(0), np.zeros(0), cos_i, wi, wo, error)


def _may_open(old: Law, new: Law, channels: ChannelSet) -> bool:
    if type(old) is not type(new) or not all(is_even(law, BACK) for law in (old, new)):
        return True
    n = np.ones(channels.n_channels)
    (back, through), (new_back, new_through) = (
        law.shares(channels, n, n, np.ones(1)) for law in (old, new)
    )
    absorbed, new_absorbed = 1.0 - back - through, 1.0 - new_back - new_through
    pairs = ((back, new_back), (through, new_through), (absorbed, new_absorbed))
    return any(bool(((a <= 0.0) & (b > 0.0)).any()) for a, b in pairs)


def _is_metal(law: Law) -> bool:
    return bool(getattr(law, "n", ()))


def _nowhere(n: int) -> Incidence:
    """For laws that do not ask where light comes from."""
    along = np.tile([0.0, 0.0, 1.0], (n, 1))
    return Incidence(np.zeros(0), np.zeros(0), np.ones(n), along, along)


def _phase_ratio(laws: tuple[MediumLaw, MediumLaw], position: F64, records: I64) -> F64:
    """(n,) density of the angles of scattering under the new phase function over the old one."""
    before = position[records] - position[records - 1]
    after = position[records + 1] - position[records]
    lengths = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    cosine = np.clip((before * after).sum(axis=1) / np.maximum(lengths, 1e-300), -1.0, 1.0)
    old, new = (_phases(law, cosine) for law in laws)
    return np.divide(new, old, out=np.zeros_like(new), where=old > 0.0)


def _phases(law: MediumLaw, cosine: F64) -> F64:
    if law.phase is None:
        return np.full(len(cosine), 1.0 / (4.0 * np.pi))
    row, table = law.phase.row()
    found = np.empty(len(cosine))
    _fill_phases(row, table, cosine, found)
    return found


@lean_kernel
def _fill_phases(row: F64, table: F64, cosine: F64, found: F64) -> None:
    for i in range(len(cosine)):
        found[i] = eval_phase(row, table, cosine[i])


def _records_of(
    class_of: NDArray[np.int32], n_classes: int, read: Read, chosen: NDArray[np.bool_] | None
) -> tuple[I64, I64, I64]:
    """Records and rays of all points of a class, class after class.

    Parameters
    ----------
    class_of : (n_points,) class of each point of the paths, -1 none
    chosen : (n_rays,) of which rays; None: of all

    Returns
    -------
    records, rays : (n,); ends : (n_classes + 1,) where each class begins in them
    """
    paths = read.paths
    if not np.array_equal(np.diff(paths.offsets)[read.numbers], np.diff(read.offsets)):
        raise FormatError("paths of rays do not account for their records")
    if chosen is None:
        chosen = np.ones(len(read.numbers), np.bool_)
    rays_of = np.bincount(read.numbers[chosen], minlength=paths.n_paths)
    taken = np.repeat(rays_of, np.diff(paths.offsets))
    here = class_of >= 0
    counts = np.bincount(class_of[here], taken[here], n_classes).astype(np.int64)
    ends = np.concatenate(([0], np.cumsum(counts)))
    asked = np.concatenate(([0], np.cumsum(here)))[paths.offsets]
    records, rays = np.empty((2, int(ends[-1])), np.int64)
    _fill_records(
        read.numbers, paths.offsets, read.offsets, class_of, np.diff(asked) > 0, chosen,
        ends[:-1].copy(), records, rays,
    )  # fmt: skip
    return records, rays, ends


@lean_kernel
def _fill_records(
    numbers: Any, path_offsets: I64, record_offsets: I64, class_of: Any, asked: Any, chosen: Any,
    place: I64, records: I64, rays: I64,
) -> None:  # fmt: skip
    for ray in range(len(numbers)):
        path = numbers[ray]
        if not asked[path] or not chosen[ray]:
            continue
        first, record = path_offsets[path], record_offsets[ray]
        for i in range(path_offsets[path + 1] - first):
            one = class_of[first + i]
            if one >= 0:
                records[place[one]] = record + i
                rays[place[one]] = ray
                place[one] += 1


@lean_kernel
def _multiply(factors: F64, rays: I64, ratios: F64) -> None:
    for k in range(len(rays)):
        for channel in range(factors.shape[1]):
            factors[rays[k], channel] *= ratios[channel, k]


@lean_kernel
def _accumulate(offsets: I64, factors: F64) -> None:
    """Products along each ray, in place."""
    for ray in range(len(offsets) - 1):
        for record in range(offsets[ray] + 1, offsets[ray + 1]):
            for channel in range(factors.shape[1]):
                factors[record, channel] *= factors[record - 1, channel]


@lean_kernel
def _meet(
    position: NDArray[np.float32], normal: NDArray[np.int16], records: I64, cos_i: F64, wi: F64,
    wo: F64,
) -> None:  # fmt: skip
    """Angles of incidence at records, and directions in frames about the normal."""
    for k in range(len(records)):
        i = records[k]
        # Direction of the light that arrives, and the normal on its side
        dx = np.float64(position[i, 0]) - np.float64(position[i - 1, 0])
        dy = np.float64(position[i, 1]) - np.float64(position[i - 1, 1])
        dz = np.float64(position[i, 2]) - np.float64(position[i - 1, 2])
        nx, ny, nz = float(normal[k, 0]), float(normal[k, 1]), float(normal[k, 2])
        size = np.sqrt((dx * dx + dy * dy + dz * dz) * (nx * nx + ny * ny + nz * nz))
        along = dx * nx + dy * ny + dz * nz
        cos_i[k] = min(1.0, abs(along) / size) if size > 0.0 else 1.0
        if k >= len(wi):
            continue
        length = np.sqrt(nx * nx + ny * ny + nz * nz) * (1.0 if along < 0.0 else -1.0)
        nx, ny, nz = nx / length, ny / length, nz / length
        ux, uy, uz, vx, vy, vz = frame_about(nx, ny, nz)
        way = np.sqrt(dx * dx + dy * dy + dz * dz)
        way = way if way > 0.0 else 1.0
        wi[k, 0] = -(dx * ux + dy * uy + dz * uz) / way
        wi[k, 1] = -(dx * vx + dy * vy + dz * vz) / way
        wi[k, 2] = cos_i[k]
        dx = np.float64(position[i + 1, 0]) - np.float64(position[i, 0])
        dy = np.float64(position[i + 1, 1]) - np.float64(position[i, 1])
        dz = np.float64(position[i + 1, 2]) - np.float64(position[i, 2])
        way = np.sqrt(dx * dx + dy * dy + dz * dz)
        way = way if way > 0.0 else 1.0
        wo[k, 0] = (dx * ux + dy * uy + dz * uz) / way
        wo[k, 1] = (dx * vx + dy * vy + dz * vz) / way
        wo[k, 2] = (dx * nx + dy * ny + dz * nz) / way

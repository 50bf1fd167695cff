"""A recorded map as it would be under other laws: a map that every reader of maps takes.

Rays, paths and places are those of the recording; weights, colours at the ends of rays, and the
sums of the paths are computed anew (`raymap.passes.reweighting`). The sums of all paths come from
one pass over the map; after it questions about paths are as quick as those to the map itself.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.bytes.decoding import decodes
from raymap.encoding.colors import ColorCodes
from raymap.encoding.paths import MergedPaths, PathDictionary
from raymap.file.plainpaths import PlainPaths
from raymap.file.reader import RayMap
from raymap.file.stored import StoredPortion
from raymap.file.views import MapView, PortionView, Unseen
from raymap.model.directory import ChannelSet, Source
from raymap.model.errors import DamagedPortion, RayMapError
from raymap.model.schema import COLOR_SCALE
from raymap.passes.branches import Partners, partners_of
from raymap.passes.pathsums import PathSums, sums_of_paths
from raymap.passes.reweighting import ChangedLaws, Reweighting

__all__ = ["LOOKED_AT", "RevisedMap", "RevisedPortion"]

F64 = NDArray[np.float64]

LOOKED_AT = 8
"""Portions from which it is estimated what changes open."""


class RevisedPortion(PortionView):
    """A portion whose rays weigh otherwise."""

    def __init__(self, own: StoredPortion, map: RevisedMap) -> None:
        super().__init__(own, map)
        self._revised = map
        self._factors: tuple[F64, F64] | None = None
        self._factors_lock = threading.Lock()
        self.has_weights = own.has_weights or map.changes_weights

    def compare(self, merged: PathDictionary, local: Any) -> None:
        """Hold the recording's own merged dictionary against the portion."""
        base = self._revised.base.merged
        if base is not None:
            self.own.compare(base.paths, local)

    def _light(self) -> tuple[F64, F64]:
        """Weights (n_rays,), and amounts (n_rays, n_channels) of light at the ends that sum to 1.

        Amounts are what the map states where weights do not change them.
        """
        with self._factors_lock:
            found = self._factors
            if found is None:
                found = self._factors = self._weighed()
                self._revised.recent.remember(self)
            return found

    def _weighed(self) -> tuple[F64, F64]:
        ends = self.own.color_codes(self.own.column("last_color")).colors() / COLOR_SCALE
        lit = ends * self._revised.reweighting(self.channel_set).of_rays(self.own)
        total = lit.sum(axis=1)
        weight = self.own.column("weight").astype(np.float64) * total
        shares = np.divide(lit, total[:, None], out=ends.copy(), where=total[:, None] > 0.0)
        return weight, shares

    def worth_of(self, rays: NDArray[np.int64]) -> F64:
        """(n,) what some rays count at their ends, without a look at all others.

        It is `raymap.optics.photometry.ray_weights` of them, up to the rounding of colours.
        """
        chosen = np.zeros(self.n_rays, np.bool_)
        chosen[rays] = True
        factors = self._revised.reweighting(self.channel_set).of_rays(self.own, chosen)[rays]
        ends = self.own.color_codes(self.own.column("last_color")[rays]).colors() / COLOR_SCALE
        source = self.own.column("source")[rays]
        worth = self._revised.photometry(self.channel_set).channel_worth[source]
        weight = self.own.column("weight")[rays].astype(np.float64)
        return np.asarray(weight * (ends * factors * worth).sum(axis=1))

    def forget(self) -> None:
        """Give back what was computed of single rays."""
        self._factors = None

    # -- columns -------------------------------------------------------------------------------

    @decodes
    def _decoded(self, name: str) -> NDArray[Any] | None:
        method = _OWN.get(name)
        return self.own._decoded(name) if method is None else method(self)

    def _column_weight(self) -> Any:
        if not self._revised.changes_weights:
            return self.own.column("weight")
        return self._light()[0]

    @decodes
    def color_table(self) -> NDArray[np.uint16]:
        """(n_colors, n_channels) mixed colours: those of the recording, and those of its ends."""
        own = self.own.color_table()
        if not self._revised.changes_colors:
            return own
        return np.concatenate((own, self._end_colors()[0]))

    def _end_colors(self) -> tuple[NDArray[np.uint16], NDArray[np.int32]]:
        """Colours at the ends of rays, and each ray's row of them."""
        rows = _as_colors(self._light()[1])
        distinct, own = np.unique(rows, axis=0, return_inverse=True)
        return distinct, own.ravel().astype(np.int32)

    def _column_last_color(self) -> NDArray[np.int32]:
        if not self._revised.changes_colors:
            return self.own.column("last_color")
        n_channels = self._revised.channel_sets[self.channel_set].n_channels
        first = n_channels + len(self.own.color_table())
        return (self._end_colors()[1] + first).astype(np.int32)

    def _column_color(self) -> NDArray[np.uint16]:
        return self.color_codes(self._column_color_code()).colors()

    def _column_color_code(self) -> NDArray[np.int32]:
        codes: NDArray[np.int32] = self.own.column("color_code")
        if self._revised.changes_colors:
            codes = codes.copy()
            codes[self.record_offsets()[1:] - 1] = self._column_last_color()
        return codes

    def color_codes(self, codes: NDArray[np.int32]) -> ColorCodes:
        """Codes, checked against this portion's own table."""
        return ColorCodes.check(codes, self.color_table())

    def carried(self, rays: Any, records: Any, *, whole: bool) -> tuple[F64, F64]:
        """Weights (n,) and shares (n, n_channels) of the light on segments, as of the map's own.

        ``whole``: of light that goes on as the whole ray did; else of all light that comes along.
        """
        weight, shares = self.own.carried(rays, records, whole=whole)
        if not self._revised.changes_weights:
            return weight, shares
        reweighting = self._revised.reweighting(self.channel_set)
        if whole:
            chosen = np.zeros(self.n_rays, np.bool_)
            chosen[rays] = True
            factors = reweighting.of_rays(self.own, chosen)[rays]
        else:
            factors = reweighting.along_rays(self.own)[records]
        lit = shares * factors
        total = lit.sum(axis=1)
        return weight * total, np.divide(
            lit, total[:, None], out=shares.copy(), where=total[:, None] > 0.0
        )

    @decodes
    def paths(self) -> PathDictionary:
        """The dictionary, with sums of the new weights."""
        if not self.has_paths:
            return PlainPaths(self)
        own = self.own.paths()
        return self._with_sums(own) if self._revised.changes_weights else own

    def _with_sums(self, own: PathDictionary) -> PathDictionary:
        sums = self.sums()
        sets = [np.zeros((own.n_paths, 0)) for _ in own.sum_wc]
        sets[self.channel_set] = sums.colors
        return replace(
            own,
            sum_w=sums.weight,
            sum_w2=sums.squares,
            sum_wc=tuple(sets),
            sum_wy2=sums.worth_squares,
        )

    def sums(self) -> PathSums:
        """Sums of this portion's paths."""
        numbers = self.own.path_numbers().astype(np.int64)
        light = self._revised.photometry(self.channel_set)
        return sums_of_paths(numbers, self.own.paths().n_paths, *self._light(), self, light)


_OWN: dict[str, Callable[[RevisedPortion], NDArray[Any]]] = {
    "weight": RevisedPortion._column_weight,
    "last_color": RevisedPortion._column_last_color,
    "color_code": RevisedPortion._column_color_code,
    "color": RevisedPortion._column_color,
}
"""Columns that are computed anew."""


class RevisedMap(MapView):
    """A map under other laws; the map that it looks at stays open and unchanged.

    Parameters
    ----------
    base : an open map, or several as one
    changed : what is different, by number of the channel set
    sources : entries that take the place of those of the directory, by number
    """

    def __init__(
        self,
        base: RayMap,
        changed: Callable[[int], ChangedLaws],
        sources: dict[int, Source] | None = None,
    ) -> None:
        super().__init__(base)
        self._sources = dict(sources or {})
        self._changed = [changed(number) for number in range(len(base.channel_sets))]
        self.changes_weights = any(
            each.faces or each.media or each.sources is not None for each in self._changed
        )
        self.changes_colors = self.changes_weights and any(
            channel_set.n_channels > 1 for channel_set in base.channel_sets
        )
        if sources:
            own = list(base.directory.sources)
            for number, entry in sources.items():
                own[number] = entry
            self.directory = base.directory.model_copy(update={"sources": tuple(own)})
        self.channel_sets = [
            _with_colors(channel_set, each.sources)
            for channel_set, each in zip(base.channel_sets, self._changed, strict=True)
        ]
        self.portions = [RevisedPortion(portion, self) for portion in base.portions]
        self._reweightings: dict[int, Reweighting] = {}
        self._sums_lock, self._laws_lock = threading.Lock(), threading.Lock()
        self._sums: MergedPaths | None = None
        self._partners: Partners | None = None

    def over(self, base: RayMap) -> RevisedMap:
        """The same changes to another map of the same faces, media and sources."""
        return RevisedMap(base, self.changed, self._sources)

    def with_further(
        self,
        changed: Callable[[int, ChangedLaws], ChangedLaws],
        sources: dict[int, Source],
    ) -> RevisedMap:
        """These changes, and others on top of them.

        Parameters
        ----------
        changed : both together, by number of the channel set, of those of this view
        """
        return RevisedMap(
            self.base,
            lambda number: changed(number, self._changed[number]),
            {**self._sources, **sources},
        )

    # -- what a map offers ---------------------------------------------------------------------

    def reweighting(self, channel_set: int) -> Reweighting:
        """Factors of rays in a channel set."""
        with self._laws_lock:
            if channel_set not in self._reweightings:
                self._reweightings[channel_set] = Reweighting(
                    self.directory,
                    self.base.channel_sets[channel_set],
                    self._changed[channel_set],
                    self._known_partners(),
                )
            return self._reweightings[channel_set]

    def changed(self, channel_set: int) -> ChangedLaws:
        """What is different, in a channel set."""
        return self._changed[channel_set]

    def _known_partners(self) -> Partners:
        if self._partners is None:
            self._partners = partners_of(self.base)
        return self._partners

    @property
    def merged(self) -> MergedPaths | None:
        """The paths of the whole map with the new sums; the first call passes over the map."""
        base = self.base.merged
        if base is None or not self.changes_weights:
            return base
        return self._summed()

    def _summed(self) -> MergedPaths:
        with self._sums_lock:
            if self._sums is None:
                self._sums = self._from_dictionary() or self._pass()
            return self._sums

    def path_factors(self) -> F64 | None:
        """(n_merged_paths,) by what all rays of each path count more; None where rays differ.

        They do not where laws are the same at all angles, and all channels change alike.
        """
        base = self.base.merged
        if base is None or len(self.base.channel_sets) != 1:
            return None
        if any(not portion.has_paths and portion.n_rays for portion in self.base.portions):
            return None
        factors, whole = self.reweighting(0).of_paths(base.paths)
        if not whole.all() or not (factors == factors[:, :1]).all():
            return None
        return np.asarray(factors[:, 0])

    def _from_dictionary(self) -> MergedPaths | None:
        """The new sums without a pass, where all rays of a path change alike."""
        base = self.base.merged
        factors = self.path_factors()
        if base is None or factors is None:
            return None
        paths = base.paths
        squares = paths.sum_wy2
        revised = replace(
            paths,
            sum_w=paths.sum_w * factors,
            sum_w2=paths.sum_w2 * factors**2,
            sum_wc=tuple(sums * factors[:, None] for sums in paths.sum_wc),
            sum_wy2=None if squares is None else squares * factors**2,
        )
        return MergedPaths(paths=revised, local_to_global=base.local_to_global)

    def _pass(self) -> MergedPaths:
        """Sum the new weights of all rays by their paths."""
        base = self.base.merged
        assert base is not None
        paths = base.paths
        n = paths.n_paths
        weight, squares = np.zeros((2, n))
        worth_squares = np.zeros(n)
        sets = [np.zeros(sums.shape) for sums in paths.sum_wc]
        told = False
        for portion, local, sums in self._each_portion(base):
            weight[local] += sums.weight
            squares[local] += sums.squares
            sets[portion.channel_set][local] += sums.colors
            if sums.worth_squares is not None:
                told = True
                worth_squares[local] += sums.worth_squares
        revised = replace(
            paths,
            sum_w=weight,
            sum_w2=squares,
            sum_wc=tuple(sets),
            sum_wy2=worth_squares if told else None if paths.sum_wy2 is None else squares,
        )
        return MergedPaths(paths=revised, local_to_global=base.local_to_global)

    def _each_portion(self, base: MergedPaths) -> Any:
        def work(index: int) -> Any:
            portion = self.portions[index]
            assert isinstance(portion, RevisedPortion)
            local = base.local_to_global[index]
            if local is None or not portion.n_rays:
                return None
            try:
                portion.own.compare(base.paths, local)
                found = portion, local, portion.sums()
            except DamagedPortion:
                if self.on_damage == "raise":
                    raise
                return None
            finally:
                portion.forget()
            return found

        count = self.threads or len(os.sched_getaffinity(0))
        with ThreadPoolExecutor(count, thread_name_prefix="what-if") as pool:
            for found in pool.map(work, range(len(self.portions))):
                if found is not None:
                    yield found

    def detector_result(self, name: str, channel_set: int = 0) -> None:
        """None: what detectors counted is counted anew."""
        if self.without_rays:
            raise RayMapError(
                f"{self.path} holds no rays, so that nothing can be weighed anew: record it with "
                "rays"
            )

    @property
    def impossible(self) -> int:
        """Events met so far that the recorded laws do not allow: rounding put them there."""
        return sum(each.impossible for each in self._reweightings.values())

    @property
    def vague(self) -> int:
        """Scatterings met so far whose law changed and whose direction is not known well enough."""
        return sum(each.vague for each in self._reweightings.values())

    def unseen(self) -> list[Unseen]:
        """What the new laws open that the old ones never drew, estimated from the first portions.

        Sums are scaled to all rays of the map.
        """
        found: dict[tuple[int, int], F64] = {}
        if not any(each.opens(self.base.channel_sets[k]) for k, each in enumerate(self._changed)):
            return []
        some = [portion for portion in self.base.portions if portion.n_rays][:LOOKED_AT]
        seen = np.zeros(len(self.directory.sources))
        for portion in some:
            seen += portion.emitted
            for each in self.reweighting(portion.channel_set).unseen(portion):
                key = each.face, each.branch
                found[key] = found.get(key, np.zeros(len(seen))) + each.by_source
        scale = np.divide(self.emitted, seen, out=np.zeros(len(seen)), where=seen > 0.0)
        return [Unseen(face, branch, sums * scale) for (face, branch), sums in found.items()]


def _with_colors(channel_set: ChannelSet, ratios: F64 | None) -> ChannelSet:
    if ratios is None:
        return channel_set
    colors = np.asarray(channel_set.source_colors) * ratios
    rows = tuple(tuple(row) for row in colors.tolist())
    return channel_set.model_copy(update={"source_colors": rows})


def _as_colors(shares: F64) -> NDArray[np.uint16]:
    """Shares in units of 1 / COLOR_SCALE that sum to it, by largest remainders."""
    scaled = shares * COLOR_SCALE
    whole = np.floor(scaled)
    rank = np.argsort(np.argsort(whole - scaled, axis=1, kind="stable"), axis=1, kind="stable")
    missing = COLOR_SCALE - whole.sum(axis=1, keepdims=True)
    rounded: NDArray[np.uint16] = (whole + (rank < missing)).astype(np.uint16)
    return rounded

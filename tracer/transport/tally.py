"""Sums over portions: how rays ended (the energy audit), and what detectors counted.

Sums are kept apart by source: a ray of source s carries the flux Φ_s/N_s, which is not the same for
all sources where ``share`` deals rays otherwise than flux. Rays of weight 1 are counted in
integers, colours in units of 1/65535, so that results do not depend on the order in which threads
finish. What several rays of one emission bring to one place is added up before it is squared.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inner_kernel, lean_kernel
from raymap.jit.scratch import lazy_zeros
from raymap.jit.types import F64, I64, Integer
from raymap.model.directory import ChannelSet, Directory
from raymap.model.errors import SceneError
from raymap.model.events import Event
from raymap.model.portion import Portion
from raymap.model.schema import COLOR_SCALE
from raymap.optics.photometry import Photometry
from tracer.transport.counts import Count, Counts, DetectorCount

__all__ = ["CLASSES", "Tally"]

CLASSES = ("absorbed", "detected", "left", "stopped", "errors")
"""How a ray can end; exclusive."""

_ABSORBED, _DETECTED, _LEFT, _STOPPED, _ERRORS = range(5)
_SURFACE = int(Event.SURFACE_ABSORPTION)
_VOLUME = int(Event.VOLUME_ABSORPTION)
_LEAVING = int(Event.LEFT_SCENE)
_STOP = int(Event.DEPTH_LIMIT | Event.ROULETTE_KILL)

_BLOCK = 2**12
"""Cells that are looked at together: memory of blocks that no light has met is never touched."""

_MOST_VALUES = 2**24
"""Beyond so many values sources that are given the same flux and share are summed together."""


class Tally:
    """Adds up portions of one run; safe to call from many threads."""

    def __init__(self, directory: Directory, channel_set: ChannelSet) -> None:
        n_sources, n_objects = len(directory.sources), len(directory.objects)
        n_media = len(directory.media)
        self.directory = directory
        self.n_channels = channel_set.n_channels
        self.rays = 0
        self.records = 0
        self.emitted = np.zeros(n_sources, np.int64)
        self.fluxes = np.array([source.flux for source in directory.sources], np.float64)
        self.blocking = np.zeros(n_objects, np.int64)
        for detector in directory.detectors:
            if detector.blocking:
                self.blocking[detector.object] = 1
        self._cells = np.array([item.cells for item in directory.detectors], np.int64)
        self._cells = self._cells.reshape(-1, 2)
        areas = self._cells[:, 0] * self._cells[:, 1]
        self._first = np.concatenate(([0], np.cumsum(areas))).astype(np.int64)
        n_cells = int(self._first[-1])
        per_group = n_cells * (2 * self.n_channels + 1) + 3 * (n_objects + n_media)
        light = Photometry(directory, channel_set)
        self._worth = np.ascontiguousarray(light.channel_worth)
        self.group = self._groups(per_group)
        _, members = np.unique(self.group, return_index=True)
        self._worth_of_group = self._worth[members]
        self._radiant = np.bincount(self.group, light.radiant_fluxes).astype(np.float64)
        n_groups = int(self.group.max(initial=-1)) + 1
        try:
            self._allocate(n_groups, n_cells, n_objects + n_media)
        except (MemoryError, ValueError):
            raise SceneError(
                f"the detectors' {n_cells:,} cells do not fit in memory; give them fewer cells"
            ) from None
        self._emissions = 0
        self.weighted = False
        self._lock = threading.Lock()

    def _allocate(self, n_groups: int, n_cells: int, n_takers: int) -> None:
        """Sums and squares by place, and what the emission at hand (from 1 on) has brought."""
        n_detectors = len(self._cells)
        places = len(CLASSES) + n_takers + n_detectors
        # Of all rays Σw, Σwy and Σ(wy)², and how many emissions they are
        self.endings = np.zeros((4, len(self.fluxes), len(CLASSES)))
        self._taken = np.zeros((4, n_groups, n_takers))
        self._whole = np.zeros((4, n_groups, n_detectors))
        self._sums = lazy_zeros((n_groups, n_cells, self.n_channels))
        self._sums2 = lazy_zeros((n_groups, n_cells, self.n_channels))
        self._squares = lazy_zeros((n_groups, n_cells))
        self._touched = np.zeros(-(-n_cells // _BLOCK), np.uint8)
        self._last_place, self._part_place = np.zeros(places, np.int64), np.zeros(places)
        self._last_cell = lazy_zeros((n_cells,)).view(np.int64)
        self._part_cell = lazy_zeros((n_cells, self.n_channels))

    def _groups(self, per_group: int) -> NDArray[np.int64]:
        """Number of the sums that each source adds to."""
        n = len(self.fluxes)
        if n * per_group <= _MOST_VALUES:
            return np.arange(n)
        known: dict[tuple[Any, ...], int] = {}
        kinds = [
            # One that is switched off has flux but no rays: it shares its sums with none that is on
            (item.flux, item.parameters.get("share"), item.parameters.get("on"), worth.tobytes())
            for item, worth in zip(self.directory.sources, self._worth, strict=True)
        ]
        return np.array([known.setdefault(kind, len(known)) for kind in kinds], np.int64)

    def add(self, portion: Portion, records: int | None = None) -> None:
        """Add a portion; of one from which records were left out, say how many there were."""
        weight, emission = portion.weight, portion.emission
        weights = np.ones(0) if weight is None else np.asarray(weight, np.float64)
        emissions = np.zeros(0, np.int64) if emission is None else np.asarray(emission, np.int64)
        with self._lock:
            self.weighted |= weight is not None
            self.rays += portion.n_rays
            self.records += portion.n_records if records is None else records
            self.emitted += portion.emitted
            before = self._emissions
            rays = _Rays(
                portion.source, portion.records_per_ray, portion.color_code, portion.color_table,
                weights, emissions,
            )  # fmt: skip
            points = _Points(portion.event, portion.object, portion.medium)
            places = _Brought(self._last_place, self._part_place)
            self._emissions = _add_endings(
                rays, points, self.blocking, self.group, self._worth, self.endings, self._taken,
                places, before,
            )  # fmt: skip
            if len(portion.descriptors.detector):
                seen = _Seen(
                    portion.descriptor_count, portion.descriptors.detector,
                    portion.descriptors.cell, portion.descriptors.registered,
                )  # fmt: skip
                grids = _Grids(
                    self._cells, self._first, self._sums, self._sums2, self._squares,
                    self._touched, self._whole,
                )  # fmt: skip
                cells = _Brought(self._last_cell, self._part_cell)
                _add_crossings(rays, seen, self.group, self._worth, grids, cells, places, before)

    # -- what was counted ------------------------------------------------------------------------

    def counts(self) -> Counts:
        """Everything as flux with standard errors, additive over the parts of a trace."""
        directory = self.directory
        return Counts(
            flux_unit=directory.flux_unit,
            sources=tuple(item.name for item in directory.sources),
            classes=CLASSES,
            endings=Count(
                source_flux=self.fluxes,
                emitted=self.emitted.astype(np.float64),
                sums=self.endings[1].copy(),
                squares=self.endings[2].copy(),
            ),
            objects=tuple(item.name for item in directory.objects),
            media=tuple(item.name for item in directory.media),
            taken=self._count(*self._taken[1:3].copy()),
            detectors={item.name: self.detector(k) for k, item in enumerate(directory.detectors)},
            weighted=self.weighted,
        )

    def detector(self, number: int) -> DetectorCount:
        """What a detector counted."""
        n_u, n_v = self._cells[number].tolist()
        first, n = int(self._first[number]), n_u * n_v
        n_groups, n_channels = len(self._sums), self.n_channels
        by_channel, cells = lazy_zeros((n_groups, n, n_channels)), lazy_zeros((n_groups, n))
        squares, sums2 = lazy_zeros((n_groups, n)), lazy_zeros((n_groups, n, n_channels))
        for low, high in self._lit(first, first + n):
            part, own = slice(low, high), slice(low - first, high - first)
            by_channel[:, own] = self._sums[:, part] / COLOR_SCALE
            cells[:, own] = _all_channels(by_channel[:, own], self._worth_of_group)
            squares[:, own] = self._squares[:, part] / COLOR_SCALE**2
            sums2[:, own] = self._sums2[:, part] / COLOR_SCALE**2
        return DetectorCount(
            cells=self._count(cells.reshape(-1, n_v, n_u), squares.reshape(-1, n_v, n_u)),
            whole=self._count(*self._whole[1:3, :, number].copy()),
            by_channel=by_channel.reshape(-1, n_v, n_u, n_channels),
            squares_by_channel=sums2.reshape(-1, n_v, n_u, n_channels),
            worth=self._worth_of_group,
            radiant=self._radiant,
            arrived=int(self._whole[3, :, number].sum()),
        )

    def _lit(self, first: int, end: int) -> Iterator[tuple[int, int]]:
        """Runs of cells from ``first`` to ``end`` outside of which no light was registered."""
        blocks = np.flatnonzero(self._touched[first // _BLOCK : -(-end // _BLOCK)])
        for block in (blocks + first // _BLOCK).tolist():
            yield max(first, block * _BLOCK), min(end, (block + 1) * _BLOCK)

    def detector_sums(self, number: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Σ w c and Σ over emissions of (Σ w c)², each (cells_v, cells_u, n_channels)."""
        found = self.detector(number)
        return found.sums, found.sums2

    def _count(self, sums: NDArray[np.float64], squares: NDArray[np.float64]) -> Count:
        n = len(sums)
        return Count(
            source_flux=np.bincount(self.group, self.fluxes, n).astype(np.float64),
            emitted=np.bincount(self.group, self.emitted, n).astype(np.float64),
            sums=sums,
            squares=squares,
        )

    def audit(self) -> dict[str, dict[str, float]]:
        """How the rays of each source ended; the classes add up to what it emitted."""
        table = {}
        for k, source in enumerate(self.directory.sources):
            row: dict[str, float] = {"emitted": int(self.emitted[k])}
            row |= {name: _plain(self.endings[0, k, c]) for c, name in enumerate(CLASSES)}
            table[source.name] = row
        return table

    def absorbed_by(self) -> dict[str, dict[str, float]]:
        """Where rays were absorbed: objects and media with how many they took."""
        taken = self._taken[0].sum(axis=0)
        objects = [item.name for item in self.directory.objects]
        media = [item.name for item in self.directory.media]
        return {
            "objects": {
                name: _plain(rays)
                for name, rays in zip(objects, taken[: len(objects)], strict=True)
                if rays > 0.0
            },
            "media": {
                name: _plain(rays)
                for name, rays in zip(media, taken[len(objects) :], strict=True)
                if rays > 0.0
            },
        }

    def share(self, name: str) -> float:
        """Share of all light that ended in a class."""
        emitted = self.emitted.astype(np.float64)
        per_ray = np.divide(self.fluxes, emitted, out=np.zeros(len(emitted)), where=emitted > 0)
        flux = per_ray @ self.endings[1]
        total = float(flux.sum())
        return float(flux[CLASSES.index(name)]) / total if total else 0.0


def _all_channels(
    by_channel: NDArray[np.float64], worth: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Σ over the last axis, which is short, times worth: NumPy's sum takes ten times as long."""
    total = np.zeros(by_channel.shape[:-1])
    for channel in range(by_channel.shape[-1]):
        total += by_channel[..., channel] * worth[:, channel, None]
    return total


def _plain(value: Any) -> float:
    """A count as int, a sum of weights as float."""
    return int(value) if float(value).is_integer() else float(value)


class _Rays(NamedTuple):
    """What a portion says of its rays and their colours; no weights, emissions where all are 1."""

    source: Any
    records: Any
    code: Any
    colors: Any
    weight: F64
    emission: I64


class _Points(NamedTuple):
    """What happened at each record, and where."""

    event: Any
    object: Any
    medium: Any


class _Seen(NamedTuple):
    """Descriptors of each record, and the columns of the descriptors."""

    count: Any
    detector: Any
    cell: Any
    registered: Any


class _Grids(NamedTuple):
    """The grids of all detectors one after the other, and the sums over them."""

    cells: I64
    first: I64
    sums: F64
    sums2: F64
    squares: F64
    touched: Any
    whole: F64


class _Brought(NamedTuple):
    """By place, the last emission that brought light there, and how much."""

    last: I64
    part: F64


@inner_kernel
def _bring(
    sums: F64, group: int, index: int, slot: int, brought: _Brought, number: int, weight: float,
    worth: float,
) -> None:  # fmt: skip
    """Add a weight to a place; the square is that of all that emission ``number`` brings there."""
    last, part = brought.last, brought.part
    if last[slot] != number:
        last[slot] = number
        part[slot] = 0.0
        sums[3, group, index] += 1.0
    light = weight * worth
    sums[0, group, index] += weight
    sums[1, group, index] += light
    sums[2, group, index] += light * (light + 2.0 * part[slot])
    part[slot] += light


@inner_kernel
def _worth_of(color_table: Any, code: Integer, worth: F64, source: int) -> float:
    """Worth of light of a colour."""
    n_channels = worth.shape[1]
    if code < n_channels:
        return float(worth[source, code])
    total = 0.0
    for k in range(n_channels):
        total += color_table[code - n_channels, k] * worth[source, k]
    return total / 65535.0


@lean_kernel
def _add_endings(
    rays: _Rays, points: _Points, blocking: I64, group: I64, worth: F64, endings: F64, taken: F64,
    places: _Brought, number: int,
) -> int:  # fmt: skip
    """Add how the rays of a portion ended; the number of the last emission."""
    emissions, weights = rays.emission, rays.weight
    n_classes, n_objects = endings.shape[2], len(blocking)
    r = -1
    for ray in range(len(rays.records)):
        r += rays.records[ray]
        if len(emissions) == 0 or ray == 0 or emissions[ray] != emissions[ray - 1]:
            number += 1
        weight = weights[ray] if len(weights) > 0 else 1.0
        bits = points.event[r]
        index = -1
        if bits & _SURFACE != 0:
            met = points.object[r]
            ending = _DETECTED if blocking[met] != 0 else _ABSORBED
            index = met
        elif bits & _LEAVING != 0:
            ending = _LEFT
        elif bits & _VOLUME != 0:
            ending = _ABSORBED
            index = n_objects + points.medium[r]
        elif bits & _STOP != 0:
            ending = _STOPPED
        else:
            ending = _ERRORS
        s = rays.source[ray]
        y = _worth_of(rays.colors, np.int64(rays.code[r]), worth, s)
        _bring(endings, s, ending, ending, places, number, weight, y)
        if index >= 0:
            _bring(taken, group[s], index, n_classes + index, places, number, weight, y)
    return number


@lean_kernel
def _add_crossings(
    rays: _Rays, seen: _Seen, group: I64, worth: F64, grids: _Grids, cells: _Brought,
    places: _Brought, number: int,
) -> None:  # fmt: skip
    """Add what the detectors registered.

    ``cells`` stay untouched until an emission registers a second time.
    """
    source, emissions, weights = rays.source, rays.emission, rays.weight
    sums, sums2, squares, whole = grids.sums, grids.sums2, grids.squares, grids.whole
    n_channels = sums.shape[2]
    beside = len(places.last) - whole.shape[2]
    record = 0
    d = 0
    met, first_place, first_code, first_weight = 0, 0, 0, 0.0
    for ray in range(len(rays.records)):
        if len(emissions) == 0 or ray == 0 or emissions[ray] != emissions[ray - 1]:
            number += 1
            met = 0
        weight = weights[ray] if len(weights) > 0 else 1.0
        g = group[source[ray]]
        for _ in range(rays.records[ray]):
            for _ in range(seen.count[record]):
                if seen.registered[d]:
                    detector = seen.detector[d]
                    code = np.int64(rays.code[record])
                    y = _worth_of(rays.colors, code, worth, source[ray])
                    _bring(whole, g, detector, beside + detector, places, number, weight, y)
                    index = grids.first[detector]
                    column, line = np.int64(seen.cell[d, 0]), np.int64(seen.cell[d, 1])
                    index += line * grids.cells[detector, 0] + column
                    grids.touched[index // _BLOCK] = 1
                    met += 1
                    if met == 1:
                        first_place, first_code, first_weight = int(index), int(code), weight
                    elif met == 2:
                        _keep(cells, first_place, number, rays.colors, first_code, first_weight)
                    mixed = met > 1 and cells.last[index] == number
                    before, added = 0.0, 0.0
                    for k in range(n_channels):
                        value = _light(rays.colors, code, k, n_channels, weight)
                        own = cells.part[index, k] if mixed else 0.0
                        before += own * worth[source[ray], k]
                        added += value * worth[source[ray], k]
                        if value != 0.0:
                            sums[g, index, k] += value
                            sums2[g, index, k] += value * (value + 2.0 * own)
                    squares[g, index] += added * (added + 2.0 * before)
                    if met > 1:
                        _keep(cells, index, number, rays.colors, code, weight)
                d += 1
            record += 1


@inner_kernel
def _light(color_table: Any, code: Integer, k: int, n_channels: int, weight: float) -> float:
    """Light of a ray in channel k, in units of 1/65535."""
    if code < n_channels:
        return 65535.0 * weight if code == k else 0.0
    return float(color_table[code - n_channels, k] * weight)


@inner_kernel
def _keep(
    cells: _Brought, index: Integer, number: int, color_table: Any, code: Integer, weight: float
) -> None:
    """Note what an emission has brought to a cell."""
    last_cell, part_cell = cells.last, cells.part
    if last_cell[index] != number:
        last_cell[index] = number
        for k in range(part_cell.shape[1]):
            part_cell[index, k] = 0.0
    for k in range(part_cell.shape[1]):
        part_cell[index, k] += _light(color_table, code, k, part_cell.shape[1], weight)

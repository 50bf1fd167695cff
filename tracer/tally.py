"""Sums over portions: how rays ended (the energy audit), and what detectors counted.

Sums are exact: rays of weight 1 are counted in integers, colours in units of 1/65535, so that
results do not depend on the order in which threads finish.
"""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.directory import ChannelSet, Directory
from raymap.events import Event
from raymap.kernels import lean_kernel
from raymap.portion import Portion
from raymap.schema import COLOR_SCALE
from tracer.geometry.kinds import F64, I64

__all__ = ["CLASSES", "Tally"]

CLASSES = ("absorbed", "detected", "left", "stopped", "errors")
"""How a ray can end; exclusive."""

_ABSORBED, _DETECTED, _LEFT, _STOPPED, _ERRORS = range(5)
_SURFACE = int(Event.SURFACE_ABSORPTION)
_VOLUME = int(Event.VOLUME_ABSORPTION)
_LEAVING = int(Event.LEFT_SCENE)
_STOP = int(Event.DEPTH_LIMIT | Event.ROULETTE_KILL)


class Tally:
    """Adds up portions of one run; safe to call from many threads."""

    def __init__(self, directory: Directory, channel_set: ChannelSet) -> None:
        n_sources, n_objects = len(directory.sources), len(directory.objects)
        self.directory = directory
        self.n_channels = channel_set.n_channels
        self.rays = 0
        self.records = 0
        self.emitted = np.zeros(n_sources, np.int64)
        self.endings = np.zeros((n_sources, len(CLASSES)))
        self.by_object = np.zeros(n_objects)
        self.by_medium = np.zeros(len(directory.media))
        self.blocking = np.zeros(n_objects, np.int64)
        for detector in directory.detectors:
            if detector.blocking:
                self.blocking[detector.object] = 1
        self._cells = np.array([item.cells for item in directory.detectors], np.int64)
        self._cells = self._cells.reshape(-1, 2)
        sizes = self._cells[:, 0] * self._cells[:, 1] * self.n_channels
        self._first = np.concatenate(([0], np.cumsum(sizes))).astype(np.int64)
        self._sums = np.zeros((2, int(self._first[-1])))
        self._lock = threading.Lock()

    def add(self, portion: Portion) -> None:
        """Add a portion."""
        weight = portion.weight
        weights = np.ones(0) if weight is None else np.asarray(weight, np.float64)
        with self._lock:
            self.rays += portion.n_rays
            self.records += portion.n_records
            self.emitted += portion.emitted
            _add_endings(
                portion.source, portion.records_per_ray, portion.event, portion.object,
                portion.medium, weights, self.blocking, self.endings, self.by_object,
                self.by_medium,
            )  # fmt: skip
            if len(portion.descriptors.detector):
                _add_meetings(
                    portion.records_per_ray, portion.descriptor_count, portion.color_code,
                    portion.color_table, weights, portion.descriptors.detector,
                    portion.descriptors.cell, portion.descriptors.registered, self._cells,
                    self._first, self._sums, self.n_channels,
                )  # fmt: skip

    def detector_sums(self, detector: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Σ w c and Σ (w c)² of a detector, each (cells_v, cells_u, n_channels)."""
        n_u, n_v = self._cells[detector]
        part = self._sums[:, self._first[detector] : self._first[detector + 1]]
        sums, sums2 = part.reshape(2, n_v, n_u, self.n_channels)
        return sums / COLOR_SCALE, sums2 / COLOR_SCALE**2

    def audit(self) -> dict[str, dict[str, float]]:
        """How the rays of each source ended; the classes add up to what it emitted."""
        table = {}
        for k, source in enumerate(self.directory.sources):
            row: dict[str, float] = {"emitted": int(self.emitted[k])}
            row |= {name: _plain(self.endings[k, c]) for c, name in enumerate(CLASSES)}
            table[source.name] = row
        return table

    def absorbed_by(self) -> dict[str, dict[str, float]]:
        """Where light was absorbed: objects and media with what they took."""
        objects = {
            item.name: _plain(self.by_object[k])
            for k, item in enumerate(self.directory.objects)
            if self.by_object[k] > 0.0
        }
        media = {
            item.name: _plain(self.by_medium[k])
            for k, item in enumerate(self.directory.media)
            if self.by_medium[k] > 0.0
        }
        return {"objects": objects, "media": media}

    def share(self, name: str) -> float:
        """Share of all rays that ended in a class."""
        total = float(self.endings.sum())
        return float(self.endings[:, CLASSES.index(name)].sum()) / total if total else 0.0


def _plain(value: Any) -> float:
    """A count as int, a sum of weights as float."""
    return int(value) if float(value).is_integer() else float(value)


@lean_kernel
def _add_endings(
    source: Any, records_per_ray: Any, event: Any, obj: Any, medium: Any, weights: F64,
    blocking: I64, endings: F64, by_object: F64, by_medium: F64,
) -> None:  # fmt: skip
    last = -1
    for ray in range(len(records_per_ray)):
        last += records_per_ray[ray]
        weight = weights[ray] if len(weights) > 0 else 1.0
        bits = event[last]
        if bits & _SURFACE != 0:
            met = obj[last]
            ending = _DETECTED if blocking[met] != 0 else _ABSORBED
            by_object[met] += weight
        elif bits & _LEAVING != 0:
            ending = _LEFT
        elif bits & _VOLUME != 0:
            ending = _ABSORBED
            by_medium[medium[last]] += weight
        elif bits & _STOP != 0:
            ending = _STOPPED
        else:
            ending = _ERRORS
        endings[source[ray], ending] += weight


@lean_kernel
def _add_meetings(
    records_per_ray: Any, descriptor_count: Any, color_code: Any, color_table: Any, weights: F64,
    detector: Any, cell: Any, registered: Any, cells: I64, first: I64, sums: F64, n_channels: int,
) -> None:  # fmt: skip
    record = 0
    d = 0
    for ray in range(len(records_per_ray)):
        weight = weights[ray] if len(weights) > 0 else 1.0
        for _ in range(records_per_ray[ray]):
            for _ in range(descriptor_count[record]):
                if registered[d]:
                    number = detector[d]
                    place = np.int64(cell[d, 1]) * cells[number, 0] + np.int64(cell[d, 0])
                    base = first[number] + place * n_channels
                    code = color_code[record]
                    if code < n_channels:
                        value = 65535.0 * weight
                        sums[0, base + code] += value
                        sums[1, base + code] += value * value
                    else:
                        for k in range(n_channels):
                            value = color_table[code - n_channels, k] * weight
                            sums[0, base + k] += value
                            sums[1, base + k] += value * value
                d += 1
            record += 1

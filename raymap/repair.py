"""Write the sound parts of a map as a sound map."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from raymap.cells import is_pinhole
from raymap.encoder import EncodedPortion
from raymap.errors import FormatError
from raymap.kernels import lean_kernel
from raymap.layout import KNOWN_TAGS
from raymap.reader import RayMap
from raymap.replacing import refuse_existing, replacing
from raymap.schema import COLOR_SCALE
from raymap.stored import StoredPortion
from raymap.verify import portion_problem
from raymap.writer import RayMapWriter

__all__ = ["add_meetings", "repair"]

Sums = NDArray[np.float64]


def repair(ray_map: RayMap, path: str | os.PathLike[str], *, force: bool = False) -> int:
    """Write a map of all sound portions, with footer and detector results made anew.

    Parameters
    ----------
    ray_map : opened with ``on_damage="skip"``; one file, finished or not
    path : of the new map
    force : replace an existing file

    Returns
    -------
    n : portions written; they are copied byte for byte

    Raises
    ------
    MapExists, NotWritten
    """
    target = Path(path)
    refuse_existing(target, force=force)
    with (
        replacing(target) as temporary,
        RayMapWriter.create(
            temporary, ray_map.directory, meshes=ray_map.meshes, trusted=True
        ) as writer,
    ):
        for channel_set in ray_map.channel_sets:
            writer.add_channel_set(channel_set, again=True)
        runs = sorted(ray_map.runs, key=lambda run: int(run.get("first_portion") or 0))
        written = 0
        results: dict[tuple[int, int], tuple[Sums, Sums]] = {}
        for portion in ray_map.portions:
            while runs and int(runs[0].get("first_portion") or 0) <= portion.number:
                writer.copy_run(runs.pop(0))
            problem = portion_problem(portion)
            if problem is not None:
                ray_map.report_damage(portion.index, problem)
                continue
            writer.copy_portion(_as_encoded(portion))
            written += 1
            _count_meetings(portion, results)
        _copy_unknown(ray_map, writer)
        _keep_pictures(ray_map, results)
        for (detector, index), (sums, sums2) in results.items():
            writer.add_detector_result(detector, sums, sums2, channel_set=index)
        writer.finish()
    return written


def _keep_pictures(ray_map: RayMap, results: dict[tuple[int, int], tuple[Sums, Sums]]) -> None:
    """Carry pictures along that no ray made, unless some of what they were summed over is lost."""
    for number, detector in enumerate(ray_map.directory.detectors):
        if not is_pinhole(detector):
            continue
        for index in range(len(ray_map.channel_sets)):
            results.pop((number, index), None)
            found = None if ray_map.damage else ray_map.detector_result(detector.name, index)
            if found is not None:
                results[number, index] = found


def _copy_unknown(ray_map: RayMap, writer: RayMapWriter) -> None:
    """Carry chunks along that this version does not know."""
    for offset, tag in ray_map.other_chunks:
        if tag not in KNOWN_TAGS:
            try:
                chunk = ray_map.file.chunk_at(offset, ray_map.bytes)
            except FormatError:
                continue
            writer.copy_chunk(tag, ray_map.file.read(offset, chunk.header.size))


def _as_encoded(portion: StoredPortion) -> EncodedPortion:
    return EncodedPortion(
        meta=portion.index.meta,
        buffers=[portion.chunk_bytes()],
        size=portion.index.size,
        paths=portion.paths() if portion.has_paths else None,
    )


def _count_meetings(
    portion: StoredPortion, results: dict[tuple[int, int], tuple[Sums, Sums]]
) -> None:
    for detector, described in enumerate(portion.map.directory.detectors):
        columns, rows = described.cells
        channels = portion.map.channel_sets[portion.channel_set].n_channels
        key = detector, portion.channel_set
        if key not in results:
            shape = (rows, columns, channels)
            results[key] = np.zeros(shape), np.zeros(shape)
        add_meetings(portion, detector, *results[key])


def add_meetings(portion: StoredPortion, detector: int, sums: Sums, sums2: Sums) -> None:
    """Add what a detector registered in a portion.

    Parameters
    ----------
    sums, sums2 : (cells_v, cells_u, n_channels), of registered meetings Σ w·c, and the sum over
        emissions of (Σ w·c)²
    """
    if not portion.n_descriptors:
        return
    meetings = portion.descriptors()
    counts = portion.column("descriptor_count")
    counted = (meetings.detector == detector) & meetings.registered
    records = np.repeat(np.arange(portion.n_records), counts)[counted]
    rays = np.searchsorted(portion.record_offsets(), records, side="right") - 1
    weight = portion.column("weight")[rays]
    colors = portion.column("color")[records]
    emission = portion.column("emission")[rays] if portion.grouped else rays.astype(np.int64)
    cell = meetings.cell[counted]
    last = np.full(sums.shape[:2], -1, np.int64)
    _count(cell, weight, emission, colors, sums, sums2, last, np.zeros(sums.shape))


@lean_kernel
def _count(
    cell: NDArray[np.uint16],
    weight: NDArray[np.float32],
    emission: NDArray[np.int64],
    colors: NDArray[np.uint16],
    sums: Sums,
    sums2: Sums,
    last: NDArray[np.int64],
    part: Sums,
) -> None:
    """Add w·c of each meeting to its cell; ``part`` is what the ``last`` emission brought there."""
    for k in range(weight.size):
        v, u = cell[k, 1], cell[k, 0]
        if last[v, u] != emission[k]:
            last[v, u] = emission[k]
            for channel in range(colors.shape[1]):
                part[v, u, channel] = 0.0
        for channel in range(colors.shape[1]):
            value = np.float64(weight[k]) * colors[k, channel] / COLOR_SCALE
            sums[v, u, channel] += value
            sums2[v, u, channel] += value * (value + 2.0 * part[v, u, channel])
            part[v, u, channel] += value

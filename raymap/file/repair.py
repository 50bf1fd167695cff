"""Write the sound parts of a map as a sound map."""

from __future__ import annotations

import os
from pathlib import Path

from raymap.bytes.layout import KNOWN_TAGS, header_size
from raymap.encoding.encoder import EncodedPortion
from raymap.file.agreement import FALSE_COUNTS
from raymap.file.cellsums import DetectorSums
from raymap.file.reader import RayMap
from raymap.file.stored import StoredPortion
from raymap.file.verify import portion_problem
from raymap.file.writer import RayMapWriter
from raymap.model.errors import FormatError
from raymap.model.replacing import refuse_existing, replacing
from raymap.optics.cells import is_pinhole

__all__ = ["repair"]


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
        results = DetectorSums()
        for portion in ray_map.portions:
            while runs and int(runs[0].get("first_portion") or 0) <= portion.number:
                writer.copy_run(runs.pop(0))
            problem = portion_problem(portion)
            if problem is not None:
                ray_map.report_damage(portion.index, problem)
            if problem in FALSE_COUNTS:
                # The rays are sound: what was said of them is said anew
                writer.copy_portion(writer.encode(portion.read(), portion.number))
            elif problem is None:
                writer.copy_portion(_as_encoded(portion))
            else:
                continue
            written += 1
            results.add(portion)
        _copy_unknown(ray_map, writer)
        _keep_sums(ray_map, results)
        for (detector, index), (sums, sums2) in results.sums.items():
            writer.add_detector_result(detector, sums, sums2, channel_set=index)
        writer.finish()
    return written


def _keep_sums(ray_map: RayMap, results: DetectorSums) -> None:
    """Carry sums along that no stored ray made, unless some of what they speak of is lost."""
    for number, detector in enumerate(ray_map.directory.detectors):
        if not (is_pinhole(detector) or ray_map.without_rays):
            continue
        for index in range(len(ray_map.channel_sets)):
            results.sums.pop((number, index), None)
            found = None if ray_map.damage else ray_map.detector_result(detector.name, index)
            if found is not None:
                results.sums[number, index] = found


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
    data = portion.chunk_bytes()
    return EncodedPortion(
        meta=portion.index.meta,
        buffers=[data],
        size=portion.index.size,
        head_size=header_size(data),
        paths=portion.paths() if portion.has_paths else None,
    )

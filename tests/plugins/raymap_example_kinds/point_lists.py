"""Rays that another program traced, as lines ``ray x y z`` (``.pts``)."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from raymap.foreign.recorded import RecordedFormat
from raymap.foreign.recorder import Point, RayRecorder
from raymap.model.errors import RayMapError
from raymap.model.events import Event

__all__ = ["FORMAT"]


def write_map(
    source: str | os.PathLike[str],
    path: str | os.PathLike[str],
    *,
    names: Mapping[str, str] | None = None,
    length_unit: str = "mm",
    flux_unit: str = "W",
    wavelength_nm: float = 550.0,
    force: bool = False,
) -> dict[str, int]:
    """Write a ray map of a file."""
    rays: dict[int, list[Any]] = {}
    for number, line in enumerate(Path(source).read_text().splitlines(), start=1):
        try:
            ray, *place = line.split()
            rays.setdefault(int(ray), []).append(tuple(map(float, place)))
        except ValueError:
            raise RayMapError(f"{source}: line {number}: write ray, x, y and z") from None
    records = 0
    with RayRecorder(
        path,
        objects={"screen": ()},
        sources={"lamp": 1.0},
        wavelengths_nm=[wavelength_nm],
        length_unit=length_unit,
        flux_unit=flux_unit,
        force=force,
    ) as record:
        for first, *others in rays.values():
            last = Point(position=others[-1], event=Event.SURFACE_ABSORPTION, object="screen")
            record.ray([Point(position=first, event=Event.EMITTED), last])
            records += 2
    return {"rays": len(rays), "records": records}


FORMAT = RecordedFormat(suffixes=(".pts",), title="points of rays, one a line", write_map=write_map)

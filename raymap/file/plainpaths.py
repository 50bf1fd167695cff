"""A plain portion seen as a path dictionary."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.encoding.paths import PathDictionary
from raymap.file.owner import ReadPortion
from raymap.model.schema import COLOR_SCALE

__all__ = ["PlainPaths"]


class PlainPaths(PathDictionary):
    """A plain portion as a dictionary of one path per ray; columns are decoded when touched."""

    def __init__(self, portion: ReadPortion) -> None:
        object.__setattr__(self, "_portion", portion)

    _portion: ReadPortion

    @property
    def n_paths(self) -> int:
        return self._portion.n_rays

    @property
    def n_points(self) -> int:
        return self._portion.n_records

    @property
    def n_crossings(self) -> int:
        return self._portion.n_descriptors

    def _source(self) -> NDArray[np.int16]:
        return self._portion.column("source")

    def _detector_offsets(self) -> NDArray[np.int64]:
        return self._portion._crossing_offsets(self._portion.column("descriptor_count"))

    def _sum_w2(self) -> NDArray[np.float64]:
        return self.sum_w**2

    def _sum_wy2(self) -> NDArray[np.float64] | None:
        portion = self._portion
        light = portion.map.photometry(portion.channel_set)
        if light.unit != "lm":
            return None
        codes = portion.column("last_color")
        worth = light.worth_of_rays(self.source, codes, portion.color_table())
        squares: NDArray[np.float64] = (self.sum_w * worth) ** 2
        return squares

    def _sum_wc(self) -> tuple[NDArray[np.float64], ...]:
        portion = self._portion
        ends = portion.record_offsets()[1:] - 1
        colors = portion.color_codes(portion.column("color_code")[ends]).colors()
        sums = [np.zeros((portion.n_rays, 0)) for _ in portion.map.channel_sets]
        sums[portion.channel_set] = colors / COLOR_SCALE * self.sum_w[:, None]
        return tuple(sums)

    def __getattribute__(self, name: str) -> Any:
        getter = _LAZY.get(name)
        if getter is None:
            return object.__getattribute__(self, name)
        known = object.__getattribute__(self, "__dict__")
        if name not in known:
            known[name] = getter(self)
        return known[name]


_LAZY: dict[str, Any] = {
    "source": PlainPaths._source,
    "offsets": lambda view: view._portion.record_offsets(),
    "object": lambda view: view._portion.column("object"),
    "face": lambda view: view._portion.column("face"),
    "event": lambda view: view._portion.column("event"),
    "medium": lambda view: view._portion.column("medium"),
    "detector_offsets": PlainPaths._detector_offsets,
    "detector": lambda view: view._portion._crossed()[0],
    "registered": lambda view: view._portion._crossed()[1],
    "rays": lambda view: np.ones(view._portion.n_rays, np.int64),
    "sum_w": lambda view: view._portion.column("weight").astype(np.float64),
    "sum_w2": PlainPaths._sum_w2,
    "sum_wc": PlainPaths._sum_wc,
    "sum_wy2": PlainPaths._sum_wy2,
    "grouped": lambda view: view._portion.grouped,
}

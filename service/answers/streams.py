"""Requests that are answered with a stream of Arrow record batches."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from raymap.model.directory import ChannelSet
from raymap.model.errors import RayMapError
from raymap.optics.colorimetry import encode_srgb
from raymap.optics.photometry import colors_of_codes, displayed
from service.answers.requests import Request
from service.answers.results import read_png
from service.files.library import Library
from service.limits import Deadline, Gate
from service.processes.workers import Bounds, Workers

__all__ = ["STREAMS", "Answer", "Streams"]

Gone = Callable[[], bool]
STREAMS = ("rays", "ray_ids", "lines", "paths", "image", "picture")
"""What can be asked for."""

_BATCH = 2**16
_IDS = pa.schema([("ray_id", pa.int64())])
_LINES = pa.schema(
    [
        ("ray_id", pa.int64()),
        ("source", pa.string()),
        ("rgb", pa.list_(pa.uint8(), 3)),
        ("points", pa.list_(pa.list_(pa.float32(), 3))),
    ]
)
_PATHS = pa.schema(
    [
        ("path", pa.string()),
        ("criterion", pa.string()),
        ("rays", pa.int64()),
        ("flux", pa.float64()),
        ("flux_se", pa.float64()),
        ("doubtful", pa.list_(pa.string())),
        ("share", pa.float64()),
        ("source", pa.string()),
        ("reflections", pa.int32()),
        ("first_object", pa.string()),
        ("last_object", pa.string()),
        ("peak_u", pa.int32()),
        ("peak_v", pa.int32()),
        ("peak_flux", pa.float64()),
    ]
)
_PICTURE = pa.schema([("png", pa.large_binary())])


@dataclass(frozen=True)
class Answer:
    """A stream: its schema is known before its batches are made."""

    schema: pa.Schema
    batches: Iterator[pa.RecordBatch]


class Streams:
    """Selected rays, path tables, images and pictures."""

    def __init__(self, library: Library, gate: Gate, workers: Workers, threads: int | None) -> None:
        self.library, self.gate, self.threads = library, gate, threads
        self.workers = workers

    def answer(self, request: Request, gone: Gone) -> Answer:
        """The stream that a ticket asks for."""
        kind = request.choice("get", STREAMS)
        request.what = kind
        made: Answer = getattr(self, f"_{kind}")(request, gone)
        return made

    def _search(
        self, request: Request, name: str, criterion: Any, limit: int | None, stack: ExitStack,
        gone: Gone,
    ) -> Any:  # fmt: skip
        """Map and selection, and the function that says whether the time is over."""
        from query.answers.selections.selector import select

        ray_map = stack.enter_context(self.library.map(name))
        with self.gate.turn():
            over = Deadline(request.limits.search_seconds, gone)
            found = select(ray_map, criterion, limit=limit, cancel=over, threads=self.threads)
            if not found.complete:
                over.check()
        rows = found.matched
        if rows > request.limits.rows:
            raise RayMapError(
                f"{request.what}: {rows} rays are selected, this service sends at most "
                f"{request.limits.rows}: ask for fewer with 'limit'"
            )
        return ray_map, found

    def _selected(self, request: Request) -> tuple[str, Any, int | None]:
        name, criterion = request.text("map"), request.criterion()
        return name, criterion, request.whole("limit", 1, 2**62, None)

    def _ray_ids(self, request: Request, gone: Gone) -> Answer:
        name, criterion, limit = self._selected(request)
        request.finish()
        with ExitStack() as stack:
            _, found = self._search(request, name, criterion, limit, stack, gone)
            ids = found.ray_ids
        schema = _IDS.with_metadata({"raymap.summary": json.dumps(found.summary())})
        table = pa.table([pa.array(ids)], schema=schema)
        return Answer(schema, iter(table.to_batches(max_chunksize=_BATCH)))

    def _rays(self, request: Request, gone: Gone) -> Answer:
        """Everything that is recorded of the selected rays, as `raymap export` writes it."""
        from raymap.tables.arrow import batches, schema_of

        name, criterion, limit = self._selected(request)
        rows: Any = request.choice("rows", ("segments", "rays"), "segments")
        request.finish()
        with self.library.map(name) as ray_map:
            schema = schema_of(ray_map, rows)

        def make() -> Iterator[pa.RecordBatch]:
            with ExitStack() as stack:
                opened, found = self._search(request, name, criterion, limit, stack, gone)
                for batch in batches(opened, rows, found.ray_ids, schema):
                    if gone():
                        return
                    yield batch

        return Answer(schema, make())

    def _lines(self, request: Request, gone: Gone) -> Answer:
        """The selected rays as polylines, to be drawn."""
        name, criterion, limit = self._selected(request)
        request.finish()

        def make() -> Iterator[pa.RecordBatch]:
            with ExitStack() as stack:
                opened, found = self._search(request, name, criterion, limit, stack, gone)
                sources = [item.name for item in opened.directory.sources]
                for portion in found.portions():
                    if gone():
                        return
                    channel_set = opened.channel_sets[portion.channel_set]
                    yield _lines_of(portion, sources, channel_set)

        return Answer(_LINES, make())

    def _paths(self, request: Request, gone: Gone) -> Answer:
        from query.answers.paths.tables import path_table

        name, criterion = request.text("map"), request.criterion()
        by = request.choice("by", ("face", "object"), "face")
        sort = request.choice("sort", ("flux", "rays", "peak"), "flux")
        peak = request.text("peak", None)
        top = request.whole("top", 1, 10**6, 1000)
        request.finish()
        with self.gate.turn(), self.library.map(name) as ray_map:
            over = Deadline(request.limits.search_seconds, gone)
            table = path_table(
                ray_map, criterion, by=by, sort=sort, peak=peak, cancel=over, threads=self.threads
            )
            if not table.complete:
                over.check()
            rows = [_flat(row) for row in table.to_json(top)]
            facts = {
                "n_paths": table.n_paths,
                "total": table.total,
                "flux_unit": ray_map.directory.flux_unit,
                "by": by,
            }
        schema = _PATHS.with_metadata({"raymap.table": json.dumps(facts)})
        return Answer(schema, iter(pa.Table.from_pylist(rows, schema=schema).to_batches()))

    def _image(self, request: Request, gone: Gone) -> Answer:
        """What the selected rays put on a detector, one row of cells per row of the table."""
        from query.answers.images.images import detector_image

        name, criterion = request.text("map"), request.criterion()
        detector = request.text("detector")
        request.finish()
        with self.gate.turn(), self.library.map(name) as ray_map:
            over = Deadline(request.limits.search_seconds, gone)
            image = detector_image(ray_map, detector, criterion, cancel=over, threads=self.threads)
            if not image.complete:
                over.check()
        lit, (width, height) = image.lit, image.detector.cells
        channels = lit.channels.shape[1]
        columns = {
            "flux": lit.flux,
            "variance": lit.variance,
            "rays": lit.rays,
            "channels": lit.channels,
        }
        schema = pa.schema(
            [
                ("v", pa.int32()),
                ("flux", pa.list_(pa.float64(), width)),
                ("variance", pa.list_(pa.float64(), width)),
                ("rays", pa.list_(pa.int64(), width)),
                ("channels", pa.list_(pa.float64(), width * channels)),
            ],
            metadata={
                "raymap.image": json.dumps(
                    {
                        "detector": image.detector.model_dump(mode="json"),
                        "channel_set": image.channel_set.model_dump(mode="json"),
                        "flux_unit": image.flux_unit,
                        "length_unit": image.length_unit,
                        "cells": [width, height],
                        "n_channels": channels,
                        "total": image.total,
                    }
                )
            },
        )

        def make() -> Iterator[pa.RecordBatch]:
            step = max(1, _BATCH // max(1, width * channels))
            for first in range(0, height, step):
                rows = range(first, min(first + step, height))
                yield pa.record_batch(
                    [
                        pa.array(np.arange(rows.start, rows.stop, dtype=np.int32)),
                        *(
                            _fixed(lit.band(values, rows), schema.field(name).type)
                            for name, values in columns.items()
                        ),
                    ],
                    schema=schema,
                )

        return Answer(schema, make())

    def _picture(self, request: Request, gone: Gone) -> Answer:
        """The scene with the selected rays, as a PNG."""
        from viewer.drawn.state import COLOR_RULES

        name, criterion = request.text("map"), request.criterion()
        rays = request.whole("rays", 1, 200_000, 500)
        width, height = (
            request.whole("width", 16, 8192, 1600),
            request.whole("height", 16, 8192, 900),
        )
        color = request.choice("color", tuple(COLOR_RULES), "natural")
        view = request.text("view", None)
        request.finish()
        if width * height > request.limits.pixels:
            raise RayMapError(
                f"picture: {width} x {height} are more than the {request.limits.pixels} pixels "
                "that this service paints"
            )
        job = {
            "folder": str(self.library.folder.root),
            "paths": [str(path) for path in self.library.folder.map_paths(name)],
            "criterion": None if criterion is None else str(criterion),
            "options": {"rays": rays, "size": [width, height], "color": color, "view": view},
        }
        bounds = Bounds(
            seconds=request.limits.search_seconds,
            memory_bytes=request.limits.memory_bytes,
            file_bytes=2**30,
            threads=os.cpu_count() or 1,
            option="--search-seconds",
        )
        with self.gate.turn():
            data = read_png(self.workers.ask("picture", job, bounds, gone))
        batch = pa.record_batch([pa.array([data], pa.large_binary())], schema=_PICTURE)
        return Answer(_PICTURE, iter([batch]))


def _fixed(values: Any, kind: Any) -> pa.Array:
    """Rows of numbers as lists of one length."""
    flat = pa.array(np.ascontiguousarray(values).reshape(-1), kind.value_type)
    return pa.FixedSizeListArray.from_arrays(flat, type=kind)


def _flat(row: dict[str, Any]) -> dict[str, Any]:
    """A row of the path table with the peak's cell as two columns."""
    cell = row.pop("peak", None) or (None, None)
    return {**row, "peak_u": cell[0], "peak_v": cell[1]}


def _lines_of(portion: Any, sources: list[str], channel_set: ChannelSet) -> pa.RecordBatch:
    """Points of every ray, its colour at the end as sRGB of full brightness."""
    offsets = np.zeros(portion.n_rays + 1, np.int32)
    np.cumsum(portion.records_per_ray, out=offsets[1:])
    points = np.ascontiguousarray(portion.position, np.float32)
    triples = pa.FixedSizeListArray.from_arrays(pa.array(points.reshape(-1)), 3)
    return pa.record_batch(
        [
            pa.array(portion.ray_ids),
            pa.array(np.array(sources, object)[portion.source], pa.string()),
            _fixed(_colors(portion, offsets[1:] - 1, channel_set), _LINES.field("rgb").type),
            pa.ListArray.from_arrays(pa.array(offsets), triples),
        ],
        schema=_LINES,
    )


def _colors(portion: Any, records: Any, channel_set: ChannelSet) -> Any:
    """(n, 3) uint8 of the chosen records."""
    shares = colors_of_codes(portion.color_table, channel_set.n_channels)
    linear = displayed(channel_set, shares)[portion.color_code[records]]
    linear /= np.maximum(linear.max(axis=1, keepdims=True), 1e-12)
    return np.round(encode_srgb(linear) * 255).astype(np.uint8)

"""The file."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

import query
import raymap
from tests.naive.format_reader import read_map
from tests.validation import Row, check
from tracer.run.recording import record
from tracer.scene.load import load_scene

SAMPLES = Path(__file__).parents[2] / "samples"


@check(
    what="samples/double_gauss.toml, 20,000 rays: what the product reads otherwise",
    source="a reader of 200 lines written from docs/format.md alone (tests/naive/format_reader.py)",
)
def second_reader() -> list[Row]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "lens.raymap"
        record(load_scene(SAMPLES / "double_gauss.toml"), path, rays=20_000, threads=1)
        directory, _, portions = read_map(path)
        with raymap.open(path) as ray_map:
            matched = query.select(ray_map, 'last(hit("sensor"))').matched
            read = [portion.read() for portion in ray_map.portions]
    sensor = [item["name"] for item in directory["objects"]].index("sensor")
    ended, differences = 0, dict.fromkeys(("position", "event", "medium", "normal"), 0)
    for portion, other in zip(portions, read, strict=True):
        last = np.cumsum(portion["records_per_ray"]) - 1
        ended += int(np.count_nonzero(portion["object"][last] == sensor))
        for column in differences:
            differences[column] += int(np.sum(portion[column] != getattr(other, column)))
    rows = [
        Row(expected=0, got=found, tolerance=0, of=f"values of {column}")
        for column, found in differences.items()
    ]
    ended_otherwise = abs(matched - ended)
    return [*rows, Row(expected=0, got=ended_otherwise, tolerance=0, of="rays on the sensor")]

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


@check(
    what="Scene of 19 × 19 discs and of 10,000 boxes, recorded and read back: bodies of the map",
    source="The counts that the scene states; a directory of at most 3 MB",
)
def many_bodies() -> list[Row]:
    rows = []
    for of, count, body in (
        ("discs", (19, 19), 'kind = "disc"\nouter = 1\nsurface = "k"'),
        ("boxes", (100, 100), 'kind = "box"\nsize = [1, 1, 1]\nsurface = "k"'),
    ):
        with tempfile.TemporaryDirectory() as folder:
            scene = Path(folder) / "scene.toml"
            scene.write_text(
                f"""
length_unit = "mm"
[surfaces.k]
kind = "absorber"
[bodies.b]
{body}
copies = {{ count = {list(count)}, step = [[5, 0, 0], [0, 5, 0]] }}
[sources.s]
kind = "collimated"
position = [0, 0, -50]
direction = [0, 0, 1]
diameter = 100
""",
                encoding="utf-8",
            )
            path = Path(folder) / "many.raymap"
            record(load_scene(scene), path, rays=100, threads=1)
            assert path.stat().st_size < 3_000_000
            with raymap.open(path) as ray_map:
                got = len(ray_map.directory.objects)
        rows.append(Row(expected=count[0] * count[1], got=got, tolerance=0, of=of))
    return rows

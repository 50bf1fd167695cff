"""How fast a large map answers, and how fast a Parquet copy answers the same questions.

Records the double Gauss (50 million rays, about 4 GB) and a room of diffuse boxes whose paths do
not repeat, asks both, and puts the same questions to DuckDB and Polars on a Parquet export of a
smaller map. Prints the machine, versions, the seed, medians and ratios as JSON. Usage::

    python benchmarks/queries.py [--rays N] [--diffuse-rays N] [--compare-rays N] [--repeat K]
                               [--folder DIR] [--keep] [--map MAP]
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import raymap
from query import path_table, select
from query.engine.scan import default_threads
from raymap.model.events import FAMILIES

SAMPLE = Path(__file__).parents[1] / "samples" / "double_gauss.toml"

PATH_LEVEL = {
    "face and event": 'hit("L1.back", reflected)',
    "ghosts": 'count(hit("L*", reflected)) == 2 & !event(scattered) & detected("sensor")',
    "order": 'hit("L2.front", reflected) -> hit("L1.back", reflected) -> detected("sensor")',
    "itinerary": 'path("beam (L*:refracted)+ L2.front:reflected .* @sensor")',
}
FURTHER = {
    "primitive": 'hit("L1.#0", reflected)',
    "region": 'detected("sensor", rect(0, 0, 360, 240))',
    "wavelength": 'wavelength < 560 nm & detected("sensor")',
}
POSITIONS = {
    "length": "length > 160 mm",
    "incidence": 'incidence(hit("L4.front")) > 30 deg',
    "optical length": "optical_length < 200 mm",
}
DIFFUSE = {
    "object": 'hit("key_3")',
    "object and detector": 'hit("key_3", reflected) & detected("ceiling")',
    "count": 'count(hit("key_*", reflected)) >= 2',
    "order": 'hit("key_3") -> hit("key_5")',
}
DIFFUSE_FURTHER = {
    "region": 'detected("ceiling", rect(0, 0, 10, 10))',
    "length": "length > 60 mm",
}


def machine() -> dict[str, object]:
    """Processor, number of cores and versions."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        model = names[0].partition(":")[2].strip() if names else model
    packages = ("numpy", "numba", "zstandard", "pyarrow", "duckdb", "polars")
    return {
        "processor": model,
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        **{name: version(name) for name in packages},
    }


def diffuse_scene(folder: Path) -> Path:
    """White boxes in a white room, and a lamp: every ray wanders on a path of its own."""
    lines = [
        'title = "Diffuse boxes"\nlength_unit = "mm"\nflux_unit = "W"',
        "[surfaces.white]\nkind = 'lambertian'\nreflectance = 0.9",
        "[bodies.room]\nkind = 'box'\nposition = [0, 0, 15]\nsize = [80, 80, 30]\n"
        "surface = 'white'",
        "[sources.lamp]\nkind = 'point'\nposition = [0, 0, 20]",
        "[detectors.ceiling]\nposition = [0, 0, 29]\nlooks = [0, 0, -1]\nup = [0, 1, 0]\n"
        "size = [80, 80]\ncells = [80, 80]",
    ]
    for number in range(36):
        x, y = 12 * (number % 6) - 30, 12 * (number // 6) - 30
        lines.append(
            f"[bodies.key_{number}]\nkind = 'box'\nposition = [{x}, {y}, 4]\nsize = [8, 8, 6]\n"
            "surface = 'white'"
        )
    path = folder / "diffuse.toml"
    path.write_text("\n".join(lines) + "\n")
    return path


def median(function: Callable[[], Any], repeat: int) -> tuple[float, Any]:
    """Median of the seconds that a call takes, and what it returned."""
    function()
    seconds = []
    for _ in range(repeat):
        start = time.perf_counter()
        answer = function()
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds), answer


def ask(path: Path, counts: dict[str, str], rays: dict[str, str], repeat: int) -> dict[str, Any]:
    """Seconds of each question on one map."""
    start = time.perf_counter()
    opened = raymap.open(path)
    report: dict[str, Any] = {"open_s": time.perf_counter() - start}
    with opened as map:
        start = time.perf_counter()
        _ = map.merged
        report |= {
            "merged_paths_s": time.perf_counter() - start,
            "rays": map.rays,
            "records": map.records,
            "bytes_per_record": map.bytes / map.records,
            "paths": None if map.merged is None else map.merged.paths.n_paths,
        }
        for name, text in counts.items():
            seconds, found = median(lambda text=text: select(map, text, rays=False), repeat)
            numbers, _ = median(lambda text=text: select(map, text).ray_ids, repeat)
            report[name] = {"matched": found.matched, "count_s": seconds, "ray_numbers_s": numbers}
        for name, text in rays.items():
            seconds, found = median(lambda text=text: select(map, text, rays=False), 1)
            report[name] = {"matched": found.matched, "count_s": seconds}
    return report


def extras(path: Path, repeat: int) -> dict[str, Any]:
    """Path table, first rays, and the curve over threads."""
    with raymap.open(path) as map:
        detected = 'detected("sensor")'
        table, _ = median(lambda: path_table(map, detected).rows(20), repeat)
        first, _ = median(lambda: select(map, detected, limit=1000), repeat)
        curve = {}
        for threads in range(1, default_threads() + 1):
            curve[threads], _ = median(
                lambda threads=threads: select(map, detected, threads=threads).ray_ids, repeat
            )
        return {"path_table_s": table, "first_1000_s": first, "threads_s": curve}


def compare(path: Path, folder: Path, repeat: int) -> dict[str, Any]:
    """The same questions put to the map and to a Parquet export of it."""
    import duckdb
    import polars as pl

    from raymap.tables.arrow import export

    parquet = folder / "segments.parquet"
    report: dict[str, Any] = {}
    with raymap.open(path) as map:
        export(map, parquet, rows="segments", force=True)
        report |= {
            "rays": map.rays,
            "records": map.records,
            "parquet_bytes": parquet.stat().st_size,
        }
        reflected, scattered = int(FAMILIES["reflected"]), int(FAMILIES["scattered"])
        registered = int(FAMILIES["detector_registered"])
        lens = [item.name for item in map.directory.objects if item.name.startswith("L")]
        listed = ", ".join(f"'{name}'" for name in lens)
        source = f"read_parquet('{parquet}')"
        sql = {
            "face and event": f"SELECT count(DISTINCT ray_id) FROM {source} WHERE object = 'L1' "
            f"AND face = 'back' AND event & {reflected} <> 0",
            "ghosts": f"SELECT count(*) FROM (SELECT ray_id FROM {source} GROUP BY ray_id HAVING "
            f"count(*) FILTER (object IN ({listed}) AND event & {reflected} <> 0) = 2 AND "
            f"count(*) FILTER (event & {scattered} <> 0) = 0 AND "
            f"count(*) FILTER (event & {registered} <> 0) > 0)",
        }
        rows = pl.scan_parquet(parquet)
        event, thing = pl.col("event"), pl.col("object")
        lazy = {
            "face and event": rows.filter(
                (thing == "L1") & (pl.col("face") == "back") & ((event & reflected) != 0)
            ).select(pl.col("ray_id").n_unique()),
            "ghosts": rows.group_by("ray_id")
            .agg(
                (thing.is_in(lens) & ((event & reflected) != 0)).sum().alias("reflections"),
                ((event & scattered) != 0).any().alias("scattered"),
                ((event & registered) != 0).any().alias("registered"),
            )
            .filter((pl.col("reflections") == 2) & ~pl.col("scattered") & pl.col("registered"))
            .select(pl.len()),
        }
        connection = duckdb.connect()
        for name in sql:
            own, found = median(lambda name=name: select(map, PATH_LEVEL[name], rays=False), repeat)
            duck, by_duck = median(lambda name=name: connection.sql(sql[name]).fetchall(), repeat)
            polar, by_polars = median(lambda name=name: lazy[name].collect().item(), repeat)
            answers = found.matched, by_duck[0][0], by_polars
            if len(set(answers)) != 1:
                raise SystemExit(f"{name}: the answers differ: {answers}")
            numbers, _ = median(lambda name=name: select(map, PATH_LEVEL[name]).ray_ids, repeat)
            report[name] = {
                "matched": found.matched,
                "raymap_s": own,
                "raymap_ray_numbers_s": numbers,
                "duckdb_s": duck,
                "polars_s": polar,
                "duckdb_ratio": duck / own,
                "polars_ratio": polar / own,
            }
    return report


def main() -> None:
    """Measure and print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rays", type=int, default=50_000_000)
    parser.add_argument("--diffuse-rays", type=int, default=5_000_000)
    parser.add_argument("--compare-rays", type=int, default=4_000_000)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, default=None)
    parser.add_argument("--map", type=Path, default=None, help="a large map that stands already")
    parser.add_argument("--keep", action="store_true")
    options = parser.parse_args()
    from tracer.run.recording import record

    folder = Path(tempfile.mkdtemp(prefix="raymap-query-", dir=options.folder))
    try:
        large = options.map
        if large is None:
            large = folder / "lens.raymap"
            record(SAMPLE, large, rays=options.rays, seed=options.seed)
        report = {
            "machine": machine(),
            "seed": options.seed,
            "lens": ask(large, PATH_LEVEL, FURTHER | POSITIONS, options.repeat),
        }
        report["lens"] |= extras(large, options.repeat)
        report["peak_memory_bytes"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        if options.diffuse_rays:
            diffuse = folder / "diffuse.raymap"
            record(diffuse_scene(folder), diffuse, rays=options.diffuse_rays, seed=options.seed)
            report["diffuse"] = ask(diffuse, DIFFUSE, DIFFUSE_FURTHER, options.repeat)
        if options.compare_rays:
            small = folder / "small.raymap"
            record(SAMPLE, small, rays=options.compare_rays, seed=options.seed)
            report["parquet"] = compare(small, folder, options.repeat)
        json.dump(report, sys.stdout, indent=2)
        print()
    finally:
        if not options.keep:
            shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()

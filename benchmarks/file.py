"""Write and read throughput and bytes per record of the ray map, against two other ways.

``python benchmarks/file.py MAP [--portions N] [--threads T]``

All three store the same portions of a recorded map, with the same threads, in one run:

- *ray map*: portions encoded on the threads, written in order;
- *zlib*: whole 36-byte segment records, descriptors and colours of 16 bits per channel, each array
  under zlib level 6, appended under one lock, as published ray maps of this layout were written;
- *Parquet*: the same columns by pyarrow, zstandard, dictionary encoding where it pays.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import tempfile
import threading
import time
import zlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import raymap
from raymap.model.portion import Portion
from raymap.model.schema import DESCRIPTOR_DTYPE

Columns = dict[str, np.ndarray[Any, Any]]


def load(path: Path, count: int) -> tuple[raymap.RayMap, list[Portion], list[Columns]]:
    """Portions of a map as columns, and as the arrays that the other ways store."""
    ray_map = raymap.open(path)
    stored = ray_map.portions[:count]
    portions = [each.read() for each in stored]
    others: list[Columns] = []
    for each in stored:
        d = each.descriptors()
        packed = np.empty(len(d.detector), DESCRIPTOR_DTYPE)
        for name in DESCRIPTOR_DTYPE.names or ():
            packed[name] = getattr(d, name)
        others.append(
            {
                "segments": each.segments(),
                "medium": each.column("medium"),
                "color": each.column("color"),
                "descriptors": packed,
            }
        )
    return ray_map, portions, others


def write_map(ray_map: raymap.RayMap, portions: list[Portion], path: Path, threads: int) -> None:
    with raymap.RayMapWriter.create(path, ray_map.directory, trusted=True) as writer:
        for channel_set in ray_map.channel_sets:
            writer.add_channel_set(channel_set)
        with ThreadPoolExecutor(threads) as pool:
            list(
                pool.map(
                    lambda k: writer.commit(writer.encode(portions[k], k)), range(len(portions))
                )
            )


def read_map(path: Path, threads: int) -> None:
    with raymap.open(path) as ray_map, ThreadPoolExecutor(threads) as pool:
        list(pool.map(lambda portion: portion.read(), ray_map.portions))


def write_zlib(others: list[Columns], path: Path, threads: int) -> list[list[int]]:
    lock = threading.Lock()
    index: list[list[int]] = []
    with path.open("wb") as file, ThreadPoolExecutor(threads) as pool:

        def work(columns: Columns) -> None:
            parts = [zlib.compress(column.tobytes(), 6) for column in columns.values()]
            with lock:
                index.append([len(part) for part in parts])
                for part in parts:
                    file.write(part)

        list(pool.map(work, others))
    return index


def read_zlib(path: Path, index: list[list[int]], threads: int) -> None:
    places = []
    offset = 0
    for sizes in index:
        for size in sizes:
            places.append((offset, size))
            offset += size
    lock = threading.Lock()
    with path.open("rb") as file, ThreadPoolExecutor(threads) as pool:

        def work(place: tuple[int, int]) -> int:
            with lock:
                file.seek(place[0])
                data = file.read(place[1])
            return len(zlib.decompress(data))

        list(pool.map(work, places))


def as_table(columns: Columns) -> pa.Table:
    segments = columns["segments"]
    flat = {name: segments[name] for name in segments.dtype.names if segments[name].ndim == 1}
    for k, axis in enumerate("xyz"):
        flat[axis] = segments["position"][:, k]
        flat[f"n{axis}"] = segments["normal"][:, k]
    for k in range(columns["color"].shape[1]):
        flat[f"c{k}"] = columns["color"][:, k]
    flat["medium"] = columns["medium"]
    return pa.table({name: np.ascontiguousarray(column) for name, column in flat.items()})


def write_parquet(others: list[Columns], path: Path, threads: int) -> None:
    """One file per thread, as a row group is written by one thread only."""

    def work(number: int) -> None:
        mine = others[number::threads]
        if mine:
            schema = as_table(mine[0]).schema
            with pq.ParquetWriter(f"{path}.{number}", schema, compression="zstd") as writer:
                for columns in mine:
                    writer.write_table(as_table(columns))

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, range(threads)))


def read_parquet(path: Path, threads: int) -> None:
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(lambda k: pq.read_table(f"{path}.{k}", use_threads=False), range(threads)))


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    start = time.perf_counter()
    result = work()
    return time.perf_counter() - start, result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("map", type=Path, help="a recorded map")
    parser.add_argument("--portions", type=int, default=8, help="how many of its portions to use")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    ray_map, portions, others = load(options.map, options.portions)
    records = sum(portion.n_records for portion in portions)
    rays = sum(portion.n_rays for portion in portions)
    threads = options.threads
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        # Compile everything before the clock runs
        write_map(ray_map, portions[:1], folder / "warm", threads)
        read_map(folder / "warm", threads)
        ours, zl, parquet = folder / "map.raymap", folder / "zlib", folder / "parquet"
        write_ours, _ = timed(lambda: write_map(ray_map, portions, ours, threads))
        read_ours, _ = timed(lambda: read_map(ours, threads))
        write_z, index = timed(lambda: write_zlib(others, zl, threads))
        read_z, _ = timed(lambda: read_zlib(zl, index, threads))
        write_p, _ = timed(lambda: write_parquet(others, parquet, threads))
        read_p, _ = timed(lambda: read_parquet(parquet, threads))
        parquet_bytes = sum(each.stat().st_size for each in folder.glob("parquet.*"))
        rows = [
            ("ray map", ours.stat().st_size, write_ours, read_ours),
            ("zlib 6, one lock", zl.stat().st_size, write_z, read_z),
            ("Parquet, zstd", parquet_bytes, write_p, read_p),
        ]
    seeds = [run.get("seed") for run in ray_map.runs]
    result = {
        "machine": f"{platform.machine()}, {threads} threads",
        "versions": {"python": platform.python_version(), "numpy": np.__version__},
        "seeds": seeds,
        "rays": rays,
        "records": records,
        "rows": [
            {
                "way": way,
                "bytes_per_record": size / records,
                "write_records_per_second": records / write,
                "write_rays_per_second": rays / write,
                "read_records_per_second": records / read,
                "size_ratio": size / rows[0][1],
                "write_ratio": write / rows[0][2],
                "read_ratio": read / rows[0][3],
            }
            for way, size, write, read in rows
        ],
    }
    if options.json:
        print(json.dumps(result))
        return
    print(f"{rays:,} rays, {records:,} records, {result['machine']}, seeds {seeds}")
    print(f"{'':20}{'bytes/record':>14}{'write M rec/s':>15}{'M rays/s':>10}{'read M rec/s':>14}")
    for way, size, write, read in rows:
        print(
            f"{way:20}{size / records:14.2f}{records / write / 1e6:15.2f}"
            f"{rays / write / 1e6:10.2f}{records / read / 1e6:14.2f}"
        )


if __name__ == "__main__":
    main()

"""How fast a scene is traced, and traced and recorded to disk.

Prints the machine, versions, the seed and medians. Usage::

    python benchmarks/record.py [SCENE] [--rays N] [--repeat K] [--threads T] [--variant NAME]
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path

from tracer import compile_scene, load_scene, record

SAMPLE = Path(__file__).parents[1] / "samples" / "double_gauss.toml"


def machine() -> dict[str, object]:
    """Processor, number of cores and versions."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        model = names[0].partition(":")[2].strip() if names else model
    packages = ("numpy", "numba", "zstandard")
    return {
        "processor": model,
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        **{name: version(name) for name in packages},
    }


def main() -> None:
    """Measure and print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", nargs="?", default=SAMPLE, type=Path)
    parser.add_argument("--rays", type=int, default=2_000_000)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--variant", action="append", default=[])
    options = parser.parse_args()
    compilation = compile_scene(load_scene(options.scene, variants=options.variant))
    common = {"threads": options.threads, "seed": options.seed}
    traced, recorded, per_record = [], [], []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "benchmark.raymap"
        # Compile everything before the clock starts
        record(compilation, path, rays=20_000, force=True, **common)
        for _ in range(options.repeat):
            result = record(compilation, None, rays=options.rays, no_rays=True, **common)
            traced.append(result.rays_per_second)
            result = record(compilation, path, rays=options.rays, force=True, **common)
            recorded.append(result.rays_per_second)
            per_record.append(result.bytes / result.records)
    report = {
        "scene": options.scene.name,
        "variants": options.variant,
        "machine": machine(),
        "rays": options.rays,
        "seed": options.seed,
        "threads": options.threads,
        "records_per_ray": result.records / result.rays,
        "traced_rays_per_second": statistics.median(traced),
        "recorded_rays_per_second": statistics.median(recorded),
        "recorded_over_traced": statistics.median(recorded) / statistics.median(traced),
        "bytes_per_record": statistics.median(per_record),
    }
    json.dump(report, sys.stdout, indent=2)
    print()


if __name__ == "__main__":
    main()

"""The main job, command by command: record a lens, ask for its ghosts, look at them.

Run by ``make demo``; everything is written to the folder ``demo``.
"""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "demo"
RAYMAP = Path(sys.executable).with_name("raymap")
SENSOR = 'detected("sensor")'
GHOST = 'count(hit("L*", reflected)) == 2 & !event(scattered) & detected("sensor")'


def run(*arguments: str) -> None:
    """Show a command as one would type it, and run it."""
    print(f"\n\033[1m$ raymap {shlex.join(arguments)}\033[0m", flush=True)
    subprocess.run([RAYMAP, *arguments], check=True, cwd=ROOT)


def first_ray(ray_map: str, criterion: str) -> int:
    """Number of the first ray that satisfies the criterion."""
    answer = subprocess.run(
        [RAYMAP, "query", ray_map, criterion, "--limit", "1", "--json"],
        check=True,
        cwd=ROOT,
        stdout=subprocess.PIPE,
    )
    return int(json.loads(answer.stdout)["ray_ids"][0])


def main() -> None:
    start = time.perf_counter()
    OUT.mkdir(exist_ok=True)
    ray_map = "demo/double_gauss.raymap"
    run("record", "samples/double_gauss.toml", "-o", ray_map, "--rays", "2000000", "--force")
    run("info", ray_map)
    run("paths", ray_map, SENSOR, "--top", "10")
    run("query", ray_map, GHOST, "--count")
    run("paths", ray_map, GHOST, "--top", "10")
    run("report", ray_map, str(first_ray(ray_map, GHOST)))
    run("picture", ray_map, GHOST, "-o", "demo/ghost_rays.png")
    run("image", ray_map, "sensor", GHOST, "--bin", "20", "-o", "demo/ghost_image.png")
    print(f"\nDone in {time.perf_counter() - start:.0f} s. Pictures: demo/*.png. Look around with:")
    print(f"  {RAYMAP.relative_to(ROOT) if RAYMAP.is_relative_to(ROOT) else RAYMAP} view {ray_map}")


if __name__ == "__main__":
    main()

"""What the viewer costs: meshing, painting, picking, answering in the application.

    python benchmarks/view.py [MAP] [--rays 100000] [--json]

Without a map it uses rays made up by the seed for meshing, painting and picking alone; with one
(for example the double Gauss) it also times the application: ready, criterion to changed picture.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import time
from collections.abc import Callable
from importlib.metadata import version
from statistics import median
from typing import Any

import numpy as np

import raymap
from raymap.model.directory import Directory, Source
from viewer.app.inquiry import Inquiry
from viewer.app.session import Session
from viewer.drawn.camera import standard_view, view_matrix
from viewer.drawn.colors import color_lines
from viewer.drawn.lines import build_lines
from viewer.drawn.rays import DrawnRays
from viewer.drawn.state import ViewState
from viewer.paint.paint import finish, paint_bodies, paint_rays
from viewer.paint.picking import pick_segment
from viewer.panels.paths import PathQuestions

SEED = 7
WIDTH, HEIGHT = 744, 848
"""The 3D panel of the application at 1440 x 900."""

BUDGETS = {
    "mesh": 0.3,
    "pick": 0.05,
    "ready": 5.0,
    "criterion to picture": 1.0,
}


def timed(work: Callable[[], Any], repeats: int = 5) -> float:
    """Median seconds of a few runs; the first, which may compile, is left out."""
    work()
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return median(seconds)


def made_up_rays(n_rays: int, steps: int = 11) -> DrawnRays:
    """Rays that travel along z through a lens-like bundle, ``steps`` records each."""
    rng = np.random.default_rng(SEED)
    z = np.sort(rng.uniform(-20, 140, (n_rays, steps)), axis=1)
    waist = 3 + 14 * np.abs(z - 60) / 80
    start = rng.normal(0, 0.5, (n_rays, 1, 2))
    xy = start * waist[:, :, None] + rng.normal(0, 0.2, (n_rays, steps, 2))
    event = np.full((n_rays, steps), int(raymap.Event.SPECULAR_REFRACTION), np.int32)
    event[:, 0], event[:, -1] = raymap.Event.EMITTED, raymap.Event.SURFACE_ABSORPTION
    rgb = np.repeat(np.eye(3, dtype=np.float32)[rng.integers(0, 3, n_rays)], steps, axis=0)
    return DrawnRays(
        ray_ids=np.arange(n_rays),
        offsets=np.arange(n_rays + 1) * steps,
        source=np.zeros(n_rays, np.int16),
        flux=np.full(n_rays, 1.0 / n_rays),
        path=rng.integers(0, 50, n_rays),
        wavelength=np.full(n_rays, 550, np.float32),
        position=np.concatenate([xy, z[:, :, None]], axis=2).reshape(-1, 3).astype(np.float32),
        event=event.ravel(),
        object=np.zeros(n_rays * steps, np.int16),
        rgb=rgb,
        index=np.ones(n_rays * steps, np.float32),
    )


def drawing(n_rays: int) -> dict[str, float]:
    """Meshing, painting and picking of many rays."""
    rays, directory = made_up_rays(n_rays), Directory(sources=(Source(name="beam"),))
    lines = build_lines(rays)
    rgba, _ = color_lines(rays, lines, "natural", directory, opacity=0.3)
    box = (np.array([-20.0, -20.0, -20.0]), np.array([20.0, 20.0, 140.0]))
    camera = standard_view("tilted", box, aspect=WIDTH / HEIGHT)
    matrix = view_matrix(camera, WIDTH, HEIGHT, 200.0)
    layer = paint_bodies([], camera, WIDTH, HEIGHT, dark=True)

    def paint() -> None:
        copy = layer.copy()
        paint_rays(copy, lines.segments, rgba, width=1.0)
        finish(copy)

    return {
        "segments": len(lines),
        "mesh": timed(lambda: build_lines(rays)),
        "colour": timed(lambda: color_lines(rays, lines, "natural", directory, opacity=0.3)),
        "paint": timed(paint, 3),
        "pick": timed(lambda: pick_segment(lines.segments, rgba, matrix, WIDTH / 2, HEIGHT / 2)),
    }


def application(path: str, criteria: list[str]) -> dict[str, float]:
    """Seconds until the first picture, and from a criterion to the changed picture."""
    start = time.perf_counter()
    ray_map = raymap.open(path, on_damage="skip")
    session = Session(ray_map, ViewState())
    inquiry, paths = Inquiry(session), PathQuestions(session)
    first: list[float] = []

    def paint() -> None:
        session.frame(WIDTH, HEIGHT, 1.0, coarse=False)

    def answer(criterion: str) -> tuple[float, float]:
        """Seconds to the first changed picture and to the whole answer."""
        begun = time.perf_counter()
        seen: list[float] = []

        def early(_: dict[str, Any]) -> None:
            if not seen:
                paint()
                seen.append(time.perf_counter() - begun)

        session.update(criterion=criterion)
        inquiry.draw(lambda: False, early)
        paint()
        seen.append(time.perf_counter() - begun)
        inquiry.answer(lambda: False, lambda progress: None)
        paths.paths("face", False, "flux", lambda: False)
        return seen[0], time.perf_counter() - begun

    answer("")
    ready = time.perf_counter() - start
    answer(criteria[0])
    for criterion in criteria:
        answer("")
        first.append(answer(criterion)[0])
    whole = answer(criteria[0])[1]
    session.look("tilted", WIDTH, HEIGHT)
    return {
        "rays": ray_map.rays,
        "records": ray_map.records,
        "ready": ready,
        "criterion to picture": max(first),
        "criterion to table": whole,
        "turning": timed(lambda: _turn(session)),
        "still picture": timed(lambda: _turn(session, coarse=False), 3),
    }


def _turn(session: Session, coarse: bool = True) -> None:
    session.move(WIDTH, HEIGHT, turn=(3.0, 1.0))
    session.frame(WIDTH, HEIGHT, 1.0, coarse=coarse)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("map", nargs="?")
    parser.add_argument("--rays", type=int, default=100_000)
    parser.add_argument("--criterion", action="append")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    found: dict[str, float] = drawing(options.rays)
    if options.map:
        criteria = options.criterion or [
            'count(hit("L*", reflected)) == 2 & !event(scattered) & detected("sensor")'
        ]
        found |= application(options.map, criteria)
    found["peak memory MB"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    if options.json:
        print(json.dumps({"seed": SEED, **found}))
        return
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} processors, "
          f"Python {platform.python_version()}, NumPy {version('numpy')}, "
          f"Numba {version('numba')}, seed {SEED}")  # fmt: skip
    for name, value in found.items():
        if name in ("segments", "rays", "records"):
            print(f"{name:24} {int(value):>14,}")
        elif name.endswith("MB"):
            print(f"{name:24} {value:14.0f}")
        else:
            budget = BUDGETS.get(name)
            rest = f"   budget {budget:g} s, {value / budget:.0%} of it" if budget else ""
            print(f"{name:24} {1000 * value:11.1f} ms{rest}")


if __name__ == "__main__":
    main()

"""Calcite on a board of colours: the double image, the analyser, and the white furnace."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracer.optics.crystals.media import calcite
from tracer.render.bodies import calcite_rhomb
from tracer.render.camera import Camera
from tracer.render.renderer import RenderScene, error_in_steps, render, sample_pixels
from tracer.render.room import Room
from tracer.studies.crystals.crystal_statements import Check

__all__ = ["box_checks", "double_image_checks", "furnace_checks", "resized"]

Real = NDArray[np.float64]
Progress = Callable[[int, int], Any]


def resized(scene: RenderScene, width: int) -> RenderScene:
    """The scene with a picture of another width, same shape."""
    w, h = scene.camera.pixels
    return replace(scene, camera=replace(scene.camera, pixels=(width, max(1, width * h // w))))


def box_checks(
    scene: RenderScene,
    folder: Path | None,
    *,
    width: int = 120,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Iterator[Check]:
    """Render the box (calcite_box.png, .exr) and compare single pixels with unpruned trees."""
    picture = ""
    if folder is not None:
        picture = "calcite_box.png"
        seen = render(
            resized(scene, width),
            threads=threads,
            progress=progress,
            state=folder / "calcite_box.state.npz",
        )
        seen.save(folder / picture)
        seen.save(folder / "calcite_box.exr")

    # Pixels spread over the picture, at every fifth wavelength, grown to the last branch
    w, h = scene.camera.pixels
    columns, rows = np.meshgrid(
        (np.array([0.34, 0.42, 0.5, 0.58, 0.66]) * w).astype(np.int64),
        (np.array([0.3, 0.42, 0.55, 0.66]) * h).astype(np.int64),
    )
    few = replace(scene, wavelengths_nm=np.asarray(scene.wavelengths_nm)[2:-2:4])
    pruned = sample_pixels(few, columns.ravel(), rows.ravel())
    whole = sample_pixels(replace(few, pruning_error=0.0), columns.ravel(), rows.ravel())
    difference = np.abs(pruned.rgb - whole.rgb)
    yield Check(
        name="calcite_box.pruning",
        statement="pixels differ from those of unpruned trees by at most half an 8-bit step",
        deviation=float(error_in_steps(whole.rgb, difference).max()),
        limit=0.5,
        picture=picture,
    )
    yield Check(
        name="calcite_box.bound",
        statement="difference over the bound that the renderer states",
        deviation=float((difference / (pruned.error_bound + 1e-15)).max()),
        limit=1.0,
    )


def _edge(values: Real, x: Real) -> float:
    """Where values that step down cross half of their range."""
    level = 0.5 * (values.max() + values.min())
    k = int(np.flatnonzero((values[:-1] >= level) & (values[1:] < level))[0])
    share = (values[k] - level) / (values[k] - values[k + 1])
    return float(x[k] + share * (x[k + 1] - x[k]))


def double_image_checks() -> Iterator[Check]:
    """An edge seen straight down through the top face of a rhomb: two images, one by one."""
    wavelength = 589.3
    rhomb = calcite_rhomb("rhomb", calcite, 30.0, (0.0, 0.0, 0.01))
    axis = rhomb.medium.optic_axis(wavelength)
    assert axis is not None
    turn = float(-np.degrees(np.arctan2(axis[1], axis[0])))
    rhomb = calcite_rhomb("rhomb", calcite, 30.0, (0.0, 0.0, 0.01), turn_deg=turn)
    axis = rhomb.medium.optic_axis(wavelength)
    assert axis is not None
    thickness = float(np.ptp(rhomb.vertices[:, 2]))
    middle = rhomb.vertices.mean(axis=0)

    # White where x lies below the middle of the top face, black above
    floor = np.zeros((1, 4000, 3))
    edge = float(middle[0])
    floor[:, np.linspace(-50.0, 50.0, 4000) < edge] = 1.0
    distance, field, pixels = 1e5, 16.0, 641
    camera = Camera(
        position=(edge, float(middle[1]), distance),
        target=(edge, float(middle[1]), 0.0),
        sensor=(field, field / pixels),
        focal_length=distance,
        pixels=(pixels, 1),
    )
    scene = RenderScene(
        bodies=(rhomb,),
        room=Room(low=(-50.0, -50.0, 0.0), high=(50.0, 50.0, 100.0), walls={"z-": floor}),
        camera=camera,
        wavelengths_nm=np.array([wavelength]),
        pruning_error=0.0,
        max_events=7,
    )
    x = (np.arange(pixels) + 0.5) / pixels * field - field / 2
    columns, rows = np.arange(pixels), np.zeros(pixels, np.int64)
    rows_of = {
        angle: sample_pixels(
            replace(scene, camera=replace(camera, analyser_deg=angle)), columns, rows
        )
        for angle in (0.0, 90.0)
    }
    extraordinary = rows_of[0.0].rgb[:, 0]
    ordinary = rows_of[90.0].rgb[:, 0]

    # tan of the walk-off angle from the closed form
    n_o, _, n_e = rhomb.medium.principal_indices(wavelength)
    theta = float(np.arccos(abs(axis[2])))
    walk_off = float(np.arctan(n_o**2 / n_e**2 * np.tan(theta))) - theta
    expected = thickness * np.tan(walk_off)
    separation = abs(_edge(extraordinary, x) - _edge(ordinary, x))
    yield Check(
        name="double_image.separation",
        statement="images of an edge stand apart by t tan(walk-off), in pixels of 0.025 mm",
        deviation=float(abs(separation - expected) / (field / pixels)),
        limit=1.0,
    )
    between = np.abs(x) < 0.3 * expected
    low, high = sorted((_edge(extraordinary, x), _edge(ordinary, x)))
    between = (x > low + 0.5) & (x < high - 0.5)
    bright = np.maximum(ordinary[between], extraordinary[between])
    dark = np.minimum(ordinary[between], extraordinary[between])
    yield Check(
        name="double_image.analyser",
        statement="an analyser along or across the main plane removes one image: what is left",
        deviation=float((dark / bright).max()),
        limit=1e-6,
    )


def furnace_checks(
    scene: RenderScene, folder: Path | None, *, threads: int | None = None
) -> Iterator[Check]:
    """Crystals among white walls: every pixel is 1 but for what was left out."""
    picture = ""
    if folder is not None:
        picture = "white_furnace.png"
        render(scene, threads=threads).save(folder / picture)
    w, h = scene.camera.pixels
    columns, rows = np.meshgrid(np.arange(1, w, 3), np.arange(1, h, 3))
    worst = 0.0
    for analyser, whole in ((None, 1.0), (30.0, 0.5)):
        turned = replace(scene, camera=replace(scene.camera, analyser_deg=analyser))
        seen = sample_pixels(turned, columns.ravel(), rows.ravel())
        total = seen.spectral / seen.white / whole + seen.pruned + seen.truncated
        worst = max(worst, float(np.abs(total - 1.0).max()))
    yield Check(
        name="white_furnace.invisible",
        statement="light seen + share pruned + share cut at the depth limit = 1, with and without "
        "analyser",
        deviation=worst,
        limit=1e-11,
        picture=picture,
    )

"""Makes the golden files of version 1: ``python -m tests.data.golden.v1.make``.

They are written once and kept: every later reader must decode them to the columns in the ``.npz``
files beside them. Run this again only to add files, never to replace one.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

import raymap
from raymap.model.events import Event
from tests.raymap.compact import write_compactly
from tests.raymap.maps import RGB, SPECTRAL, small_directory
from tests.strategies import make_portion

HERE = Path(__file__).parent


def lens_directory():
    """A ball lens, a mesh mirror and a flat blocking sensor."""
    ball = raymap.Quadric(coefficients=(1, 1, 1, 0, 0, 0, 0, 0, -40.0, 300.0), solve_axis=2)
    plane = raymap.Quadric(coefficients=(0, 0, 0, 0, 0, 0, 0, 0, -1.0, 50.0), solve_axis=2)
    tilted = raymap.Quadric(coefficients=(0, 0, 0, 0, 0, 0, 1.0, 0.0, 1.0, -90.0), solve_axis=0)
    return raymap.Directory(
        sources=(raymap.Source(name="beam"), raymap.Source(name="lamp", flux=3.0)),
        objects=(
            raymap.SceneObject(name="ball", faces=(raymap.Face(name="all", quadrics=(ball,)),)),
            raymap.SceneObject(name="sensor", faces=(raymap.Face(name="f", quadrics=(plane,)),)),
            raymap.SceneObject(
                name="roof",
                faces=(
                    raymap.Face(name="panes", primitive_count=3, quadrics=(tilted, None, tilted)),
                ),
            ),
        ),
        media=(raymap.Medium(name="air"), raymap.Medium(name="glass")),
        detectors=(
            raymap.Detector(
                name="sensor",
                cells=(64, 48),
                center=(0.5, 0.0, 50.0),
                axis_u=(0.8, 0.6, 0.0),
                axis_v=(-0.6, 0.8, 0.0),
                size=(30.0, 20.0),
                blocking=True,
                object=1,
            ),
        ),
        bounding_sphere=raymap.BoundingSphere(center=(0.0, 0.0, 20.0), radius=100.0),
        scene_hash="golden",
    )


def traced_portion(n_rays, first_ray, channels=RGB, channel_set=0):
    """Rays from a disc through the ball to the sensor, the roof, or out of the scene."""
    rng = np.random.default_rng(n_rays + first_ray)
    rows = {name: [] for name in ("p", "n", "object", "triangle", "event", "medium", "code")}
    counts, hits = [], []
    for _ in range(n_rays):
        x, y = rng.uniform(-7, 7, 2)
        pure = int(rng.integers(0, channels.n_channels))
        points = [((x, y, -20.0), (0, 0, 1), -1, -1, Event.EMITTED, 0, channels.n_channels)]
        for sign in (-1.0, 1.0):
            z = 20.0 + sign * np.sqrt(100.0 - x * x - y * y)
            normal = (x / 10, y / 10, (z - 20) / 10)
            event = Event.SPECULAR_REFRACTION | Event.MEDIUM_CHANGED
            points.append(((x, y, z), normal, 0, 0, event, int(sign < 0), pure))
            x, y = 0.8 * x + 0.01, 0.8 * y
        end = rng.integers(0, 3)
        if end == 0:
            points.append(((x, y, 50.0), (0, 0, -1), 1, 0, Event.SURFACE_ABSORPTION, 0, pure))
            hits.append((len(rows["p"]) + len(points) - 2, (x, y)))
        elif end == 1:
            pane = int(rng.integers(0, 3))
            place = (90.0 - 60.0, y, 60.0) if pane != 1 else (5.0, y, 61.0)
            normal = (0.5**0.5, 0, 0.5**0.5) if pane != 1 else (0, 0.6, 0.8)
            points.append((place, normal, 2, pane, Event.SURFACE_ABSORPTION, 0, pure))
        else:
            before = np.array(points[-1][0])
            place = np.array([0.0, 0.0, 20.0]) + 100.0 * np.array([0.1, 0.2, 0.95**0.5])
            direction = (place - before) / np.linalg.norm(place - before)
            points.append((place, direction, -1, -1, Event.LEFT_SCENE, 0, pure))
        counts.append(len(points))
        for point in points:
            for column, value in zip(rows.values(), point, strict=True):
                column.append(value)
    position = np.array(rows["p"], np.float32)
    descriptor_count = np.zeros(len(position), np.uint16)
    descriptor_count[[record for record, _ in hits]] = 1
    places = np.array([place for _, place in hits]).reshape(-1, 2) - (0.5, 0.0)
    uv = places @ np.array([[0.8, -0.6], [0.6, 0.8]]) / (30.0, 20.0) + 0.5
    segments = [(position[r].astype(float), position[r + 1].astype(float)) for r, _ in hits]
    cosine = [(q - p)[2] / np.linalg.norm(q - p) for p, q in segments]
    last = 65535 - (channels.n_channels - 1) * 9000
    return raymap.Portion(
        emitted=np.array([n_rays + 3, 1]),
        source=np.zeros(n_rays, np.int16),
        records_per_ray=np.array(counts, np.int32),
        position=position,
        normal=np.rint(np.array(rows["n"], float) * 32767).astype(np.int16),
        object=np.array(rows["object"], np.int16),
        triangle=np.array(rows["triangle"], np.int32),
        event=np.array([int(event) for event in rows["event"]], np.int32),
        medium=np.array(rows["medium"], np.int16),
        color_code=np.array(rows["code"], np.int32),
        color_table=np.array([[9000] * (channels.n_channels - 1) + [last]], np.uint16),
        descriptor_count=descriptor_count,
        descriptors=raymap.Descriptors(
            detector=np.zeros(len(hits), np.int16),
            cell=np.floor(uv * (64, 48)).astype(np.uint16),
            cosine=np.rint(-np.array(cosine) * 32767).astype(np.int16),
            uv=np.rint(uv * 65535).astype(np.uint16),
            registered=np.ones(len(hits), np.bool_),
        ),
        first_ray=first_ray,
        channel_set=channel_set,
    )


def make_lens(path):
    """Everything that shapes imply; two channel sets, two runs, a footer in the middle."""
    with raymap.RayMapWriter.create(path, lens_directory()) as writer:
        write_compactly(writer)
        writer.add_channel_set(RGB)
        writer.start_run(seed=1)
        writer.append(traced_portion(300, 0))
        writer.append(traced_portion(40, 300))
    with raymap.RayMapWriter.append_to(path) as writer:
        write_compactly(writer)
        number = writer.add_channel_set(SPECTRAL)
        writer.start_run(seed=2)
        writer.append(traced_portion(50, 1000, SPECTRAL, number))


def make_random(path, raw=False):
    """Columns of any value: paths and plain, weights, groups, gaps, further columns."""
    directory = small_directory()
    with raymap.RayMapWriter.create(path, directory, raw=raw) as writer:
        writer.add_channel_set(RGB)
        for k, options in enumerate(
            (
                {"n_paths": 3},
                {"n_paths": None, "weighted": True, "strange": True},
                {"n_paths": 5, "weighted": True, "grouped": True, "extra": True},
                {"n_paths": 3, "with_ids": True, "strange": True},
            )
        ):
            portion = make_portion(directory, RGB, n_rays=40, seed=k, **options)
            ids = None if portion.ray_ids is None else portion.ray_ids + 10_000
            writer.append(dataclasses.replace(portion, first_ray=100 * k, ray_ids=ids))
        empty = make_portion(directory, RGB, n_rays=0)
        writer.append(dataclasses.replace(empty, emitted=np.array([7, 8])))


def columns_of(stored):
    """What a reader must decode, by name."""
    descriptors = stored.descriptors()
    columns = {
        "emitted": stored.emitted,
        "ray_ids": stored.ray_ids(),
        "source": stored.column("source"),
        "records_per_ray": np.diff(stored.record_offsets()),
        "detector": descriptors.detector,
        "registered": descriptors.registered,
        "cosine": descriptors.cosine,
        "cell_u": descriptors.cell[:, 0],
        "cell_v": descriptors.cell[:, 1],
        "u": descriptors.uv[:, 0],
        "v": descriptors.uv[:, 1],
    }
    for name in ("object", "face", "triangle", "position", "normal", "event", "medium", "color"):
        columns[name] = stored.column(name)
    columns["descriptor_count"] = stored.column("descriptor_count")
    if stored.has_weights:
        columns["weight"] = stored.column("weight")
    if stored.grouped:
        columns["emission"] = stored.column("emission")
    known = {"source", "weight", "emission", "face", "first_descriptor", "color_code", *columns}
    for name in stored.column_names:
        if name not in known:
            columns[f"x:{name}"] = stored.column(name)
    return columns


MAKERS = {
    "lens": make_lens,
    "random": make_random,
    "raw": lambda path: make_random(path, raw=True),
}


def main():
    """Make the files that are not there."""
    for name, make in MAKERS.items():
        path = HERE / f"{name}.raymap"
        if path.exists():
            continue
        make(path)
        with raymap.open(path) as ray_map:
            columns = {
                f"{k}/{column}": values
                for k, stored in enumerate(ray_map.portions)
                for column, values in columns_of(stored).items()
            }
        np.savez_compressed(path.with_suffix(".npz"), **columns)


if __name__ == "__main__":
    main()

"""A small map for tests of the viewer: one lens before a sensor in a tube, made up by hand.

The rays are not traced, but every itinerary is sound: most go through, some bounce twice inside the
lens (the ghost), some end on the tube, some leave.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from raymap import (
    BoundingSphere,
    ChannelSet,
    Descriptors,
    Detector,
    Directory,
    DisplayMesh,
    Event,
    Face,
    Medium,
    Portion,
    RayMapWriter,
    SceneObject,
    Source,
    Surface,
)

LENS, TUBE, SENSOR = 0, 1, 2
CELLS = (36, 24)
SIZE = (18.0, 12.0)
SENSOR_Z = 50.0


def lathe(profile: list[tuple[float, float, int]], n: int = 48) -> DisplayMesh:
    """A surface of revolution around z from (z, radius, face) points."""
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle)], -1)
    vertices = np.concatenate([np.column_stack([r * ring, np.full(n, z)]) for z, r, _ in profile])
    triangles, face = [], []
    for k in range(len(profile) - 1):
        j = np.arange(n)
        a, b = k * n + j, k * n + (j + 1) % n
        triangles += [np.stack([a, b, b + n], -1), np.stack([a, b + n, a + n], -1)]
        face += [profile[k + 1][2]] * 2 * n
    return DisplayMesh(
        vertices=vertices.astype(np.float32),
        triangles=np.concatenate(triangles).astype(np.int32),
        face=np.array(face, np.int32),
    )


def lens_mesh(n: int = 48) -> DisplayMesh:
    """A biconvex lens of radius 10 from z = 0 to z = 4."""
    radii = np.linspace(1e-3, 10, 12)
    front = [(0.01 * r * r, r, 0) for r in radii]
    back = [(4 - 0.01 * r * r, r, 2) for r in radii[::-1]]
    return lathe([*front, (back[0][0], 10.0, 1), *back], n)


def square(z: float, half_x: float, half_y: float) -> DisplayMesh:
    corners = [
        [-half_x, -half_y, z],
        [half_x, -half_y, z],
        [half_x, half_y, z],
        [-half_x, half_y, z],
    ]
    return DisplayMesh(
        vertices=np.array(corners, np.float32),
        triangles=np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        face=np.zeros(2, np.int32),
    )


def make_meshes() -> dict[int, DisplayMesh]:
    return {
        LENS: lens_mesh(),
        TUBE: lathe([(-5.0, 15.0, 0), (SENSOR_Z, 15.0, 0)]),
        SENSOR: square(SENSOR_Z, SIZE[0] / 2, SIZE[1] / 2),
    }


def make_directory(*, spectral: bool = False) -> Directory:
    del spectral
    return Directory(
        sources=(Source(name="star", flux=1.0), Source(name="lamp", flux=0.5)),
        media=(Medium(name="air"), Medium(name="glass")),
        surfaces=(
            Surface(name="polished", kind="fresnel"),
            Surface(name="black", kind="absorber"),
        ),
        objects=(
            SceneObject(
                name="L1",
                faces=tuple(
                    Face(name=name, first_primitive=k, surface=0)
                    for k, name in enumerate(("front", "rim", "back"))
                ),
            ),
            SceneObject(name="tube", faces=(Face(name="inside", surface=1),)),
            SceneObject(name="sensor", faces=(Face(name="front", surface=1),)),
        ),
        detectors=(
            Detector(
                name="sensor",
                cells=CELLS,
                center=(0, 0, SENSOR_Z),
                size=SIZE,
                blocking=True,
                object=SENSOR,
            ),
        ),
        bounding_sphere=BoundingSphere(center=(0, 0, 20), radius=80),
        title="one lens before a sensor",
    )


def rgb_channels() -> ChannelSet:
    return ChannelSet(
        kind="rgb",
        wavelengths_nm=(610.0, 550.0, 465.0),
        luminous=(0.2126, 0.7152, 0.0722),
        display_rgb=((1, 0, 0), (0, 1, 0), (0, 0, 1)),
        refractive_index=((1.0, 1.0, 1.0), (1.5, 1.51, 1.52)),
        source_colors=((1 / 3, 1 / 3, 1 / 3), (1 / 3, 1 / 3, 1 / 3)),
    )


def spectral_channels() -> ChannelSet:
    return ChannelSet(
        kind="spectral",
        wavelengths_nm=(450.0, 550.0, 650.0),
        luminous=(26.0, 680.0, 73.0),
        display_rgb=((0.1, 0, 1), (0.2, 1, 0), (1, 0, 0)),
        refractive_index=((1.0, 1.0, 1.0), (1.53, 1.52, 1.51)),
        source_colors=((1 / 3, 1 / 3, 1 / 3), (1 / 3, 1 / 3, 1 / 3)),
    )


_IN = Event.SPECULAR_REFRACTION | Event.MEDIUM_CHANGED
_BACK = Event.SPECULAR_REFLECTION
_END = Event.SURFACE_ABSORPTION
_SEEN = Event.DETECTOR_CROSSED | Event.DETECTOR_REGISTERED


def make_portion(
    n_rays: int, first_ray: int = 0, seed: int = 0, *, detect: bool = True, channels: int = 3
) -> Portion:
    """Rays of four kinds: through (0), ghost (1), tube (2), reflected out of the scene (3)."""
    rng = np.random.default_rng([seed, first_ray])
    kind = rng.choice(4, n_rays, p=[0.80, 0.06, 0.08, 0.06])
    source = (rng.random(n_rays) < 0.3).astype(np.int16)
    start = rng.uniform(-7, 7, (n_rays, 2))
    target = start * 0.15 + rng.normal(0, 0.4, (n_rays, 2)) + np.array([2.0, 1.0])
    ghost = start * 0.5 + np.array([-3.0, -1.5])
    rows: list[tuple] = []  # object, triangle, position, normal, event, medium, descriptors
    counts, crossings = [], []
    up, down = (0, 0, 32767), (0, 0, -32767)
    for i in range(n_rays):
        x, y = start[i]
        bulge = 0.01 * (x * x + y * y)
        front, back = (x, y, bulge), (x * 0.93, y * 0.93, 4 - bulge)
        before = len(rows)
        rows.append((-1, -1, (x, y, -20.0), (0, 0, 0), Event.EMITTED, 0, 0))
        if kind[i] == 3:
            rows.append((LENS, 0, front, down, _BACK, 0, 0))
            rows.append((-1, -1, (2 * x, 2 * y, -55.0), down, Event.LEFT_SCENE, 0, 0))
        else:
            rows.append((LENS, 0, front, down, _IN, 1, 0))
            if kind[i] == 1:
                rows.append((LENS, 2, back, up, _BACK, 1, 0))
                rows.append((LENS, 0, (x * 0.8, y * 0.8, bulge), down, _BACK, 1, 0))
                back = (x * 0.7, y * 0.7, 4 - bulge)
            seen = int(detect and kind[i] != 2)
            rows.append((LENS, 2, back, up, _IN, 0, seen))
            place = ghost[i] if kind[i] == 1 else target[i]
            if kind[i] == 2:
                angle = np.arctan2(y, x)
                end = (15 * np.cos(angle), 15 * np.sin(angle), 30.0)
                rows.append((TUBE, 0, end, (0, 0, 0), _END, 0, 0))
            else:
                end = (place[0], place[1], SENSOR_Z)
                rows.append((SENSOR, 0, end, down, _END | (_SEEN if detect else 0), 0, 0))
                if detect:
                    crossings.append((place[0] / SIZE[0] + 0.5, place[1] / SIZE[1] + 0.5))
        counts.append(len(rows) - before)
    n = len(rows)
    uv = np.clip(np.array(crossings).reshape(-1, 2), 0, 0.9999)
    color = np.repeat(
        np.where(rng.random(n_rays) < 0.5, channels, rng.integers(0, channels, n_rays)), counts
    )
    white = np.full((1, channels), 65535 // channels, np.uint16)
    white[0, -1] += 65535 - int(white.sum())
    return (
        Portion(
            emitted=np.array([(source == 0).sum(), (source == 1).sum()], np.int64),
            source=source,
            records_per_ray=np.array(counts, np.int32),
            position=np.array([row[2] for row in rows], np.float32),
            normal=np.array([row[3] for row in rows], np.int16),
            object=np.array([row[0] for row in rows], np.int16),
            triangle=np.array([row[1] for row in rows], np.int32),
            event=np.array([int(row[4]) for row in rows], np.int32),
            medium=np.array([row[5] for row in rows], np.int16),
            color_code=color.astype(np.int32),
            color_table=white,
            descriptor_count=np.array([row[6] for row in rows], np.uint16),
            descriptors=Descriptors(
                detector=np.zeros(len(uv), np.int16),
                cell=(uv * CELLS).astype(np.uint16),
                cosine=np.full(len(uv), 32000, np.int16),
                uv=(uv * 65535).astype(np.uint16),
                registered=np.ones(len(uv), np.bool_),
            ),
            first_ray=first_ray,
        )
        if n
        else None
    )  # type: ignore[return-value]


def write_map(
    path: Path,
    *,
    portions: int = 3,
    rays: int = 400,
    meshes: bool = True,
    detect: bool = True,
    spectral: bool = False,
    finish: bool = True,
) -> Path:
    """Write the map; ``finish=False`` leaves it as a trace that is still running."""
    directory = make_directory()
    shown = make_meshes() if meshes else {}
    writer = RayMapWriter.create(path, directory, meshes=shown, force=True)
    try:
        number = writer.add_channel_set(spectral_channels() if spectral else rgb_channels())
        assert number == 0
        writer.start_run(seed=1, parameters={})
        for k in range(portions):
            writer.append(make_portion(rays, k * rays, detect=detect))
        if finish:
            writer.finish(statistics={})
    finally:
        writer.close()
    return path

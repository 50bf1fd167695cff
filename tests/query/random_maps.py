"""Random but sound maps: rays that no scene would trace, with every column filled."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import raymap
from raymap import (
    ChannelSet,
    Descriptors,
    Detector,
    Directory,
    Event,
    Face,
    Medium,
    Portion,
    SceneObject,
    Source,
    Surface,
)

_AT_SURFACE = (
    Event.SPECULAR_REFLECTION,
    Event.SPECULAR_REFRACTION | Event.MEDIUM_CHANGED,
    Event.DIFFUSE_REFLECTION,
    Event.GLOSSY_TRANSMISSION,
    Event.TIR,
    Event.SPECULAR_REFLECTION | Event.RIM_HIT,
    Event.SPECULAR_REFLECTION | Event.POLARISER,
)
_ENDS = (
    Event.SURFACE_ABSORPTION,
    Event.VOLUME_ABSORPTION,
    Event.LEFT_SCENE,
    Event.DEPTH_LIMIT,
    Event.GEOMETRY_ERROR,
)


def make_directory() -> Directory:
    """Five objects, eight faces (one with an alias, one of many primitives), two detectors."""
    return Directory(
        sources=(Source(name="lamp", flux=2.0), Source(name="sun", flux=5.0)),
        objects=(
            SceneObject(
                name="L1",
                faces=(
                    Face(name="front", surface=0),
                    Face(name="back", first_primitive=1, surface=1, aliases=("L2.front",)),
                    Face(name="rim", first_primitive=2, surface=2),
                ),
            ),
            SceneObject(
                name="L2",
                faces=(
                    Face(name="back", surface=0),
                    Face(name="rim", first_primitive=1, primitive_count=4, surface=2),
                ),
            ),
            SceneObject(name="mesh.a", faces=(Face(name="skin", primitive_count=50, surface=1),)),
            SceneObject(name="wall"),
            SceneObject(name="eye", faces=(Face(name="face", surface=2),)),
        ),
        media=(Medium(name="air"), Medium(name="glass_1"), Medium(name="glass_2")),
        surfaces=(
            Surface(name="clear", parameters={"n": 1.5, "roughness": 0.0}),
            Surface(name="two", parameters={"inside": {"roughness": 0.3}, "outside": {"n": 1.7}}),
            Surface(name="black", parameters={"roughness": 0.9, "loss": 0.95}),
        ),
        detectors=(
            Detector(name="screen", cells=(8, 6), size=(16.0, 12.0)),
            Detector(name="eye", cells=(5, 5), size=(1.0, 1.0), blocking=True, object=4),
        ),
    )


def make_channel_set() -> ChannelSet:
    return ChannelSet(
        kind="spectral",
        wavelengths_nm=(450.0, 550.0, 650.0),
        luminous=(25.0, 680.0, 73.0),
        display_rgb=((0.1, 0.0, 0.9), (0.2, 0.9, 0.1), (0.9, 0.1, 0.0)),
        refractive_index=((1.0, 1.0, 1.0), (1.53, 1.52, 1.51), (1.7, 1.7, 1.7)),
        absorption=((0.0,) * 3,) * 3,
        source_colors=((1 / 3,) * 3,) * 2,
    )


def _itinerary(rng: np.random.Generator, directory: Directory) -> dict[str, list[object]]:
    """Source, points and crossings of one path."""
    faces = directory.faces
    bare = next((k for k, item in enumerate(directory.objects) if not item.faces), None)
    n_media, n_detectors = len(directory.media), len(directory.detectors)
    n = int(rng.integers(1, 7))
    points: list[tuple[int, int, int, int]] = []
    crossings: list[list[tuple[int, bool]]] = []
    for step in range(n):
        if step == 0:
            here = (-1, -1, int(Event.EMITTED))
        elif step < n - 1 and rng.random() < 0.15:
            here = (-1, -1, int(Event.VOLUME_SCATTER))
        else:
            face = int(rng.integers(0 if bare is None else -1, len(faces.object)))
            owner = bare if face < 0 else int(faces.object[face])
            here = (owner, face, int(_AT_SURFACE[rng.integers(len(_AT_SURFACE))]))
        owner, face, event = here
        if step == n - 1:
            end = _ENDS[rng.integers(len(_ENDS))]
            if step and end == Event.LEFT_SCENE:
                owner, face = -1, -1
            event = (event if step == 0 else 0) | int(end)
        points.append((owner, face, event, int(rng.integers(-1, n_media))))
        k = int(rng.integers(0, 3)) if step < n - 1 and rng.random() < 0.4 else 0
        crossings.append(
            [(int(rng.integers(n_detectors)), bool(rng.random() < 0.7)) for _ in range(k)]
        )
    return {"source": [int(rng.integers(2))], "points": points, "crossings": crossings}


def random_portion(
    rng: np.random.Generator,
    n_rays: int,
    pool: list[dict[str, list[object]]],
    *,
    directory: Directory,
    first_ray: int,
    weights: bool = False,
    emissions: bool = False,
    gaps: bool = False,
    states: bool = False,
) -> Portion:
    """Rays that take paths of the pool, at random places and in random colours."""
    table = directory.faces
    chosen = [pool[int(rng.integers(len(pool)))] for _ in range(n_rays)]
    points = [point for path in chosen for point in path["points"]]
    met = [pair for path in chosen for here in path["crossings"] for pair in here]
    counts = np.array([len(path["points"]) for path in chosen], np.int32)
    n = len(points)
    owner = np.array([p[0] for p in points], np.int16)
    face = np.array([p[1] for p in points], np.int32)
    first = np.where(face >= 0, table.first_primitive[face], 0)
    span = np.where(face >= 0, table.primitive_count[face], 1)
    triangle = np.where(face >= 0, first + rng.integers(0, span), -1)
    normal = rng.normal(size=(n, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    normal[(owner < 0)] = 0
    cells = np.array([detector.cells for detector in directory.detectors])
    detector = np.array([pair[0] for pair in met], np.int16)
    uv = rng.integers(0, 65536, (len(met), 2)).astype(np.uint16)
    cell = np.minimum(uv.astype(np.int64) * cells[detector] // 65535, cells[detector] - 1)
    # Colours: mixed until some point, then one channel; a table row may hold one channel alone.
    colors = np.array([[21845, 21845, 21845], [65535, 0, 0], [30000, 0, 35535]], np.uint16)
    code = []
    for count in counts:
        change = int(rng.integers(0, count + 1))
        start, end = int(rng.integers(3, 6)), int(rng.integers(0, 3))
        code += [start] * change + [end] * (int(count) - change)
    emitted = np.array([n_rays, n_rays + 3], np.int64)
    ids = None
    if gaps:
        ids = first_ray + np.cumsum(rng.integers(1, 4, n_rays)).astype(np.int64) - 1
    return Portion(
        emitted=emitted,
        source=np.array([path["source"][0] for path in chosen], np.int16),
        records_per_ray=counts,
        position=rng.normal(scale=5, size=(n, 3)).astype(np.float32),
        normal=np.round(normal * 32767).astype(np.int16),
        object=owner,
        triangle=triangle.astype(np.int32),
        event=np.array([p[2] for p in points], np.int32),
        medium=np.array([p[3] for p in points], np.int16),
        color_code=np.array(code, np.int32),
        color_table=colors,
        descriptor_count=np.array(
            [len(here) for path in chosen for here in path["crossings"]], np.uint16
        ),
        descriptors=Descriptors(
            detector=detector,
            cell=cell.astype(np.uint16).reshape(-1, 2),
            cosine=rng.integers(0, 32768, len(met)).astype(np.int16),
            uv=uv.reshape(-1, 2),
            registered=np.array([pair[1] for pair in met], np.bool_),
        ),
        first_ray=int(ids[0]) if ids is not None and n_rays else first_ray,
        ray_ids=ids,
        weight=rng.integers(1, 9, n_rays).astype(np.float32) / 4 if weights else None,
        emission=first_ray + np.sort(rng.integers(0, n_rays // 2, n_rays)) if emissions else None,
        extra=_states(rng, n) if states else {},
    )


def _states(rng: np.random.Generator, n: int) -> dict[str, np.ndarray]:
    """Columns of polarised traces: linear, elliptical, circular and natural light among them."""
    stokes = rng.normal(size=(n, 3))
    stokes *= (rng.random(n) / np.linalg.norm(stokes, axis=1))[:, None]
    kind = rng.integers(0, 5, n)
    stokes[kind == 0] = (1, 0, 0)
    stokes[kind == 1] = (-1, -0.0, 0)
    stokes[kind == 2] = (0, 0, 1)
    stokes[kind == 3] = 0
    return {
        "stokes": stokes.astype(np.float32),
        "optical_path": (rng.integers(0, 60, n) / 2).astype(np.float32),
    }


def write_random_map(
    path: Path,
    seed: int,
    *,
    portions: int = 3,
    rays: int = 40,
    paths: int = 6,
    finish: bool = True,
    weights: bool = False,
    emissions: bool = False,
    gaps: bool = False,
    plain: bool = False,
    states: bool = False,
    directory: Directory | None = None,
    first_ray: int = 0,
) -> Path:
    """Write a map; ``plain`` gives every ray a path of its own, so that no dictionary pays."""
    rng = np.random.default_rng(seed)
    directory = make_directory() if directory is None else directory
    pool = [_itinerary(rng, directory) for _ in range(paths)]
    writer = raymap.RayMapWriter.create(path, directory)
    try:
        with writer:
            writer.add_channel_set(make_channel_set())
            for number in range(portions):
                own = pool
                if plain and number % 2 == 0:
                    own = [_itinerary(rng, directory) for _ in range(rays)]
                # Names of rays must not overlap, gaps included.
                writer.append(
                    random_portion(
                        rng,
                        rays,
                        own,
                        directory=directory,
                        first_ray=first_ray + number * rays * 4,
                        weights=weights,
                        emissions=emissions,
                        gaps=gaps,
                        # A map may have its columns in some portions only.
                        states=states and number != 1,
                    )
                )
            if not finish:
                raise _Stop
    except _Stop:
        pass
    return path


class _Stop(Exception):
    pass

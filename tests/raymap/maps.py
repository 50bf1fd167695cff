"""Small maps for the tests of the file."""

from __future__ import annotations

import dataclasses

import numpy as np

import raymap
from tests.strategies import make_portion

RGB = raymap.ChannelSet(kind="rgb", wavelengths_nm=(610.0, 550.0, 465.0))
SPECTRAL = raymap.ChannelSet(kind="spectral", wavelengths_nm=(450.0, 500.0, 550.0, 600.0, 650.0))
COLORED = raymap.ChannelSet(
    kind="spectral",
    wavelengths_nm=(450.0, 550.0, 610.0),
    luminous=(25.954, 679.585, 343.549),
    source_colors=((0.5, 0.3, 0.2), (0.1, 0.0, 0.9)),
)
"""Of light in lumen: 683 V(λ), and the mean colours of the sources of `small_directory`."""


def small_directory(**changes):
    """Two sources, a lens with a sphere and a mesh, a box without faces, two detectors."""
    sphere = raymap.Quadric(coefficients=(1, 1, 1, 0, 0, 0, 0, 0, 0, -2500.0), solve_axis=2)
    fields = {
        "sources": (raymap.Source(name="lamp", flux=2.0), raymap.Source(name="sun")),
        "objects": (
            raymap.SceneObject(
                name="lens",
                faces=(
                    raymap.Face(name="front", quadrics=(sphere,)),
                    raymap.Face(name="mesh", first_primitive=1, primitive_count=9),
                ),
            ),
            raymap.SceneObject(name="box"),
        ),
        "media": (raymap.Medium(name="air"), raymap.Medium(name="glass")),
        "detectors": (
            raymap.Detector(name="sensor", cells=(7, 5), size=(40.0, 40.0)),
            raymap.Detector(name="sky", kind="far_field", cells=(3, 4)),
        ),
        "bounding_sphere": raymap.BoundingSphere(radius=60.0),
        "scene_hash": "small",
    }
    return raymap.Directory(**{**fields, **changes})


def portion_at(first_ray, n_rays=50, seed=0, **options):
    """A portion of the small scene whose rays are numbered from ``first_ray``."""
    options = {"n_paths": 4, **options}
    channels = options.pop("channels", RGB)
    portion = make_portion(small_directory(), channels, n_rays=n_rays, seed=seed, **options)
    return dataclasses.replace(portion, first_ray=first_ray)


def write_small(path, n_portions=4, n_rays=50, seed=1, directory=None, finish=True, **options):
    """A map of some portions; returns what was handed in."""
    portions = [
        portion_at(100 * k, n_rays, seed=10 * seed + k, **options) for k in range(n_portions)
    ]
    writer = raymap.RayMapWriter.create(path, directory or small_directory())
    writer.add_channel_set(options.get("channels", RGB))
    writer.start_run(seed=seed, parameters={"why": "a test"})
    for portion in portions:
        writer.append(portion)
    if finish:
        writer.finish({"seconds": 1.0})
    else:
        writer.close()
    return portions


def ids_of(ray_map):
    """All ray numbers of a map."""
    return np.concatenate([portion.ray_ids() for portion in ray_map.portions])

"""Rays of a map as lists of Python numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass
class Point:
    object: int
    face: int
    triangle: int
    event: int
    medium: int
    position: tuple[float, float, float]
    normal: tuple[int, int, int]
    crossings: list[tuple[int, bool, tuple[int, int]]]
    stokes: list[float] | None
    optical_path: float | None


@dataclass
class Ray:
    id: int
    source: int
    weight: float
    points: list[Point]
    channels: list[int]  # channels that carry light at the end
    emission: tuple[int, int]  # portion and number; equal for rays of one emission


def rays_of(map: Any) -> list[Ray]:
    """Every ray of a map."""
    rays = []
    for number, portion in enumerate(map.portions):
        whole = portion.read()
        faces = portion.column("face")
        ids = portion.ray_ids()
        emissions = portion.column("emission").tolist() if portion.grouped else ids.tolist()
        n_channels = map.channel_sets[portion.channel_set].n_channels
        row = crossing = 0
        for index in range(whole.n_rays):
            points = []
            for _ in range(int(whole.records_per_ray[index])):
                count = int(whole.descriptor_count[row])
                found = whole.descriptors
                crossings = [
                    (
                        int(found.detector[i]),
                        bool(found.registered[i]),
                        (int(found.uv[i, 0]), int(found.uv[i, 1])),
                    )
                    for i in range(crossing, crossing + count)
                ]
                crossing += count
                points.append(
                    Point(
                        int(whole.object[row]),
                        int(faces[row]),
                        int(whole.triangle[row]),
                        int(whole.event[row]),
                        int(whole.medium[row]),
                        tuple(float(x) for x in whole.position[row]),
                        tuple(int(x) for x in whole.normal[row]),
                        crossings,
                        whole.extra["stokes"][row].tolist() if "stokes" in whole.extra else None,
                        float(whole.extra["optical_path"][row])
                        if "optical_path" in whole.extra
                        else None,
                    )
                )
                code = int(whole.color_code[row])
                row += 1
            if code < n_channels:
                channels = [code]
            else:
                shares = whole.color_table[code - n_channels]
                channels = [k for k in range(n_channels) if shares[k] > 0]
            weight = 1.0 if whole.weight is None else float(whole.weight[index])
            source, emission = int(whole.source[index]), (number, emissions[index])
            rays.append(Ray(int(ids[index]), source, weight, points, channels, emission))
    return rays

"""One ray, point by point, in names and units."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from query.engine.recorded import ellipse_of
from raymap.model.directory import ChannelSet, Directory
from raymap.model.events import Event, event_names
from raymap.model.portion import Portion
from raymap.model.rows import take_rays
from raymap.model.schema import COLOR_SCALE, NORMAL_SCALE, UV_SCALE
from raymap.optics.photometry import displayed

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["report"]


def report(map: RayMap, ray_id: int) -> dict[str, Any]:
    """Everything that is recorded of one ray.

    Returns
    -------
    dict
        ``ray_id``, ``source``, ``flux`` at its end, ``weight`` and ``points``: for each point
        position, object, face, triangle, events, normal, angle of incidence, and of the segment
        that starts there medium, refractive index, length, colour, spectrum and detector crossings;
        further columns of the map by name, and ``polarisation`` (degree, angle_deg, axis_ratio,
        handedness) beside Stokes parameters

    Raises
    ------
    RayNotFound
    """
    index, place = map.find_ray(int(ray_id))
    portion = map.portions[index]
    ray = take_rays(portion.read(), np.array([place]), np.array([int(ray_id)]))
    directory: Directory = map.directory
    channel_set: ChannelSet = map.channel_sets[portion.channel_set]
    faces = _faces(ray, directory)
    source = int(ray.source[0])
    weight = 1.0 if ray.weight is None else float(ray.weight[0])
    light = map.photometry(portion.channel_set)
    carried = weight * float(
        light.worth_of_rays(ray.source, ray.color_code[-1:], ray.color_table)[0]
    )
    emitted = int(map.emitted[source])
    extra = {name: column for name, column in ray.extra.items() if len(column) == 1}
    points = [_point(ray, row, faces[row], directory, channel_set) for row in range(ray.n_records)]
    return {
        "ray_id": int(ray_id),
        "source": directory.sources[source].name,
        "weight": weight,
        "flux": directory.sources[source].flux * carried / emitted if emitted else 0.0,
        "units": {"length": directory.length_unit, "flux": directory.flux_unit},
        "channels": channel_set.labels,
        "length": _total_length(ray, points),
        "points": points,
        **{name: column[0].tolist() for name, column in extra.items()},
    }


def _total_length(ray: Portion, points: list[dict[str, Any]]) -> float:
    """Length of the segments, without the last one of a ray that left."""
    lengths = [float(point["length"]) for point in points[:-1]]
    left = bool(ray.event[-1] & int(Event.LEFT_SCENE))
    return sum(lengths[:-1] if left else lengths)


def _faces(ray: Portion, directory: Directory) -> list[int]:
    """Face index of each record, -1 none."""
    table = directory.faces
    found = []
    for owner, triangle in zip(ray.object.tolist(), ray.triangle.tolist(), strict=True):
        face = -1
        if owner >= 0 and triangle >= 0:
            begin, end = int(table.first_face[owner]), int(table.first_face[owner + 1])
            for candidate in range(begin, end):
                first = int(table.first_primitive[candidate])
                if first <= triangle < first + int(table.primitive_count[candidate]):
                    face = candidate
        found.append(face)
    return found


def _point(
    ray: Portion, row: int, face: int, directory: Directory, channel_set: ChannelSet
) -> dict[str, Any]:
    is_last = row == ray.n_records - 1
    owner = int(ray.object[row])
    medium = -1 if is_last else int(ray.medium[row])
    shares = _shares(ray, row, channel_set)
    normal = ray.normal[row] / NORMAL_SCALE
    known = medium >= 0
    return {
        "position": [float(x) for x in ray.position[row]],
        "object": directory.objects[owner].name if owner >= 0 else None,
        "face": directory.faces.names[face].rpartition(".")[2] if face >= 0 else None,
        "triangle": int(ray.triangle[row]) if ray.triangle[row] >= 0 else None,
        "surface": _surface(face, directory),
        "events": event_names(int(ray.event[row])),
        "normal": [float(x) for x in normal] if ray.normal[row].any() else None,
        "incidence_deg": _incidence(ray, row),
        "medium": directory.media[medium].name if known else None,
        "refractive_index": _index(medium, shares, channel_set),
        "medium_parameters": directory.media[medium].parameters if known else None,
        "length": None if is_last else _length(ray, row),
        "color": _color(shares, channel_set),
        "spectrum": dict(zip(channel_set.labels, shares, strict=True)),
        "detectors": _crossings(ray, row, directory),
        **_polarisation(ray, row, is_last),
        **{
            name: column[row].tolist()
            for name, column in ray.extra.items()
            if len(column) == ray.n_records and ray.n_records > 1
        },
    }


def _polarisation(ray: Portion, row: int, is_last: bool) -> dict[str, Any]:
    """State of the light of the segment that starts here, where the map has it."""
    stokes = ray.extra.get("stokes")
    if stokes is None or stokes.shape != (ray.n_records, 3) or stokes.dtype.kind != "f":
        return {}
    return {"polarisation": None if is_last else ellipse_of(stokes[row])}


def _shares(ray: Portion, row: int, channel_set: ChannelSet) -> list[float]:
    """Share of each channel in the light of the segment; they sum to 1."""
    code = int(ray.color_code[row])
    n = channel_set.n_channels
    if code < n:
        return [1.0 if channel == code else 0.0 for channel in range(n)]
    return [int(value) / COLOR_SCALE for value in ray.color_table[code - n]]


def _surface(face: int, directory: Directory) -> str | None:
    surface = int(directory.faces.surface[face]) if face >= 0 else -1
    return directory.surfaces[surface].name if surface >= 0 else None


def _length(ray: Portion, row: int) -> float:
    step = ray.position[row + 1].astype(np.float64) - ray.position[row].astype(np.float64)
    return float(np.sqrt(step @ step))


def _incidence(ray: Portion, row: int) -> float | None:
    """Angle between the arriving ray and the normal [deg]; None without a surface."""
    if row == 0 or ray.object[row] < 0 or not ray.normal[row].any():
        return None
    step = ray.position[row].astype(np.float64) - ray.position[row - 1].astype(np.float64)
    normal = ray.normal[row].astype(np.float64)
    size = float(np.linalg.norm(step) * np.linalg.norm(normal))
    if size == 0.0:
        return None
    # The arctangent keeps its digits at small angles, where the cosine loses them.
    across = float(np.linalg.norm(np.cross(step, normal)))
    return float(np.degrees(np.arctan2(across, abs(float(step @ normal)))))


def _index(
    medium: int, shares: list[float], channel_set: ChannelSet
) -> float | dict[str, float] | None:
    """Refractive index at the ray's channel; by channel where light is mixed and they differ."""
    table = channel_set.refractive_index
    if not 0 <= medium < len(table):
        return None
    lit = [channel for channel, share in enumerate(shares) if share > 0]
    found = {channel_set.labels[channel]: float(table[medium][channel]) for channel in lit}
    values = set(found.values())
    return values.pop() if len(values) == 1 else found


def _color(shares: list[float], channel_set: ChannelSet) -> list[float]:
    """Linear sRGB of the light, brightest component 1."""
    rgb = displayed(channel_set, shares)
    top = float(rgb.max())
    return [float(x) for x in (rgb / top if top > 0 else rgb)]


def _crossings(ray: Portion, row: int, directory: Directory) -> list[dict[str, Any]]:
    """Crossings of the segment that starts here and detectors."""
    begin = int(ray.descriptor_count[:row].sum())
    end = begin + int(ray.descriptor_count[row])
    found = ray.descriptors
    return [
        {
            "detector": directory.detectors[int(found.detector[number])].name,
            "cell": [int(x) for x in found.cell[number]],
            "cosine": float(found.cosine[number] / NORMAL_SCALE),
            "uv": [float(x) / UV_SCALE for x in found.uv[number]],
            "registered": bool(found.registered[number]),
        }
        for number in range(begin, end)
    ]

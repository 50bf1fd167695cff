"""Zemax ray databases as ray maps.

A ray of the database is a tree: it splits at surfaces, and its intensity falls on the way. A ray of
a map carries one weight from its emission to its end. So each end of a tree becomes a ray, and the
light that a tree loses at a point becomes a ray that ends there, absorbed: then the rays through
any segment carry together what the database says, and all of them what the source emitted. The
rays of a tree form one emission.

What happened at a point follows from the directions before and behind it, the normal and the
indices, not from the status bits, whose meaning has changed between versions.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.file.writer import RayMapWriter
from raymap.foreign.recorded import RecordedFormat
from raymap.foreign.zrd import FATAL, Trees, ZrdFile
from raymap.model.directory import (
    BoundingSphere,
    ChannelSet,
    Directory,
    Face,
    Medium,
    SceneObject,
    Source,
)
from raymap.model.errors import RayMapError
from raymap.model.events import Event
from raymap.model.portion import Descriptors, Portion
from raymap.model.replacing import refuse_existing, replacing
from raymap.model.schema import NORMAL_SCALE
from raymap.optics.colorimetry import channel_display_rgb, luminous_efficacy

__all__ = ["import_zrd"]

_LOSS = 1e-6
_SNELL = 1e-4
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def import_zrd(
    source: str | os.PathLike[str],
    path: str | os.PathLike[str],
    *,
    names: Mapping[str, str] | None = None,
    length_unit: str = "mm",
    flux_unit: str = "W",
    wavelength_nm: float = 550.0,
    force: bool = False,
) -> dict[str, int]:
    """Write a ray map of an uncompressed Zemax ray database.

    Parameters
    ----------
    source : the ``.zrd`` file
    path : of the map
    names : names by number, as in the Non-Sequential Component Editor: "3" an object (or source),
        "3.1" its face 1; others are called object_3, face_1, source_3
    length_unit, flux_unit, wavelength_nm : what the database does not say: the lens unit, "W" or
        "lm", the wavelength of its rays
    force : replace an existing map

    Returns
    -------
    counts of ``trees``, ``rays`` and ``records``

    Raises
    ------
    ZrdError
        The file is none, compressed, cut off, or holds impossible numbers.
    RayMapError, MapExists
    """
    target = Path(path)
    refuse_existing(target, force=force)
    file = ZrdFile(Path(source))
    found = _Survey(file)
    directory = found.directory(dict(names or {}), length_unit, flux_unit)
    channels = found.channels(wavelength_nm)
    rays = records = 0
    with (
        replacing(target) as beside,
        RayMapWriter.create(beside, directory) as writer,
    ):
        writer.add_channel_set(channels)
        writer.start_run(parameters={"imported_from": file.name, "zrd_version": file.version})
        for trees in file.pieces():
            portion = _portion(trees, found, rays)
            writer.append(portion)
            rays += portion.n_rays
            records += portion.n_records
    return {"trees": file.n_trees, "rays": rays, "records": records}


class _Survey:
    """What the whole file holds: numbers of objects, faces, sources, media; flux and extent."""

    def __init__(self, file: ZrdFile) -> None:
        self.file = file
        self.flux: dict[int, float] = {}
        self.emitted: dict[int, int] = {}
        faces: set[tuple[int, int]] = set()
        media: dict[int, float] = {0: 1.0}
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for trees in file.pieces():
            s, root = trees.segments, trees.parent < 0
            for number in np.unique(s["hit_object"][root]).tolist():
                mine = s[root & (s["hit_object"] == number)]
                self.flux[number] = self.flux.get(number, 0.0) + float(mine["intensity"].sum())
                self.emitted[number] = self.emitted.get(number, 0) + len(mine)
            hit = s[~root & (s["hit_object"] > 0)]
            pairs = np.unique(np.stack([hit["hit_object"], hit["hit_face"]], 1), axis=0)
            faces.update((int(a), int(b)) for a, b in pairs)
            inside, first = np.unique(s["in_object"][~root], return_index=True)
            for number, index in zip(inside.tolist(), first.tolist(), strict=True):
                media.setdefault(number, float(s["index"][~root][index]))
                if number == 0:
                    media[0] = float(s["index"][~root][index])
            points = np.stack([s["x"], s["y"], s["z"]], 1)[root | (s["hit_object"] > 0)]
            low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
        self.sources = sorted(self.flux)
        self.faces = sorted(faces)
        self.objects = sorted({number for number, _ in self.faces})
        self.media = dict(sorted(media.items()))
        self.center = 0.5 * (low + high)
        self.radius = max(0.75 * float(np.linalg.norm(high - low)), 1e-3)

    def directory(self, names: dict[str, str], length_unit: str, flux_unit: str) -> Directory:
        """The names and numbers of the map."""
        known = {str(number) for number in (*self.objects, *self.sources)}
        known |= {f"{a}.{b}" for a, b in self.faces}
        stray = next((key for key in names if key not in known), None)
        if stray is not None:
            shown = ", ".join(sorted(known, key=lambda key: [int(part) for part in key.split(".")]))
            raise RayMapError(f"no ray of {self.file.name} meets {stray!r}; they meet {shown}")
        objects = []
        for number in self.objects:
            faces = [face for owner, face in self.faces if owner == number]
            objects.append(
                SceneObject(
                    name=names.get(str(number), f"object_{number}"),
                    kind="zemax",
                    faces=tuple(
                        Face(name=names.get(f"{number}.{face}", f"face_{face}"), first_primitive=k)
                        for k, face in enumerate(faces)
                    ),
                )
            )
        fields: dict[str, Any] = {"flux_unit": flux_unit}
        return Directory(
            length_unit=length_unit,
            sources=tuple(
                Source(name=names.get(str(k), f"source_{k}"), flux=self.flux[k], kind="zemax")
                for k in self.sources
            ),
            objects=tuple(objects),
            media=tuple(
                Medium(name=f"in {names.get(str(k), f'object_{k}')}" if k else "background")
                for k in self.media
            ),
            bounding_sphere=BoundingSphere(
                center=(float(self.center[0]), float(self.center[1]), float(self.center[2])),
                radius=self.radius,
            ),
            scene_hash=f"zrd {self.file.name} {self.file.n_trees} {sum(self.flux.values())!r}",
            title=f"imported from {self.file.name}",
            **fields,
        )

    def channels(self, wavelength_nm: float) -> ChannelSet:
        """One channel."""
        nm = np.array([wavelength_nm])
        rgb = channel_display_rgb(nm, gamut=False)
        return ChannelSet(
            kind="spectral",
            wavelengths_nm=(wavelength_nm,),
            luminous=(float(luminous_efficacy(wavelength_nm)),),
            display_rgb=tuple((float(r), float(g), float(b)) for r, g, b in rgb),
            refractive_index=tuple((index,) for index in self.media.values()),
            absorption=tuple((0.0,) for _ in self.media),
            source_colors=tuple((1.0,) for _ in self.sources),
        )


def _portion(trees: Trees, found: _Survey, first_ray: int) -> Portion:
    """The rays of some trees."""
    end, weight, lost = _ends(trees)
    rows, counts = _paths(trees.parent, end)
    offsets = np.concatenate(([0], np.cumsum(counts)))
    last = offsets[1:] - 1
    first = offsets[:-1]
    s = trees.segments[rows]
    root = trees.segments[rows[first]]

    source = np.searchsorted(found.sources, root["hit_object"])
    share = np.array([found.emitted[k] / max(found.flux[k], 1e-300) for k in found.sources])
    position, normal = _geometry(s, found, first, last, lost)
    event = _events(s, position, first, last, lost)
    item = np.where(s["hit_object"] > 0, np.searchsorted(found.objects, s["hit_object"]), -1)
    item[first] = -1
    triangle = _primitives(s, found)
    triangle[item < 0] = -1
    # The medium of a record is that of the segment that starts there
    inside = np.searchsorted(list(found.media), s["in_object"])
    medium = np.append(inside[1:], -1)
    medium[last] = np.where(counts > 1, medium[np.maximum(last - 1, 0)], 0)
    changed = np.zeros(len(s), np.bool_)
    inner = np.ones(len(s), np.bool_)
    inner[first] = inner[last] = False
    changed[1:] = (medium[1:] != medium[:-1]) & inner[1:]
    event[changed] |= int(Event.MEDIUM_CHANGED)
    emitted = np.bincount(
        np.searchsorted(found.sources, trees.segments["hit_object"][trees.parent < 0]),
        minlength=len(found.sources),
    )
    return Portion(
        emitted=emitted.astype(np.int64),
        source=source.astype(np.int16),
        records_per_ray=counts.astype(np.int32),
        position=position.astype(np.float32),
        normal=np.rint(normal * NORMAL_SCALE).astype(np.int16),
        object=item.astype(np.int16),
        triangle=triangle.astype(np.int32),
        event=event.astype(np.int32),
        medium=medium.astype(np.int16),
        color_code=np.zeros(len(s), np.int32),
        color_table=np.empty((0, 1), np.uint16),
        descriptor_count=np.zeros(len(s), np.uint16),
        descriptors=Descriptors.empty(),
        first_ray=first_ray,
        weight=(weight * share[source]).astype(np.float32),
        emission=trees.tree[rows[first]],
    )


def _ends(trees: Trees) -> tuple[Ints, Floats, NDArray[np.bool_]]:
    """Segments at which rays end, what the rays carry, and whether it was lost on the way."""
    n = len(trees.parent)
    child = trees.parent >= 0
    intensity = trees.segments["intensity"].astype(np.float64)
    passed = np.bincount(trees.parent[child], intensity[child], n)
    leaf = np.ones(n, np.bool_)
    leaf[trees.parent[child]] = False
    roots = np.maximum.accumulate(np.where(child, 0, np.arange(n)))
    loss = np.where(leaf, 0.0, intensity - passed)
    lossy = loss > _LOSS * intensity[roots]
    end = np.concatenate([np.flatnonzero(leaf), np.flatnonzero(lossy)])
    carried = np.concatenate([intensity[leaf], loss[lossy]])
    lost = np.arange(len(end)) >= leaf.sum()
    # Rays of one tree stand together
    order = np.lexsort((end, trees.tree[end]))
    return end[order], carried[order], lost[order]


def _paths(parent: Ints, end: Ints) -> tuple[Ints, Ints]:
    """Segments from the start to each end, ray after ray, and how many."""
    counts = np.ones(len(end), np.int64)
    ray, here = np.arange(len(end)), parent[end]
    while len(ray := ray[here >= 0]):
        here = here[here >= 0]
        counts[ray] += 1
        here = parent[here]
    # Fill from the ends back to the starts
    rows = np.empty(int(counts.sum()), np.int64)
    index = np.cumsum(counts) - 1
    here = end
    while len(here):
        rows[index] = here
        here = parent[here]
        index = index[here >= 0] - 1
        here = here[here >= 0]
    return rows, counts


def _geometry(
    s: NDArray[np.void], found: _Survey, first: Ints, last: Ints, lost: NDArray[np.bool_]
) -> tuple[Floats, Floats]:
    """Points and normals; rays that meet nothing at last end on the bounding sphere."""
    position = np.stack([s["x"], s["y"], s["z"]], 1)
    normal = np.stack([s["nx"], s["ny"], s["nz"]], 1)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.where(length > 0.5, normal / np.maximum(length, 1e-30), 0.0)
    normal[first] = 0.0
    left = last[(s["hit_object"][last] == 0) & ~lost & (last > first)]
    start = position[left - 1]
    along = np.stack([s["l"][left], s["m"][left], s["n"][left]], 1)
    size = np.linalg.norm(along, axis=1, keepdims=True)
    straight = position[left] - start
    along = np.where(size > 0.5, along, straight)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-30)
    offset = start - found.center
    b = np.einsum("ij,ij->i", offset, along)
    c = np.einsum("ij,ij->i", offset, offset) - found.radius**2
    reach = -b + np.sqrt(np.maximum(b * b - c, 0.0))
    position[left] = start + reach[:, None] * along
    normal[left] = along
    return position, normal


def _primitives(s: NDArray[np.void], found: _Survey) -> Ints:
    """Number of each face within its object."""
    order = {pair: k for k, pair in enumerate(found.faces)}
    starts: dict[int, int] = {}
    for k, (owner, _) in enumerate(found.faces):
        starts.setdefault(owner, k)
    pairs, inverse = np.unique(
        np.stack([s["hit_object"], s["hit_face"]], 1), axis=0, return_inverse=True
    )
    numbers = [
        order[(int(a), int(b))] - starts[int(a)] if (int(a), int(b)) in order else -1
        for a, b in pairs
    ]
    return np.array(numbers, np.int64)[inverse.ravel()]


def _events(
    s: NDArray[np.void], position: Floats, first: Ints, last: Ints, lost: NDArray[np.bool_]
) -> Ints:
    event = np.zeros(len(s), np.int64)
    inner = np.ones(len(s), np.bool_)
    inner[first] = inner[last] = False
    at = np.flatnonzero(inner)
    event[at] = _happened(s, position, at)
    single = first == last
    event[first] |= int(Event.EMITTED)
    ending = np.where(
        (s["hit_object"][last] == 0) & ~lost, int(Event.LEFT_SCENE), int(Event.SURFACE_ABSORPTION)
    )
    nowhere = lost & (s["hit_object"][last] == 0)
    ending[nowhere | single] = int(Event.VOLUME_ABSORPTION)
    ending[((s["status"][last] & FATAL) != 0) & ~lost] = int(Event.GEOMETRY_ERROR)
    event[last] |= ending
    return event


def _happened(s: NDArray[np.void], position: Floats, at: Ints) -> Ints:
    """Reflection or transmission, specular or not, from the directions and the normal."""
    before = _unit(position[at] - position[at - 1])
    behind = _unit(position[at + 1] - position[at])
    normal = np.stack([s["nx"][at], s["ny"][at], s["nz"][at]], 1)
    normal = _unit(normal)
    cos_in = np.einsum("ij,ij->i", before, normal)
    cos_out = np.einsum("ij,ij->i", behind, normal)
    reflected = cos_in * cos_out < 0
    plain = np.linalg.norm(normal, axis=1) < 0.5
    reflected[plain] = s["in_object"][at][plain] == s["in_object"][at + 1][plain]
    # Compare tangential components of index times direction: equal for specular light
    n_in = s["index"][at]
    n_out = np.where(reflected, n_in, s["index"][at + 1])
    change = n_in[:, None] * before - n_out[:, None] * behind
    change -= np.einsum("ij,ij->i", change, normal)[:, None] * normal
    specular = (np.linalg.norm(change, axis=1) < _SNELL) | plain
    happened = np.where(
        reflected,
        np.where(specular, int(Event.SPECULAR_REFLECTION), int(Event.DIFFUSE_REFLECTION)),
        np.where(specular, int(Event.SPECULAR_REFRACTION), int(Event.DIFFUSE_TRANSMISSION)),
    )
    happened[s["hit_object"][at] == 0] = int(Event.VOLUME_SCATTER)
    return happened.astype(np.int64)


def _unit(vectors: Floats) -> Floats:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0, length, 1.0))


KINDS = (
    RecordedFormat(
        suffixes=(".zrd",),
        title="ray databases of Zemax OpticStudio, uncompressed",
        place=10,
        write_map=import_zrd,
    ),
)

"""Record what another program traces: points in, ray map out.

A program that finds the points of a ray one after the other hands them over as `Point`s; names,
indices, colours, portions and the footer are this module's business. For programs that have whole
columns of points `raymap.RayMapWriter` is faster.

>>> objects = {"ball": ["surface"], "floor": ["top", "bottom"]}
>>> sources = {"lamp": 10.0}
>>> with RayRecorder("a.raymap", objects=objects, sources=sources) as record:    # doctest: +SKIP
...     start = Point(position=(0, 0, 3), event=Event.EMITTED)
...     end = Point(position=(0, 0, 0), event=Event.SURFACE_ABSORPTION, object="floor")
...     record.ray([start, end])
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.file.writer import RayMapWriter
from raymap.model.directory import (
    BoundingSphere,
    ChannelSet,
    Directory,
    DisplayMesh,
    Face,
    Medium,
    SceneObject,
    Source,
)
from raymap.model.errors import InvalidPortion
from raymap.model.events import ENDINGS, Event
from raymap.model.portion import Descriptors, Portion
from raymap.model.schema import COLOR_SCALE, NORMAL_SCALE
from raymap.optics.colorimetry import (
    RGB_LUMINANCE,
    RGB_WAVELENGTHS_NM,
    channel_display_rgb,
    luminous_efficacy,
)

__all__ = ["Point", "RayRecorder"]

_PORTION_RECORDS = 2**16
Vector = Sequence[float] | NDArray[np.floating]


@dataclass(frozen=True, kw_only=True)
class Point:
    """A point of a ray.

    Attributes
    ----------
    position : [length unit]
    event : what happened there; the last point of a ray has one ending event
    object, face : what was met; None at emission, in a volume and outside
    normal : outward normal of the face, of any length; zero unknown
    medium : of the segment that starts here; None: the first medium
    color : shares of the channels in the segment that starts here, of any sum; None: as before, or
        even
    """

    position: Vector
    event: int
    object: str | None = None
    face: str | None = None
    normal: Vector = (0.0, 0.0, 0.0)
    medium: str | None = None
    color: Vector | None = None


class RayRecorder:
    """Writes rays as a map; leave the ``with`` block to finish it.

    Parameters
    ----------
    path : of the map
    objects : names of the faces of each object; () for one face "surface"
    sources : flux of each source [flux_unit]
    media : refractive index of each medium
    wavelengths_nm : channels of a spectral map; None: R, G, B
    meshes : display meshes by object, for pictures
    center, radius : sphere around everything, on which rays that leave end [length unit]
    length_unit, flux_unit, title : of the map
    tracer : what traces, kept with the run
    force : replace an existing map

    Raises
    ------
    MapExists
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        objects: Mapping[str, Sequence[str]],
        sources: Mapping[str, float],
        media: Mapping[str, float] | None = None,
        wavelengths_nm: Sequence[float] | None = None,
        meshes: Mapping[str, DisplayMesh] | None = None,
        center: Vector = (0.0, 0.0, 0.0),
        radius: float = 1.0,
        length_unit: str = "mm",
        flux_unit: str = "W",
        title: str = "",
        tracer: str = "",
        seed: int | None = None,
        force: bool = False,
    ) -> None:
        faces = {name: list(parts) or ["surface"] for name, parts in objects.items()}
        self._objects = {name: k for k, name in enumerate(faces)}
        self._faces = {name: {part: k for k, part in enumerate(parts)}
                       for name, parts in faces.items()}  # fmt: skip
        self._sources = {name: k for k, name in enumerate(sources)}
        indices = dict(media or {"air": 1.0})
        self._media = {name: k for k, name in enumerate(indices)}
        self._center, self._radius = np.array(center, float), float(radius)
        channels = _channel_set(wavelengths_nm, list(indices.values()), len(sources))
        self._n_channels = channels.n_channels
        fields: dict[str, Any] = {"flux_unit": flux_unit}
        directory = Directory(
            length_unit=length_unit,
            sources=tuple(Source(name=name, flux=flux) for name, flux in sources.items()),
            objects=tuple(
                SceneObject(
                    name=name,
                    faces=tuple(Face(name=p, first_primitive=k) for k, p in enumerate(parts)),
                )
                for name, parts in faces.items()
            ),
            media=tuple(Medium(name=name) for name in indices),
            bounding_sphere=BoundingSphere(
                center=(float(center[0]), float(center[1]), float(center[2])), radius=radius
            ),
            scene_hash=f"{tracer}: {title or Path(path).stem}",
            title=title,
            **fields,
        )
        known = {self._objects[name]: mesh for name, mesh in (meshes or {}).items()}
        self._writer = RayMapWriter.create(path, directory, meshes=known, force=force)
        self._writer.add_channel_set(channels)
        self._writer.start_run(seed=seed, parameters={"tracer": tracer} if tracer else {})
        self._first_ray = 0
        self._clear()

    def __enter__(self) -> RayRecorder:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is not None:
            self._writer.close()
            return
        self._flush()
        self._writer.finish()

    def ray(
        self, points: Sequence[Point], *, source: str | None = None, weight: float = 1.0
    ) -> None:
        """Record one ray.

        Parameters
        ----------
        points : from emission to end
        source : that emitted it; the first one if left out
        weight : 1 where every ray of a source carries the same flux

        Raises
        ------
        InvalidPortion
            A name is none of those declared, or the ray does not begin with an emission and end
            with one ending.
        """
        if not points:
            raise InvalidPortion("a ray has at least the point of its emission")
        emitted = int(points[0].event) & int(Event.EMITTED)
        ending = int(points[-1].event) & int(ENDINGS)
        if not emitted or not ending or ending & (ending - 1):
            raise InvalidPortion(
                "a ray begins with Event.EMITTED and ends with one ending event, such as "
                "Event.LEFT_SCENE or Event.SURFACE_ABSORPTION"
            )
        number = self._number(self._sources, source, "source") if source is not None else 0
        rows = []
        color: Vector = (1.0,) * self._n_channels
        for point in points:
            color = color if point.color is None else point.color
            rows.append(self._row(point, color))
        self._rows += rows
        self._counts.append(len(rows))
        self._source.append(number)
        self._weights.append(weight)
        if len(self._rows) >= _PORTION_RECORDS:
            self._flush()

    def leave(self, position: Vector, direction: Vector, **rest: Any) -> Point:
        """The last point of a ray that leaves the scene from a position into a direction."""
        start = np.array(position, float) - self._center
        along = np.array(direction, float) / np.linalg.norm(direction)
        b, c = start @ along, start @ start - self._radius**2
        end = self._center + start + (math.sqrt(max(b * b - c, 0.0)) - b) * along
        return Point(position=end, normal=along, event=Event.LEFT_SCENE, **rest)

    # -- inside --------------------------------------------------------------------------------

    def _clear(self) -> None:
        self._rows: list[tuple[Any, ...]] = []
        self._counts: list[int] = []
        self._source: list[int] = []
        self._weights: list[float] = []

    def _number(self, names: Mapping[str, int], name: str, kind: str) -> int:
        if name not in names:
            raise InvalidPortion(
                f"no {kind} {name!r} was declared; there are {', '.join(names) or 'none'}"
            )
        return names[name]

    def _row(self, point: Point, color: Vector) -> tuple[Any, ...]:
        item = triangle = -1
        if point.object is not None:
            item = self._number(self._objects, point.object, "object")
            faces = self._faces[point.object]
            face = next(iter(faces)) if point.face is None else point.face
            triangle = self._number(faces, face, f"face of {point.object!r}")
        medium = 0 if point.medium is None else self._number(self._media, point.medium, "medium")
        normal = np.array(point.normal, float)
        size = float(np.linalg.norm(normal))
        return (
            tuple(point.position),
            tuple(normal / size if size > 0 else normal),
            item,
            triangle,
            int(point.event),
            medium,
            tuple(color),
        )

    def _flush(self) -> None:
        if not self._counts:
            return
        position, normal, item, triangle, event, medium, color = zip(*self._rows, strict=True)
        codes, table = _color_codes(np.array(color, float))
        weights = np.array(self._weights, np.float32)
        n = len(item)
        portion = Portion(
            emitted=np.bincount(self._source, minlength=len(self._sources)).astype(np.int64),
            source=np.array(self._source, np.int16),
            records_per_ray=np.array(self._counts, np.int32),
            position=np.array(position, np.float32),
            normal=np.rint(np.array(normal) * NORMAL_SCALE).astype(np.int16),
            object=np.array(item, np.int16),
            triangle=np.array(triangle, np.int32),
            event=np.array(event, np.int32),
            medium=np.array(medium, np.int16),
            color_code=codes,
            color_table=table,
            descriptor_count=np.zeros(n, np.uint16),
            descriptors=Descriptors.empty(),
            first_ray=self._first_ray,
            weight=None if (weights == 1).all() else weights,
        )
        self._writer.append(portion)
        self._first_ray += len(self._counts)
        self._clear()


def _channel_set(
    wavelengths_nm: Sequence[float] | None, indices: list[float], n_sources: int
) -> ChannelSet:
    nm = tuple(float(value) for value in wavelengths_nm or RGB_WAVELENGTHS_NM)
    n = len(nm)
    media: dict[str, Any] = {
        "refractive_index": tuple((index,) * n for index in indices),
        "absorption": tuple((0.0,) * n for _ in indices),
        "source_colors": tuple((1.0 / n,) * n for _ in range(n_sources)),
    }
    if wavelengths_nm is None:
        rgb = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        return ChannelSet(
            kind="rgb", wavelengths_nm=nm, luminous=RGB_LUMINANCE, display_rgb=rgb, **media
        )
    display = channel_display_rgb(np.array(nm), gamut=False)
    return ChannelSet(
        kind="spectral",
        wavelengths_nm=nm,
        luminous=tuple(luminous_efficacy(np.array(nm)).tolist()),
        display_rgb=tuple((float(r), float(g), float(b)) for r, g, b in display),
        **media,
    )


def _color_codes(color: Any) -> tuple[Any, Any]:
    """Codes of the records' colours and the table of the mixed ones."""
    n, channels = color.shape
    if (color < 0).any() or not (color.sum(axis=1) > 0).all() or not np.isfinite(color).all():
        raise InvalidPortion("colours are shares of light: not negative, and not zero everywhere")
    stored = np.floor(color / color.sum(axis=1, keepdims=True) * COLOR_SCALE).astype(np.int64)
    largest = stored.argmax(axis=1)
    stored[np.arange(n), largest] += COLOR_SCALE - stored.sum(axis=1)
    codes = largest.astype(np.int32)
    mixed = stored[np.arange(n), largest] < COLOR_SCALE
    table, numbers = np.unique(stored[mixed], axis=0, return_inverse=True)
    codes[mixed] = numbers.reshape(-1) + channels
    return codes, table.reshape(-1, channels).astype(np.uint16)

"""The directory of a ray map: every name and every shape that its indices speak about.

A ray map is self-describing. Queries and pictures need nothing but the file, so the directory holds
the names of sources, objects, faces, media, surfaces and detectors, the shapes that the encodings
lean on, and the units. Display meshes stand beside it as binary streams (`DisplayMesh`).

Frames and units: lengths in ``length_unit`` of the scene, right-handed coordinates, directions are
unit vectors, flux in ``flux_unit``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    ConfigDict,
    FailFast,
    Field,
    PlainSerializer,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    model_validator,
)

from raymap.model.cellparameters import check_cells, is_length
from raymap.model.entry import Component, Entry, Name, Parameters, PlainText, Vector
from raymap.model.limits import (
    MAX_CELLS_PER_SIDE,
    MAX_CHANNELS,
    MAX_FLUX,
    MAX_INDEX,
    MAX_WAVELENGTH_NM,
)
from raymap.model.sceneobjects import Face, ObjectColumns, Quadric, SceneObject, SceneObjects
from raymap.model.schema import NONE

__all__ = [
    "BoundingSphere",
    "InputFile",
    "ChannelSet",
    "Detector",
    "Directory",
    "DisplayMesh",
    "Face",
    "FaceTable",
    "Medium",
    "Quadric",
    "SceneObject",
    "Source",
    "Surface",
]


Numbers = Annotated[tuple[Component, ...], FailFast()]
_FAINTEST = 1e-20
"""Shares and efficacies that are not 0: what is divided by them is a number."""
Wavelengths = Annotated[
    tuple[Annotated[float, Field(gt=0.0, le=MAX_WAVELENGTH_NM)], ...], FailFast()
]


class Source(Entry):
    """A light source; ``flux`` in the flux unit of the map."""

    name: Name
    flux: Annotated[float, Field(ge=0, le=MAX_FLUX)] = 1.0
    kind: PlainText = ""
    parameters: Parameters = Field(default_factory=dict)


class Medium(Entry):
    """A medium by name; indices and absorption per channel stand in the channel sets."""

    name: Name
    kind: PlainText = ""
    parameters: Parameters = Field(default_factory=dict)


def _always_one(share: Any) -> bool:
    """Whether a share is given, and is 1 at every wavelength."""
    if isinstance(share, dict):
        share = share.get("rgb", share.get("value"))
    if isinstance(share, list | tuple):
        return bool(share) and all(value == 1 for value in share)
    return bool(share == 1)


class Surface(Entry):
    """Optical properties of faces; numeric ``parameters`` can be asked for in criteria."""

    name: Name
    kind: PlainText = ""
    parameters: Parameters = Field(default_factory=dict)

    @property
    def transmits(self) -> bool:
        """Whether some light may pass; False where all that is not absorbed turns back.

        The parameter ``transmits`` decides if there is one; else the kind does. A kind that is
        not known here may transmit.
        """
        if "transmits" in self.parameters:
            return bool(self.parameters["transmits"])
        if self.kind in ("absorber", "mirror", "rough_mirror", "retroreflector"):
            return False
        if self.kind in ("lambertian", "tabulated"):
            return bool({"transmittance", "transmitted"} & set(self.parameters))
        if self.kind == "dielectric":
            return not _always_one(self.parameters.get("reflectance"))
        return True


class Detector(Entry):
    """A grid of cells that counts flux.

    For ``kind == "plane"``: ``center`` of the rectangle, unit vectors ``axis_u`` and ``axis_v``,
    full ``size`` (width along u, height along v) in scene units; cell (0, 0) is at -u, -v; the
    detector looks along ``axis_u x axis_v``. For "far_field", "camera" and "surface" the axes and
    ``parameters`` define the mapping; ``size`` is in the units of ``parameters["size_unit"]``.
    """

    name: Name
    kind: Literal["plane", "far_field", "camera", "surface"] = "plane"
    cells: tuple[
        Annotated[int, Field(ge=1, le=MAX_CELLS_PER_SIDE)],
        Annotated[int, Field(ge=1, le=MAX_CELLS_PER_SIDE)],
    ]
    center: Vector = (0.0, 0.0, 0.0)
    axis_u: Vector = (1.0, 0.0, 0.0)
    axis_v: Vector = (0.0, 1.0, 0.0)
    size: tuple[float, float] = (1.0, 1.0)
    blocking: bool = False
    uv_meaning: Literal["crossing", "projection"] = "crossing"
    object: Annotated[int, Field(ge=NONE, le=MAX_INDEX)] = NONE
    """Index of the object of the same name, for blocking and surface detectors."""
    parameters: Parameters = Field(default_factory=dict)

    @model_validator(mode="after")
    def _check(self) -> Detector:
        if not all(map(is_length, self.size)):
            raise ValueError(f"its size is {self.size}, no two lengths")
        check_cells(self.cells, self.parameters)
        return self


class InputFile(Entry):
    """A file that the scene was made of; its content is not in the map."""

    name: PlainText
    bytes: Annotated[int, Field(ge=0)] = 0
    sha256: PlainText = ""


class BoundingSphere(Entry):
    """Rays that leave the scene end here."""

    center: Vector = (0.0, 0.0, 0.0)
    radius: Annotated[float, Field(gt=0)] = 1.0

    @model_validator(mode="after")
    def _check(self) -> BoundingSphere:
        if not np.isfinite(sum(value * value for value in (*self.center, self.radius))):
            raise ValueError("the bounding sphere has no equation: its squares are no numbers")
        return self


class ChannelSet(Entry):
    """The colour channels of a run of portions, and what media and sources are in them.

    Attributes
    ----------
    wavelengths_nm : one per channel [nm, vacuum]; for RGB the representative wavelengths
    luminous : luminous efficacy of each channel: 683 V(wavelength) [lm/W] in a spectral set, the
        Y coefficients of linear sRGB in an RGB set
    display_rgb : (n_channels, 3) linear sRGB of one unit of each channel, for pictures
    refractive_index : (n_media, n_channels)
    absorption : (n_media, n_channels) [1 / length_unit]
    source_colors : (n_sources, n_channels), rows sum to 1
    laws : what surfaces and media do to light (`raymap.laws.stored`)
    """

    kind: Literal["rgb", "spectral"]
    wavelengths_nm: Annotated[Wavelengths, Field(min_length=1, max_length=MAX_CHANNELS)]
    luminous: Numbers = ()
    display_rgb: Annotated[tuple[Vector, ...], FailFast()] = ()
    refractive_index: Annotated[tuple[Numbers, ...], FailFast()] = ()
    absorption: Annotated[tuple[Numbers, ...], FailFast()] = ()
    source_colors: Annotated[tuple[Numbers, ...], FailFast()] = ()
    laws: Parameters = {}

    @model_validator(mode="after")
    def _check(self) -> ChannelSet:
        n = self.n_channels
        if self.kind == "rgb" and n != 3:
            raise ValueError(f"RGB has three channels, not {n}")
        for name in ("refractive_index", "absorption", "source_colors"):
            if any(len(row) != n for row in getattr(self, name)):
                raise ValueError(f"{name} has rows of other lengths than the {n} channels")
        for name, rows in (("luminous", (self.luminous,)), ("source_colors", self.source_colors)):
            if any(value < 0.0 or 0.0 < value < _FAINTEST for row in rows for value in row):
                raise ValueError(f"{name} has numbers below 0, or between 0 and {_FAINTEST:g}")
        return self

    @property
    def n_channels(self) -> int:
        return len(self.wavelengths_nm)

    @property
    def said(self) -> str:
        """Its channels in words."""
        if self.kind == "rgb":
            return "R, G, B"
        shown = ", ".join(f"{nm:g}" for nm in self.wavelengths_nm[:8])
        return f"{shown}{', …' if self.n_channels > 8 else ''} nm"

    @property
    def labels(self) -> list[str]:
        """Names of the channels: R, G, B or the wavelengths."""
        if self.kind == "rgb":
            return ["R", "G", "B"]
        return [f"{wavelength:g} nm" for wavelength in self.wavelengths_nm]


@dataclass(frozen=True, kw_only=True, eq=False)
class DisplayMesh:
    """Triangles to draw one object with; need not be the primitives that rays meet.

    Attributes
    ----------
    vertices : (n, 3) float32 [scene units]
    triangles : (m, 3) int32 indices of vertices
    face : (m,) int32 index of the face within the object
    """

    vertices: NDArray[np.float32]
    triangles: NDArray[np.int32]
    face: NDArray[np.int32]


@dataclass(frozen=True, kw_only=True, eq=False)
class FaceTable:
    """All faces of a map as arrays, for compiled code; a *face index* is a row of it.

    Attributes
    ----------
    first_face : (n_objects + 1,) int32, faces of object o are rows first_face[o]:first_face[o + 1]
    object : (n_faces,) int16
    first_primitive, primitive_count : (n_faces,) int32
    surface : (n_faces,) int16
    object_names : by object
    face_names : of each face, within its object
    """

    first_face: NDArray[np.int32]
    object: NDArray[np.int16]
    first_primitive: NDArray[np.int32]
    primitive_count: NDArray[np.int32]
    surface: NDArray[np.int16]
    object_names: tuple[str, ...]
    face_names: tuple[str, ...]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Full names "object.face", in order."""
        owners = zip(self.object.tolist(), self.face_names, strict=True)
        return tuple(f"{self.object_names[owner]}.{name}" for owner, name in owners)

    def __len__(self) -> int:
        return len(self.primitive_count)


def _as_objects(given: Any, handler: ValidatorFunctionWrapHandler) -> SceneObjects:
    """Objects in whatever form as the one sequence that has columns."""
    if isinstance(given, Sequence) and len(given) > MAX_INDEX:
        raise ValueError(f"there are {len(given)} of them; at most {MAX_INDEX} can be numbered")
    return given if isinstance(given, SceneObjects) else SceneObjects(handler(given))


Objects = Annotated[
    Sequence[SceneObject],
    WrapValidator(_as_objects),
    PlainSerializer(tuple, return_type=tuple[SceneObject, ...]),
]


class Directory(Entry):
    """Names, shapes and units of one ray map."""

    model_config = ConfigDict(
        frozen=True, extra="allow", allow_inf_nan=False, ignored_types=(cached_property,)
    )

    length_unit: PlainText = "mm"
    flux_unit: Literal["W", "lm"] = "W"
    sources: Annotated[tuple[Source, ...], Field(max_length=MAX_INDEX), FailFast()]
    objects: Annotated[Objects, Field(validate_default=True)] = ()
    media: Annotated[tuple[Medium, ...], Field(max_length=MAX_INDEX), FailFast()] = ()
    surfaces: Annotated[tuple[Surface, ...], Field(max_length=MAX_INDEX), FailFast()] = ()
    detectors: Annotated[tuple[Detector, ...], Field(max_length=MAX_INDEX), FailFast()] = ()
    bounding_sphere: BoundingSphere = BoundingSphere()
    scene_hash: str = ""
    """Hash of geometry, media, surfaces, sources and detectors; maps of one scene share it."""
    scene_text: str = ""
    """The scene description as the user wrote it, for people."""
    inputs: Annotated[tuple[InputFile, ...], Field(max_length=MAX_INDEX), FailFast()] = ()
    """The files that the scene read, to tell whether they are still the same."""
    title: PlainText = ""
    parameters: Parameters = Field(default_factory=dict)

    @model_validator(mode="after")
    def _check(self) -> Directory:
        for kind in ("sources", "media", "surfaces", "detectors"):
            _refuse_twice(kind, [entry.name for entry in getattr(self, kind)])
        columns = self.object_columns
        _refuse_twice("objects", columns.names)
        if len(columns.surface) and int(columns.surface.max()) >= len(self.surfaces):
            row = int(columns.surface.argmax())
            raise ValueError(f"{self.faces.names[row]} names surface {columns.surface[row]}")
        for detector in self.detectors:
            if detector.object >= len(self.objects):
                raise ValueError(f"detector {detector.name!r} names object {detector.object}")
        return self

    def model_dump(self, **options: Any) -> dict[str, Any]:
        """As pydantic's; what is parsed late must not fail within it, which hides the error."""
        if "objects" not in (options.get("exclude") or ()):
            self.object_columns.parse_further()
        return super().model_dump(**options)

    def model_dump_json(self, **options: Any) -> str:
        """As `model_dump`."""
        self.object_columns.parse_further()
        return super().model_dump_json(**options)

    @property
    def object_columns(self) -> ObjectColumns:
        """The objects as columns."""
        return SceneObjects.of(self.objects).columns

    @cached_property
    def faces(self) -> FaceTable:
        """The faces of all objects, in order."""
        columns = self.object_columns
        owner = np.repeat(
            np.arange(len(columns.names), dtype=np.int16), np.diff(columns.first_face)
        )
        return FaceTable(
            first_face=columns.first_face,
            object=owner,
            first_primitive=columns.first_primitive,
            primitive_count=columns.primitive_count,
            surface=columns.surface,
            object_names=columns.names,
            face_names=columns.face_names,
        )


def _refuse_twice(kind: str, names: Sequence[str]) -> None:
    if len(set(names)) != len(names):
        twice = next(name for name, count in Counter(names).items() if count > 1)
        raise ValueError(f"two {kind} are called {twice!r}")

"""Read STEP files: solids in place, with the names and colours that the file gives them.

An assembly is walked down to its parts; every solid becomes one body, every CAD face a named face.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from raymap.model.errors import SceneError
from raymap.model.givenfile import check_given
from tracer.description.named_files import is_guarded
from tracer.importers.cad_formats.occt import occt
from tracer.importers.cad_formats.step_text import check_step_text
from tracer.importers.cad_solid import CadFace, CadSolid
from tracer.importers.prescription import ImportWarning

__all__ = ["clean_name", "explore", "read_step"]

LARGEST_BYTES = 2 * 2**30

_REFERENCES = (b"EXTERNAL_IDENTIFICATION_ASSIGNMENT", b"DOCUMENT_FILE", b"EXTERNALLY_DEFINED_ITEM")
"""Entities of STEP through which a file refers to others (AP 203, 214 and 242)."""

_WIDEST_GAP = 1e-2
"""Share of a solid's size by which the edges of a face may miss each other."""

_MADE_UP = re.compile(r"=>\[|NAUO\d*$|^\s*$|Open CASCADE|^\d+$|^NONE$", re.IGNORECASE)
"""Names that programs put where the user gave none."""

_OF_SHAPES = re.compile(r"^(COMPOUND|COMPSOLID|SOLID|SHELL|FACE|WIRE|EDGE|VERTEX)$")
"""Names that OpenCASCADE gives to shapes for which the file has no product."""


def read_step(path: str | Path) -> tuple[CadSolid, ...]:
    """The solids of a STEP file in millimetres, whatever its unit; names are unique.

    Raises
    ------
    SceneError
        where the file is missing, is no STEP file, holds no solid, or has a broken one
    MissingExtra
        without OpenCASCADE
    """
    path = Path(path)
    check_given(path, "CAD file", SceneError)
    status = path.stat()
    if status.st_size > LARGEST_BYTES:
        raise SceneError(f"{path.name}: is too large to read ({status.st_size:,} bytes)")
    if is_guarded():
        _refuse_references(path.name, path.read_bytes())
    return _read(str(path.resolve()), status.st_mtime_ns, status.st_size)


def _refuse_references(origin: str, content: bytes) -> None:
    """Refuse a file that names others, which OpenCASCADE opens by itself, wherever they lie."""
    content = content.upper()
    if any(word in content for word in _REFERENCES):
        raise SceneError(
            f"{origin}: names other files, which are not followed here; export one STEP file "
            "that holds all parts"
        )


@lru_cache(maxsize=16)
def _read(path: str, modified: int, size: int) -> tuple[CadSolid, ...]:
    check_step_text(Path(path).name, Path(path).read_bytes())
    return _StepFile(Path(path)).solids()


class _StepFile:
    def __init__(self, path: Path) -> None:
        self.origin = path.name
        self.loose = 0
        self.products: set[str] | None = None
        caf, application = occt("STEPCAFControl"), occt("XCAFApp").XCAFApp_Application
        format_name = occt("TCollection").TCollection_ExtendedString("BinXCAF")
        self.document = occt("TDocStd").TDocStd_Document(format_name)
        application.GetApplication_s().InitDocument(self.document)
        self.reader = caf.STEPCAFControl_Reader()
        self.reader.SetNameMode(True)
        self.reader.SetColorMode(True)
        done = self.reader.ReadFile(str(path)) == occt("IFSelect").IFSelect_RetDone
        if not done or not self.reader.Transfer(self.document):
            raise SceneError(f"{self.origin}: cannot be read as a STEP file; export it again")
        tool = occt("XCAFDoc").XCAFDoc_DocumentTool
        self.shapes = tool.ShapeTool_s(self.document.Main())
        self.colors = tool.ColorTool_s(self.document.Main())
        self.transfer = self.reader.Reader().WS().TransferReader()

    def solids(self) -> tuple[CadSolid, ...]:
        """All solids, names made unique."""
        found: list[CadSolid] = []
        for number, (name, color, shape) in enumerate(self._parts(), start=1):
            found.append(self._solid(name or f"solid_{number}", color, shape))
        if not found:
            raise SceneError(
                f"{self.origin}: holds no solid ({self._contents()}); light needs an inside and an "
                "outside: join the surfaces to solids in the CAD program"
            )
        if self.loose > 0:
            warnings.warn(
                f"{self.origin}: {self.loose} faces belong to no solid and are left out; join them "
                "to solids in the CAD program if light shall meet them",
                ImportWarning,
                stacklevel=2,
            )
        return tuple(_unique(found))

    def _contents(self) -> str:
        counts = []
        for word, kind in (("faces", "TopAbs_FACE"), ("edges", "TopAbs_EDGE")):
            count = sum(1 for label in self._roots() for _ in explore(self._shape(label), kind))
            counts.append(f"{count} {word}")
        return ", ".join(counts)

    # -- the tree --------------------------------------------------------------------------------

    def _roots(self) -> list[Any]:
        tool = occt("XCAFDoc").XCAFDoc_ShapeTool
        return [
            label
            for label in _children(self.shapes.BaseLabel())
            if tool.IsShape_s(label) and tool.IsFree_s(label)
        ]

    def _shape(self, label: Any) -> Any:
        return occt("XCAFDoc").XCAFDoc_ShapeTool.GetShape_s(label)

    def _parts(self) -> Iterator[tuple[str, str, Any]]:
        """Name, colour and located shape of every solid."""
        location = occt("TopLoc").TopLoc_Location()
        for label in self._roots():
            yield from self._walk(label, location, "", "", "")

    def _walk(
        self, label: Any, place: Any, name: str, color: str, above: str
    ) -> Iterator[tuple[str, str, Any]]:
        """Solids below a label; ``above`` is the name of the assembly that it is part of."""
        tool = occt("XCAFDoc").XCAFDoc_ShapeTool
        name = name or self._name(label)
        color = color or self._label_color(label)
        if tool.IsReference_s(label):
            place = place.Multiplied(tool.GetLocation_s(label))
            referred = occt("TDF").TDF_Label()
            tool.GetReferredShape_s(label, referred)
            yield from self._walk(referred, place, name, color, above)
        elif tool.IsAssembly_s(label):
            for child in _children(label):
                if tool.IsComponent_s(child):
                    yield from self._walk(child, place, "", color, name or above)
        else:
            if not name and _OF_SHAPES.match(self._label_text(label)):
                # A part with curves or points beside its solid: OpenCASCADE makes an assembly of it
                name = above
            shape = self._shape(label)
            solids = list(explore(shape, "TopAbs_SOLID"))
            in_solids = sum(1 for solid in solids for _ in explore(solid, "TopAbs_FACE"))
            self.loose += sum(1 for _ in explore(shape, "TopAbs_FACE")) - in_solids
            for solid in solids:
                own = self._entity_name(solid) if len(solids) > 1 else ""
                yield own or name, self._shape_color(solid) or color, solid.Moved(place)

    def _name(self, label: Any) -> str:
        """The name that a label carries, "" where it is none of the user's.

        A part may be called by a number, or SOLID: then the file has a product of this name.
        """
        name = self._label_text(label)
        part = not occt("XCAFDoc").XCAFDoc_ShapeTool.IsReference_s(label)
        if name.isdigit() or _OF_SHAPES.match(name):
            return name if part and name in self._products() else ""
        return "" if _MADE_UP.search(name) else name

    def _label_text(self, label: Any) -> str:
        iterator = occt("TDF").TDF_AttributeIterator(label, True)
        while iterator.More():
            attribute = iterator.Value()
            if type(attribute).__name__ == "TDataStd_Name":
                return str(attribute.Get().ToExtString()).strip()
            iterator.Next()
        return ""

    def _products(self) -> set[str]:
        """Names of the products in the file."""
        if self.products is None:
            model = self.reader.Reader().WS().Model()
            entities = (model.Value(k) for k in range(1, model.NbEntities() + 1))
            self.products = {
                str(entity.Name().ToCString()).strip()
                for entity in entities
                if type(entity).__name__ == "StepBasic_Product" and entity.Name() is not None
            }
        return self.products

    def _entity_name(self, shape: Any) -> str:
        """The name in the record of the file that a shape was made of."""
        bare = shape.Located(occt("TopLoc").TopLoc_Location())
        for candidate in (shape, bare):
            entity = self.transfer.EntityFromShapeResult(candidate, 1)
            if entity is not None and hasattr(entity, "Name") and entity.Name() is not None:
                name = str(entity.Name().ToCString())
                return "" if _MADE_UP.search(name) else name
        return ""

    # -- colours ---------------------------------------------------------------------------------

    def _label_color(self, label: Any) -> str:
        return self._color(lambda kind, color: self.colors.GetColor_s(label, kind, color))

    def _shape_color(self, shape: Any) -> str:
        bare = shape.Located(occt("TopLoc").TopLoc_Location())
        return self._color(lambda kind, color: self.colors.GetColor(bare, kind, color))

    def _color(self, get: Any) -> str:
        kinds, quantity = occt("XCAFDoc").XCAFDoc_ColorType, occt("Quantity")
        for kind in (kinds.XCAFDoc_ColorSurf, kinds.XCAFDoc_ColorGen):
            color = quantity.Quantity_Color()
            if get(kind, color):
                values = color.Values(quantity.Quantity_TypeOfColor.Quantity_TOC_sRGB)
                return "#" + "".join(f"{round(255 * value):02x}" for value in values)
        return ""

    # -- solids and faces ------------------------------------------------------------------------

    def _solid(self, name: str, color: str, shape: Any) -> CadSolid:
        faces = list(explore(shape, "TopAbs_FACE"))
        names = _face_names([self._entity_name(face) for face in faces])
        self._check(name, shape, faces, names)
        properties = occt("GProp").GProp_GProps()
        occt("BRepGProp").BRepGProp.VolumeProperties_s(shape, properties)
        volume = float(properties.Mass())
        if volume < 0.0:
            shape = shape.Complemented()
            faces = list(explore(shape, "TopAbs_FACE"))
        return CadSolid(
            origin=self.origin,
            name=name,
            shape=shape,
            volume=abs(volume),
            size=_size(shape),
            color=color,
            faces=tuple(
                CadFace(
                    name=face_name,
                    shape=face,
                    kind=_kind(face),
                    area=_area(face),
                    color=self._shape_color(face),
                )
                for face_name, face in zip(names, faces, strict=True)
            ),
        )

    def _check(self, name: str, shape: Any, faces: list[Any], names: list[str]) -> None:
        """Refuse a solid that OpenCASCADE finds broken, naming the face."""
        analyzer = occt("BRepCheck").BRepCheck_Analyzer
        if not faces:
            raise SceneError(f"{self.origin}: {name!r} is a solid without faces; export it again")
        size = _size(shape)
        for face_name, face in zip(names, faces, strict=True):
            gap = max(
                (occt("BRep").BRep_Tool.Tolerance_s(v) for v in explore(face, "TopAbs_VERTEX")),
                default=0.0,
            )
            if gap > _WIDEST_GAP * size:
                raise SceneError(
                    f"{self.origin}: {name!r}: its face {face_name!r} is broken (its edges miss "
                    f"each other by {gap:.3g} mm); repair the part in the CAD program and export "
                    "it again"
                )
        if analyzer(shape).IsValid():
            return
        for face_name, face in zip(names, faces, strict=True):
            if not analyzer(face).IsValid():
                raise SceneError(
                    f"{self.origin}: {name!r}: its face {face_name!r} is broken (its edges do not "
                    "bound it); repair the part in the CAD program and export it again"
                )
        raise SceneError(
            f"{self.origin}: {name!r}: its faces do not close to a solid; repair the part in the "
            "CAD program and export it again"
        )


def explore(shape: Any, kind: str) -> Iterator[Any]:
    """Sub-shapes of a kind, each once, in the order of the file."""
    explorer = occt("TopExp").TopExp_Explorer(shape, getattr(occt("TopAbs").TopAbs_ShapeEnum, kind))
    as_kind = getattr(occt("TopoDS").TopoDS, f"{kind.removeprefix('TopAbs_').capitalize()}")
    seen: list[Any] = []
    hashes: dict[int, list[Any]] = {}
    while explorer.More():
        current = explorer.Current()
        same = hashes.setdefault(hash(current), [])
        if not any(current.IsSame(other) for other in same):
            same.append(current)
            seen.append(as_kind(current))
        explorer.Next()
    yield from seen


def _children(label: Any) -> list[Any]:
    iterator = occt("TDF").TDF_ChildIterator(label, False)
    tags = []
    while iterator.More():
        tags.append(iterator.Value().Tag())
        iterator.Next()
    return [label.FindChild(tag, False) for tag in tags]


def _kind(face: Any) -> str:
    """plane, cylinder, cone, sphere, torus, bspline …"""
    surface = occt("BRepAdaptor").BRepAdaptor_Surface(face)
    name: str = surface.GetType().name
    return name.removeprefix("GeomAbs_").lower().removesuffix("surface")


def _size(shape: Any) -> float:
    box = occt("Bnd").Bnd_Box()
    occt("BRepBndLib").BRepBndLib.Add_s(shape, box)
    return math.sqrt(float(box.SquareExtent()))


def _area(face: Any) -> float:
    properties = occt("GProp").GProp_GProps()
    occt("BRepGProp").BRepGProp.SurfaceProperties_s(face, properties)
    return abs(float(properties.Mass()))


def clean_name(name: str) -> str:
    """A name that criteria can speak of."""
    return re.sub(r"[*?\\\"'()\s.]+", "_", name).strip("_") or "part"


def _face_names(given: list[str]) -> list[str]:
    """Names of the faces of a solid: the file's where it has them, else by number."""
    names: list[str] = []
    for number, name in enumerate(given, start=1):
        wanted = clean_name(name) if name else f"face_{number}"
        unique, copy = wanted, 2
        while unique in names:
            unique, copy = f"{wanted}_{copy}", copy + 1
        names.append(unique)
    return names


def _unique(solids: list[CadSolid]) -> Iterator[CadSolid]:
    """The solids with names that differ: several copies of a part are numbered."""
    names = [clean_name(solid.name) for solid in solids]
    taken: set[str] = set()
    for solid, name in zip(solids, names, strict=True):
        unique, copy = name, 1
        if names.count(name) > 1:
            unique = f"{name}_1"
        while unique in taken:
            copy += 1
            unique = f"{name}_{copy}"
        taken.add(unique)
        yield replace(solid, name=unique)

"""STEP files for the tests, written by OpenCASCADE itself."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from OCP.BRep import BRep_Builder
from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
from OCP.gp import gp_Trsf, gp_Vec
from OCP.Interface import Interface_Static
from OCP.Quantity import Quantity_Color, Quantity_TypeOfColor
from OCP.STEPCAFControl import STEPCAFControl_Writer
from OCP.STEPControl import STEPControl_StepModelType
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDataStd import TDataStd_Name
from OCP.TDocStd import TDocStd_Document
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS_Compound
from OCP.XCAFApp import XCAFApp_Application
from OCP.XCAFDoc import XCAFDoc_ColorType, XCAFDoc_DocumentTool

from tracer.importers.cad_formats.occt import occt

occt("gp")  # silences the library


@dataclass
class Part:
    """A shape with its name, where copies of it stand, its colour and that of its first face."""

    name: str
    shape: Any
    places: Sequence[tuple[float, float, float]] = ((0.0, 0.0, 0.0),)
    color: tuple[float, float, float] | None = None
    first_face_color: tuple[float, float, float] | None = None


def write_step(
    path: Path, parts: Sequence[Part], *, unit: str = "MM", face_names: Sequence[str] = ()
) -> Path:
    """An assembly of parts; names of faces are written in the order of the file."""
    document = TDocStd_Document(TCollection_ExtendedString("BinXCAF"))
    XCAFApp_Application.GetApplication_s().InitDocument(document)
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    colors = XCAFDoc_DocumentTool.ColorTool_s(document.Main())
    assembly = shapes.NewShape()
    TDataStd_Name.Set_s(assembly, TCollection_ExtendedString("assembly"))
    for part in parts:
        label = shapes.AddShape(part.shape, False)
        TDataStd_Name.Set_s(label, TCollection_ExtendedString(part.name))
        if part.color:
            colors.SetColor(label, _color(part.color), XCAFDoc_ColorType.XCAFDoc_ColorGen)
        if part.first_face_color:
            face = TopExp_Explorer(part.shape, TopAbs_ShapeEnum.TopAbs_FACE).Current()
            sub = shapes.AddSubShape(label, face)
            kind = XCAFDoc_ColorType.XCAFDoc_ColorSurf
            colors.SetColor(sub, _color(part.first_face_color), kind)
        for place in part.places:
            move = gp_Trsf()
            move.SetTranslation(gp_Vec(*place))
            shapes.AddComponent(assembly, label, TopLoc_Location(move))
    shapes.UpdateAssemblies()
    writer = STEPCAFControl_Writer()
    Interface_Static.SetCVal_s("write.step.unit", unit)
    writer.SetNameMode(True)
    writer.SetColorMode(True)
    writer.Transfer(document, STEPControl_StepModelType.STEPControl_AsIs)
    writer.Write(str(path))
    Interface_Static.SetCVal_s("write.step.unit", "MM")
    if face_names:
        names = iter(face_names)
        text = re.sub(
            r"ADVANCED_FACE\(''",
            lambda match: f"ADVANCED_FACE('{next(names, '')}'",
            path.read_text(encoding="utf-8"),
        )
        path.write_text(text, encoding="utf-8")
    return path


def _color(rgb: tuple[float, float, float]) -> Quantity_Color:
    return Quantity_Color(*rgb, Quantity_TypeOfColor.Quantity_TOC_sRGB)


def faces_only() -> Any:
    """The faces of a box, joined to nothing."""
    compound, builder = TopoDS_Compound(), BRep_Builder()
    builder.MakeCompound(compound)
    explorer = TopExp_Explorer(
        BRepPrimAPI_MakeBox(1.0, 1.0, 1.0).Shape(), TopAbs_ShapeEnum.TopAbs_FACE
    )
    while explorer.More():
        builder.Add(compound, explorer.Current())
        explorer.Next()
    return compound

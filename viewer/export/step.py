"""Rays as curves in a STEP file, with the edges of the scene, through OpenCASCADE.

The file is AP214 in millimetres: one assembly, in which each group of rays, each body and each
detector is a part with its name. A ray is one curve (a B-spline of degree 1 through its points), so
that a CAD program picks it as a whole. Rays keep their colours.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import MissingExtra, RayMapError
from raymap.model.units import length_scale
from viewer.export.content import Content
from viewer.export.format import ExportFormat

__all__ = ["STEP", "write_step"]

_SHORTEST_MM = 1e-6


def write_step(content: Content, path: Path) -> None:
    """Write a STEP file.

    Raises
    ------
    MissingExtra
        The OpenCASCADE binding is not installed.
    RayMapError
        It could not write the file, or the map's unit of length is not known.
    """
    try:
        from OCP import IFSelect, Interface, STEPCAFControl, TCollection, TDocStd, XCAFDoc
    except ImportError:
        raise MissingExtra(
            "STEP files need OpenCASCADE, which is not installed: pip install 'raymap[cad]'"
        ) from None
    scale = length_scale(content.length_unit, "mm")
    document = TDocStd.TDocStd_Document(TCollection.TCollection_ExtendedString("XmlOcaf"))
    parts = _Parts(XCAFDoc, document, content.title)
    for body in content.bodies:
        color = tuple(int(value) for value in np.rint(body.color * 255))
        edges = [edge.astype(np.float64) * scale for edge in body.edges]
        parts.add(body.name, [(edge, color) for edge in edges])
    for name, corners in content.frames:
        closed = np.concatenate([corners, corners[:1]]) * scale
        parts.add(f"detector {name}", [(closed, (0, 140, 60))])
    for number, name in enumerate(content.groups):
        lines = [(points * scale, rgb) for points, rgb in content.polylines(number)]
        parts.add(name, lines, colored=True)
    parts.shapes.UpdateAssemblies()
    Interface.Interface_Static.SetCVal_s("write.step.unit", "MM")
    writer = STEPCAFControl.STEPCAFControl_Writer()
    writer.SetNameMode(True)
    writer.SetColorMode(True)
    with _silence():
        done = writer.Transfer(document)
        state = writer.Write(str(path)) if done else None
    if state != IFSelect.IFSelect_ReturnStatus.IFSelect_RetDone:
        raise RayMapError(f"OpenCASCADE could not write {path.name}")


@contextmanager
def _silence() -> Iterator[None]:
    """Keep OpenCASCADE from printing what it does on stdout, where results belong."""
    from OCP import Message

    printers = list(Message.Message.DefaultMessenger_s().Printers())
    levels = [printer.GetTraceLevel() for printer in printers]
    for printer in printers:
        printer.SetTraceLevel(Message.Message_Gravity.Message_Fail)
    try:
        yield
    finally:
        for printer, level in zip(printers, levels, strict=True):
            printer.SetTraceLevel(level)


class _Parts:
    """Named compounds of curves in an assembly."""

    def __init__(self, xcaf: Any, document: Any, title: str) -> None:
        tool = xcaf.XCAFDoc_DocumentTool
        tool.SetLengthUnit_s(document, 0.001)
        self.shapes = tool.ShapeTool_s(document.Main())
        self.colors = tool.ColorTool_s(document.Main())
        self.curve = xcaf.XCAFDoc_ColorType.XCAFDoc_ColorCurv
        self.root = self.shapes.NewShape()
        _name(self.root, title)

    def add(
        self,
        name: str,
        lines: list[tuple[NDArray[np.float64], Any]],
        *,
        colored: bool = False,
    ) -> None:
        """A part of polylines (corners in mm, sRGB); each in its colour, or all in the first's."""
        from OCP import BRep, TopLoc, TopoDS

        curves = [(curve, rgb) for points, rgb in lines if (curve := _curve(points)) is not None]
        if not curves:
            return
        builder, compound = BRep.BRep_Builder(), TopoDS.TopoDS_Compound()
        builder.MakeCompound(compound)
        for curve, _ in curves:
            builder.Add(compound, curve)
        label = self.shapes.AddShape(compound, False)
        _name(label, name)
        _name(self.shapes.AddComponent(self.root, label, TopLoc.TopLoc_Location()), name)
        self.colors.SetColor(label, _color(curves[0][1]), self.curve)
        if colored:
            for curve, rgb in curves:
                part = self.shapes.AddSubShape(label, curve)
                self.colors.SetColor(part, _color(rgb), self.curve)


def _name(label: Any, name: str) -> None:
    from OCP import TCollection, TDataStd

    TDataStd.TDataStd_Name.Set_s(label, TCollection.TCollection_ExtendedString(name, True))


def _curve(points: NDArray[np.float64]) -> Any:
    """An edge along the corners; None if it has no length."""
    from OCP import BRepBuilderAPI, Geom, collections, gp

    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    points = points[np.concatenate(([True], steps > _SHORTEST_MM))]
    n = len(points)
    if n < 2:
        return None
    corners = [gp.gp_Pnt(x, y, z) for x, y, z in points.tolist()]
    if n == 2:
        return BRepBuilderAPI.BRepBuilderAPI_MakeEdge(*corners).Edge()
    # Knots at the length along the ray
    length = np.concatenate(([0.0], np.cumsum(steps[steps > _SHORTEST_MM])))
    poles, knots = collections.Array1_gp_Pnt(1, n), collections.Array1_double(1, n)
    times = collections.Array1_int(1, n)
    for k, (corner, index) in enumerate(zip(corners, length.tolist(), strict=True), 1):
        poles.SetValue(k, corner)
        knots.SetValue(k, index)
        times.SetValue(k, 2 if k in (1, n) else 1)
    curve = Geom.Geom_BSplineCurve(poles, knots, times, 1)
    return BRepBuilderAPI.BRepBuilderAPI_MakeEdge(curve).Edge()


def _color(rgb: Any) -> Any:
    from OCP import Quantity

    red, green, blue = (value / 255.0 for value in rgb)
    return Quantity.Quantity_Color(
        red, green, blue, Quantity.Quantity_TypeOfColor.Quantity_TOC_sRGB
    )


STEP = ExportFormat(
    suffixes=(".step", ".stp"),
    title="curves and edges of STEP, a part for each, in millimetres",
    place=4.0,
    write=write_step,
)

KINDS = (STEP,)

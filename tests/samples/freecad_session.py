"""Runs inside FreeCAD's command line: draws a lens, runs the macro, says what came of it as JSON.

The macro is named by RAYMAP_MACRO, the answer goes to the file RAYMAP_ANSWER.
"""

import json
import os
import traceback

import FreeCAD
import Part

V = FreeCAD.Vector


def plane(document, name, center, size, toward, role, text):
    """A rectangle of FreeCAD around ``center`` that faces along ±z."""
    item = document.addObject("Part::Plane", name)
    item.Length = item.Width = size
    turn = FreeCAD.Rotation() if toward > 0 else FreeCAD.Rotation(V(1, 0, 0), 180)
    item.Placement = FreeCAD.Placement(V(*center) - turn.multVec(V(size / 2, size / 2, 0)), turn)
    item.addProperty("App::PropertyString", role, "Raymap")
    setattr(item, role, text)
    return item


def run():
    space = {"__name__": "macro"}
    with open(os.environ["RAYMAP_MACRO"], encoding="utf-8") as file:
        exec(compile(file.read(), "Raymap.FCMacro", "exec"), space)
    document = FreeCAD.newDocument("Bench")
    # A biconvex lens of radius 30 mm, 6 mm thick, as a CAD user makes it
    lens = document.addObject("Part::Feature", "Lens")
    lens.Shape = Part.makeSphere(30, V(0, 0, 27)).common(Part.makeSphere(30, V(0, 0, -27)))
    lens.addProperty("App::PropertyString", "RaymapBody", "Raymap")
    lens.RaymapBody = 'medium = "glass"'
    # And a stop, of which nothing is said: black
    stop = document.addObject("Part::Feature", "Stop_1")
    stop.Shape = Part.makeBox(40, 40, 1, V(-20, -20, -10)).cut(
        Part.makeCylinder(5, 3, V(0, 0, -11))
    )
    plane(document, "Lamp", (0, 0, -30), 14, 1, "RaymapSource", 'kind = "collimated"')
    plane(document, "Screen", (0, 0, 29), 4, -1, "RaymapDetector",
          "cells = [20, 20]\nblocking = true")  # fmt: skip
    document.recompute()
    items = [item for item in document.Objects if space["role_of"](item)]
    said = []
    group, found, table = space["raymap_trace"](
        document, items, os.environ["RAYMAP_CRITERION"], rays=4_000, say=said.append
    )
    shapes = [child.Shape for child in group.Group]
    ends = [edge.Vertexes[-1].Point for shape in shapes for edge in shape.Edges]
    lens_box, drawn_box = lens.Shape.BoundBox, Part.makeCompound(shapes).BoundBox
    return {
        "version": FreeCAD.Version()[:2],
        "roles": {item.Label: space["role_of"](item) for item in items},
        "lens_faces": len(lens.Shape.Faces),
        "matched": found.matched,
        "wires": sum(len(shape.Wires) for shape in shapes),
        "highest": max(end.z for end in ends),
        "lens_inside": drawn_box.isInside(lens_box.Center),
        "paths": [row["path"] for row in table],
        "said": said,
    }


try:
    answer = run()
except BaseException:
    answer = {"error": traceback.format_exc()}
with open(os.environ["RAYMAP_ANSWER"], "w", encoding="utf-8") as out:
    json.dump(answer, out)
os._exit(0)

"""Files of other programs."""

from __future__ import annotations

import math
import struct
import tempfile
import warnings
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import raymap
import tracer
from raymap import rayfiles
from raymap.rayfiles import RaySet
from tests.validation import Row, check
from tracer.light import Opening
from tracer.photometry import eulumdat, lm63


@check(
    what="Flux of 1,000 cos V cos H cd in LM-63 type B, steps of 5°",
    source="A cosine lamp about V = 0, H = 0: π · 1,000 lm",
)
def type_b() -> Row:
    angles = np.arange(-90.0, 91.0, 5.0)
    candela = 1000.0 * np.outer(np.cos(np.radians(angles)), np.cos(np.radians(angles)))
    said = " ".join(f"{angle:g}" for angle in angles)
    lines = [" ".join(f"{abs(value):.4f}" for value in row) for row in candela]
    head = f"IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 {len(angles)} {len(angles)} 2 2 0 0 0\n1 1 1\n"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "b.ies"
        path.write_text(head + "\n".join([said, said, *lines]) + "\n")
        found = lm63.read(path)
    # Linear between steps of 5°: a chord of the cosine misses up to (5°)²/8
    return Row(expected=1000.0 * math.pi, got=float(found.flux), tolerance=6.0, unit="lm")


@check(
    what="Ray files of 1,000 rays of 1 each whose header states 1: flux",
    source="LightTools writes relative powers: the header is the flux; the rays where asked for",
)
def header_rule() -> list[Row]:
    rays = RaySet(
        position=np.zeros((1000, 3), np.float32),
        direction=np.tile(np.array([0.0, 0.0, 1.0], np.float32), (1000, 1)),
        flux=np.ones(1000, np.float32),
        length_unit="mm",
        flux_unit="W",
    )
    rows = []
    for suffix, at, of in ((".tm25ray", 16, "TM-25"), (".sdf", 112, "Zemax")):
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            path = rayfiles.write(rays, Path(folder) / f"rays{suffix}")
            raw = bytearray(path.read_bytes())
            # Total radiant flux of the header
            struct.pack_into("<f", raw, at, 1.0)
            path.write_bytes(raw)
            header = rayfiles.read(path).total_flux
            summed = rayfiles.read(path, flux_from="rays").total_flux
        rows += [
            Row(expected=1.0, got=header, tolerance=1e-6, unit="W", of=of),
            Row(expected=1000.0, got=summed, tolerance=1e-3, unit="W", of=f"{of}, from its rays"),
        ]
    return rows


@check(
    what="Luminous opening of LM-63-2002 seen from gamma 0",
    source="LM-63-2002, table of negative sizes: sides of the tube's outline; π a b of the ellipse",
)
def openings() -> list[Row]:
    rows = []
    for of, sizes, area in (
        ("tube, −0.03 × 1.2 × −0.03 m", "-0.03 1.2 -0.03", 0.03 * 1.2),
        ("ellipse, −0.3 × −1.2 × 0 m", "-0.3 -1.2 0", math.pi * 0.15 * 0.6),
    ):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "lamp.ies"
            path.write_text(
                f"IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 2 1 1 2 {sizes}\n1 1 1\n0 90\n0\n1000 0\n"
            )
            opening = lm63.read(path).opening
        assert isinstance(opening, Opening)
        along, across, _ = opening.size
        got = along * across * (math.pi / 4.0 if opening.shape == "ellipse" else 1.0)
        rows.append(Row(expected=area, got=got, tolerance=1e-9, unit="m²", of=of))
    return rows


_MIRROR = {"focus": 25.0, "inner": 5.0, "outer": 50.0, "reflectance": 0.88}
"""A parabolic mirror [mm] with a lamp of 2 × 1 mm and 1,000 lm in its focus."""


def _exact_illuminance(half: float, distance: float) -> float:
    """Mean illuminance [lx] of a square about the axis, by quadrature over the exact paraboloid.

    Each place of the mirror sends the lamp's radiance where the mirrored line of sight meets it.
    """
    f, low, high = _MIRROR["focus"], _MIRROR["inner"], _MIRROR["outer"]
    n = 1000
    middle = (np.arange(n) + 0.5) / n
    r, turn = np.meshgrid(np.sqrt(low**2 + (high**2 - low**2) * middle), 2 * math.pi * middle)
    x, y, z = r * np.cos(turn), r * np.sin(turn), r**2 / (4.0 * f)
    normal = np.array([-x / (2.0 * f), -y / (2.0 * f), np.ones_like(x)])
    area = math.pi * (high**2 - low**2) / n**2
    radiance = _MIRROR["reflectance"] * 1000.0 / (math.pi * 2.0)
    found, places = 0.0, half * (np.arange(4) + 0.5) / 4.0
    for px in places:
        for py in places:
            way = np.array([x - px, y - py, z - distance])
            length = np.sqrt((way**2).sum(axis=0))
            way /= length
            onto = (way * normal).sum(axis=0)
            back = way - 2.0 * onto / (normal**2).sum(axis=0) * normal
            t = (f - z) / back[2]
            lit = (np.abs(x + t * back[0]) <= 1.0) & (np.abs(y + t * back[1]) <= 0.5)
            found += float((lit * way[2] * onto / length**2).sum())
    return 1e6 * radiance * area * found / len(places) ** 2


def _mirror_file(path: Path) -> None:
    """The mirror as a turned solid; its reflecting face is called so."""
    from OCP.BRepBuilderAPI import (
        BRepBuilderAPI_MakeEdge,
        BRepBuilderAPI_MakeFace,
        BRepBuilderAPI_MakeWire,
    )
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeRevol
    from OCP.gp import gp_Ax1, gp_Ax2, gp_Dir, gp_Parab, gp_Pnt

    from tests.tracer.importers.step_files import Part, write_step

    f, low, high = _MIRROR["focus"], _MIRROR["inner"], _MIRROR["outer"]
    curve = gp_Parab(gp_Ax2(gp_Pnt(0, 0, 0), gp_Dir(0, 1, 0), gp_Dir(0, 0, 1)), f)
    wire = BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(curve, low, high).Edge())
    corners = [
        (high, high**2 / (4 * f)), (high + 2.0, high**2 / (4 * f)), (high + 2.0, -2.0),
        (low, -2.0), (low, low**2 / (4 * f)),
    ]  # fmt: skip
    for (x0, z0), (x1, z1) in pairwise(corners):
        wire.Add(BRepBuilderAPI_MakeEdge(gp_Pnt(x0, 0, z0), gp_Pnt(x1, 0, z1)).Edge())
    face = BRepBuilderAPI_MakeFace(wire.Wire()).Face()
    turned = BRepPrimAPI_MakeRevol(face, gp_Ax1(gp_Pnt(0, 0, 0), gp_Dir(0, 0, 1))).Shape()
    write_step(path, [Part("reflector", turned)], face_names=["mirror"])


@check(
    what="Parabolic mirror of a STEP file, f = 25 mm, lamp of 2 × 1 mm: 0.2 m × 0.2 m at 25 m",
    source="Quadrature of the lamp's radiance over the exact paraboloid",
    packages=("cadquery-ocp-novtk",),
)
def step_mirror() -> list[Row]:
    distance, half = 25_000.0, 100.0
    expected = _exact_illuminance(half, distance)
    rows = []
    for chord, of in (("", "chord by default"), ("chord = 0.005", "chord of 5 µm")):
        text = f"""
length_unit = "mm"
flux_unit = "lm"
[surfaces.alu]
kind = "mirror"
reflectance = {_MIRROR["reflectance"]}
[surfaces.black]
kind = "absorber"
[cad_files.r]
file = "mirror.step"
surface = "black"
{chord}
[cad_files.r.bodies."*"]
faces = {{ mirror = "alu" }}
[sources.led]
kind = "lambertian"
position = [0, 0, {_MIRROR["focus"]}]
axis = [0, 0, -1]
size = [2, 1]
flux = 1000
[detectors.screen]
position = [0, 0, {distance}]
looks = [0, 0, -1]
up = [0, 1, 0]
size = [{2 * half}, {2 * half}]
cells = [1, 1]
"""
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            _mirror_file(Path(folder) / "mirror.step")
            (Path(folder) / "scene.toml").write_text(text)
            scene = tracer.load_scene(Path(folder) / "scene.toml")
            found = tracer.record(scene, rays=400_000, no_rays=True).fluxes["detectors"]["screen"]
        lux = 1e6 / (2.0 * half) ** 2
        error = lux * float(found["flux_se"])
        rows.append(
            Row(
                expected=expected,
                got=lux * float(found["flux"]),
                got_error=error,
                tolerance=4.5 * error,
                unit="lx",
                of=of,
            )
        )
    return rows


@check(
    what="Exported mesh (.glb) of a box of 10 mm with a ball of 3 mm cut out of it: volume",
    source="1,000 mm³ − 36π mm³; corners lie on the ball, so that triangles miss 0.7 % of it",
    packages=("cadquery-ocp-novtk", "trimesh"),
)
def exported_cavity() -> Row:
    import trimesh
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox, BRepPrimAPI_MakeSphere
    from OCP.gp import gp_Pnt

    from tests.tracer.importers.step_files import Part, write_step
    from viewer.export import export_3d

    box: Any = BRepPrimAPI_MakeBox(10.0, 10.0, 10.0).Shape()
    ball = BRepPrimAPI_MakeSphere(gp_Pnt(5.0, 5.0, 5.0), 3.0).Shape()
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        write_step(place / "void.step", [Part("void", BRepAlgoAPI_Cut(box, ball).Shape())])
        (place / "scene.toml").write_text("""
length_unit = "mm"
[media.glass]
index = 1.5
[cad_files.v]
file = "void.step"
medium = "glass"
[sources.s]
kind = "point"
position = [0, 0, 50]
""")
        tracer.record(tracer.load_scene(place / "scene.toml"), place / "v.raymap", rays=100)
        with raymap.open(place / "v.raymap") as ray_map:
            export_3d(ray_map, place / "v.glb")
        bodies = trimesh.load_scene(place / "v.glb").geometry.values()
        got = sum(float(body.volume) for body in bodies if hasattr(body, "faces"))
    return Row(expected=1000.0 - 36.0 * math.pi, got=got, tolerance=0.01 * 36 * math.pi, unit="mm³")


@check(
    what="Flux of a cosine lamp in EULUMDAT, steps of 5°, with a byte 0x85 in its name: encoding",
    source="π I0 with I0 = 1,000/π cd/klm and lamps of 1,000 lm; 0x85 ends no line of a file",
)
def text_of_eulumdat() -> list[Row]:
    gamma = np.arange(0.0, 91.0, 5.0)
    candela = 1000.0 / math.pi * np.cos(np.radians(gamma))
    numbers = [f"{value:.6f}" for value in abs(candela)]
    rows = []
    # 0x85 is the ellipsis of Windows-1252 and part of letters of UTF-8
    for of, name in (("UTF-8", "Ścienna oprawa ąę".encode()), ("Windows-1252", b"wall \x85 lamp")):
        head = ["maker", "1", "1", "1", "0", str(len(gamma)), "5", "report"]
        lines = [*head, "NAME", "number", "file", "date", *["0"] * 9, "100", "100", "1", "0"]
        lines += ["1", "1", "lamp", "1000", "white", "80", "10", *["0.5"] * 10, "0"]
        lines += [f"{angle:g}" for angle in gamma] + numbers
        raw = "\r\n".join(lines).encode().replace(b"NAME", name)
        assert b"\x85" in raw
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            path = Path(folder) / "lamp.ldt"
            path.write_bytes(raw)
            got = float(eulumdat.read(path).flux)
        # Linear between steps of 5°: a chord of the cosine misses up to (5°)²/8
        rows.append(Row(expected=1000.0, got=got, tolerance=2.0, unit="lm", of=of))
    return rows


@check(
    what="Part of a STEP file with supplementary curves: volume of the body called like its "
    "product",
    source="A box of 10 mm, written by OpenCASCADE; PRODUCT names it",
    packages=("cadquery-ocp-novtk",),
)
def step_names() -> list[Row]:
    from tests.tracer.importers.test_step import part_file
    from tracer.importers import read_cad

    rows = []
    for name in ("LIGHTGUIDE", "4711"):
        with tempfile.TemporaryDirectory() as folder:
            path = part_file(Path(folder) / "part.step", name, curves=True, solid="12")
            volumes = {part.name: part.volume for part in read_cad(path)}
        rows.append(Row(expected=1e3, got=volumes[name], tolerance=1e-6, unit="mm³", of=name))
    return rows

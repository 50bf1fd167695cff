"""Scenes that together use every kind of surface, body, medium, source and detector."""

from __future__ import annotations

import itertools
import json
import math
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

__all__ = ["generated_scenes", "write_files"]

SURFACES: dict[str, dict[str, Any]] = {
    "black": {"kind": "absorber"},
    "clear": {"kind": "dielectric"},
    "half": {"kind": "dielectric", "reflectance": 0.3},
    "coated": {
        "kind": "dielectric",
        "coating": {
            "between": ["air", "glass"],
            "layers": [
                {"index": 1.38, "thickness_nm": 99.5},
                {"index": 2.3, "extinction": 0.01, "thickness_nm": 60.0},
            ],
        },
    },
    "measured_coating": {
        "kind": "dielectric",
        "coating": {
            "wavelength_nm": [400, 700],
            "angle_deg": [0, 40, 90],
            "reflectance": [[0.1, 0.2, 0.9], [0.3, 0.3, 0.9]],
            "transmittance": [[0.8, 0.7, 0.05], [0.6, 0.6, 0.05]],
        },
    },
    "hazy": {"kind": "dielectric", "scatter": {"abg": [1e-3, 0.01, 2.0]}},
    "ground": {"kind": "rough_dielectric", "roughness": 0.3},
    "white": {"kind": "lambertian", "reflectance": {"rgb": [0.8, 0.6, 0.4]}},
    "milky": {"kind": "lambertian", "reflectance": 0.3, "transmittance": 0.5},
    "mirror": {"kind": "mirror", "reflectance": 0.9},
    "silver": {"kind": "mirror", "metal": {"n": 0.06, "k": 3.6}},
    "dusty": {"kind": "mirror", "reflectance": 0.9, "scatter": {"harvey_shack": [0.2, 0.05, -1.5]}},
    "brushed": {"kind": "rough_mirror", "roughness": 0.15, "reflectance": 0.8},
    "gold": {"kind": "rough_mirror", "roughness": 0.4, "metal": {"n": 0.3, "k": 2.9}},
    "red": {"kind": "filter", "transmittance": {"rgb": [0.9, 0.2, 0.1]}, "index": 1.5},
    "beads": {"kind": "retroreflector", "reflectance": 0.7, "spread_deg": 2.0},
    "sampled": {
        "kind": "tabulated",
        "reflected": {
            "theta_i_deg": [0, 60],
            "theta_o_deg": [0, 45, 90],
            "phi_deg": [0, 180],
            "values": [
                [[0.2, 0.2], [0.1, 0.08], [0.0, 0.0]],
                [[0.15, 0.1], [0.2, 0.05], [0.0, 0.0]],
            ],
        },
        "transmitted": {
            "theta_i_deg": [0, 90],
            "theta_o_deg": [0, 90],
            "phi_deg": [0, 180],
            "values": [[[0.1, 0.1], [0.0, 0.0]], [[0.05, 0.05], [0.0, 0.0]]],
        },
    },
}
"""A surface of every kind and law."""

SPECTRAL_ONLY = {"white": 0.6, "red": 0.4}
"""Reflectance or transmittance in place of three channels in a spectral scene."""

MEDIA: dict[str, dict[str, Any]] = {
    "glass": {"index": 1.5},
    "flint": {"glass": "N-SF11"},
    "fluorite": {
        "sellmeier": {
            "b": [0.5675888, 0.4710914, 3.8484723],
            "c": [0.00252643, 0.01007833, 1200.556],
        }
    },
    "plastic": {"cauchy": [1.48, 0.004], "absorption": 0.002},
    "milk": {
        "index": 1.33,
        "scattering": {
            "mean_free_path": 8.0,
            "albedo": 0.98,
            "phase": {"kind": "henyey_greenstein", "g": 0.7},
        },
    },
    "mist": {"index": 1.0, "scattering": {"mean_free_path": 30.0}},
    "cloud": {
        "index": 1.2,
        "absorption": 0.001,
        "scattering": {
            "coefficient": 0.05,
            "phase": {"kind": "generalized", "g": 0.5, "gamma": 1.4},
        },
    },
    "gas": {"index": 1.0, "scattering": {"mean_free_path": 20.0, "phase": {"kind": "rayleigh"}}},
    "paint": {
        "index": 1.4,
        "scattering": {
            "mean_free_path": 12.0,
            "albedo": 0.95,
            "phase": {"kind": "tabulated", "angle_deg": [0, 30, 90, 180], "value": [9, 3, 1, 0.5]},
        },
    },
}
"""A medium of every kind."""

BODIES: dict[str, dict[str, Any]] = {
    "lens": {
        "thickness": 6,
        "diameter": 20,
        "front": {"radius": 30, "conic": -0.5, "aspheric": [1e-6, 1e-9]},
        "back": {"radius": -40},
    },
    "box": {"size": [12, 14, 10]},
    "sphere": {"radius": 7},
    "cylinder": {"radius": 6, "length": 12},
    "cone": {"radius": 8, "end_radius": 3, "length": 12},
    "prism": {"outline": [[-8, -6], [8, -6], [0, 9]], "length": 14},
    "disc": {"outer": 9},
    "ring": {"outer": 9, "inner": 4},
    "rectangle": {"size": [16, 14]},
    "mesh": {"file": "tetrahedron.obj", "scale": 1.0},
}
"""A body of every kind."""

SHEETS = {"disc", "ring", "rectangle"}
SHEET_SURFACES = [name for name in SURFACES if name not in ("clear", "coated", "hazy", "ground")]

SOURCES: dict[str, dict[str, Any]] = {
    "beam": {"kind": "collimated", "diameter": 18},
    "square_beam": {"kind": "collimated", "size": [14, 10]},
    "chip": {"kind": "lambertian", "size": [2, 2], "cone_deg": 60},
    "bulb": {"kind": "point", "cone_deg": 25},
    "ring": {"kind": "ring", "diameter": 16, "inner_diameter": 12, "tilt_deg": 15},
    "screen": {"kind": "picture", "file": "picture.npy", "size": [8, 6], "cone_deg": 40},
    "luminaire": {
        "kind": "intensity",
        "diameter": 6,
        "intensity": {
            "gamma_deg": [0, 15, 40],
            "c_deg": [0, 90],
            "value": [[5, 5], [4, 3], [0, 0]],
        },
    },
    "measured": {"kind": "rays", "file": "rays.dat", "draw": "flux"},
    "in_order": {"kind": "rays", "file": "rays.dat", "draw": "in_order"},
}
"""A source of every kind."""

SPECTRA: list[Any] = [
    "white",
    "D65",
    {"blackbody": 3000},
    {"led": {"peak_nm": 525, "width_nm": 30}},
    {"white_led": {"blue_nm": 450, "phosphor_nm": 560, "blue_share": 0.25}},
    {"lines": {"wavelength_nm": [486.1, 546.1, 587.6], "power": [1, 2, 1]}},
]
DETECTORS: dict[str, dict[str, Any]] = {
    "screen": {"position": [0, 0, 120], "looks": [0, 0, -1], "size": [160, 160], "cells": [16, 16]},
    "plate": {
        "position": [10, 0, 100],
        "looks": [0.2, 0, -1],
        "size": [60, 60],
        "cells": [8, 8],
        "acceptance_deg": 40,
        "both_sides": True,
    },
    "wall": {
        "position": [0, 60, 40],
        "looks": [0, -1, 0],
        "up": [0, 0, 1],
        "size": [80, 80],
        "cells": [8, 8],
        "blocking": True,
    },
    "far": {"kind": "far_field", "axis": [0, 0, 1], "cells": [12, 9]},
    "far_turned": {
        "kind": "far_field",
        "axis": [0, 1, 0],
        "c0": [0, 0, 1],
        "cells": [12, 9],
        "angles": "theta_phi",
    },
    "camera": {
        "kind": "camera",
        "position": [0, 0, 150],
        "looks": [0, 0, -1],
        "aperture": 20,
        "focus": 150,
        "field_deg": 60,
        "cells": [16, 12],
    },
    "eye": {
        "kind": "pinhole",
        "position": [5, -50, -60],
        "looks": [0, 1, 1],
        "up": [0, 0, 1],
        "field_deg": 70,
        "cells": [16, 12],
    },
}
"""A detector of every kind but ``surface``, which needs a face."""

FIRST_FACE = {
    "lens": "front",
    "box": "z_min",
    "sphere": "surface",
    "cylinder": "side",
    "cone": "side",
    "prism": "side_1",
    "disc": "face",
    "ring": "face",
    "rectangle": "face",
}
PITCH = 30.0
OBJ = """
v 0 0 -8
v 9 0 6
v -5 8 6
v -5 -8 6
f 1 3 2
f 1 4 3
f 1 2 4
f 2 3 4
"""
MODES: list[dict[str, Any]] = [
    {"mode": "analog"},
    {"mode": "weighted", "min_reflection": 0.2},
    {"mode": "weighted", "split_depth": 2},
    {"mode": "weighted", "min_reflection": 0.1, "aim": ["screen"], "roulette_weight": 1e-5},
]


def write_files(folder: Path) -> None:
    """Write the files that the scenes name: a picture, a mesh and a list of rays."""
    import numpy as np

    draws = np.random.default_rng(7)
    np.save(folder / "picture.npy", draws.uniform(0.05, 1.0, (6, 8, 3)))
    (folder / "tetrahedron.obj").write_text(OBJ.lstrip())
    x, y = draws.uniform(-3, 3, (2, 500))
    u, v = draws.uniform(-0.3, 0.3, (2, 500))
    flux = draws.uniform(0.2, 1.0, 500)
    w = np.sqrt(1.0 - u * u - v * v)
    nm = draws.choice([0.45, 0.55, 0.62], 500)
    rows = [
        " ".join(f"{number:.9g}" for number in row)
        for row in zip(x, y, 0 * x, u, v, w, flux, nm, strict=True)
    ]
    (folder / "rays.dat").write_text("\n".join(["500 4", *rows]) + "\n")


def generated_scenes(count: int = 40) -> Iterator[tuple[str, str]]:
    """Names and texts of scenes; together they use every kind, each several times."""
    draws = random.Random(19)
    surfaces = itertools.cycle(SURFACES)
    sheet_surfaces = itertools.cycle(SHEET_SURFACES)
    bodies = itertools.cycle(BODIES)
    media = itertools.cycle(MEDIA)
    sources = itertools.cycle(SOURCES)
    detectors = itertools.cycle(DETECTORS)
    for number in range(count):
        spectral = number % 3 == 1
        trace = MODES[number % len(MODES)]
        scene: dict[str, Any] = {
            "length_unit": ("mm", "cm", "um")[number % 3],
            "flux_unit": ("W", "lm")[number % 2],
            "spectrum": {"kind": "spectral", "wavelengths_nm": [450, 520, 590, 650]}
            if spectral
            else {"kind": "rgb"},
            "limits": {"depth": 200},
            "trace": trace,
            "media": MEDIA,
            "surfaces": _for_channels(spectral),
            "bodies": {},
            "sources": {},
            "detectors": {},
        }
        places = [(i * PITCH, j * PITCH) for i in (-1, 0, 1) for j in (-1, 0, 1)]
        for place in draws.sample(places, 5):
            name, body = _body(next(bodies), place, draws)
            sheet = body["kind"] in SHEETS
            body["surface"] = next(sheet_surfaces if sheet else surfaces)
            if not sheet:
                body["medium"] = next(media)
                # A stack lies between its two media; a law needs light to take its share from
                body["medium"] = {"coated": "glass", "hazy": "flint"}.get(
                    body["surface"], body["medium"]
                )
            scene["bodies"][name] = body
        if number % 4 == 0:
            scene["bodies"] |= _nested(draws)
        if number % 5 == 2:
            scene["bodies"]["row"] = {
                **BODIES["sphere"], "kind": "sphere", "radius": 2, "medium": "glass",
                "surface": "clear", "position": [-40, 45, 20],
                "copies": {"count": 4, "step": [12, 0, 0]},
            }  # fmt: skip
        for _ in range(2):
            kind = next(sources)
            target = draws.choice(list(scene["bodies"].values()))["position"]
            scene["sources"][kind] = _source(kind, target, spectral, draws)
        for _ in range(3):
            kind = next(detectors)
            if kind == "eye" and trace["mode"] != "analog":
                kind = next(detectors)
            scene["detectors"][kind] = DETECTORS[kind]
        if "aim" in trace:
            scene["detectors"].setdefault("screen", DETECTORS["screen"])
        scene["detectors"]["skin"] = _skin(scene["bodies"])
        yield f"generated_{number:02}", _toml(scene)


def _for_channels(spectral: bool) -> dict[str, dict[str, Any]]:
    """The surfaces with values that the channels of the scene can have."""
    made = {name: dict(table) for name, table in SURFACES.items()}
    if spectral:
        for name, value in SPECTRAL_ONLY.items():
            key = "reflectance" if "reflectance" in made[name] else "transmittance"
            made[name][key] = {"wavelength_nm": [400, 700], "value": [value, 0.5 * value]}
    return made


def _body(
    kind: str, place: tuple[float, float], draws: random.Random
) -> tuple[str, dict[str, Any]]:
    body: dict[str, Any] = {"kind": kind, **BODIES[kind]}
    body["position"] = [*place, draws.uniform(10.0, 50.0)]
    body["rotation"] = [draws.uniform(-180.0, 180.0) for _ in range(3)]
    return f"{kind}_{int(place[0])}_{int(place[1])}".replace("-", "m"), body


def _nested(draws: random.Random) -> dict[str, dict[str, Any]]:
    """A ball in a block in a drum, with a hole of air that cuts all of them."""
    z = draws.uniform(60.0, 70.0)
    return {
        "drum": {
            "kind": "cylinder", "radius": 12, "length": 24, "position": [0, 0, z - 12],
            "medium": "plastic", "surface": "clear",
        },
        "block": {
            "kind": "box", "size": [10, 10, 10], "position": [0, 0, z], "medium": "milk",
            "surface": "clear", "priority": 1,
        },
        "ball": {
            "kind": "sphere", "radius": 4, "position": [0, 0, z], "medium": "flint",
            "surface": "clear", "priority": 2,
        },
        "bore": {
            "kind": "cylinder", "radius": 2, "length": 40, "position": [-20, 0, z],
            "axis": [1, 0, 0], "medium": "air", "surface": "clear", "priority": 3,
        },
    }  # fmt: skip


def _source(kind: str, target: list[float], spectral: bool, draws: random.Random) -> dict[str, Any]:
    x, y, z = target
    turn, tilt = draws.uniform(0.0, 2.0 * math.pi), draws.uniform(0.0, 0.5)
    axis = [
        math.sin(tilt) * math.cos(turn),
        math.sin(tilt) * math.sin(turn),
        math.cos(tilt),
    ]
    away = 60.0 + draws.uniform(0.0, 20.0)
    source: dict[str, Any] = {
        **SOURCES[kind],
        "position": [p - away * a for p, a in zip((x, y, z), axis, strict=True)],
        "axis": axis,
        "flux": draws.uniform(0.5, 5.0),
    }
    if kind == "beam":
        del source["position"], source["axis"]
        source |= {"aim": [x, y, z], "distance": away, "direction": axis}
    if spectral and source["kind"] not in ("picture", "rays"):
        source["spectrum"] = draws.choice(SPECTRA)
    elif source["kind"] not in ("picture", "rays"):
        source["spectrum"] = draws.choice(["white", "D65", {"rgb": [1.0, 0.8, 0.5]}])
    return source


def _skin(bodies: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """A surface detector on the first body."""
    name, body = next(iter(bodies.items()))
    if body["kind"] == "mesh":
        return {"kind": "surface", "face": name}
    face = FIRST_FACE[body["kind"]]
    return {"kind": "surface", "face": f"{name}.{face}", "cells": [6, 5], "side": "both"}


def _toml(scene: dict[str, Any]) -> str:
    """The scene as text; JSON's numbers, texts and lists are TOML's."""
    lines = [f"{key} = {json.dumps(value)}" for key, value in scene.items() if not _is_table(value)]
    for key, value in scene.items():
        if _is_table(value):
            lines += _table(key, value)
    return "\n".join(lines) + "\n"


def _is_table(value: Any) -> bool:
    return isinstance(value, dict)


def _table(name: str, table: dict[str, Any]) -> list[str]:
    lines = [f"[{name}]"]
    lines += [f"{key} = {_inline(value)}" for key, value in table.items() if not _is_table(value)]
    for key, value in table.items():
        if _is_table(value):
            lines += _table(f"{name}.{key}", value)
    return lines


def _inline(value: Any) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(_inline(item) for item in value) + "]"
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_inline(item)}" for key, item in value.items()) + " }"
    return json.dumps(value)

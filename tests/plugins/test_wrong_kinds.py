"""Kinds of other distributions that answer wrongly: one line that names place and module."""

from __future__ import annotations

import json

import pytest

from tests.plugins.installing import install, run

SCENE = """
length_unit = "mm"
[media.glass]
conrady = [1.5, 0.01, 0.001]
[media.fog]
index = 1.0
[media.fog.scattering]
mean_free_path = 30
phase = { kind = "draine", g = 0.6, alpha = 1.0 }
[surfaces.foil]
kind = "phong"
diffuse = 0.5
glossy = 0.2
exponent = 10
[bodies.block]
kind = "pyramid"
base = 10
height = 4
position = [0, 0, 5]
medium = "glass"
surface = "foil"
[bodies.cloud]
kind = "sphere"
radius = 1
position = [0, 0, 20]
medium = "fog"
surface = "absorber"
[sources.lamp]
kind = "diode"
spread_deg = [10, 20]
[detectors.side]
kind = "drum"
radius = 25
height = 50
cells = [24, 12]
"""

WRONG = {
    "half of a box": ("diode:Diode", "half_size", "lambda self: (1.0, 1.0)", "sources.lamp"),
    "no box": ("diode:Diode", "half_size", "lambda self: (-1.0, 0.0, 0.0)", "sources.lamp"),
    "words for numbers": ("diode:Diode", "own", "lambda self: ['wide']", "sources.lamp"),
    "no law": ("diode:Diode", "law", "None", "sources.lamp"),
    "no unit vector": ("diode:Diode", "law", "law(1.0, 2.0)", "sources.lamp"),
    "no number": ("diode:Diode", "law", "law(1.0, float('nan'))", "sources.lamp"),
    "out of the box": ("diode:Diode", "law", "law(3.0, 1.0)", "sources.lamp"),
    "no faces": ("pyramid:Pyramid", "plan", "lambda self: None", "bodies.block"),
    "no face": ("pyramid:Pyramid", "plan", "lambda self: []", "bodies.block"),
    "many numbers": ("drum:Drum", "own", "lambda self: [1.0] * 13", "detectors.side"),
    "one length": ("drum:Drum", "extent", "lambda self: 1.0", "detectors.side"),
    "no function": ("drum:Drum", "register", "None", "detectors.side"),
    "an index in words": ("conrady:CONRADY", "index", "lambda value, at: 'n'", "media.glass"),
    "an error": ("draine:Draine", "density", "lambda self, mu: mu / None", "phase"),
    "no row": ("phong:Phong", "compile", "lambda self, row: 1 / 0", "surfaces.foil"),
}

DRIVER = """
import json, sys, types
from importlib import import_module
from raymap.model.errors import SceneError
from tracer.scene.compile import compile_scene
from tracer.scene.load import parse_scene
from tracer.sources.source import SourceLaw

def law(start, along):
    emit = lambda own, *uniform: (0.0, 0.0, start - 1.0, 0.0, 0.0, along)
    return SourceLaw(emit=types.SimpleNamespace(py_func=emit))

scene, cases = json.loads(sys.stdin.read())
said = {}
for case, (kind, attribute, value) in cases.items():
    module, name = kind.split(":")
    kind = getattr(import_module("raymap_example_kinds." + module), name)
    put = type.__setattr__ if isinstance(kind, type) else object.__setattr__
    before = getattr(kind, attribute)
    put(kind, attribute, eval(value))
    try:
        compile_scene(parse_scene(scene))
        said[case] = ""
    except SceneError as error:
        said[case] = str(error)
    except Exception as error:
        said[case] = f"{type(error).__name__}\\n{error}"
    put(kind, attribute, before)
print(json.dumps(said))
"""


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """What the compilation of a scene says of each wrong kind, in one process for all."""
    site = install(tmp_path_factory.mktemp("site"))
    cases = {"right": ("drum:Drum", "stored", "'surface'")} | {
        case: wrong[:3] for case, wrong in WRONG.items()
    }
    done = run(site, "-c", DRIVER, given=json.dumps([SCENE, cases]))
    assert done.returncode == 0, done.stderr
    found: dict[str, str] = json.loads(done.stdout)
    return found


def test_the_scene_is_right_as_it_is(said: dict[str, str]) -> None:
    assert said["right"] == ""


@pytest.mark.parametrize("case", WRONG)
def test_wrong_answers_are_one_line(said: dict[str, str], case: str) -> None:
    assert WRONG[case][3] in said[case]
    assert "\n" not in said[case]

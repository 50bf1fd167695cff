"""Scene files with slips of every kind: refused in one clear line, or compiled."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from raymap.model.errors import RayMapError
from tests.examples import examples
from tracer.scene.compile import compile_scene
from tracer.scene.load import parse_scene

SAMPLES = Path(__file__).parents[3] / "samples"
LANGUAGE = (Path(__file__).parents[3] / "docs" / "scenes.md").read_text(encoding="utf-8")
FILES = [
    SAMPLES / name
    for name in (
        "double_gauss.toml", "prism_spectrometer.toml", "integrating_sphere.toml", "room.toml",
        "led_lens/led_lens.toml", "opal/backlight.toml", "crystals/calcite_paths.toml",
    )
]  # fmt: skip
TEXTS = {str(file.relative_to(SAMPLES)): file.read_text(encoding="utf-8") for file in FILES}
TEXTS["page"] = max(re.findall(r"```toml\n(.*?)```", LANGUAGE, re.S), key=len)

EXTRA = """
[surfaces.polish]
kind = "mirror"
reflectance = 0.9
scatter = { abg = [0.01, 0.01, 2] }
[surfaces.stack]
kind = "dielectric"
coating = { between = ["air", "glass"], layers = [{ index = 1.38, thickness_nm = 99.5 }] }
[surfaces.sheet]
kind = "filter"
transmittance = 0.5
index = 1.5
[bodies.asphere]
kind = "lens"
position = [400, 0, 0]
medium = "fog"
thickness = 5
rim = "absorber"
front = { radius = 40, conic = -1, semi_diameter = 9, aspheric = [1e-6, 0] }
back = { radius = inf, semi_diameter = 9, surface = "polish" }
[bodies.horn]
kind = "cone"
position = [500, 0, 0]
radius = 3
end_radius = 1
length = 4
surface = "sheet"
[media.fog]
cauchy = [1.5, 0.004]
scattering = { mean_free_path = 2.0, albedo = 0.9, phase = { kind = "henyey_greenstein", g = 0.8 } }
[sources.ringlight]
kind = "ring"
position = [600, 0, 0]
diameter = 9
inner_diameter = 8
tilt_deg = 30
spectrum = { led = { peak_nm = 525, width_nm = 30 } }
[detectors.cam]
kind = "camera"
position = [700, 0, 0]
looks = [0, 0, -1]
cells = [8, 6]
field_deg = 40
aperture = 2
focus = 100
[detectors.far]
kind = "far_field"
axis = [0, 0, -1]
c0 = [1, 0, 0]
cells = [24, 36]
gamma_deg = [0, 90]
"""
TEXTS["all kinds"] = TEXTS["room.toml"] + EXTRA

VALUES = [
    "0", "-1", "1e308", "-1e308", "1e-320", "nan", "inf", "-inf", str(2**70), "1.5", "true", '""',
    '"x"', '"*"', '"L1"', '"lens"', '"box"', '"room"', "[]", "[[]]", "[nan, 0, 0]", "[0, 0, 0]",
    "[1e300, 1e300, 1e300]", "[1e-300, 0, 0]", "[1, 2]", "[5, 5]", "{}", "{ radius = 3 }",
    "{ rgb = [0, 0, 0] }", "{ wavelength_nm = [500, 400], value = [1, 2] }", "1979-05-27",
    '{ cemented = "L1" }', '{ kind = "rgb" }', "'''\n'''", "4096", "70000",
]  # fmt: skip
KEYS = [
    "kind", "radius", "size", "position", "axis", "rotation", "medium", "surface", "glass", "flux",
    "share", "cells", "blocking", "inside", "aspheric", "conic", "hole", "diameter", "contacts",
    "priority", "faces", "index", "absorption", "scattering", "mode", "depth", "colour", "open",
]  # fmt: skip


@st.composite
def slips(draw: st.DrawFn) -> tuple[str, str]:
    """A shipped scene with a few lines changed, left out, doubled or put in."""
    name = draw(st.sampled_from(sorted(TEXTS)))
    lines = TEXTS[name].splitlines()
    for _ in range(draw(st.integers(1, 4))):
        place = draw(st.integers(0, len(lines) - 1))
        action = draw(st.sampled_from(["value", "value", "value", "number", "drop", "put", "word"]))
        line = lines[place]
        if action == "value" and "=" in line:
            lines[place] = f"{line.split('=')[0]}= {draw(st.sampled_from(VALUES))}"
        elif action == "number":
            numbers = list(re.finditer(r"-?\d+(\.\d+)?(e-?\d+)?", line))
            if numbers:
                found = draw(st.sampled_from(numbers))
                lines[place] = (
                    line[: found.start()] + draw(st.sampled_from(VALUES[:10])) + line[found.end() :]
                )
        elif action == "drop":
            lines[place] = ""
        elif action == "put":
            key = draw(st.sampled_from(KEYS))
            lines.insert(place, f"{key} = {draw(st.sampled_from(VALUES))}")
        elif action == "word":
            lines[place] = line.replace("e", draw(st.sampled_from(["", "x"])), 1)
    return name, "\n".join(lines)


def accepted_or_refused(name: str, text: str) -> None:
    folder = (SAMPLES / name).parent
    refused = ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            scene = parse_scene(text, folder=folder)
            compile_scene(scene)
    except RayMapError as error:
        refused = str(error)
    assert "\n" not in refused
    assert len(refused) < 1_000


def test_the_shipped_scenes_compile() -> None:
    for name, text in TEXTS.items():
        accepted_or_refused(name, text)
        parse_scene(text, folder=(SAMPLES / name).parent)


@settings(max_examples=examples(80), suppress_health_check=list(HealthCheck))
@given(slips())
def test_slips_are_refused_in_one_line(case: tuple[str, str]) -> None:
    accepted_or_refused(*case)

"""No key of a scene file is read and then left without effect and without a word."""

from __future__ import annotations

import importlib
import re
from typing import Any

import pytest
from pydantic import ValidationError

from raymap.model.errors import SceneError
from tests.tracer.scene.test_obeyed import CRYSTAL, LENS, PLATE, plate
from tracer import compile_scene, parse_scene
from tracer.detectors.registry import DETECTORS
from tracer.render.load import load_render_text
from tracer.scattering.scene_goniophotometer import measure_scene
from tracer.sources.registry import SOURCES
from tracer.surfaces.registry import SURFACES

PICTURE = """
[room]
low = [-50, -50, -50]
high = [50, 50, 50]
all = [1, 1, 1]
[camera]
position = [0, 0, 45]
target = [0, 0, 0]
sensor = [10, 10]
focal_length = 10
pixels = [4, 4]
"""


def with_line(text: str, table: str, line: str) -> str:
    """The scene with a line more in one of its tables, in place of one of the same key."""
    head, found, rest = text.partition(f"[{table}]\n")
    if not found:
        return f"{text}\n[{table}]\n{line}\n"
    inner, mark, after = rest.partition("\n[")
    key = line.partition("=")[0].strip()
    kept = [old for old in inner.splitlines() if old.partition("=")[0].strip() != key]
    return head + found + "\n".join([line, *kept]) + mark + after


@pytest.mark.parametrize(
    ("table", "line", "key"),
    [
        ("media.glass", "scattering = { mean_free_path = 5, phase = { kind = 'isotropic', g = 0.5 } }", "phase: the isotropic phase function has no g"),  # noqa: E501
        ("media.glass", "scattering = { mean_free_path = 5, phase = { kind = 'henyey_greenstein', gamma = 1 } }", "has no gamma; it takes g"),  # noqa: E501
        ("media.glass", "scattering = { mean_free_path = 5, phase = { kind = 'rayleigh', value = [1] } }", "has no value"),  # noqa: E501
        ("bodies.plate", "surface = 'clear'\nfaces = { front = 'clear' }", "has no such face"),
        ("bodies.sheet", "kind = 'disc'\nouter = 3\nsurface = 'white'\nposition = [0, 0, 9]\npriority = 2", "bodies.sheet.priority"),  # noqa: E501
        ("bodies.part", "kind = 'mesh'\nfile = 'x.obj'\nscale = 1\nangle_deg = 20\nsurface = 'white'", "bodies.part.angle_deg"),  # noqa: E501
        ("sources.lamp", "diameter = 1\ncone_deg = 5", "a collimated source has no cone_deg"),
        ("surfaces.coated", "coating = { between = ['air', 'glass'], layers = [{ index = 2, thickness_nm = 70 }], reflectance = [[1]] }", "reflectance belongs to a table"),  # noqa: E501
        ("trace", "aim_share = 0.2", "aim_share goes with mode"),
    ],
)  # fmt: skip
def test_a_key_without_effect_is_refused_by_name(table: str, line: str, key: str) -> None:
    with pytest.raises(SceneError, match=re.escape(key)):
        compile_scene(parse_scene(with_line(plate(), table, line)))


@pytest.mark.parametrize(
    ("lamp", "key"),
    [
        ("kind = 'lambertian'\nsize = [4, 4]\ninner_diameter = 2", "is that of a disc"),
        ("kind = 'collimated'\nsize = [4, 4]\ninner_diameter = 2", "is that of a disc"),
        ("kind = 'intensity'\nintensity = { gamma_deg = [0, 90], phi_deg = [30], value = [1, 1] }", "phi_deg are azimuths of a table over theta_deg"),  # noqa: E501
        ("kind = 'intensity'\nintensity = { theta_deg = [0, 90], c_deg = [30], value = [1, 1] }", "c_deg are azimuths of a table over gamma_deg"),  # noqa: E501
    ],
)  # fmt: skip
def test_a_lamp_without_use_for_a_key_refuses_it(lamp: str, key: str) -> None:
    head = PLATE.partition("[sources.lamp]")[0].replace("SURFACE", "clear")
    text = f"{head}[sources.lamp]\nposition = [0, 0, -10]\n{lamp}\n"
    with pytest.raises(SceneError, match=re.escape(key)):
        compile_scene(parse_scene(text))


@pytest.mark.parametrize(
    ("line", "key"),
    [
        (
            "front = { radius = 50, surface = 'bare' }\nfaces = { front = 'absorber' }",
            "faces.front",
        ),
        ("rim = 'bare'\nfaces = { rim = 'absorber' }", "faces.rim"),
    ],
)
def test_two_words_on_one_face_of_a_lens_are_refused(line: str, key: str) -> None:
    text = LENS
    if line.startswith("front"):
        text = text.replace("front = { radius = 50 }\n", "")
    with pytest.raises(SceneError, match=rf"bodies\.lens\.{key}: .*drop one"):
        compile_scene(parse_scene(with_line(text, "bodies.lens", line)))


@pytest.mark.parametrize(
    ("table", "line", "key"),
    [
        ("limits", "depth = 9", "limits.depth"),
        ("render", "wavelengths = 9", "render.wavelengths"),
        ("camera", "focus_distance = 9", "camera.focus_distance"),
        ("trace", "light = 'polarised'", "trace.light"),
    ],
)
def test_a_picture_refuses_what_it_does_not_heed(table: str, line: str, key: str) -> None:
    load_render_text(CRYSTAL + PICTURE)
    with pytest.raises(SceneError, match=rf"{key}: has no effect"):
        load_render_text(with_line(CRYSTAL + PICTURE, table, line))


@pytest.mark.parametrize("line", ["light = 'polarised'", "lens_trees = 3"])
def test_the_goniophotometer_refuses_other_light(line: str) -> None:
    with pytest.raises(SceneError, match=r"trace: the goniophotometer follows natural light"):
        measure_scene(parse_scene(with_line(LENS, "trace", line)), rays=100)


def _own_keys(model: Any, word: str) -> set[str]:
    """Keys of a kind; models of several kinds keep them in tables."""
    module = importlib.import_module(model.__module__)
    table = getattr(module, "_KEYS", None)
    if table is None or word not in table:
        return set(model.model_fields)
    return {*table[word], *getattr(module, "_COMMON", ()), "kind"}


def _kinds() -> list[Any]:
    """Model and word of every kind of surface, source and detector."""
    found = [
        pytest.param(registry[word], word, registry, id=f"{name}-{word}")
        for name, registry in (
            ("surfaces", SURFACES),
            ("sources", SOURCES),
            ("detectors", DETECTORS),
        )
        for word in registry
    ]
    assert len(found) > 15
    return found


@pytest.mark.parametrize(("model", "word", "registry"), _kinds())
def test_kinds_refuse_the_keys_of_other_kinds(model: Any, word: str, registry: Any) -> None:
    """A key is one of the kind's own, or is named in a refusal whatever its value."""
    own = _own_keys(model, word)
    others = {key for other in registry for key in registry[other].model_fields}
    for key in sorted(others - own - {"kind"}):
        field = next(
            registry[other].model_fields[key]
            for other in registry
            if key in registry[other].model_fields
        )
        value = None if field.is_required() else field.get_default(call_default_factory=True)
        with pytest.raises(ValidationError) as error:
            model.model_validate({"kind": word, key: value})
        assert any(
            key in found["loc"] or f"no {key};" in found["msg"] for found in error.value.errors()
        )

"""Vignetted fields: what a file takes from the pupil is not launched.

Right values are the definition itself: in Zemax p' = VD + p (1 - VC), turned by VAN; CODE V's VUX,
VLX, VUY and VLY are shares of the radius lost at the four ends. The stop is the first surface, so
that the pupil is the stop.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import query
import raymap
from raymap.model.errors import SceneError
from tests.tracer.importers.lens_texts import codev, opened, zemax
from tracer.run.recording import record
from tracer.scene.load import parse_scene
from tracer.sources.elliptical import EllipticalSource, emit

Array = NDArray[np.float64]

_SURFACES = (
    "STOP;DISZ 5;DIAM 5 0",
    "CURV 0.02;DISZ 5;GLAS N-BK7 0 0 1.5168 64.17;DIAM 14 0",
    "CURV -0.02;DISZ 90;DIAM 14 0",
    "DIAM 60 0",
)
_FACTORS = {"vdx": 0.05, "vdy": -0.1, "vcx": 0.2, "vcy": 0.3}


def _lit(folder: Path, text: str, suffix: str = ".zmx") -> dict[str, Any]:
    lens, said = opened(folder, text, suffix)
    assert not [line for line in said if "VCYN" in line or "VUY" in line]
    return lens.sources()


def _zemax(field: str, turn: float, factors: bool = True, distance: str = "") -> str:
    head = field
    if factors:
        words = {"VDXN": "vdx", "VDYN": "vdy", "VCXN": "vcx", "VCYN": "vcy"}
        head += "".join(f"\n{word} 0 {_FACTORS[key]}" for word, key in words.items())
        head += f"\nVANN 0 {turn}"
    text = zemax(*_SURFACES, head=head)
    return text.replace("DISZ INFINITY", distance) if distance else text


def _on_stop(table: dict[str, Any], u: Array) -> Array:
    """(n, 2) where emitted rays cross the plane of the stop, z = 0."""
    source = EllipticalSource.model_validate(table)
    origin, frame = source.frame()
    rays = np.array([emit(np.array(source.own()), *row, 0.0, 0.0, 0.0) for row in u])
    p, d = origin + rays[:, :3] @ frame.T, rays[:, 3:] @ frame.T
    assert np.allclose(np.linalg.norm(d, axis=1), 1.0)
    return (p - d * (p[:, 2:] / d[:, 2:]))[:, :2]


def _turn(degrees: float) -> Array:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[c, -s], [s, c]])


@pytest.mark.parametrize("turn", [0.0, 35.0])
@pytest.mark.parametrize(
    ("field", "distance"),
    [
        ("FTYP 0 0 2 1\nXFLN 0 0\nYFLN 0 8", ""),
        ("FTYP 0 0 2 1\nXFLN 0 6\nYFLN 0 -8", ""),
        ("FTYP 1 0 2 1\nXFLN 0 2\nYFLN 0 9", "DISZ 400"),
    ],
)
def test_light_fills_the_ellipse_that_zemax_leaves(tmp_path, field, distance, turn):
    table = _lit(tmp_path, _zemax(field, turn, distance=distance))["field_2"]
    middle = 5.0 * _turn(turn) @ [_FACTORS["vdx"], _FACTORS["vdy"]]
    half = 5.0 * (1.0 - np.array([_FACTORS["vcx"], _FACTORS["vcy"]]))
    # The edge
    rim = _on_stop(table, np.column_stack([np.ones(64), np.arange(64) / 64]))
    places = (rim - middle) @ _turn(turn) / half
    assert np.allclose(np.hypot(*places.T), 1.0, atol=2e-4 if distance else 1e-9)
    # Within it light is even: its middle, and a quarter of the squares of the half axes
    places = (_on_stop(table, np.random.default_rng(7).random((40_000, 2))) - middle) @ _turn(turn)
    assert np.all(np.abs(places.mean(axis=0)) < 4.5 * half / 2 / 200)
    moments = np.cov(places.T)
    assert np.allclose(moments / np.outer(half, half), np.eye(2) / 4, atol=0.005)


@pytest.mark.parametrize("distance", ["", "DISZ 400"])
def test_flux_follows_the_area_of_the_pupil(tmp_path, distance):
    """Behind the stop, of the same irradiance before it: (1 - VCX) (1 - VCY)."""
    kind = 1 if distance else 0
    field = f"FTYP {kind} 0 2 1\nXFLN 0 0\nYFLN 0 8"
    behind = []
    for factors in (False, True):
        path = tmp_path / f"{factors}.zmx"
        path.write_text(_zemax(field, 20.0, factors, distance), encoding="utf-8")
        scene = parse_scene(
            f"""
length_unit = "mm"
[lens_files.l]
file = "{path.name}"
sources = true
[detectors.behind]
position = [0, 0, 1]
size = [40, 40]
cells = [1, 1]
looks = [0, 0, -1]
""",
            folder=tmp_path,
        )
        record(scene, tmp_path / f"{factors}.raymap", rays=200_000, seed=3)
        with raymap.open(tmp_path / f"{factors}.raymap") as ray_map:
            image = query.detector_image(ray_map, "behind", 'source("l.field_2")')
            behind.append((image.total, image.total_se))
    whole, left = behind
    share = (1.0 - _FACTORS["vcx"]) * (1.0 - _FACTORS["vcy"])
    error = math.hypot(left[1], share * whole[1])
    assert left[0] == pytest.approx(share * whole[0], abs=4.0 * error + 1e-3 * left[0])


def test_code_v_says_the_same_by_its_four_ends(tmp_path):
    body = "S 0 5\nSTO\nS 50 5 NBK7_SCHOTT\nS -50 90\nSI 0 0"
    fields = "YAN 0 8\nVUX 0 0.15\nVLX 0 0.25\nVUY 0 0.4\nVLY 0 0.2"
    table = _lit(tmp_path, codev(body, fields=fields), ".seq")["field_2"]
    rim = _on_stop(table, np.column_stack([np.ones(360), np.arange(360) / 360]))
    ends = [*rim.max(axis=0), *rim.min(axis=0)]
    assert np.allclose(ends, [4.25, 3.0, -3.75, -4.0], atol=1e-3)


def test_a_field_of_which_nothing_is_left_is_dark(tmp_path):
    field = "FTYP 0 0 2 1\nXFLN 0 0\nYFLN 0 8\nVCYN 0 1"
    lens, said = opened(tmp_path, zemax(*_SURFACES, head=field))
    assert list(lens.sources()) == ["axis"]
    assert any("field 2 (0, 8): no light gets through" in line for line in said)


@pytest.mark.parametrize("words", ["SO 0 1e13\nSTO\nS 50 5 NBK7_SCHOTT\nS -50 90\nSI 0 0"])
def test_the_object_is_no_stop(words, tmp_path):
    text = codev("").replace("SO 0 1e13\n", f"{words}\n")
    with pytest.raises(SceneError, match="surface 0: the object is marked as the stop"):
        opened(tmp_path, text, ".seq")

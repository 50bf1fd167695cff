"""Scene files that cannot be traced: one line that names the place and the remedy."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from raymap.cli import application
from raymap.model.errors import SceneError
from tracer.scene.compile import compile_scene
from tracer.scene.load import load_scene, parse_scene

SAMPLE = Path(__file__).parents[3] / "samples" / "double_gauss.toml"
TEXT = SAMPLE.read_text(encoding="utf-8")

BAD = {
    "unknown key": (
        ("thickness = 8.75", "thicknes = 8.75"),
        ("bodies.L1.thicknes", "thickness"),
    ),
    "unknown key in a face": (
        ("front = { radius = 56.20238,", "front = { radius = 56.20238, colour = 3,"),
        ("bodies.L1.front.colour", "unknown key"),
    ),
    "unknown table": (("[limits]", "[limit]"), ("limit", "did you mean 'limits'")),
    "missing glass": (('medium = "N-SSK2"', 'medium = "N-SSK3"'), ("bodies.L1.medium", "'N-SSK2'")),
    "negative aperture": (
        ("semi_diameter = 29.2", "semi_diameter = -29.2"),
        ("bodies.L1.front.semi_diameter", "greater than 0"),
    ),
    "aperture beyond the sphere": (
        ("semi_diameter = 29.2", "semi_diameter = 60"),
        ("bodies.L1.front", "smaller"),
    ),
    "faces that overlap": (("thickness = 8.75", "thickness = 0.75"), ("bodies.L1", "overlap")),
    "lenses that overlap": (
        ("position = [0, 0, 70.967402]", "position = [0, 0, 69.967402]"),
        ("bodies.L6", "overlaps 'L5' by 0.5"),
    ),
    "cement apart": (
        ("position = [0, 0, 21.75]", "position = [0, 0, 21.85]"),
        ("bodies.L3.position", "21.75"),
    ),
    "missing surface": (('rim = "black"', 'rim = "blakc"'), ("bodies.L1", "'black'")),
    "no unit": (('length_unit = "mm"', ""), ("length_unit", "missing")),
    "wrong kind": (('kind = "ring"', 'kind = "rong"'), ("bodies.stop.kind", "'ring'")),
    "more light than came": (("reflectance = 0.1", "reflectance = 1.1"), ("surfaces.black", "1.1")),
    "no toml": (("[limits]", "[limits"), ("TOML", "line")),
    "negative flux": (("flux = 1.0", "flux = -1.0"), ("sources.beam.flux", "greater than 0")),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_scenes_are_refused_in_one_line(case: str) -> None:
    (old, new), expected = BAD[case]
    assert old in TEXT
    with pytest.raises(SceneError) as caught:
        compile_scene(parse_scene(TEXT.replace(old, new, 1), origin="lens.toml"))
    message = str(caught.value)
    assert message.startswith("lens.toml: ")
    assert "\n" not in message
    for part in expected:
        assert part in message


def test_no_source_is_refused() -> None:
    head = TEXT.split("# ---- light")[0]
    with pytest.raises(SceneError, match=r"sources: there is no source that is on; add"):
        compile_scene(parse_scene(head))


def test_unknown_variant_and_missing_file() -> None:
    with pytest.raises(SceneError, match="did you mean 'spectral'"):
        load_scene(SAMPLE, variants=["spectal"])
    with pytest.raises(SceneError, match="there is no scene file"):
        load_scene("nowhere.toml")


def test_variants_are_laid_over_the_scene() -> None:
    coated = load_scene(SAMPLE, variants=["coated", "spectral"])
    assert coated.surfaces["glass"].reflectance is not None
    assert len(coated.spectrum.channels()) == 11
    assert load_scene(SAMPLE).surfaces["glass"].reflectance is None


def test_scene_hash_leaves_out_channels_and_limits() -> None:
    plain = compile_scene(load_scene(SAMPLE)).directory
    spectral = compile_scene(load_scene(SAMPLE, variants=["spectral"])).directory
    coated = compile_scene(load_scene(SAMPLE, variants=["coated"])).directory
    shallow = compile_scene(parse_scene(TEXT.replace("depth = 1000", "depth = 10"))).directory
    assert plain.scene_hash == spectral.scene_hash == shallow.scene_hash != coated.scene_hash


def test_command_refuses_without_touching_anything(tmp_path: Path) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text(TEXT.replace("thickness = 8.75", "thicknes = 8.75"), encoding="utf-8")
    out = tmp_path / "out.raymap"
    result = CliRunner().invoke(application(), ["record", str(bad), "-o", str(out)])
    assert result.exit_code == 1
    assert isinstance(result.exception, SceneError)
    assert not out.exists()


def test_faces_of_a_lens_are_as_wide_as_the_lens_unless_they_say_otherwise() -> None:
    text = """
length_unit = "mm"
[media.glass]
index = 1.5
[bodies.L1]
kind = "lens"
medium = "glass"
thickness = 3
diameter = 10
front = { radius = 20, semi_diameter = 4 }
back = { radius = -20 }
"""
    lens = parse_scene(text).bodies["L1"]
    assert (lens.front.semi_diameter, lens.back.semi_diameter) == (4.0, 5.0)
    with pytest.raises(SceneError, match=r"bodies\.L1\.back: semi_diameter is missing"):
        parse_scene(text.replace("diameter = 10\n", ""))

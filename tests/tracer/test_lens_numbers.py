"""First-order numbers of the sample against its published values."""

from __future__ import annotations

from pathlib import Path

import pytest

from tracer.scene.load import load_scene, parse_scene
from tracer.studies.check_text import check_lines
from tracer.studies.lens import examine, first_order

SAMPLE = Path(__file__).parents[2] / "samples" / "double_gauss.toml"


def test_focal_length_and_back_focus_at_the_d_line() -> None:
    found = first_order(load_scene(SAMPLE))
    assert found.efl == pytest.approx(100.0037, abs=5e-5)
    assert found.bfl == pytest.approx(61.48755, abs=1e-4)
    assert found.f_number == pytest.approx(3.0, abs=1e-3)
    assert found.entrance_pupil == pytest.approx(57.91, abs=5e-3)


def test_thin_lens_in_front_of_its_stop() -> None:
    scene = parse_scene(
        """
length_unit = "mm"
[media.glass]
index = 1.5
[bodies.lens]
kind = "lens"
medium = "glass"
thickness = 0.6
surface = "bare"
rim = "absorber"
front = { radius = 50, semi_diameter = 5 }
back = { radius = -50, semi_diameter = 5 }
[bodies.stop]
kind = "ring"
position = [0, 0, 10]
inner = 2
outer = 6
surface = "absorber"
stop = true
[sources.lamp]
kind = "point"
position = [0, 0, -50]
"""
    )
    found = first_order(scene)
    assert found.efl == pytest.approx(50.0, rel=5e-3)
    assert found.exit_pupil == 10.0
    # The stop seen through the lens, whose principal planes lie 0.2 inside its vertices
    image = 1.0 / (1.0 / 9.6 - 1.0 / found.efl)
    assert found.entrance_pupil == pytest.approx(0.2 + image, abs=2e-3)
    assert found.entrance_diameter == pytest.approx(4.0 * image / 9.6, rel=1e-3)


@pytest.mark.parametrize(("place", "none"), [(-98.0, "exit"), (103.0, "entrance")])
def test_a_stop_in_a_focal_plane_has_a_pupil_at_infinity(place: float, none: str) -> None:
    # A plano-convex lens of f = 100 with its focal planes at -98 and 103
    stop = f'kind = "ring"\nposition = [0, 0, {place}]\ninner = 2\nouter = 9\nstop = true'
    scene = parse_scene(
        f"""
length_unit = "mm"
[media.glass]
index = 1.5
[bodies.lens]
kind = "lens"
medium = "glass"
thickness = 3
front = {{ semi_diameter = 5 }}
back = {{ radius = -50, semi_diameter = 5 }}
[bodies.stop]
{stop}
surface = "absorber"
[sources.lamp]
kind = "point"
position = [0, 0, -150]
"""
    )
    found = first_order(scene)
    assert found.efl == pytest.approx(100.0)
    assert getattr(found, f"{none}_pupil") is getattr(found, f"{none}_diameter") is None
    assert (found.f_number is None) == (none == "entrance")
    assert any(line.startswith("efl") for line in check_lines(examine(scene)))


def test_check_reports_what_the_scene_holds() -> None:
    report = examine(load_scene(SAMPLE, variants=["spectral"]))
    assert report["efl"] == pytest.approx(100.0037, abs=5e-5)
    assert list(report["bodies"])[:3] == ["L1", "L2", "L3"]
    assert len(report["channels"]) == 11


@pytest.mark.parametrize(
    ("wavelengths", "stated"),
    [("450, 550, 650", 587.5618), ("3000, 4000, 5000", 4000.0), ("400", 400.0)],
)
def test_first_order_is_stated_for_light_of_the_scene(wavelengths: str, stated: float) -> None:
    """1/f = (n - 1)(1/R1 - 1/R2 + (n - 1) d / (n R1 R2)) with n = 1.5 + 10⁴ nm² / λ²."""
    scene = parse_scene(
        f"""
length_unit = "mm"
[spectrum]
kind = "spectral"
wavelengths_nm = [{wavelengths}]
[media.glass]
cauchy = [1.5, 0.01]
[bodies.L1]
kind = "lens"
medium = "glass"
thickness = 10
diameter = 20
front = {{ radius = 50 }}
back = {{ radius = -50 }}
[sources.lamp]
kind = "point"
position = [0, 0, -50]
"""
    )
    n = 1.5 + 0.01 / (1e-3 * stated) ** 2
    report = examine(scene)
    assert report["wavelength_nm"] == stated
    power = (n - 1.0) * (2.0 / 50.0 - (n - 1.0) * 10.0 / (n * 2500.0))
    assert report["efl"] == pytest.approx(1.0 / power, rel=1e-3)
    # The primary wavelength of a lens file
    assert examine(scene, 520.0)["wavelength_nm"] == 520.0


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ('kind = "cylinder"\nradius = 1\nlength = 3\nposition = [0, 0, 3]', "stands on the axis"),
        ('kind = "cylinder"\nradius = 1\nlength = 3\nposition = [4, 0, 3]', ""),
        ('kind = "cylinder"\nradius = 1\nlength = 3\nposition = [0, 0, 30]', ""),
        (
            'kind = "lens"\nthickness = 1\nposition = [0, 0, 3]\ndiameter = 2\n'
            "front = { radius = 5 }\nback = { radius = inf }",
            "L2.front lies before L1.back",
        ),
    ],
)
def test_solids_among_the_lenses_leave_no_focal_length(body: str, message: str) -> None:
    scene = parse_scene(
        """
length_unit = "mm"
[media.glass]
index = 1.5
[bodies.L1]
kind = "lens"
medium = "glass"
thickness = 10
diameter = 20
front = { radius = 50 }
back = { radius = -50 }
[sources.lamp]
kind = "point"
position = [0, 0, -50]
[bodies.L2]
medium = "air"
priority = 1
"""
        + body
    )
    report = examine(scene)
    if message:
        assert message in report["first order"]
    else:
        assert report["efl"] == pytest.approx(51.7, abs=0.1)
    lines = check_lines(report)
    assert not any("None" in line for line in lines)
    assert not message or any(line.startswith("first order: not available") for line in lines)
    assert message or any(line.startswith("efl: 51.") and line.endswith(" mm") for line in lines)

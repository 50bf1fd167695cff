"""Headlines of paths, plots and colour tables."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from viewer.drawn.falsecolor import COLORMAPS, apply_colormap, wavelength_rgb
from viewer.drawn.itinerary import headline
from viewer.paint.plots import bars, heat_map, profile
from viewer.panels.paths import path_rows, sort_rows


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("s:emitted @eye eye.front:surface_absorption", "straight to eye"),
        ("s:emitted tube:surface_absorption", "straight to tube, absorbed"),
        ("s:emitted L1.front:specular_reflection :left", "L1.front ↩ → out of the scene"),
        (
            "s:emitted a.b:refracted c.d:specular_reflection a.b:tir @eye eye:surface_absorption",
            "c.d ↩ a.b ↩ (total) → eye",
        ),
        (
            "s:emitted w:diffuse_reflection w:diffuse_reflection :left",
            "w ↩ (diffuse) ×2 → out of the scene",
        ),
        (
            "s:emitted" + " a:tir b:tir" * 3 + " a:tir c:specular_reflection :left",
            "(a ↩ (total) b ↩ (total)) ×3 a ↩ (total) c ↩ → out of the scene",
        ),
        ("s:emitted :volume_scatter :volume_absorption", "scattered → medium, absorbed inside"),
        (
            r"s:emitted my\ lens.f\:1:specular_reflection t:depth_limit",
            "my lens.f:1 ↩ → t, stopped",
        ),
    ],
)  # fmt: skip
def test_headlines_say_what_distinguishes_a_path(path: str, words: str) -> None:
    assert headline(path) == words


def row(path: str, rays: int, flux: float) -> dict:
    return {"path": path, "criterion": f"p({path})", "rays": rays, "flux": flux, "flux_se": 0.1,
            "share": 0.5, "source": "s"}  # fmt: skip


def test_tables_are_sorted_and_checked_paths_get_colours() -> None:
    rows = [row("b :left", 5, 1.0), row("a :left", 9, 0.5)]
    rows.append({**row("remainder", 99, 9.0), "criterion": None})
    assert [r["rays"] for r in sort_rows(rows, "rays")] == [9, 5, 99]
    assert [r["path"][0] for r in sort_rows(rows, "path")] == ["a", "b", "r"]
    shown = path_rows(rows, ["p(a :left)", "p(b :left)"], "W")
    assert [r["checked"] for r in shown] == [True, True, False]
    assert shown[0]["color"] != shown[1]["color"] != ""
    assert shown[2]["criterion"] == ""


@pytest.mark.parametrize("name", COLORMAPS)
def test_colour_maps_rise_from_end_to_end(name: str) -> None:
    colors = apply_colormap(np.array([-1.0, 0, 0.5, 1, 7, np.nan, np.inf]), name)
    np.testing.assert_array_equal(colors[0], colors[1])
    np.testing.assert_array_equal(colors[3], colors[4])
    np.testing.assert_array_equal(colors[5], colors[1])
    if name != "turbo":
        luma = apply_colormap(np.linspace(0, 1, 50), name) @ np.array([0.2126, 0.7152, 0.0722])
        assert (np.diff(luma) > -1).all()


def test_wavelengths_have_their_hues() -> None:
    red, green, blue = wavelength_rgb(np.array([640.0, 530.0, 460.0]))
    assert red.argmax() == 0
    assert green.argmax() == 1
    assert blue.argmax() == 2


@pytest.mark.parametrize("log", [False, True])
def test_plots_are_sound_svg(log: bool) -> None:
    curves = [("all", np.array([0, 1.0, 1000.0]), "#fff"), ("none", np.zeros(0), "#000")]
    for text in (
        profile(curves, log=log, caption="a < b"),
        profile([("zero", np.zeros(4), "#fff")], log=log),
        bars(["R", "G", "B"], [0.1, 0.9, 0.0]),
        bars(["450", "550"], [1, 2], wavelengths_nm=[450, 550]),
        bars([], []),
        heat_map(["<a>", "b"], ["c"], np.array([[0.0], [2.0]]), unit="W"),
    ):
        assert ET.fromstring(text).tag == "svg"
    assert heat_map([], [], np.zeros((0, 0))) == ""


def test_heat_maps_order_their_colours() -> None:
    root = ET.fromstring(heat_map(["a"], ["b", "c", "d"], np.array([[0.0, 1e-6, 1.0]])))
    fills = [cell.get("fill") for cell in root.iter("rect")]
    assert fills[0] == "var(--rm-cell)"
    assert len(set(fills)) == 3

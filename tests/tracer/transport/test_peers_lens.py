"""The sample lens against an independent sequential ray tracer."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from raymap.model.events import Event
from tracer.run.recording import record
from tracer.scene.load import load_scene, parse_scene
from tracer.scene.media import refractive_index
from tracer.transport.trace import trace_rays

SAMPLE = Path(__file__).parents[3] / "samples" / "double_gauss.toml"

RADII = (
    56.20238, 152.28580, 37.68262, math.inf, 24.23130, math.inf, -28.37731, math.inf, -37.92546,
    177.41176, -79.41143,
)  # fmt: skip
THICKNESSES = (8.75, 0.5, 12.5, 3.8, 16.369445, 13.747957, 3.8, 11.0, 0.5, 7.0, 61.487536)
GLASSES = (
    "N-SSK2", None, "N-SK2", "F5", None, None, "F5", "N-SK16", None, "N-SK16", None,
)  # fmt: skip
STOP = 5
APERTURES = np.array([29.2, 28.1, 24.4, 22.2, 16.0, 10.57, 14.1, 17.2, 19.5, 21.8, 22.1])


@pytest.mark.peers
@pytest.mark.parametrize("wavelength_nm", [486.1327, 587.5618, 656.2725])
def test_transmitted_path_matches_optiland(wavelength_nm: float) -> None:
    pytest.importorskip("optiland")
    n = 200
    generator = np.random.default_rng(7)
    radius = 12.0 * np.sqrt(generator.random(n))
    angle = 2.0 * np.pi * generator.random(n)
    start = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(n, -10.0)])
    tilt = math.radians(3.0)
    along = np.tile([0.0, math.sin(tilt), math.cos(tilt)], (n, 1))
    start[:, 1] -= 67.91 * math.tan(tilt)
    expected = _sequential(start, along, wavelength_nm)
    traced = trace_rays(SAMPLE, start, along, wavelength_nm=wavelength_nm)
    sensor = traced.object_names.index("sensor")
    compared = 0
    for ray in range(n):
        points = traced.points[traced.offsets[ray] : traced.offsets[ray + 1]]
        if traced.object[traced.offsets[ray + 1] - 1] != sensor:
            continue
        assert len(points) == 12
        surfaces = [k for k in range(1, 13) if k != STOP + 1]
        assert np.allclose(points[1:], expected[surfaces, ray], rtol=0.0, atol=1e-9)
        compared += 1
    assert compared >= 100
    assert not np.any(traced.event & int(Event.SPECULAR_REFLECTION))


FIELD = 40
"""Cells a side of the picture that is compared."""

PLANE = 110.0
"""Height of a screen before the focus, where the light is a patch of some millimetres."""


@pytest.mark.peers
@pytest.mark.parametrize("emitted", [60_000, pytest.param(2_000_000, marks=pytest.mark.slow)])
def test_irradiance_before_the_focus_matches_optiland(emitted: int) -> None:
    """The same light, drawn apart: pictures of a vignetted beam on a screen, by a χ² test."""
    pytest.importorskip("optiland")
    text = SAMPLE.read_text(encoding="utf-8")
    text = text.replace('kind = "lambertian"\nreflectance = 0.1', 'kind = "absorber"')
    text = text.replace("[surfaces.glass]", "[surfaces.glass]\nreflectance = 0.0\n#")
    text = text.replace("position = [0, 0, 139.454938]", f"position = [0, 0, {PLANE}]")
    text = text.replace(
        "size = [36, 24]\ncells = [720, 480]", f"size = [24, 24]\ncells = [{FIELD}, {FIELD}]"
    )
    text = text.replace('kind = "rgb"', 'kind = "spectral"\nwavelengths_nm = [587.5618]', 1)
    text = text.replace("direction = [0, 0.052407779283, 1]", "direction = [0, 0.12, 1]")
    text = text.replace("diameter = 33.33", "diameter = 44")
    own = record(parse_scene(text), rays=emitted, no_rays=True, seed=3).detectors["sensor"]
    # The same beam for the sequential tracer: a disc across the beam, 80 before the point aimed at
    generator = np.random.default_rng(8)
    radius = 22.0 * np.sqrt(generator.random(emitted))
    turn = 2.0 * np.pi * generator.random(emitted)
    w = np.array([0.0, 0.12, 1.0]) / math.hypot(0.12, 1.0)
    v = np.array([0.0, w[2], -w[1]])
    centre = np.array([0.0, 0.0, 57.91]) - 80.0 * w
    start = centre + radius[:, None] * (
        np.cos(turn)[:, None] * np.eye(3)[0] + np.sin(turn)[:, None] * v
    )
    points = _sequential(start, np.tile(w, (emitted, 1)), 587.5618, screen=PLANE)
    across = np.hypot(points[1:12, :, 0], points[1:12, :, 1])
    passed = np.isfinite(points[12]).all(axis=1) & (across <= APERTURES[:, None]).all(axis=0)
    edges = np.linspace(-12.0, 12.0, FIELD + 1)
    u, v_axis = -points[12, passed, 0], points[12, passed, 1]
    expected = np.histogram2d(v_axis, u, [edges, edges])[0]
    counts = own.by_channel[0, :, :, 0]
    both = counts + expected
    lit = both >= 10
    assert lit.sum() > 60
    # Vignetting takes a part of the beam
    assert 0.3 < passed.mean() < 0.95
    statistic = ((counts - expected)[lit] ** 2 / both[lit]).sum()
    p = float(chi2.sf(statistic, lit.sum()))
    total = (counts.sum() - expected.sum()) / np.sqrt(both.sum())
    own_share, share = counts.sum() / emitted, expected.sum() / emitted
    print(f"{lit.sum()} cells, p = {p:.3f}; {own_share:.5f} and {share:.5f}: {total:.2f} se")
    assert p > 1e-4
    assert abs(total) < 4.5


def _sequential(
    start: np.ndarray, along: np.ndarray, wavelength_nm: float, *, screen: float | None = None
) -> np.ndarray:
    """Points on object plane, eleven surfaces and image plane (or screen), (13, n, 3)."""
    thicknesses = list(THICKNESSES)
    if screen is not None:
        thicknesses[-1] = screen - sum(thicknesses[:-1])
    scene = load_scene(SAMPLE)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from optiland.materials import IdealMaterial
        from optiland.optic import Optic
        from optiland.rays import RealRays

        optic = Optic()
        optic.add_surface(index=0, radius=math.inf, thickness=10.0)
        for k, glass in enumerate(GLASSES):
            index = 1.0
            if glass is not None:
                model = scene.media[glass]
                index = float(refractive_index(model, np.array([wavelength_nm]), glass)[0])
            optic.add_surface(
                index=k + 1,
                radius=RADII[k],
                thickness=thicknesses[k],
                material=IdealMaterial(n=index),
                is_stop=k == STOP,
            )
        optic.add_surface(index=12)
        optic.add_wavelength(wavelength_nm / 1000.0, is_primary=True)
        n = len(start)
        rays = RealRays(*start.T, *along.T, np.ones(n), np.full(n, wavelength_nm / 1000.0))
        optic.surface_group.trace(rays)
        group = optic.surface_group
        return np.stack([group.x, group.y, group.z], axis=-1)

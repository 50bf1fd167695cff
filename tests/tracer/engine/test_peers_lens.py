"""The sample lens against an independent sequential ray tracer."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import numpy as np
import pytest

from raymap.events import Event
from tracer.scene.load import load_scene
from tracer.scene.media import refractive_index
from tracer.trace import trace_rays

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


def _sequential(start: np.ndarray, along: np.ndarray, wavelength_nm: float) -> np.ndarray:
    """Points on object plane, eleven surfaces and image plane, (13, n, 3)."""
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
                thickness=THICKNESSES[k],
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

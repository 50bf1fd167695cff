"""Fields behind lenses against Optiland's polarisation ray trace."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.tracer.lens.lenses import LINE_D, N_D, biconvex
from tracer.lens import Lens, trace_lens
from tracer.optics.polarization_rays import PolarizedRays

pytestmark = pytest.mark.peers


def skew_rays(n: int, radius: float, seed: int) -> PolarizedRays:
    """Rays of any polarisation that fill a lens, up to some 10 degrees from its axis."""
    rng = np.random.default_rng(seed)
    r, turn = radius * np.sqrt(rng.random(n)), 2.0 * np.pi * rng.random(n)
    d = np.column_stack([rng.normal(0.0, 0.08, n), rng.normal(0.0, 0.08, n), np.ones(n)])
    origin = np.column_stack([r * np.cos(turn), r * np.sin(turn), np.zeros(n)]) - 20.0 * d
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    rays = PolarizedRays.linear(origin, d, np.cross(d, [0.0, 1.0, 0.0]), wavelength_nm=LINE_D)
    real, imaginary = (np.cross(d, rng.normal(size=(n, 3))) for _ in range(2))
    return replace(rays, field=real + 1j * imaginary)


def optiland_fields(
    surfaces: list[tuple[float, float, float, bool]], rays: PolarizedRays
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points on the surfaces (k, n, 3), last directions (n, 3), last fields (n, 3).

    ``surfaces`` : radius, distance to the next one, index behind, whether the light is reflected
    """
    pytest.importorskip("optiland")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from optiland.coatings import FresnelCoating
        from optiland.materials import IdealMaterial
        from optiland.optic import Optic
        from optiland.rays import PolarizedRays as Rays

        optic = Optic()
        optic.add_surface(index=0, radius=math.inf, thickness=20.0)
        coatings = []
        before = 1.0
        for place, (radius, distance, behind, mirror) in enumerate(surfaces, 1):
            media = IdealMaterial(n=before), IdealMaterial(n=behind)
            coatings.append(FresnelCoating(*media))
            optic.add_surface(
                index=place,
                radius=radius,
                thickness=distance,
                material="mirror" if mirror else media[1],
                is_stop=place == 1,
            )
            if mirror:
                coatings[-1]._jones = _reflecting(*media)
            else:
                before = behind
        optic.add_surface(index=len(surfaces) + 1)
        for place, coating in enumerate(coatings, 1):
            optic.surface_group.surfaces[place].interaction_model.coating = coating
        optic.add_wavelength(LINE_D / 1000.0, is_primary=True)
        n = len(rays)
        traced = Rays(*rays.origin.T, *rays.direction.T, np.ones(n), np.full(n, LINE_D / 1000.0))
        optic.surface_group.trace(traced)
        group = optic.surface_group
        points = np.stack([group.x, group.y, group.z], axis=-1)
    directions = np.column_stack([traced.L, traced.M, traced.N])
    return points[1:-1], directions, np.einsum("nij,nj->ni", traced.p, rays.field)


def _reflecting(first: Any, second: Any) -> Any:
    """Optiland's Fresnel reflection with the sign of r_p that its own basis calls for.

    Optiland 0.6.3 gives -r_p for p = d x s on both sides, so that at normal incidence x and y would
    come back with opposite signs.
    """
    from optiland.jones import JonesFresnel

    class Reflecting(JonesFresnel):  # type: ignore[misc]
        def calculate_matrix(self, rays: Any, reflect: bool = False, aoi: Any = None) -> Any:
            matrix = super().calculate_matrix(rays, reflect, aoi)
            matrix[:, 1, 1] *= -1.0
            return matrix

    return Reflecting(first, second)


def electric(tree: Any, level: int) -> np.ndarray:
    """Electric field of the exits of a level, relative to that of the incoming ray."""
    root = np.sqrt(tree.tube[:, level - 1])[:, np.newaxis]
    return np.asarray(tree.field[:, level - 1] / root)


@pytest.mark.parametrize(
    ("front", "back", "thickness"),
    [(50.0, -50.0, 6.0), (35.0, 80.0, 5.0), (math.inf, -30.0, 8.0), (-60.0, 45.0, 3.0)],
)
def test_transmitted_fields(front: float, back: float, thickness: float) -> None:
    lens = biconvex(radius_front=front, radius_back=back, thickness=thickness)
    rays = skew_rays(300, 9.0, seed=1)
    tree = trace_lens(lens, rays, depth=2)
    points, directions, fields = optiland_fields(
        [(front, thickness, N_D, False), (back, 10.0, 1.0, False)], rays
    )
    out = tree.flux[:, 1] > 0.0
    assert out.sum() > 250
    np.testing.assert_allclose(tree.point[out, 1], points[1, out], rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(tree.direction[out, 1], directions[out], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(electric(tree, 2)[out], fields[out], rtol=0.0, atol=1e-12)


def test_fields_of_the_first_ghost() -> None:
    rays = skew_rays(300, 9.0, seed=2)
    tree = trace_lens(biconvex(), rays, depth=3)
    points, directions, fields = optiland_fields(
        [(50.0, 6.0, N_D, False), (-50.0, -6.0, 1.0, True), (50.0, -10.0, 1.0, False)], rays
    )
    out = tree.flux[:, 2] > 0.0
    assert out.sum() > 250
    np.testing.assert_allclose(tree.point[out, 2], points[2, out], rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(tree.direction[out, 2], directions[out], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(electric(tree, 3)[out], fields[out], rtol=0.0, atol=1e-12)


def test_fields_behind_two_lenses() -> None:
    second = Lens(
        radius_front=-40.0, radius_back=70.0, thickness=4.0, semi_aperture_front=14.0, glass=1.7847,
        origin=(0.0, 0.0, 11.0),
    )  # fmt: skip
    rays = skew_rays(300, 8.0, seed=3)
    first = trace_lens(biconvex(), rays, depth=2)
    exits = first.exits()
    kept = np.flatnonzero(exits.level == 2)
    between = first.exit_rays().where(kept)
    tree = trace_lens(second, between, depth=2)
    _, directions, fields = optiland_fields(
        [
            (50.0, 6.0, N_D, False),
            (-50.0, 5.0, 1.0, False),
            (-40.0, 4.0, 1.7847, False),
            (70.0, 10.0, 1.0, False),
        ],
        rays,
    )
    out = tree.flux[:, 1] > 0.0
    assert out.sum() > 250
    ray = exits.ray[kept][out]
    root = np.sqrt(exits.tube[kept][out] * tree.tube[out, 1])[:, np.newaxis]
    np.testing.assert_allclose(tree.direction[out, 1], directions[ray], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(tree.field[out, 1] / root, fields[ray], rtol=0.0, atol=1e-12)

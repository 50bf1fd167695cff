"""The reference lens against independent numbers: closed forms and other packages' traces.

The polarised field, exit points, directions and optical paths are those of optiland 0.6.3, the axis
crossings those of rayoptics 0.9.8.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.tracer.lens.lenses import LINE_D, N_D, biconvex, parallel_ray, plate
from tracer.lens import Glass, LensError, trace_lens, trace_rgb
from tracer.optics.dispersion import sellmeier
from tracer.optics.polarization_rays import PolarizedRays

DIAGONAL = 10.0 / math.sqrt(2.0)
N_BK7 = sellmeier(
    (1.03961212, 0.231792344, 1.01046945),
    (0.00600069867, 0.0200179144, 103.560653),
    range_nm=(300.0, 2500.0),
    name="N-BK7",
)


def test_levels_on_axis_are_the_geometric_series() -> None:
    tree = trace_lens(biconvex(), parallel_ray(0.0, 0.0, (1.0, 0.0, 0.0)), depth=9)
    r = ((N_D - 1.0) / (N_D + 1.0)) ** 2
    expected = [r] + [(1.0 - r) ** 2 * r ** (level - 2) for level in range(2, 10)]
    np.testing.assert_allclose(tree.flux[0], expected, rtol=1e-12)
    assert tree.remainder[0] == pytest.approx((1.0 - r) * r**8, rel=1e-12)
    assert tree.flux[0, 0] == pytest.approx(0.042164567068, abs=5e-13)


@pytest.mark.parametrize(
    ("height", "shares"),
    [
        (
            5.0,
            [0.041606278, 0.920095468, 0.037138799, 0.001135321, 2.3623e-5, 4.94e-7, 1.5e-8],
        ),
        (10.0, [0.039903343, 0.928589808, 0.031441085, 0.0, 0.0, 6.5415e-5, 3.36e-7]),
    ],
)
def test_levels_of_p_light(height: float, shares: list[float]) -> None:
    tree = trace_lens(biconvex(), parallel_ray(height, 0.0, (1.0, 0.0, 0.0)), depth=7)
    np.testing.assert_allclose(tree.flux[0, :4], shares[:4], atol=5e-10)
    np.testing.assert_allclose(tree.flux[0, 4:], shares[4:], rtol=1e-2)
    # Total internal reflection leaves levels without an exit
    assert [share > 0.0 for share in tree.flux[0]] == [share > 0.0 for share in shares]


@pytest.mark.parametrize(
    ("height", "point", "direction", "path"),
    [
        (
            10.0,
            (9.720616188, 0.0, 5.045994953),
            (-0.2109196729, 0.0, 0.9775033972),
            27.146341780,
        ),
        (5.0, (4.811281116, 0.0, 5.767977395), (-0.1022333336, 0.0, 0.9947604463), 28.624237765),
    ],
)
def test_transmitted_ray(
    height: float, point: tuple[float, ...], direction: tuple[float, ...], path: float
) -> None:
    tree = trace_lens(biconvex(), parallel_ray(height, 0.0, (1.0, 0.0, 0.0)))
    np.testing.assert_allclose(tree.point[0, 1], point, atol=5e-10)
    np.testing.assert_allclose(tree.direction[0, 1], direction, atol=5e-10)
    assert tree.optical_path[0, 1] == pytest.approx(path, abs=5e-9)
    from_lens = trace_lens(
        biconvex(), parallel_ray(height, 0.0, (1.0, 0.0, 0.0)), path_from_origin=False
    )
    assert from_lens.optical_path[0, 0] == 0.0


def test_polarisation_aberration() -> None:
    tree = trace_lens(biconvex(), parallel_ray(DIAGONAL, DIAGONAL, (1.0, 0.0, 0.0)), depth=7)
    assert tree.field is not None
    assert tree.tube is not None
    electric = tree.field[0, 1] / math.sqrt(tree.tube[0, 1])
    np.testing.assert_allclose(electric, [0.96516555, -0.00484796, 0.14652060], atol=1e-8)
    assert np.sum(np.abs(electric) ** 2) == pytest.approx(0.9530363375, abs=5e-10)
    assert tree.flux[0, 1] == pytest.approx(0.9169383828, abs=5e-10)
    np.testing.assert_allclose(tree.point[0, 2], [5.302111, 5.302111, 0.565445], atol=5e-7)
    np.testing.assert_allclose(
        tree.direction[0, 2], [-0.55605443, -0.55605443, -0.61774343], atol=5e-9
    )
    assert tree.flux[0, 2] == pytest.approx(0.036149262, abs=5e-10)
    # Two total reflections have made levels 6 and 7 elliptical
    for level, elliptical in ((2, False), (3, False), (6, True), (7, True)):
        e = tree.field[0, level - 1]
        turned = e * np.exp(-0.5j * np.angle(np.sum(e * e)))
        assert (np.linalg.norm(turned.imag) > 1e-3 * np.linalg.norm(e)) is np.bool_(elliptical)


@pytest.mark.parametrize(
    ("line", "height", "crossing"),
    [
        (587.5618, 5.0, 46.583159706),
        (587.5618, 10.0, 44.096014305),
        (486.1327, 10.0, 43.580051002),
        (656.2725, 10.0, 44.328784024),
    ],
)
def test_axis_crossings_with_dispersion(line: float, height: float, crossing: float) -> None:
    lens = biconvex(glass=Glass(dispersion=N_BK7))
    rays = PolarizedRays.linear(
        [[height, 0.0, -20.0]], [[0.0, 0.0, 1.0]], [[0.0, 1.0, 0.0]], wavelength_nm=line
    )
    tree = trace_lens(lens, rays, depth=2)
    point, direction = tree.point[0, 1], tree.direction[0, 1]
    behind = point[2] - point[0] * direction[2] / direction[0] - lens.thickness
    assert behind == pytest.approx(crossing, abs=1e-7)


@pytest.mark.parametrize(
    ("line", "f", "back"),
    [
        (587.5618, 49.384172328, 47.365047219),
        (486.1327, 48.864234626, 46.852207684),
        (656.2725, 49.618796311, 47.596501190),
    ],
)
def test_focal_lengths_with_dispersion(line: float, f: float, back: float) -> None:
    lens = biconvex(glass=Glass(dispersion=N_BK7))
    assert lens.focal_length(line) == pytest.approx(f, abs=1e-7)
    assert lens.back_focal_length(line) == pytest.approx(back, abs=1e-7)


@pytest.mark.parametrize(
    ("height", "exact", "scalar"),
    [
        (10.0, (0.9169384, 0.0361493), (0.9169158, 0.0370334)),
        (5.0, (None, 0.0386445), (None, 0.0386727)),
    ],
)
def test_unpolarised_modes(
    height: float, exact: tuple[float | None, float], scalar: tuple[float | None, float]
) -> None:
    ray = parallel_ray(height, 0.0, (1.0, 0.0, 0.0))
    for mode, expected in (("unpolarized", exact), ("scalar", scalar)):
        tree = trace_lens(biconvex(), ray, mode=mode)  # type: ignore[arg-type]
        for level, share in zip((2, 3), expected, strict=True):
            if share is not None:
                assert tree.flux[0, level - 1] == pytest.approx(share, abs=5e-8)
        np.testing.assert_allclose(tree.energy_error(), 0.0, atol=1e-12)


def test_schlick_against_its_formula() -> None:
    tree = trace_lens(biconvex(), parallel_ray(10.0, 0.0, (1.0, 0.0, 0.0)), depth=2, mode="schlick")
    r0 = ((1.0 - N_D) / (1.0 + N_D)) ** 2
    into = math.sqrt(1.0 - (10.0 / 50.0) ** 2)
    assert tree.flux[0, 0] == pytest.approx(r0 + (1.0 - r0) * (1.0 - into) ** 5, rel=1e-12)
    # Leaving the glass, the angle of refraction counts
    normal = np.array([tree.point[0, 1, 0], 0.0, tree.point[0, 1, 2] + 44.0]) / 50.0
    out = float(tree.direction[0, 1] @ normal)
    second = r0 + (1.0 - r0) * (1.0 - out) ** 5
    assert tree.flux[0, 1] == pytest.approx((1.0 - tree.flux[0, 0]) * (1.0 - second), rel=1e-10)


def test_absorption_from_catalogue_transmittance() -> None:
    glass = Glass(dispersion=N_BK7, transmittance=((380.0, 0.99276), (400.0, 0.99679)))
    rays = PolarizedRays.linear([[0, 0, -5.0]], [[0, 0, 1.0]], [[1.0, 0, 0]], wavelength_nm=400.0)
    clear = trace_lens(biconvex(glass=Glass(dispersion=N_BK7)), rays, depth=2)
    tree = trace_lens(biconvex(glass=glass), rays, depth=2)
    assert tree.flux[0, 1] / clear.flux[0, 1] == pytest.approx(0.9980728, abs=5e-8)
    assert abs(tree.energy_error()[0]) < 1e-12
    assert float(glass.absorption(390.0)) == pytest.approx(
        -0.5 * (math.log(0.99276) + math.log(0.99679)) / 10.0
    )
    opaque = Glass(dispersion=N_BK7, transmittance=((300.0, 0.0), (400.0, 0.9)))
    assert math.isinf(opaque.absorption(350.0))
    dark = trace_lens(
        biconvex(glass=opaque),
        PolarizedRays.linear([[0, 0, -5.0]], [[0, 0, 1.0]], [[1.0, 0, 0]], wavelength_nm=350.0),
    )
    assert dark.absorbed_glass[0] == pytest.approx(1.0 - dark.flux[0, 0], rel=1e-12)
    assert np.all(dark.flux[0, 1:] == 0.0)


def test_rgb_channels() -> None:
    lens = biconvex(glass=Glass(dispersion=N_BK7))
    ray = parallel_ray(10.0, 0.0, (1.0, 0.0, 0.0))
    together = trace_rgb(lens, ray)
    assert np.array_equal(together[0].direction, together[2].direction)
    apart = trace_rgb(lens, ray, dispersion=True)
    assert apart[2].direction[0, 1, 0] < apart[0].direction[0, 1, 0]  # blue bends more
    n_green = float(N_BK7.index(549.0))
    green = trace_lens(biconvex(glass=n_green), ray, mode="scalar")
    np.testing.assert_allclose(apart[1].flux, green.flux, rtol=1e-14)


def test_options_suppress_and_book_what_they_suppress() -> None:
    ray = parallel_ray(10.0, 0.0, (1.0, 0.0, 0.0))
    full = trace_lens(biconvex(), ray, depth=7)
    forward_only = trace_lens(biconvex(), ray, depth=7, keep_backward=False)
    assert forward_only.flux[0, 0] == 0.0  # the first reflection runs back
    assert forward_only.flux[0, 2] == 0.0
    assert forward_only.flux[0, 1] == full.flux[0, 1]
    quiet = trace_lens(biconvex(), ray, depth=7, keep_reflection=False)
    assert quiet.suppressed[0] == pytest.approx(full.flux[0, 0])
    bright = trace_lens(biconvex(), ray, depth=7, min_share=0.01)
    assert [share > 0.0 for share in bright.flux[0]] == [True, True, True] + [False] * 4
    for tree in (full, forward_only, quiet, bright):
        assert abs(tree.energy_error()[0]) < 1e-12


def test_rays_that_start_in_the_glass_are_refused() -> None:
    rays = PolarizedRays.linear(
        [[0, 0, -3.0], [0, 0, 3.0]], [[0, 0, 1.0]] * 2, [[1.0, 0, 0]] * 2, wavelength_nm=LINE_D
    )
    with pytest.raises(LensError, match=r"origin of ray 1 .*inside"):
        trace_lens(biconvex(), rays)
    on_the_cap = PolarizedRays.linear(
        [[0, 0, 0.0], [0, 0, 6.0]],
        [[0, 0, 1.0]] * 2,
        [[1.0, 0, 0]] * 2,
        wavelength_nm=LINE_D,
    )
    assert list(trace_lens(biconvex(), on_the_cap).missed) == [False, True]


@pytest.mark.parametrize(
    ("options", "named"),
    [({"depth": 0}, "depth"), ({"mode": "exact"}, "mode"), ({"min_share": 1.0}, "min_share")],
)
def test_bad_options_are_refused(options: dict[str, object], named: str) -> None:
    with pytest.raises(LensError, match=named):
        trace_lens(biconvex(), parallel_ray(0.0, 0.0, (1.0, 0.0, 0.0)), **options)  # type: ignore


def test_wavelengths_outside_the_glass_data_are_refused() -> None:
    lens = biconvex(glass=Glass(dispersion=N_BK7))
    rays = PolarizedRays.linear([[0, 0, -3.0]], [[0, 0, 1.0]], [[1.0, 0, 0]], wavelength_nm=200.0)
    with pytest.raises(LensError, match=r"wavelength_nm is 200.*N-BK7"):
        trace_lens(lens, rays)


def test_the_rim_is_opaque_and_rays_may_miss() -> None:
    lens = plate(10.0, semi_aperture=5.0)
    rays = PolarizedRays.linear(
        [[20.0, 0.0, 5.0], [3.5, 0.0, -1.0], [30.0, 0.0, 30.0], [0.0, 0.0, -3.0]],
        [[-1.0, 0.0, 0.0], [math.sin(0.8), 0.0, math.cos(0.8)], [0.0, 1.0, 0.0], [0, 0, -1.0]],
        [[0.0, 1.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
        wavelength_nm=LINE_D,
    )
    tree = trace_lens(lens, rays, depth=4)
    np.testing.assert_array_equal(tree.missed, [False, False, True, True])
    assert tree.absorbed_rim[0] == pytest.approx(1.0)
    assert tree.point[0, 0] == pytest.approx([5.0, 0.0, 5.0])
    assert list(tree.face[1]) == [0, 2, -1, -1]
    np.testing.assert_allclose(tree.energy_error(), 0.0, atol=1e-12)

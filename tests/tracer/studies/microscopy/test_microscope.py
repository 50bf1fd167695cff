"""The polarising microscope: closed forms, a Berreman solver's numbers, both implementations.

Interference colours are those of colour-science 0.4.7 (D65, 2° observer, 1 nm); plate numbers with
all inner reflections those of pyElli 0.23.1.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from tracer.lens import Lens
from tracer.optics.crystals.media import biaxial, uniaxial
from tracer.optics.polarization_elements import Diaphragm, Polarizer, Retarder
from tracer.optics.polarization_rays import PolarizationError, PolarizedRays
from tracer.studies.interference_colors import interference_xyz, white_weights
from tracer.studies.lenses.lens_beams import parallel_beam
from tracer.studies.microscopy.microscope import Microscope, conoscopy, orthoscopy
from tracer.studies.microscopy.microscope_bench import bench_conoscopy
from tracer.studies.microscopy.microscope_train import (
    LensStage,
    MapStage,
    PlateStage,
    Screen,
    run_train,
)
from tracer.studies.microscopy.specimens import CrystalPlate, RetarderPlate

N_O, N_E = 1.6583574, 1.4864161
CALCITE = uniaxial(N_O, N_E, name="calcite")
SODIUM = 589.3
RINGS = [0.359918, 0.502138, 0.606707, 0.691145, 0.762360, 0.823957, 0.878121, 0.926302, 0.969529]


@pytest.mark.parametrize(
    ("difference", "xyz"),
    [
        (100.0, (0.27227, 0.28959, 0.44274)),
        (250.0, (0.89466, 0.96614, 1.05408)),
        (551.0, (0.13339, 0.05236, 0.42705)),
        (575.0, (0.13502, 0.06844, 0.59364)),
        (800.0, (0.66037, 0.87094, 0.51110)),
        (1100.0, (0.35365, 0.17668, 0.90607)),
        (1650.0, (0.45607, 0.30907, 0.73164)),
    ],
)
def test_interference_colours(difference: float, xyz: tuple[float, ...]) -> None:
    np.testing.assert_allclose(interference_xyz(difference), xyz, atol=2e-5)
    both = interference_xyz(difference) + interference_xyz(difference, polarisers="parallel")
    assert both[1] == pytest.approx(1.0)


@pytest.mark.parametrize("chi", [90.0, 0.0, 35.0])
@pytest.mark.parametrize("phi", [0.0, 20.0, 45.0, 110.0])
def test_retarder_between_polars(chi: float, phi: float) -> None:
    microscope = Microscope(analyser_deg=chi, wavelength_nm=550.0)
    _, found = orthoscopy(200.0, phi, microscope)
    c, p, half = math.radians(chi), math.radians(phi), math.pi * 200.0 / 550.0
    expected = math.cos(c) ** 2 - math.sin(2 * p) * math.sin(2 * (p - c)) * math.sin(half) ** 2
    assert found == pytest.approx(expected, abs=1e-14)


def test_calcite_rings_and_cross() -> None:
    """Dark rings where the path difference is whole, a dark cross along both polars."""
    microscope = Microscope(numerical_aperture=0.98, wavelength_nm=SODIUM)
    plate = CrystalPlate(crystal=CALCITE, thickness_mm=0.06)
    diagonal = np.array(RINGS) / math.sqrt(2.0)
    dark = microscope.transmitted(plate.jones(diagonal, diagonal, SODIUM), SODIUM)
    # Not quite dark: s and p light lose different shares at the faces
    matrix = plate.jones(np.array(RINGS), 0.0, SODIUM)
    losses = np.abs(np.abs(matrix[:, 0, 0]) - np.abs(matrix[:, 1, 1])) ** 2 / 4.0
    np.testing.assert_allclose(dark, losses, atol=2e-5)
    assert dark[0] < 2e-4
    between = np.array([0.5 * (a + b) for a, b in pairwise(RINGS)])[:5]
    bright = microscope.transmitted(
        plate.jones(between / math.sqrt(2), between / math.sqrt(2), SODIUM), SODIUM
    )
    assert bright.min() > 0.6
    figure = conoscopy(plate, microscope, pixels=101)
    assert figure.transmission[50].max() < 1e-12
    assert figure.transmission[:, 50].max() < 1e-12
    np.testing.assert_allclose(figure.transmission, figure.transmission.T, atol=1e-10)
    assert np.all(figure.transmission[~figure.inside] == 0.0)


@pytest.mark.parametrize(
    ("s", "law", "solver"),
    [(0.25, 0.994159, 0.993067), (0.65, 0.998885, 0.993754), (0.80, 0.913770, 0.909465)],
)
def test_calcite_in_balsam(s: float, law: float, solver: float) -> None:
    microscope = Microscope(numerical_aperture=1.2, wavelength_nm=SODIUM)
    component = s / math.sqrt(2.0)
    whole = CrystalPlate(crystal=CALCITE, thickness_mm=0.06, index_outside=1.54, levels=None)
    found = microscope.transmitted(whole.jones(component, component, SODIUM), SODIUM)
    assert found == pytest.approx(solver, abs=2e-6)
    difference = 60e3 * (math.sqrt(N_O**2 - s * s) - N_O * math.sqrt(1.0 - (s / N_E) ** 2))
    assert math.sin(math.pi * difference / SODIUM) ** 2 == pytest.approx(law, abs=1e-6)


@pytest.mark.parametrize(("turn", "solver"), [(15.0, 0.249794), (45.0, 0.999177)])
def test_quartz_section(turn: float, solver: float) -> None:
    angle = math.radians(turn)
    quartz = uniaxial(1.544, 1.553, (math.cos(angle), math.sin(angle), 0.0))
    plate = CrystalPlate(crystal=quartz, thickness_mm=0.03, index_outside=1.5485, levels=None)
    microscope = Microscope(wavelength_nm=550.0)
    found = microscope.transmitted(plate.jones(0.0, 0.0, 550.0), 550.0)
    assert found == pytest.approx(solver, abs=2e-6)


def test_biaxial_figure_turns_with_the_plate() -> None:
    crossed = Microscope(numerical_aperture=0.9, wavelength_nm=SODIUM)
    turned = Microscope(
        numerical_aperture=0.9, wavelength_nm=SODIUM, polariser_deg=90.0, analyser_deg=180.0
    )
    upright = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]).T
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    first, second = (
        conoscopy(
            CrystalPlate(crystal=biaxial(1.5, 1.6, 1.7, axes), thickness_mm=0.03), view, pixels=61
        )
        for axes, view in ((upright, crossed), (quarter @ upright, turned))
    )
    expected = np.rot90(first.transmission, -1)
    both = second.inside & np.rot90(first.inside, -1)
    np.testing.assert_allclose(second.transmission[both], expected[both], atol=1e-9)
    assert first.transmission.max() > 0.1


def test_compensator_subtracts() -> None:
    """A plate at 45° and a compensator at -45° of the same path difference give darkness."""
    compensator = Retarder.at_angle(-45.0, 551.0)
    microscope = Microscope(compensator=compensator)
    _, dark = orthoscopy(551.0, 45.0, microscope)
    _, bright = orthoscopy(0.0, 45.0, microscope)
    assert dark == pytest.approx(0.0, abs=1e-12)
    xyz, _ = orthoscopy(275.0, 45.0, Microscope(white_samples=401))
    np.testing.assert_allclose(xyz, interference_xyz(275.0), atol=1e-9)
    assert bright > 0.3


def test_plate_without_effect_and_open_polars() -> None:
    nothing = RetarderPlate(path_difference_nm=0.0)
    figure = conoscopy(nothing, Microscope(analyser_deg=None, white_samples=401), pixels=11)
    np.testing.assert_allclose(figure.transmission[figure.inside], 1.0)
    white = white_weights(np.linspace(380.0, 780.0, 401)).sum(axis=0)
    np.testing.assert_allclose(figure.xyz[5, 5], white)


def test_retarder_plate_by_direction() -> None:
    wedge = RetarderPlate(
        path_difference_nm=lambda x, y, wavelength: 1000.0 * x, slow_deg=lambda x, y: 45.0 + 0.0 * y
    )
    found = Microscope(wavelength_nm=500.0).transmitted(wedge.jones([0.0, 0.25], 0.0, 500.0), 500.0)
    np.testing.assert_allclose(found, [0.0, 1.0], atol=1e-15)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"numerical_aperture": 0.0}, "numerical_aperture"),
        ({"extinction": -1.0}, "extinction"),
        ({"wavelength_nm": -5.0}, "wavelength_nm"),
        ({"white_samples": 2}, "white_samples"),
    ],
)
def test_impossible_microscopes_are_refused(arguments: dict[str, float], named: str) -> None:
    with pytest.raises(PolarizationError, match=named):
        Microscope(**arguments)  # type: ignore[arg-type]
    with pytest.raises(PolarizationError, match="numerical_aperture"):
        conoscopy(RetarderPlate(path_difference_nm=1.0), Microscope(numerical_aperture=1.1))


def plano_convex(origin_z: float, *, flat_first: bool) -> Lens:
    return Lens(
        radius_front=math.inf if flat_first else 40.0,
        radius_back=-40.0 if flat_first else math.inf,
        thickness=5.0,
        semi_aperture_front=15.0,
        glass=1.5168,
        origin=(0.0, 0.0, origin_z),
    )


def test_real_lenses_show_the_rings_of_direction_space() -> None:
    """A thick calcite plate between two real lenses: rings at r = f s but for distortion."""
    condenser = plano_convex(0.0, flat_first=False)
    f = condenser.focal_length(SODIUM)
    specimen = 5.0 + condenser.back_focal_length(SODIUM)
    plate = CrystalPlate(crystal=CALCITE, thickness_mm=1.0)
    objective = plano_convex(specimen + condenser.back_focal_length(SODIUM), flat_first=True)
    back_focal = objective.origin[2] + 5.0 + f  # a plano-convex lens: f from its curved vertex
    # A narrow fan of rays at 45° to the polars
    heights = np.linspace(0.05, 12.0, 1500)
    start = np.stack([heights, heights, np.full_like(heights, -20.0) * math.sqrt(2)], axis=1)
    start[:, :2] /= math.sqrt(2.0)
    rays = PolarizedRays.linear(start, (0, 0, 1.0), (1.0, 0, 0), wavelength_nm=SODIUM)
    train = [
        Polarizer.at_angle(0.0, z=-10.0),
        LensStage(lens=condenser),
        PlateStage(plate=plate, z=specimen - 0.5),
        LensStage(lens=objective),
        Polarizer.at_angle(90.0, z=back_focal - 0.01),
        Screen(z=back_focal, half_size=15.0),
    ]
    arrived = run_train(rays, train)
    assert len(arrived) == len(rays)
    sines = np.linalg.norm(run_train(rays, train[:2]).direction[:, :2], axis=1)
    r = np.linalg.norm(arrived.origin[:, :2], axis=1)
    flux = arrived.flux
    minimum = (flux[1:-1] < flux[:-2]) & (flux[1:-1] < flux[2:]) & (flux[1:-1] < 0.05)
    dark = r[1:-1][minimum]

    # The same rings in direction space
    s = np.linspace(0.0, 0.28, 4000)
    shares = Microscope(wavelength_nm=SODIUM).transmitted(
        plate.jones(s / math.sqrt(2), s / math.sqrt(2), SODIUM), SODIUM
    )
    inner = shares[1:-1]
    rings = s[1:-1][(inner < shares[:-2]) & (inner < shares[2:]) & (inner < 0.05)]
    assert len(rings) >= 3
    assert len(dark) == 3
    np.testing.assert_allclose(sines[1:-1][minimum], rings[:3], rtol=2e-3)
    # On the screen the spherical aberration of the singlets shows, more at larger angles
    np.testing.assert_allclose(dark / f, rings[:3], rtol=0.04)
    assert abs(dark[0] / f - rings[0]) < 0.012 * rings[0]


def test_a_ghost_of_the_objective_is_weaker() -> None:
    lens = plano_convex(0.0, flat_first=True)
    beam = parallel_beam(lens, 400, wavelength_nm=SODIUM)
    direct = LensStage(lens=lens)(beam).flux.sum()
    both = LensStage(lens=lens, levels=(2, 4))(beam).flux.sum()
    assert 0.0 < both - direct < 0.005
    assert direct > 0.9


def test_orthoscopic_image_through_a_real_objective() -> None:
    """A wedge in parallel light: the fringes stand on the screen, magnified and turned."""
    lens = plano_convex(0.0, flat_first=True)
    f = lens.focal_length(SODIUM)
    # Specimen at 2 f before the principal plane near the curved vertex: image at 2 f behind
    specimen, screen = 5.0 - 2.0 * f, 5.0 + 2.0 * f
    x = np.linspace(-3.0, 3.0, 1201)
    start = np.stack([x, 0.0 * x, np.full_like(x, specimen - 10.0)], axis=1)
    rays = PolarizedRays.linear(start, (0, 0, 1.0), (1.0, 0, 0), wavelength_nm=SODIUM)
    wedge = MapStage(
        path_difference_nm=lambda x, y: 589.3 * x, slow_deg=lambda x, y: 45.0 + 0.0 * x, z=specimen
    )
    arrived = run_train(
        rays,
        [
            wedge,
            Diaphragm(radius=10.0, center=(0.0, 0.0, -1.0)),
            LensStage(lens=lens),
            Polarizer.at_angle(90.0, z=10.0),
            Screen(z=screen, half_size=5.0),
        ],
    )
    dark = arrived.origin[arrived.flux < 1e-4 * arrived.flux.max(), 0]
    for fringe in (-2.0, -1.0, 0.0, 1.0, 2.0):
        assert np.min(np.abs(dark + fringe)) < 0.1
    picture = Screen(z=screen, half_size=5.0, pixels=50).collect(arrived)
    assert picture.sum() == pytest.approx(arrived.flux.sum())


def test_the_bench_shows_the_figure_of_direction_space() -> None:
    """Both implementations over the whole aperture, at a low one where singlets are good."""
    plate = CrystalPlate(crystal=CALCITE, thickness_mm=2.0)
    view = Microscope(numerical_aperture=0.12, wavelength_nm=SODIUM)
    real, brightest = bench_conoscopy(plate, view, pixels=41)
    ideal = conoscopy(plate, view, pixels=41).xyz[..., 1]
    inside = np.hypot(*np.meshgrid(np.linspace(-1, 1, 41), np.linspace(-1, 1, 41))) < 0.8
    # Two lenses lose a sixth of the light at their faces
    scaled = real[..., 1] / 0.84
    assert np.corrcoef(scaled[inside], ideal[inside])[0, 1] > 0.97
    assert np.abs(scaled - ideal)[inside].mean() < 0.05
    assert 0.7 < brightest < 0.9
    with pytest.raises(PolarizationError, match="numerical_aperture"):
        bench_conoscopy(plate, Microscope(numerical_aperture=0.5))

"""Lenses."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import numpy as np

from tests.tracer.importers.lens_texts import opened, zemax
from tests.tracer.lens.lenses import N_D, biconvex, parallel_ray
from tests.tracer.transport.test_peers_lens import GLASSES, RADII, THICKNESSES
from tests.validation import Row, check
from tracer.lens import Glass, trace_lens
from tracer.optics.glasses import find_glass
from tracer.optics.polarization_rays import PolarizedRays
from tracer.scene.load import load_scene
from tracer.studies.lens import first_order

SAMPLES = Path(__file__).parents[2] / "samples"

# nd as the maker prints it, five decimals
N_D_OF = {None: 1.0, "N-SSK2": 1.62229, "N-SK2": 1.60738, "F5": 1.60342, "N-SK16": 1.62041}


@check(
    what="Double Gauss of samples/double_gauss.toml at the d line",
    source="n'u' = nu − y(n' − n)/R from surface to surface, indices nd of Schott's catalogue",
)
def double_gauss() -> list[Row]:
    y, u, before = 1.0, 0.0, 1.0
    for radius, thickness, name in zip(RADII, THICKNESSES, GLASSES, strict=True):
        after = N_D_OF[name]
        u = (before * u - y * (after - before) / radius) / after
        before = after
        back = -y / u if u else math.inf
        y += thickness * u
    found = first_order(load_scene(SAMPLES / "double_gauss.toml"))
    return [
        Row(expected=-1.0 / u, got=found.efl, tolerance=0.01, unit="mm", of="EFL"),
        Row(expected=back, got=found.bfl, tolerance=0.01, unit="mm", of="BFL"),
    ]


@check(
    what="Biconvex lens, R = ±50 mm, 6 mm of N-BK7",
    source="1/f = (n − 1)(1/R1 − 1/R2 + (n − 1)d/(n R1 R2)), BFL = f(1 − (n − 1)d/(n R1))",
)
def lens_maker() -> list[Row]:
    lens = biconvex(glass=Glass(dispersion=find_glass("N-BK7").dispersion))
    rows = []
    for line, nm, n in (
        ("d", 587.5618, 1.516800035),
        ("F", 486.1327, 1.522376290),
        ("C", 656.2725, 1.514322347),
    ):
        f = 1.0 / ((n - 1.0) * (2.0 / 50.0 - (n - 1.0) * 6.0 / (n * 2500.0)))
        bfl = f * (1.0 - (n - 1.0) * 6.0 / (n * 50.0))
        got = lens.focal_length(nm), lens.back_focal_length(nm)
        rows.append(Row(expected=f, got=got[0], tolerance=2e-7, unit="mm", of=f"f, {line} line"))
        rows.append(
            Row(expected=bfl, got=got[1], tolerance=2e-7, unit="mm", of=f"BFL, {line} line")
        )
    return rows


@check(
    what="Axis crossing behind that lens of a ray that enters 10 mm high",
    source="rayoptics 0.9.8, real ray trace",
)
def axis_crossing() -> list[Row]:
    lens = biconvex(glass=Glass(dispersion=find_glass("N-BK7").dispersion))
    rows = []
    for line, nm, expected in (
        ("d", 587.5618, 44.096014305),
        ("F", 486.1327, 43.580051002),
        ("C", 656.2725, 44.328784024),
    ):
        rays = PolarizedRays.linear(
            [[10.0, 0.0, -20.0]], [[0.0, 0.0, 1.0]], [[0.0, 1.0, 0.0]], wavelength_nm=nm
        )
        tree = trace_lens(lens, rays, depth=2)
        point, direction = tree.point[0, 1], tree.direction[0, 1]
        got = float(point[2] - point[0] * direction[2] / direction[0]) - lens.thickness
        rows.append(Row(expected=expected, got=got, tolerance=1e-6, unit="mm", of=f"{line} line"))
    return rows


@check(
    what="Ray tree of that lens on the axis, n = 1.5168000345: share of each level",
    source="L1 = R, Lk = (1 − R)² R^(k − 2), R = ((n − 1)/(n + 1))²",
)
def tree_on_axis() -> list[Row]:
    tree = trace_lens(biconvex(), parallel_ray(0.0, 0.0, (1.0, 0.0, 0.0)), depth=5)
    r = ((N_D - 1.0) / (N_D + 1.0)) ** 2
    expected = [r] + [(1.0 - r) ** 2 * r**k for k in range(4)]
    return [
        Row(expected=share, got=float(got), tolerance=1e-12, of=f"level {level}")
        for level, (share, got) in enumerate(zip(expected, tree.flux[0], strict=True), start=1)
    ]


@check(
    what="Field behind that lens, ray 10 mm high at 45° azimuth, light along x",
    source="optiland 0.6.3, polarised ray trace",
)
def polarised_field() -> list[Row]:
    side = 10.0 / math.sqrt(2.0)
    tree = trace_lens(biconvex(), parallel_ray(side, side, (1.0, 0.0, 0.0)), depth=2)
    assert tree.field is not None
    assert tree.tube is not None
    field = tree.field[0, 1] / math.sqrt(tree.tube[0, 1])
    field = np.real(field * np.exp(-1j * np.angle(field[0])))
    expected = (0.96516555, -0.00484796, 0.14652060)
    return [
        Row(expected=e, got=float(g), tolerance=2e-8, of=axis)
        for axis, e, g in zip("xyz", expected, field, strict=True)
    ]


@check(
    what="A lens file of barium fluoride, R = ±50 mm, 5 mm (`GCAT SCHOTT INFRARED`, `GLAS BAF2`)",
    source="1/f = (n − 1)(1/R1 − 1/R2 + (n − 1)d/(n R1 R2)), n by Malitson, JOSA 54, 628 (1964)",
)
def lens_file_of_a_crystal() -> list[Row]:
    rows = []
    for nm in (587.5618, 4000.0):
        square = (1e-3 * nm) ** 2
        terms = ((0.643356, 0.057789), (0.506762, 0.10968), (3.8261, 46.3864))
        n = math.sqrt(1.0 + sum(b * square / (square - c * c) for b, c in terms))
        f = 1.0 / ((n - 1.0) * (2.0 / 50.0 - (n - 1.0) * 5.0 / (n * 2500.0)))
        text = zemax(
            "STOP;CURV 0.02;DISZ 5;GLAS BAF2 0 0 1.5 40;DIAM 10 0",
            "CURV -0.02;DISZ 50;DIAM 10 0",
            "CURV 0;DISZ 0",
            head="GCAT SCHOTT INFRARED",
        ).replace("0.5875618", repr(1e-3 * nm))
        with tempfile.TemporaryDirectory() as folder:
            lens, _ = opened(Path(folder), text)
        got = lens.design()["efl"]
        rows.append(Row(expected=f, got=got, tolerance=1e-6, unit="mm", of=f"f, {nm:g} nm"))
    return rows

"""Lenses."""

from __future__ import annotations

import math
import tempfile
import warnings
from pathlib import Path

import numpy as np

import query
import raymap
from raymap.optics.cells import cell_measure
from tests.tracer.importers.lens_texts import codev, opened, zemax
from tests.tracer.lens.lenses import N_D, biconvex, parallel_ray
from tests.tracer.transport.test_peers_lens import GLASSES, RADII, THICKNESSES
from tests.validation import Row, check
from tracer.lens import Glass, trace_lens
from tracer.optics.glasses import find_glass
from tracer.optics.polarization_rays import PolarizedRays
from tracer.run.recording import record
from tracer.scene.load import load_scene
from tracer.sources.elliptical import EllipticalSource, emit
from tracer.studies.lens import first_order
from tracer.transport.trace import trace_rays

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


@check(
    what="Field at 8° of a lens file with `VDYN -0.1`, `VCXN 0.2`, `VCYN 0.3`, stop of 10 mm",
    source="p' = VD + p (1 − VC): an ellipse of π · 25 mm² · 0.8 · 0.7 about y = −0.5 mm; uniform "
    "over it, variances are a quarter of the squares of the half axes",
)
def vignetted_pupil() -> list[Row]:
    head = "FTYP 0 0 2 1\nXFLN 0 0\nYFLN 0 8\nVDYN 0 -0.1\nVCXN 0 0.2\nVCYN 0 0.3"
    text = zemax(
        "STOP;DISZ 5;DIAM 5 0",
        "CURV 0.02;DISZ 5;GLAS N-BK7 0 0 1.5168 64.17;DIAM 14 0",
        "CURV -0.02;DISZ 90;DIAM 14 0",
        "DIAM 60 0",
        head=head,
    )
    with tempfile.TemporaryDirectory() as folder:
        source = EllipticalSource.model_validate(opened(Path(folder), text)[0].sources()["field_2"])
    origin, frame = source.frame()
    n = 40_000
    drawn = [emit(np.array(source.own()), *u, 0.0, 0.0, 0.0) for u in _halton(n)]
    rays = np.array(drawn)
    p, d = origin + rays[:, :3] @ frame.T, rays[:, 3:] @ frame.T
    x, y, _ = (p - d * (p[:, 2:] / d[:, 2:])).T
    area = math.pi * 4.0 * float(x.std() * y.std())
    return [
        Row(
            expected=math.pi * 25.0 * 0.56, got=area, tolerance=0.02, unit="mm²", of="area on stop"
        ),
        Row(expected=-0.5, got=float(y.mean()), tolerance=0.002, unit="mm", of="middle"),
    ]


def _halton(n: int) -> list[tuple[float, float]]:
    """Places of the unit square, more even than random ones (Halton, bases 2 and 3)."""

    def radical(k: int, base: int) -> float:
        value, share = 0.0, 1.0
        while k:
            share /= base
            value += share * (k % base)
            k //= base
        return value

    return [(radical(k, 2), radical(k, 3)) for k in range(1, n + 1)]


@check(
    what="Direct light on the detector of a lens file, image at the marginal focus, R = ±50 mm",
    source="(1 − R)², R = ((n − 1)/(n + 1))² at both faces, near the normal; none of it beside",
)
def all_light_at_the_marginal_focus() -> Row:
    text = zemax(
        "STOP;CURV 0.02;DISZ 5;GLAS N-BK7 0 0 1.5 40;DIAM 10 0",
        "CURV -0.02;DISZ 46.5;DIAM 10 0",
        "CURV 0;DISZ 0",
    )
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "lens.zmx").write_text(text, encoding="utf-8")
        path = Path(folder) / "a.raymap"
        record(load_scene(Path(folder) / "lens.zmx"), path, rays=20_000, seed=1)
        with raymap.open(path) as ray_map:
            image = query.detector_image(ray_map, "image", "bounces == 2")
    n = 1.516800035
    expected = (1.0 - ((n - 1.0) / (n + 1.0)) ** 2) ** 2
    se = image.total_se
    return Row(expected=expected, got=image.total, got_error=se, tolerance=5.0 * se, unit="W")


@check(
    what="Areas of the cells of a map of a lens face, R = 50 mm, 40 mm wide, together",
    source="A cap of a sphere: 2 π R (R − √(R² − 20²))",
)
def areas_of_a_cap() -> list[Row]:
    area = 2.0 * math.pi * 50.0 * (50.0 - math.sqrt(2500.0 - 400.0))
    rows = []
    for cells in ((7, 7), (100, 100), (4000, 4000)):
        law = {"kind": "revolution", "outer": 20.0, "curvature": 0.02}
        detector = raymap.Detector(
            name="face",
            kind="surface",
            cells=cells,
            size=(40.0, 40.0),
            parameters={"area_law": law},
        )
        measure = cell_measure(detector, "m")
        assert measure is not None
        got = measure.sizes.total()
        rows.append(Row(expected=area, got=got, tolerance=0.1, unit="mm²", of=f"{cells[0]}² cells"))
    return rows


@check(
    what="A lens file of seawater, R = ±50 mm, 5 mm (`GCAT MISC`, `GLAS SEAWATER`): f, d line",
    source="Lens maker's equation, n by Quan & Fry, Appl. Opt. 34, 3477 (1995), 35 ‰ and 20 °C",
)
def lens_file_of_seawater() -> Row:
    s, t, nm = 35.0, 20.0, 587.5618
    n = (
        1.31405
        + (1.779e-4 - 1.05e-6 * t + 1.6e-8 * t * t) * s
        - 2.02e-6 * t * t
        + (15.868 + 0.01155 * s - 0.00423 * t) / nm
        - 4382.0 / nm**2
        + 1.1455e6 / nm**3
    )
    # Indices of Quan & Fry are relative to air, as a catalogue's are
    f = 1.0 / ((n - 1.0) * (2.0 / 50.0 - (n - 1.0) * 5.0 / (n * 2500.0)))
    text = zemax(
        "STOP;CURV 0.02;DISZ 5;GLAS SEAWATER 0 0 1.5 40;DIAM 10 0",
        "CURV -0.02;DISZ 47;DIAM 10 0",
        "CURV 0;DISZ 0",
        head="GCAT MISC",
    )
    with tempfile.TemporaryDirectory() as folder:
        got = opened(Path(folder), text)[0].design()["efl"]
    return Row(expected=f, got=got, tolerance=1e-6, unit="mm")


@check(
    what="Spherical mirror, R = 200 mm, stop of 60 mm at its centre, image of R = 100 mm in a lens "
    "file: rms radius at 5°",
    source="Reflection 200 mm from the centre and section with 100 mm about it, by vectors",
)
def curved_image() -> Row:
    text = zemax(
        "STOP;DISZ 200;DIAM 30 0",
        "CURV -0.005;DISZ -100;GLAS MIRROR;DIAM 50 0",
        "CURV -0.01;DISZ 0;DIAM 9 0",
        epd=60,
        head="FTYP 0 0 2 1\nXFLN 0 0\nYFLN 0 5",
    )
    u, v = np.array(_halton(4000)).T
    p = np.column_stack([np.cos(math.tau * v), np.sin(math.tau * v), 0.0 * v])
    p *= 30.0 * np.sqrt(u)[:, None]
    d = np.array([0.0, math.sin(math.radians(5.0)), math.cos(math.radians(5.0))])
    met = p + (np.sqrt(200.0**2 - np.sum(p * p, axis=1) + (p @ d) ** 2) - p @ d)[:, None] * d
    away = d - 2.0 * (met @ d)[:, None] * met / 200.0**2
    along = np.sum(met * away, axis=1)
    expected = met - (along + np.sqrt(along**2 - 200.0**2 + 100.0**2))[:, None] * away
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the image lies in the light on its way to the mirror
        (Path(folder) / "lens.zmx").write_text(text, encoding="utf-8")
        scene = load_scene(Path(folder) / "lens.zmx")
    traced = trace_rays(scene, p - d, np.tile(d, (len(p), 1)), wavelength_nm=587.5618)
    mirror, image = (traced.object_names.index(name) for name in ("M1", "image_surface"))
    at = np.flatnonzero((traced.object[1:] == image) & (traced.object[:-1] == mirror)) + 1
    right, got = (
        float(np.sqrt(np.mean(np.sum((spot - spot.mean(axis=0)) ** 2, axis=1))))
        for spot in (expected, traced.points[at])
    )
    return Row(expected=right, got=got, tolerance=1e-9, unit="mm")


@check(
    what="Commands of CODE V that name surfaces after `SI`",
    source="1/f = (n − 1)(1/R1 − 1/R2 + (n − 1)d/(n R1 R2)) with R2, thicknesses as commanded; "
    "a mirror: f = −R/2",
)
def commands_after_the_image() -> list[Row]:
    n = 1.516800035
    commanded = codev("S 50 5 NBK7_SCHOTT\nSTO\nS -50 46\nSI 0 0\nTHI S2 30\nRDY S2 -80\nTHI S1 7")
    commanded = commanded.replace("WL 587.6", "WL 587.5618")
    mirror = codev("S -200 -100\n RMD REFL\n STO\nSI 0 0")
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the image lies in the light on its way to the mirror
        lens, _ = opened(Path(folder), commanded, ".seq")
        found = lens.design()["efl"]
        at = float(lens.scene_tables()["detectors"]["image"]["position"][2])
        reflected = opened(Path(folder), mirror, ".seq")[0].design()["efl"]
    f = 1.0 / ((n - 1.0) * (1.0 / 50.0 + 1.0 / 80.0 - (n - 1.0) * 7.0 / (n * 4000.0)))
    return [
        Row(expected=f, got=found, tolerance=1e-4, unit="mm", of="f, `RDY S2` and `THI S1`"),
        Row(expected=37.0, got=at, tolerance=1e-9, unit="mm", of="place of the image, `THI S2`"),
        Row(expected=100.0, got=reflected, tolerance=1e-9, unit="mm", of="f, `RMD REFL`"),
    ]

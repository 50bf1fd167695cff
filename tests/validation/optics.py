"""Interfaces, films, plates and prisms."""

from __future__ import annotations

import cmath
import math
from pathlib import Path

import numpy as np

from raymap.model.events import Event
from raymap.optics.fresnel import fresnel_amplitudes, fresnel_reflectance, schlick_reflectance
from raymap.optics.stacks import Layer, stack_shares
from tests.tracer.transport.tracing import compiled, trace
from tests.validation import Row, check
from tracer.optics.dispersion import abbe_number
from tracer.optics.glasses import find_glass

SAMPLES = Path(__file__).parents[2] / "samples"


@check(
    what="Amplitudes at air to glass, n = 1.5",
    source="Fresnel's equations (Born & Wolf, 1.5.2), evaluated to nine digits",
)
def fresnel_table() -> list[Row]:
    table = {
        45.0: (-0.303337045, 0.092013363, 0.696662955, 0.728008909),
        85.0: (-0.855771861, -0.702320306, 0.144228139, 0.198453130),
    }
    rows = []
    for angle, expected in table.items():
        found = fresnel_amplitudes(1.0 + 0j, 1.5 + 0j, math.cos(math.radians(angle)))
        for name, right, value in zip(("rs", "rp", "ts", "tp"), expected, found[:4], strict=True):
            rows.append(
                Row(expected=right, got=value.real, tolerance=1e-9, of=f"{name} at {angle:g}°")
            )
    return rows


@check(
    what="Phase between p and s, total reflection in a Fresnel rhomb of n = 1.51",
    source="Born & Wolf, 1.5.4: 45° at 48°37′ and 54°37′",
)
def fresnel_rhomb() -> list[Row]:
    rows = []
    for angle in (48.624359, 54.623105):
        r_s, r_p, *_ = fresnel_amplitudes(1.51 + 0j, 1.0 + 0j, math.cos(math.radians(angle)))
        phase = abs(math.degrees(cmath.phase(r_p / r_s)))
        rows.append(Row(expected=45.0, got=phase, tolerance=1e-5, unit="°", of=f"{angle:g}°"))
    return rows


@check(
    what="Error of Schlick's approximation at 45°, n = 1.5",
    source="Schlick (1994), eq. 24, against Fresnel's equations",
)
def schlick() -> Row:
    cosine = math.cos(math.radians(45.0))
    got = schlick_reflectance(1.0, 1.5, cosine) / fresnel_reflectance(1.0, 1.5, cosine) - 1.0
    return Row(expected=-16.2632, got=100.0 * got, tolerance=1e-3, unit="%")


@check(
    what="Mirror of 11 quarter-wave layers, 2.35 and 1.45 on 1.52, normal incidence",
    source="R = ((1 − Y)/(1 + Y))², Y = (nH/nL)^2N nH²/ns (Macleod, ch. 5)",
)
def quarter_wave_mirror() -> Row:
    high, low = (
        Layer(index=np.array([n], complex), thickness_nm=550.0 / 4.0 / n) for n in (2.35, 1.45)
    )
    r, _ = stack_shares([1.0], [1.52], [*([high, low] * 5), high], [550.0], [0.0])
    y = (2.35 / 1.45) ** 10 * 2.35**2 / 1.52
    return Row(expected=((1.0 - y) / (1.0 + y)) ** 2, got=float(r[0, 0]), tolerance=1e-12)


@check(
    what="Reflection of MgF2 100 nm, 2.05 130 nm and an absorbing 1.62 + 0.01i 80 nm at 532 nm",
    source="tmm, coh_tmm, mean of s and p",
    packages=("tmm",),
)
def film_stack() -> list[Row]:
    import tmm

    films = [(1.38, 100.0), (2.05, 130.0), (1.62 + 0.01j, 80.0)]
    layers = [Layer(index=np.array([n], complex), thickness_nm=d) for n, d in films]
    rows = []
    for angle in (0.0, 30.0, 60.0, 80.0):
        sine = math.sin(math.radians(angle))
        r, _ = stack_shares([1.0], [1.52], layers, [532.0], [sine])
        indices = [1.0, *(n for n, _ in films), 1.52]
        depths = [math.inf, *(d for _, d in films), math.inf]
        s, p = (tmm.coh_tmm(pol, indices, depths, math.radians(angle), 532.0)["R"] for pol in "sp")
        got = float(r[0, 0])
        rows.append(Row(expected=0.5 * (s + p), got=got, tolerance=1e-10, of=f"{angle:g}°"))
    return rows


@check(
    what="Indices of N-BK7",
    source="Schott data sheet N-BK7 517642.251: Sellmeier coefficients and nd, nF, nC",
)
def n_bk7() -> list[Row]:
    glass = find_glass("N-BK7")
    lines = {"d": (587.5618, 1.51680), "F": (486.1327, 1.52238), "C": (656.2725, 1.51432)}
    return [
        Row(expected=n, got=float(glass.index(nm)), tolerance=5e-6, of=f"{line} line")
        for line, (nm, n) in lines.items()
    ]


@check(
    what="Light that a glass plate of n = 1.5 lets through, all reflections",
    source="T = (1 − R)/(1 + R), R by Fresnel",
)
def plate() -> list[Row]:
    rows, n = [], 100_000
    for angle in (0.0, 45.0, 70.0):
        a = math.radians(angle)
        found = trace(
            f"""
[media.glass]
index = 1.5
[bodies.plate]
kind = "box"
size = [4000, 4000, 1]
medium = "glass"
[sources.beam]
kind = "collimated"
position = [0, 0, -10]
direction = [{math.sin(a)}, 0, {math.cos(a)}]
diameter = 0.5
""",
            n,
        )
        cos_t = math.sqrt(1.0 - (math.sin(a) / 1.5) ** 2)
        s = ((math.cos(a) - 1.5 * cos_t) / (math.cos(a) + 1.5 * cos_t)) ** 2
        p = ((1.5 * math.cos(a) - cos_t) / (1.5 * math.cos(a) + cos_t)) ** 2
        r = 0.5 * (s + p)
        expected = (1.0 - r) / (1.0 + r)
        got = float(np.mean(found.portion.normal[found.last, 2] > 0))
        error = math.sqrt(expected * (1.0 - expected) / n)
        rows.append(
            Row(
                expected=expected, got=got, got_error=error, tolerance=4.5 * error, of=f"{angle:g}°"
            )
        )
    return rows


@check(
    what="Absorption in 1 mm of 0.7/mm",
    source="Beer and Lambert: 1 − exp(−0.7), mean depth of a truncated exponential",
)
def beer_lambert() -> list[Row]:
    n = 100_000
    found = trace(
        """
[media.haze]
index = 1.0
absorption = 0.7
[bodies.plate]
kind = "box"
size = [4000, 4000, 1]
medium = "haze"
[sources.beam]
kind = "collimated"
position = [0, 0, -10]
direction = [0, 0, 1]
diameter = 0.5
""",
        n,
    )
    share = 1.0 - math.exp(-0.7)
    error = math.sqrt(share * (1.0 - share) / n)
    absorbed = found.portion.event[found.last] & int(Event.VOLUME_ABSORPTION) != 0
    depth = found.portion.position[found.last][absorbed, 2] + 0.5
    mean = 1.0 / 0.7 - math.exp(-0.7) / (1.0 - math.exp(-0.7))
    spread = float(depth.std()) / math.sqrt(len(depth))
    got = float(np.mean(absorbed))
    return [
        Row(expected=share, got=got, got_error=error, tolerance=4.5 * error, of="share"),
        Row(
            expected=mean,
            got=float(depth.mean()),
            got_error=spread,
            tolerance=4.5 * spread,
            unit="mm",
            of="mean depth",
        ),
    ]


@check(
    what="Deviation by the 60° prism of N-SF11 in samples/prism_spectrometer.toml",
    source="Snell's law with Schott's Sellmeier coefficients of N-SF11",
)
def prism() -> list[Row]:
    from tests.tracer.test_samples import traced

    found = traced("prism_spectrometer.toml", 4_000)
    p = found.portion
    whole = (p.records_per_ray == 6) & (p.object[found.last] == found.object("sensor"))
    first = found.offsets[:-1][whole]
    step = p.position[first + 3].astype(float) - p.position[first + 2]
    beam = math.atan2(0.55313979, 0.83308845)
    angle = beam - np.arctan2(step[:, 1], step[:, 0])
    channel = p.color_code[found.last[whole]]
    wavelengths = found.compilation.channel_set.wavelengths_nm
    rows = []
    for k in (0, 5, 10):
        square = (wavelengths[k] / 1000.0) ** 2
        b = (1.73759695, 0.313747346, 1.89878101)
        c = (0.013188707, 0.0623068142, 155.23629)
        n = math.sqrt(1.0 + sum(x * square / (square - y) for x, y in zip(b, c, strict=True)))
        incidence = beam + math.radians(30.0)
        inner = math.asin(math.sin(incidence) / n)
        leaving = math.asin(n * math.sin(math.radians(60.0) - inner))
        expected = math.degrees(incidence + leaving) - 60.0
        got = math.degrees(float(np.mean(angle[channel == k])))
        rows.append(
            Row(expected=expected, got=got, tolerance=1e-4, unit="°", of=f"{wavelengths[k]:g} nm")
        )
    return rows


ABBE = {
    "COP": (56.0, "zeon.agf, E48R"),
    "COC": (56.150461, "topas.agf, 5013LS-01"),
    "PMMA": (57.440791, "misc.agf, PMMA, of the Handbook of Optics II"),
    "PC": (29.909185, "misc.agf, POLYCARB, of the Handbook of Optics II"),
    "PS": (30.866877, "misc.agf, POLYSTYR, of the Handbook of Optics II"),
}
"""V_d and where it stands in the catalogues."""


@check(
    what="Abbe numbers of plastics",
    source="Catalogues of glasses for Zemax (AGF_files of github nzhagen/zemaxglass)",
)
def abbe_numbers() -> list[Row]:
    return [
        Row(
            expected=abbe,
            got=abbe_number(find_glass(name).dispersion),
            tolerance=0.02 * abbe,
            of=f"{name}: {where}",
        )
        for name, (abbe, where) in ABBE.items()
    ]


@check(
    what="Share that a rod of plastic of 1 m absorbs, ends uncoated",
    source="PMMA, PC, PS: fibres in Argyros, ISRN Optics 2013, 785162, table 1; COP: 3 mm of E48R "
    "keep 0.998 (zeon.agf)",
)
def plastic_rods() -> list[Row]:
    rays = 100_000
    lost_db = {
        ("PMMA", 650): 0.15,
        ("PC", 650): 0.5,
        ("PS", 670): 0.11,
        ("COP", 460): -math.log10(0.998) * 10.0 / 0.003,
    }
    rows = []
    for (name, wavelength), loss in lost_db.items():
        scene = compiled(
            f'''
            [spectrum]
            kind = "spectral"
            wavelengths_nm = [{wavelength}]
            [media.m]
            glass = "{name}"
            [bodies.rod]
            kind = "cylinder"
            radius = 10
            length = 1000
            medium = "m"
            [sources.s]
            kind = "collimated"
            position = [0, 0, -5]
            direction = [0, 0, 1]
            diameter = 1
            '''
        )
        n = float(scene.arrays.medium_f[2, 0])
        back = ((n - 1.0) / (n + 1.0)) ** 2
        kept = 10.0 ** (-loss / 10.0)
        expected = (1.0 - back) * (1.0 - kept) / (1.0 - back * kept)
        got = trace(scene, rays).endings(Event.VOLUME_ABSORPTION) / rays
        error = math.sqrt(expected * (1.0 - expected) / rays)
        rows.append(
            Row(
                expected=100.0 * expected,
                got=100.0 * got,
                got_error=100.0 * error,
                tolerance=450.0 * error,
                unit="%",
                of=f"{name} at {wavelength} nm",
            )
        )
    return rows

"""Polarised light and crystals."""

from __future__ import annotations

import math

import numpy as np

from tests.validation import Row, check
from tracer.crystals.media import isotropic, uniaxial
from tracer.crystals.plates import plate_jones
from tracer.optics.glasses import find_glass
from tracer.optics.polarization_elements import Polarizer, Retarder
from tracer.optics.polarization_rays import PolarizedRays


def _beam() -> PolarizedRays:
    return PolarizedRays.linear(
        [[0.0, 0.0, -1.0]], [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]], wavelength_nm=550.0
    )


@check(what="Linear light behind a turned polariser", source="Malus: cos²θ")
def malus() -> list[Row]:
    return [
        Row(
            expected=math.cos(math.radians(angle)) ** 2,
            got=float(Polarizer.at_angle(angle)(_beam()).flux[0]),
            tolerance=1e-14,
            of=f"{angle:g}°",
        )
        for angle in (17.0, 45.0, 80.0)
    ]


@check(
    what="Retarder of a quarter of 550 nm at 12° before a polariser at 30°",
    source="cos²χ − sin 2φ sin 2(φ − χ) sin²(δ/2) (Born & Wolf, 15.4.1)",
)
def retarder() -> Row:
    light = Polarizer.at_angle(30.0, z=1.0)(Retarder.at_angle(12.0, 137.5)(_beam()))
    chi, phi = math.radians(30.0), math.radians(12.0)
    bent = math.sin(2.0 * phi) * math.sin(2.0 * (phi - chi)) * math.sin(math.pi / 4.0) ** 2
    return Row(expected=math.cos(chi) ** 2 - bent, got=float(light.flux[0]), tolerance=1e-14)


@check(
    what="Light through 1 µm of n = 1.5168000345 at 589.3 nm with interference",
    source="tmm, coh_tmm: Airy's formula",
    packages=("tmm",),
)
def thin_plate() -> list[Row]:
    import tmm

    rows = []
    for angle, pol in ((0.0, "s"), (30.0, "s"), (30.0, "p"), (60.0, "s"), (60.0, "p")):
        t, _ = plate_jones(isotropic(1.5168000345), math.sin(math.radians(angle)), 0.0, 1e-3, 589.3)
        index = "sp".index(pol)
        indices, depths = [1.0, 1.5168000345, 1.0], [math.inf, 1000.0, math.inf]
        expected = float(tmm.coh_tmm(pol, indices, depths, math.radians(angle), 589.3)["T"])
        got = float(abs(t[index, index]) ** 2)
        rows.append(Row(expected=expected, got=got, tolerance=1e-9, of=f"{pol} at {angle:g}°"))
    return rows


@check(
    what="Quartz plate of 30 µm between crossed polarisers at 550 nm",
    source="sin²2φ sin²(π Δn d/λ) with the plate in its own index",
)
def quartz() -> list[Row]:
    rows = []
    for degrees in (15.0, 45.0):
        a = math.radians(degrees)
        crystal = uniaxial(1.544, 1.553, (math.cos(a), math.sin(a), 0.0))
        t, _ = plate_jones(crystal, 0.0, 0.0, 0.03, 550.0, n_before=1.5485, n_after=1.5485)
        expected = math.sin(2.0 * a) ** 2 * math.sin(math.pi * 0.009 * 0.03 / 550e-6) ** 2
        # The formula leaves out the faint reflection at the faces, some 1e-5
        got = float(np.abs(t[0, 1]) ** 2)
        rows.append(Row(expected=expected, got=got, tolerance=5e-5, of=f"{degrees:g}°"))
    return rows


@check(what="Calcite at 589.3 nm", source="Ghosh (1999), refractiveindex.info")
def calcite() -> list[Row]:
    return [
        Row(
            expected=n,
            got=float(find_glass(f"calcite {ray}").index(589.3)),
            tolerance=2e-6,
            of=ray,
        )
        for ray, n in (("o", 1.658343), ("e", 1.486130))
    ]

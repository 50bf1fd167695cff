"""Polarised light and crystals."""

from __future__ import annotations

import math
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

import query
import raymap
from tests.validation import Row, check
from tracer.optics.crystals.media import isotropic, uniaxial
from tracer.optics.crystals.plates import plate_jones
from tracer.optics.glasses import find_glass
from tracer.optics.polarization_elements import Polarizer, Retarder
from tracer.optics.polarization_rays import PolarizedRays
from tracer.run.recording import record


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


def _reflected(surfaces: str, body: str, polarisation: str, direction: str) -> Row:
    """Share of polarised light that a traced scene sends back, without the right value."""
    text = f"""
length_unit = "mm"
[spectrum]
kind = "spectral"
wavelengths_nm = [550]
{surfaces}
{body}
[sources.b]
kind = "collimated"
diameter = 0.2
aim = [0, 0, 0]
distance = 10
direction = {direction}
polarisation = {polarisation}
[detectors.R]
kind = "far_field"
axis = [0, 0, -1]
gamma_deg = [0, 90]
cells = [1, 1]
[trace]
light = "polarised"
"""
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.toml"
        scene.write_text(text, encoding="utf-8")
        record(scene, scene.with_suffix(".raymap"), rays=200_000, threads=1)
        with raymap.open(scene.with_suffix(".raymap")) as ray_map:
            found = query.select(ray_map, 'detected("R")').summary()
    se = found["flux_se"]
    return Row(expected=0.0, got=found["flux"], got_error=se, tolerance=4.5 * se)


def _s_and_p(degrees: float) -> tuple[str, list[tuple[str, str]]]:
    """Direction of a beam towards +z at an incidence in the plane of x and z, with s and p."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return str([s, 0.0, c]), [("s", "[0, 1, 0]"), ("p", str([c, 0.0, -s]))]


@check(
    what="Traced linear light at 45° on a film of 70 nm, n = 2.3, on glass of n = 1.52: reflected",
    source="tmm, coh_tmm at 550 nm",
    packages=("tmm",),
)
def traced_film() -> list[Row]:
    import tmm

    surfaces = """
[media.g]
index = 1.52
[surfaces.film]
kind = "dielectric"
coating = { between = ["air", "g"], layers = [{ index = 2.3, thickness_nm = 70 }] }
[surfaces.k]
kind = "absorber"
"""
    body = """
[bodies.p]
kind = "box"
size = [400, 400, 100]
position = [0, 0, 50]
medium = "g"
surface = "k"
faces = { z_min = "film" }
"""
    direction, states = _s_and_p(45.0)
    indices, depths = [1.0, 2.3, 1.52], [math.inf, 70.0, math.inf]
    return [
        replace(
            _reflected(surfaces, body, polarisation, direction),
            expected=float(tmm.coh_tmm(of, indices, depths, math.radians(45.0), 550.0)["R"]),
            of=of,
        )
        for of, polarisation in states
    ]


@check(
    what="Traced linear light at 75° on a metal of n + ik = 2.9 + 3.1i: reflected",
    source="Fresnel's equations with a complex index (Born & Wolf, 14.2)",
)
def traced_metal() -> list[Row]:
    surfaces = '[surfaces.m]\nkind = "mirror"\nmetal = { n = 2.9, k = 3.1 }\n'
    body = '[bodies.m]\nkind = "rectangle"\nsize = [100, 100]\nsurface = "m"\n'
    direction, states = _s_and_p(75.0)
    n, cos = 2.9 + 3.1j, math.cos(math.radians(75.0))
    inside = np.sqrt(n * n - math.sin(math.radians(75.0)) ** 2)
    right = {
        "s": abs((cos - inside) / (cos + inside)) ** 2,
        "p": abs((n * n * cos - inside) / (n * n * cos + inside)) ** 2,
    }
    return [
        replace(
            _reflected(surfaces, body, polarisation, direction),
            expected=float(right[of]),
            of=of,
        )
        for of, polarisation in states
    ]

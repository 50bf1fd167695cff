"""Scattering media and surfaces."""

from __future__ import annotations

import math

import numpy as np

from raymap.model.events import Event
from tests.tracer.transport.tracing import compiled, trace
from tests.validation import Row, check
from tracer.scattering.plates.medium import ScatteringMedium
from tracer.scattering.plates.plate_exact import reflectance_transmittance


@check(
    what="Index-matched slab, 2 mm, μs = 0.9/mm, μa = 0.1/mm, g = 0.75",
    source="van de Hulst (1980), table 35, as quoted by Wang et al., CMPB 47, 131 (1995)",
)
def van_de_hulst() -> list[Row]:
    medium = ScatteringMedium(mean_free_path_mm=1 / 0.9, absorption_per_mm=0.1, g=0.75, index=1.0)
    out = reflectance_transmittance(medium, 2.0, 0.0)
    r, t = float(out.reflectance[0, 0]), float(out.transmittance[0, 0])
    return [
        Row(expected=0.09739, got=r, tolerance=1e-5, of="R"),
        Row(expected=0.66096, got=t, tolerance=1e-5, of="T"),
    ]


@check(
    what="Plate of n = 1.5 with Fresnel faces, Henyey-Greenstein g = 0.8, 1 mm, free path 0.5 mm",
    source="iadpython, normal incidence",
    packages=("iadpython",),
)
def glass_plate() -> list[Row]:
    import iadpython

    medium = ScatteringMedium(
        mean_free_path_mm=0.5, absorption_per_mm=0.01, g=0.8, gamma=1.5, index=1.5
    )
    out = reflectance_transmittance(medium, 1.0, 0.0)
    with np.errstate(all="ignore"):
        sample = iadpython.Sample(a=2.0 / 2.01, b=2.01, g=0.8, n=1.5, quad_pts=48)
        r, t, _, _ = sample.rt()
    return [
        Row(expected=float(r), got=float(out.reflectance[0, 0]), tolerance=1e-4, of="R"),
        Row(expected=float(t), got=float(out.transmittance[0, 0]), tolerance=1e-4, of="T"),
    ]


def _abg_rows(abg: tuple[float, float, float], expected: float) -> list[Row]:
    """Shares of light that a mirror of several reflectances scatters at normal incidence."""
    rays = 200_000
    rows = []
    for reflectance in (0.05, 0.5, 1.0):
        scene = compiled(
            f"""
            [surfaces.m]
            kind = "mirror"
            reflectance = {reflectance}
            scatter = {{ abg = {list(abg)} }}
            [bodies.p]
            kind = "disc"
            outer = 50
            surface = "m"
            [sources.s]
            kind = "collimated"
            position = [0, 0, 50]
            direction = [0, 0, -1]
            diameter = 1
            """
        )
        found = trace(scene, rays)
        got = np.count_nonzero(found.portion.event & int(Event.GLOSSY_REFLECTION)) / rays
        error = math.sqrt(expected * (1.0 - expected) / rays)
        rows.append(
            Row(
                expected=100.0 * expected,
                got=100.0 * got,
                got_error=100.0 * error,
                tolerance=450.0 * error,
                unit="%",
                of=f"R = {reflectance:g}",
            )
        )
    return rows


@check(
    what="Light that ABg (0.004, 0.05, 2) scatters at normal incidence, whatever R",
    source="Closed integral of the BSDF: π A ln(1 + 1/B)",
)
def abg_share() -> list[Row]:
    return _abg_rows((0.004, 0.05, 2.0), math.pi * 0.004 * math.log(1.0 + 1.0 / 0.05))


@check(
    what="Light that ABg (0.004, 0.05, 2.2) scatters at normal incidence, whatever R",
    source="2π ∫ A β/(B + β^g) dβ from 0 to 1, β = sin θ, by Gauss and Kronrod (SciPy)",
)
def abg_share_of_any_power() -> list[Row]:
    from scipy.integrate import quad

    integral, _ = quad(lambda beta: beta / (0.05 + beta**2.2), 0.0, 1.0)
    return _abg_rows((0.004, 0.05, 2.2), 2.0 * math.pi * 0.004 * integral)

"""Numeric checks of a local model: Snell, total reflection, Brewster, double refraction, energy.

After V. A. Debelov and D. S. Kozlov, "Verification of algorithms of photorealistic rendering of
crystals" (2012), with the statements corrected that hold only under conditions: s-polarised light
at the Brewster angle is reflected in part, totally reflected light is elliptical only if it holds
both s and p, and the ordinary ray leaves a plate polarised across the main plane only if the axis
lies in the plane of incidence.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from tracer.optics.crystals.media import isotropic, uniaxial
from tracer.studies.crystals import crystal_conservation as conservation
from tracer.studies.crystals.crystal_statements import (
    AIR,
    LAMBDA_NM,
    NORMAL,
    Check,
    ellipticity,
    field_angle,
    incident_ray,
    on_side,
    share_of,
)
from tracer.studies.crystals.local_model import LocalModel

__all__ = ["local_checks"]

Real = NDArray[np.float64]


def _snell(model: LocalModel) -> Iterator[Check]:
    coplanar = equal = snell = energy = 0.0
    for n1, n2 in ((1.0, 1.5), (1.5, 1.0), (1.33, 1.62), (2.4, 1.7)):
        critical = np.degrees(np.arcsin(min(n2 / n1, 1.0)))
        for degrees in (0.0, 5.0, 20.0, 0.5 * critical, 0.95 * critical):
            vector, s, p = incident_ray(n1, degrees, 0.7)
            rays = model(
                isotropic(n1), isotropic(n2), vector, (0.6 * s + 0.8 * p) + 0j, NORMAL, LAMBDA_NM
            )
            energy = max(energy, abs(sum(ray.share for ray in rays) - 1.0))
            for ray in rays:
                triple = np.cross(vector / n1, NORMAL) @ ray.direction
                coplanar = max(coplanar, abs(float(triple)))
                sine = float(np.linalg.norm(np.cross(ray.direction, NORMAL)))
                inside = n1 if ray.side == "reflected" else n2
                deviation = abs(inside * sine - n1 * np.sin(np.radians(degrees)))
                if ray.side == "reflected":
                    equal = max(equal, deviation)
                else:
                    snell = max(snell, deviation)
    yield Check(
        name="snell.plane",
        statement="incident, reflected and refracted ray and normal lie in one plane",
        deviation=coplanar,
        limit=1e-12,
    )
    yield Check(
        name="snell.reflection",
        statement="angle of reflection = angle of incidence",
        deviation=equal,
        limit=1e-12,
    )
    yield Check(
        name="snell.refraction",
        statement="n1 sin(a1) = n2 sin(a2)",
        deviation=snell,
        limit=1e-12,
    )
    yield Check(
        name="snell.energy",
        statement="reflected and refracted flux add up to the incident flux",
        deviation=energy,
        limit=1e-12,
    )


def _total_reflection(model: LocalModel) -> Iterator[Check]:
    refracted = energy = linear = phase = unpolarised = 0.0
    n1, n2 = 1.5, 1.0
    first, second = isotropic(n1), isotropic(n2)
    for degrees in (42.0, 45.0, 50.0, 60.0, 80.0):
        vector, s, p = incident_ray(n1, degrees)
        coherency = np.zeros((3, 3), complex)
        for state, pure in ((s, True), (p, True), ((s + p) / np.sqrt(2.0), False)):
            rays = model(first, second, vector, state + 0j, NORMAL, LAMBDA_NM)
            reflected = on_side(rays, "reflected")
            if len(reflected) != 1:
                refracted = 1.0
                continue
            refracted = max(refracted, share_of(rays, "refracted"))
            energy = max(energy, abs(reflected[0].share - 1.0))
            if pure:
                linear = max(linear, ellipticity(reflected[0]))
                e = reflected[0].field
                coherency += np.outer(e, e.conj())
            else:
                # tan(delta / 2) = cos(theta) sqrt(sin^2(theta) - (n2/n1)^2) / sin^2(theta)
                sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
                expected = 2.0 * np.arctan(cosine * np.sqrt(sine**2 - (n2 / n1) ** 2) / sine**2)
                phase = max(phase, abs(ellipticity(reflected[0]) - abs(np.sin(expected))))
        values = np.linalg.eigvalsh(coherency)
        unpolarised = max(unpolarised, float(abs(values[2] - values[1]) / values[2]))
    yield Check(
        name="total_reflection.no_refraction",
        statement="beyond the critical angle nothing is refracted",
        deviation=refracted,
        limit=1e-12,
    )
    yield Check(
        name="total_reflection.energy",
        statement="beyond the critical angle everything is reflected",
        deviation=energy,
        limit=1e-12,
    )
    yield Check(
        name="total_reflection.linear",
        statement="pure s or p light stays linear",
        deviation=linear,
        limit=1e-12,
    )
    yield Check(
        name="total_reflection.elliptical",
        statement="light at 45 deg becomes elliptical by the phase difference of the closed form",
        deviation=phase,
        limit=1e-12,
    )
    yield Check(
        name="total_reflection.natural",
        statement="natural light stays natural",
        deviation=unpolarised,
        limit=1e-12,
    )


def _brewster(model: LocalModel) -> Iterator[Check]:
    polarised = right_angle = absent = partial = linear = 0.0
    for n1, n2 in ((1.0, 1.5), (1.0, 2.0), (1.33, 1.7), (1.5, 1.0)):
        vector, s, p = incident_ray(n1, float(np.degrees(np.arctan(n2 / n1))), -1.1)
        first, second = isotropic(n1), isotropic(n2)
        with_s = model(first, second, vector, s + 0j, NORMAL, LAMBDA_NM)
        with_p = model(first, second, vector, p + 0j, NORMAL, LAMBDA_NM)
        r_s, r_p = share_of(with_s, "reflected"), share_of(with_p, "reflected")
        polarised = max(polarised, 1.0 - abs(r_s - r_p) / (r_s + r_p))
        absent = max(absent, r_p, abs(share_of(with_p, "refracted") - 1.0))
        expected = ((n2**2 - n1**2) / (n2**2 + n1**2)) ** 2
        partial = max(
            partial, abs(r_s - expected), abs(share_of(with_s, "refracted") - (1.0 - expected))
        )
        for ray in with_s:
            linear = max(linear, field_angle(ray.field, s))
        reflected, refracted = on_side(with_s, "reflected")[0], on_side(with_s, "refracted")[0]
        right_angle = max(right_angle, abs(float(reflected.direction @ refracted.direction)))
    yield Check(
        name="brewster.natural",
        statement="the reflection of natural light is fully s-polarised",
        deviation=polarised,
        limit=1e-12,
    )
    yield Check(
        name="brewster.right_angle",
        statement="reflected and refracted ray are perpendicular",
        deviation=right_angle,
        limit=1e-12,
    )
    yield Check(
        name="brewster.p",
        statement="p light is not reflected",
        deviation=absent,
        limit=1e-12,
    )
    yield Check(
        name="brewster.s",
        statement="s light is reflected by ((n2^2 - n1^2) / (n2^2 + n1^2))^2, the rest refracted",
        deviation=partial,
        limit=1e-12,
    )
    yield Check(
        name="brewster.linear",
        statement="s light stays s in both rays",
        deviation=linear,
        limit=1e-12,
    )


def _double_refraction(model: LocalModel) -> Iterator[Check]:
    n_o, n_e = 1.6584, 1.4864
    plane = across = index = walk = back = snell = parallel = 0.0
    for tilt, azimuth in ((44.61, 0.0), (20.0, 1.0), (75.0, 4.0)):
        angle = np.radians(tilt)
        axis = np.array(
            [np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)]
        )
        crystal = uniaxial(n_o, n_e, axis)
        main = np.cross(NORMAL, axis) / np.linalg.norm(np.cross(NORMAL, axis))
        vector = NORMAL.copy()
        for state in (main, np.cross(main, NORMAL)):
            rays = model(AIR, crystal, vector, state + 0j, NORMAL, LAMBDA_NM)
            for ray in on_side(rays, "reflected"):
                back = max(back, float(np.linalg.norm(ray.direction + NORMAL)))
            for ray in on_side(rays, "refracted"):
                if ray.share < 1e-9:
                    continue
                plane = max(plane, abs(float(ray.direction @ main)))
                size = float(np.linalg.norm(ray.refraction_vector))
                if abs(size - n_o) < 1e-6:
                    across = max(across, field_angle(ray.field, main))
                else:
                    across = max(across, abs(ray.field @ main) / np.linalg.norm(ray.field))
                    expected = 1.0 / np.sqrt(
                        (np.cos(angle) / n_o) ** 2 + (np.sin(angle) / n_e) ** 2
                    )
                    index = max(index, abs(size - expected))
                    ray_tilt = np.arctan(n_o**2 / n_e**2 * np.tan(angle))
                    walk = max(walk, abs(float(ray.direction @ axis) - np.cos(ray_tilt)))

        # Any incidence: the ordinary ray obeys Snell, and a plate lets both out parallel
        for degrees in (15.0, 40.0, 70.0):
            vector, s, p = incident_ray(1.0, degrees, 0.3)
            rays = model(AIR, crystal, vector, (s + p) + 0j, NORMAL, LAMBDA_NM)
            sizes = [abs(np.linalg.norm(ray.refraction_vector) - n_o) for ray in rays[-2:]]
            snell = max(snell, float(min(sizes)))
            for ray in on_side(rays, "refracted"):
                out = model(crystal, AIR, ray.refraction_vector, ray.field, NORMAL, LAMBDA_NM)
                for leaving in on_side(out, "refracted"):
                    parallel = max(parallel, float(np.linalg.norm(leaving.direction - vector)))
    yield Check(
        name="double_refraction.plane",
        statement="normal incidence: both rays lie in the main plane",
        deviation=plane,
        limit=1e-12,
    )
    yield Check(
        name="double_refraction.back",
        statement="normal incidence: the reflected ray goes straight back",
        deviation=back,
        limit=1e-12,
    )
    yield Check(
        name="double_refraction.polarisation",
        statement="normal incidence: o polarised across the main plane, e in it",
        deviation=float(across),
        limit=1e-12,
    )
    yield Check(
        name="double_refraction.index",
        statement="index of the e wave is (cos^2/n_o^2 + sin^2/n_e^2)^-1/2",
        deviation=float(index),
        limit=1e-12,
    )
    yield Check(
        name="double_refraction.walk_off",
        statement="e ray at tan(th_S) = (n_o/n_e)^2 tan(th) from the axis",
        deviation=float(walk),
        limit=1e-12,
    )
    yield Check(
        name="double_refraction.ordinary",
        statement="any incidence: the o wave has the index n_o",
        deviation=snell,
        limit=1e-12,
    )
    yield Check(
        name="double_refraction.plate",
        statement="behind a plane-parallel plate both rays are parallel to the incident one",
        deviation=parallel,
        limit=1e-12,
    )


def _closed_forms(model: LocalModel) -> Iterator[Check]:
    n_o, n_e = 1.6584, 1.4864
    worst = 0.0
    for degrees in (0.0, 10.0, 50.0, 80.0):
        vector, s, p = incident_ray(1.0, degrees)
        sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))

        def fresnel_s(n: float, cosine: float = cosine, sine: float = sine) -> float:
            root = np.sqrt(n * n - sine * sine)
            return float(((cosine - root) / (cosine + root)) ** 2)

        def along_p(under: float, cosine: float = cosine) -> float:
            root = np.sqrt(under)
            return float(((n_o * n_e * cosine - root) / (n_o * n_e * cosine + root)) ** 2)

        root_o = np.sqrt(n_o**2 - sine**2)
        p_with_o = float(((n_o**2 * cosine - root_o) / (n_o**2 * cosine + root_o)) ** 2)
        for axis, r_s, r_p in (
            ((0.0, 1.0, 0.0), fresnel_s(n_e), p_with_o),
            ((0.0, 0.0, 1.0), fresnel_s(n_o), along_p(n_e**2 - sine**2)),
            ((1.0, 0.0, 0.0), fresnel_s(n_o), along_p(n_o**2 - sine**2)),
        ):
            crystal = uniaxial(n_o, n_e, axis)
            for state, expected in ((s, r_s), (p, r_p)):
                rays = model(AIR, crystal, vector, state + 0j, NORMAL, LAMBDA_NM)
                worst = max(worst, abs(share_of(rays, "reflected") - expected))
    yield Check(
        name="closed_forms.principal_cuts",
        statement="reflectance of uniaxial crystals cut along and across their axis",
        deviation=worst,
        limit=1e-12,
    )


_GROUPS: tuple[Callable[[LocalModel], Iterator[Check]], ...] = (
    _snell,
    _total_reflection,
    _brewster,
    _double_refraction,
    _closed_forms,
    conservation.energy,
    conservation.reciprocity,
)


def local_checks(model: LocalModel) -> Iterator[Check]:
    """All checks of a local model, one after the other.

    A model that raises, or returns no ray where one must be, fails the group.
    """
    for group in _GROUPS:
        name = group.__name__.strip("_")
        try:
            yield from group(model)
        except Exception as error:  # another's model may fail in any way
            yield Check(
                name=f"{name}.failed",
                statement=f"the model raised {type(error).__name__}: {error}",
                deviation=float("inf"),
                limit=0.0,
            )

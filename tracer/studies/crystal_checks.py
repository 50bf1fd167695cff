"""Numeric checks of a local model: Snell, total reflection, Brewster, double refraction, energy.

After V. A. Debelov and D. S. Kozlov, "Verification of algorithms of photorealistic rendering of
crystals" (2012), with the statements corrected that hold only under conditions: s-polarised light
at the Brewster angle is reflected in part, totally reflected light is elliptical only if it holds
both s and p, and the ordinary ray leaves a plate polarised across the main plane only if the axis
lies in the plane of incidence.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracer.crystals.local import s_and_p
from tracer.crystals.local_model import LocalModel, OutgoingRay
from tracer.crystals.media import Crystal, biaxial, isotropic, rotation_between, uniaxial
from tracer.crystals.waves import waves_along

__all__ = ["Check", "local_checks"]

Real = NDArray[np.float64]
Complex = NDArray[Any]

_NORMAL = np.array([0.0, 0.0, 1.0])
_LAMBDA = 589.3
_AIR = isotropic(1.0, name="air")


@dataclass(frozen=True, kw_only=True)
class Check:
    """One statement that was tested.

    Attributes
    ----------
    name : dotted, group first
    statement : what must hold
    deviation : largest deviation measured
    limit : largest deviation allowed
    picture : file name of a picture that shows it, or ""
    """

    name: str
    statement: str
    deviation: float
    limit: float
    picture: str = ""

    @property
    def passed(self) -> bool:
        """Whether the deviation is a number within the limit."""
        return bool(self.deviation <= self.limit)


def _incident(index: float, degrees: float, azimuth: float = 0.0) -> tuple[Real, Real, Real]:
    """Refraction vector, s and p of a ray towards +z."""
    angle = np.radians(degrees)
    d = np.array([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)])
    s, p = s_and_p(d, _NORMAL)
    return index * d, s[0], p[0]


def _side(rays: list[OutgoingRay], side: str) -> list[OutgoingRay]:
    return [ray for ray in rays if ray.side == side]


def _share(rays: list[OutgoingRay], side: str) -> float:
    return float(sum(ray.share for ray in _side(rays, side)))


def _ellipticity(ray: OutgoingRay) -> float:
    """|Im(E x E*)| / |E|^2: 0 for linear light, 1 for circular."""
    e = ray.field
    return float(np.linalg.norm(np.cross(e, e.conj())) / np.vdot(e, e).real)


def _field_angle(field: Complex, along: Real) -> float:
    """Share of a field's amplitude that is not along a unit vector."""
    e = np.asarray(field)
    rest = e - (e @ along) * along
    return float(np.linalg.norm(rest) / np.linalg.norm(e))


def _snell(model: LocalModel) -> Iterator[Check]:
    coplanar = equal = snell = energy = 0.0
    for n1, n2 in ((1.0, 1.5), (1.5, 1.0), (1.33, 1.62), (2.4, 1.7)):
        critical = np.degrees(np.arcsin(min(n2 / n1, 1.0)))
        for degrees in (0.0, 5.0, 20.0, 0.5 * critical, 0.95 * critical):
            vector, s, p = _incident(n1, degrees, 0.7)
            rays = model(
                isotropic(n1), isotropic(n2), vector, (0.6 * s + 0.8 * p) + 0j, _NORMAL, _LAMBDA
            )
            energy = max(energy, abs(sum(ray.share for ray in rays) - 1.0))
            for ray in rays:
                triple = np.cross(vector / n1, _NORMAL) @ ray.direction
                coplanar = max(coplanar, abs(float(triple)))
                sine = float(np.linalg.norm(np.cross(ray.direction, _NORMAL)))
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
        vector, s, p = _incident(n1, degrees)
        coherency = np.zeros((3, 3), complex)
        for state, pure in ((s, True), (p, True), ((s + p) / np.sqrt(2.0), False)):
            rays = model(first, second, vector, state + 0j, _NORMAL, _LAMBDA)
            reflected = _side(rays, "reflected")
            if len(reflected) != 1:
                refracted = 1.0
                continue
            refracted = max(refracted, _share(rays, "refracted"))
            energy = max(energy, abs(reflected[0].share - 1.0))
            if pure:
                linear = max(linear, _ellipticity(reflected[0]))
                e = reflected[0].field
                coherency += np.outer(e, e.conj())
            else:
                # tan(delta / 2) = cos(theta) sqrt(sin^2(theta) - (n2/n1)^2) / sin^2(theta)
                sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
                expected = 2.0 * np.arctan(cosine * np.sqrt(sine**2 - (n2 / n1) ** 2) / sine**2)
                phase = max(phase, abs(_ellipticity(reflected[0]) - abs(np.sin(expected))))
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
        vector, s, p = _incident(n1, float(np.degrees(np.arctan(n2 / n1))), -1.1)
        first, second = isotropic(n1), isotropic(n2)
        with_s = model(first, second, vector, s + 0j, _NORMAL, _LAMBDA)
        with_p = model(first, second, vector, p + 0j, _NORMAL, _LAMBDA)
        r_s, r_p = _share(with_s, "reflected"), _share(with_p, "reflected")
        polarised = max(polarised, 1.0 - abs(r_s - r_p) / (r_s + r_p))
        absent = max(absent, r_p, abs(_share(with_p, "refracted") - 1.0))
        expected = ((n2**2 - n1**2) / (n2**2 + n1**2)) ** 2
        partial = max(
            partial, abs(r_s - expected), abs(_share(with_s, "refracted") - (1.0 - expected))
        )
        for ray in with_s:
            linear = max(linear, _field_angle(ray.field, s))
        reflected, refracted = _side(with_s, "reflected")[0], _side(with_s, "refracted")[0]
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
        main = np.cross(_NORMAL, axis) / np.linalg.norm(np.cross(_NORMAL, axis))
        vector = _NORMAL.copy()
        for state in (main, np.cross(main, _NORMAL)):
            rays = model(_AIR, crystal, vector, state + 0j, _NORMAL, _LAMBDA)
            for ray in _side(rays, "reflected"):
                back = max(back, float(np.linalg.norm(ray.direction + _NORMAL)))
            for ray in _side(rays, "refracted"):
                if ray.share < 1e-9:
                    continue
                plane = max(plane, abs(float(ray.direction @ main)))
                size = float(np.linalg.norm(ray.refraction_vector))
                if abs(size - n_o) < 1e-6:
                    across = max(across, _field_angle(ray.field, main))
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
            vector, s, p = _incident(1.0, degrees, 0.3)
            rays = model(_AIR, crystal, vector, (s + p) + 0j, _NORMAL, _LAMBDA)
            sizes = [abs(np.linalg.norm(ray.refraction_vector) - n_o) for ray in rays[-2:]]
            snell = max(snell, float(min(sizes)))
            for ray in _side(rays, "refracted"):
                out = model(crystal, _AIR, ray.refraction_vector, ray.field, _NORMAL, _LAMBDA)
                for leaving in _side(out, "refracted"):
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
        vector, s, p = _incident(1.0, degrees)
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
                rays = model(_AIR, crystal, vector, state + 0j, _NORMAL, _LAMBDA)
                worst = max(worst, abs(_share(rays, "reflected") - expected))
    yield Check(
        name="closed_forms.principal_cuts",
        statement="reflectance of uniaxial crystals cut along and across their axis",
        deviation=worst,
        limit=1e-12,
    )


def _energy(model: LocalModel) -> Iterator[Check]:
    def total(first: Crystal, second: Crystal, vector: Real, field: Complex) -> float:
        rays = model(first, second, vector, field, _NORMAL, _LAMBDA)
        return abs(sum(ray.share for ray in rays) - 1.0)

    # At and near a binormal that stands on the face
    crystal = biaxial(1.3, 1.4, 1.5)
    turn = rotation_between(crystal.binormals(_LAMBDA)[0], _NORMAL)
    cut = crystal.turned(turn)
    worst = 0.0
    for exponent in range(17):
        for azimuth in np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False):
            offset = 0.0 if exponent == 16 else 10.0**-exponent * 0.1
            vector, s, p = _incident(1.0, float(np.degrees(offset)), float(azimuth))
            for state in (s, p):
                worst = max(worst, total(_AIR, cut, vector, state + 0j))
    yield Check(
        name="energy.binormal",
        statement="fluxes add up at any distance from a binormal, down to 0",
        deviation=worst,
        limit=1e-12,
    )

    # At and near the optic axis of a uniaxial crystal
    crystal = uniaxial(1.6584, 1.4864)
    worst = 0.0
    for exponent in range(17):
        offset = 0.0 if exponent == 16 else 10.0**-exponent * 0.1
        vector, s, p = _incident(1.0, float(np.degrees(offset)), 0.4)
        for state in (s, p):
            worst = max(worst, total(_AIR, crystal, vector, state + 0j))
    yield Check(
        name="energy.optic_axis",
        statement="fluxes add up at any distance from the optic axis",
        deviation=worst,
        limit=1e-12,
    )

    # From a dense medium through all critical angles and mixed regimes
    dense = isotropic(2.0)
    worst = 0.0
    for indices in ((1.4, 1.6, 1.7), (1.4, 1.4, 1.7), (1.5, 1.5, 1.5)):
        for turn_axis, angle in (((0.0, 0.0, 1.0), 0.0), ((1.0, 2.0, 3.0), 0.7)):
            crystal = Crystal(indices=indices, orientation=_turn(turn_axis, angle))
            edges = [np.arcsin(n / 2.0) for n in indices]
            steps = [e + d for e in edges for d in (-1e-6, -1e-10, -1e-14, 0.0, 1e-14, 1e-10, 1e-6)]
            for incidence in (*np.linspace(0.0, 1.57, 40), *steps):
                vector, s, p = _incident(2.0, float(np.degrees(incidence)))
                for state in (s, p):
                    worst = max(worst, total(dense, crystal, vector, state + 0j))
    yield Check(
        name="energy.critical",
        statement="fluxes add up at critical angles and where one wave decays and one travels",
        deviation=worst,
        limit=1e-12,
    )

    # Out of a crystal, at all angles
    worst = 0.0
    generator = np.random.default_rng(7)
    crystal = Crystal(indices=(1.3, 1.4, 1.5), orientation=_turn((1.0, 1.0, 1.0), 0.9))
    normals = generator.normal(size=(200, 3))
    waves = waves_along(crystal, normals / np.linalg.norm(normals, axis=1)[:, None], _LAMBDA)
    for k in range(200):
        for j in range(2):
            vector, flow = waves.refraction_vector[k, j], waves.direction[k, j]
            if flow[2] > 1e-3:
                worst = max(worst, total(crystal, _AIR, vector, waves.field[k, j] + 0j))
    yield Check(
        name="energy.out_of_crystal",
        statement="fluxes add up for light that meets the boundary from inside a crystal",
        deviation=worst,
        limit=1e-12,
    )


def _turn(axis: tuple[float, float, float], angle: float) -> Real:
    a = np.asarray(axis) / np.linalg.norm(axis)
    k = np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
    result: Real = np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * k @ k
    return result


def _reciprocity(model: LocalModel) -> Iterator[Check]:
    """In through a face and back out along the same wave: the same shares."""
    worst = 0.0
    generator = np.random.default_rng(3)
    for _ in range(40):
        crystal = Crystal(
            indices=(1.3, 1.45, 1.6), orientation=_turn(tuple(generator.normal(size=3)), 1.0)
        )
        vector, s, p = _incident(1.0, float(generator.uniform(0.0, 80.0)))
        forward = [model(_AIR, crystal, vector, e + 0j, _NORMAL, _LAMBDA) for e in (s, p)]
        for k in range(2):
            refracted = [_side(rays, "refracted") for rays in forward]
            if any(len(rays) != 2 for rays in refracted):
                continue
            ray = refracted[0][k]
            back = model(crystal, _AIR, -ray.refraction_vector, ray.field, -_NORMAL, _LAMBDA)
            out = _share(back, "refracted")
            worst = max(worst, abs(out - refracted[0][k].share - refracted[1][k].share))
    yield Check(
        name="reciprocity",
        statement="a wave leaves a crystal with the shares of s and p light that feed it",
        deviation=worst,
        limit=1e-12,
    )


_GROUPS: tuple[Callable[[LocalModel], Iterator[Check]], ...] = (
    _snell,
    _total_reflection,
    _brewster,
    _double_refraction,
    _closed_forms,
    _energy,
    _reciprocity,
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

"""Checks of a local model where light is easily lost: near axes, at critical angles, and back."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracer.optics.crystals.media import Crystal, biaxial, isotropic, rotation_between, uniaxial
from tracer.optics.crystals.waves import waves_along
from tracer.studies.crystals.crystal_statements import (
    AIR,
    LAMBDA_NM,
    NORMAL,
    Check,
    incident_ray,
    on_side,
    share_of,
)
from tracer.studies.crystals.local_model import LocalModel

__all__ = ["energy", "reciprocity"]

Real = NDArray[np.float64]
Complex = NDArray[Any]


def energy(model: LocalModel) -> Iterator[Check]:
    """Fluxes add up to that of the incident light."""

    def total(first: Crystal, second: Crystal, vector: Real, field: Complex) -> float:
        rays = model(first, second, vector, field, NORMAL, LAMBDA_NM)
        return abs(sum(ray.share for ray in rays) - 1.0)

    # At and near a binormal that stands on the face
    crystal = biaxial(1.3, 1.4, 1.5)
    turn = rotation_between(crystal.binormals(LAMBDA_NM)[0], NORMAL)
    cut = crystal.turned(turn)
    worst = 0.0
    for exponent in range(17):
        for azimuth in np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False):
            offset = 0.0 if exponent == 16 else 10.0**-exponent * 0.1
            vector, s, p = incident_ray(1.0, float(np.degrees(offset)), float(azimuth))
            for state in (s, p):
                worst = max(worst, total(AIR, cut, vector, state + 0j))
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
        vector, s, p = incident_ray(1.0, float(np.degrees(offset)), 0.4)
        for state in (s, p):
            worst = max(worst, total(AIR, crystal, vector, state + 0j))
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
                vector, s, p = incident_ray(2.0, float(np.degrees(incidence)))
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
    waves = waves_along(crystal, normals / np.linalg.norm(normals, axis=1)[:, None], LAMBDA_NM)
    for k in range(200):
        for j in range(2):
            vector, flow = waves.refraction_vector[k, j], waves.direction[k, j]
            if flow[2] > 1e-3:
                worst = max(worst, total(crystal, AIR, vector, waves.field[k, j] + 0j))
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


def reciprocity(model: LocalModel) -> Iterator[Check]:
    """In through a face and back out along the same wave: the same shares."""
    worst = 0.0
    generator = np.random.default_rng(3)
    for _ in range(40):
        crystal = Crystal(
            indices=(1.3, 1.45, 1.6), orientation=_turn(tuple(generator.normal(size=3)), 1.0)
        )
        vector, s, p = incident_ray(1.0, float(generator.uniform(0.0, 80.0)))
        forward = [model(AIR, crystal, vector, e + 0j, NORMAL, LAMBDA_NM) for e in (s, p)]
        for k in range(2):
            refracted = [on_side(rays, "refracted") for rays in forward]
            if any(len(rays) != 2 for rays in refracted):
                continue
            ray = refracted[0][k]
            back = model(crystal, AIR, -ray.refraction_vector, ray.field, -NORMAL, LAMBDA_NM)
            out = share_of(back, "refracted")
            worst = max(worst, abs(out - refracted[0][k].share - refracted[1][k].share))
    yield Check(
        name="reciprocity",
        statement="a wave leaves a crystal with the shares of s and p light that feed it",
        deviation=worst,
        limit=1e-12,
    )

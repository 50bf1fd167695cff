"""Directions about another one: unit vectors at the angle and azimuth that were asked for."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import kernel
from raymap.optics.angles import turned
from tracer.rays.directions import about

F64 = NDArray[np.float64]


@kernel
def _turned(u: F64, out: F64) -> None:
    for i in range(len(u)):
        out[i, 0], out[i, 1] = turned(u[i])


@kernel
def _about(normals: F64, cosines: F64, u: F64, out: F64) -> None:
    for i in range(len(u)):
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        cosine = cosines[i]
        sine = math.sqrt((1.0 - cosine) * (1.0 + cosine))
        out[i] = about(nx, ny, nz, cosine, sine, u[i])


def _turns(rng: np.random.Generator, n: int) -> F64:
    """Azimuths in turns; eighths lie on the borders between the polynomials."""
    u = rng.random(n)
    u[:800] = np.tile(np.arange(8) / 8.0, 100)
    u[800] = np.nextafter(1.0, 0.0)
    return u


def test_cosine_and_sine_of_turns_are_exact_to_a_rounding() -> None:
    u = _turns(np.random.default_rng(2), 200_000)
    found = np.empty((len(u), 2))
    _turned(u, found)
    # In extended precision; 2 pi has to be as exact
    angle = u.astype(np.longdouble) * (2 * np.longdouble("3.14159265358979323846264338327950288"))
    exact = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    assert np.finfo(np.longdouble).nmant > 60
    assert np.abs(found - exact).max() < 2.3e-16


def test_directions_keep_length_angle_and_azimuth() -> None:
    rng = np.random.default_rng(3)
    n = 100_000
    normals = rng.normal(size=(n, 3))
    normals[:6] = np.concatenate((np.eye(3), -np.eye(3)))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    u, cosines = _turns(rng, n), rng.uniform(-1.0, 1.0, n)
    cosines[:3] = 1.0, -1.0, 0.0
    found, opposite = np.empty((n, 3)), np.empty((n, 3))
    _about(normals, cosines, u, found)
    assert np.abs(np.linalg.norm(found, axis=1) - 1.0).max() < 1e-15
    assert np.abs((found * normals).sum(axis=1) - cosines).max() < 2e-15
    # Half a turn further the part across the normal is the opposite, a quarter further at a right
    # angle, in the positive sense about the normal
    across = found - cosines[:, None] * normals
    _about(normals, cosines, (u + 0.5) % 1.0, opposite)
    assert np.abs(across + opposite - cosines[:, None] * normals).max() < 4e-15
    _about(normals, cosines, (u + 0.25) % 1.0, opposite)
    quarter = opposite - cosines[:, None] * normals
    assert np.abs(np.cross(normals, across) - quarter).max() < 4e-15

"""Directions about a normal: unit vectors at the angle and azimuth that were asked for."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from raymap.kernels import kernel
from tracer.engine.directions import about, about_turn

F64 = NDArray[np.float64]


@kernel
def _both(normals: F64, u: F64, v: F64, by_angle: F64, by_turn: F64) -> None:
    for i in range(len(u)):
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        cosine, sine = math.sqrt(1.0 - u[i]), math.sqrt(u[i])
        by_angle[i] = about(nx, ny, nz, cosine, 2.0 * math.pi * v[i])
        by_turn[i] = about_turn(nx, ny, nz, cosine, sine, v[i])


def test_turns_and_angles_give_the_same_unit_vectors() -> None:
    rng = np.random.default_rng(3)
    n = 100_000
    normals = rng.normal(size=(n, 3))
    normals[:6] = np.concatenate((np.eye(3), -np.eye(3)))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    u, v = rng.random(n), rng.random(n)
    # Eighths of a turn lie on the borders between the polynomials
    v[: 8 * 100] = np.tile(np.arange(8) / 8.0, 100)
    v[800], u[800:802] = np.nextafter(1.0, 0.0), (0.0, np.nextafter(1.0, 0.0))
    by_angle, by_turn = np.empty((n, 3)), np.empty((n, 3))
    _both(normals, u, v, by_angle, by_turn)
    # The sine loses places where it is found from the cosine
    lost = 2e-16 / np.sqrt(np.maximum(u, 1e-16))
    assert np.all(np.abs(by_turn - by_angle).max(axis=1) < 2e-15 + lost)
    for found in (by_angle, by_turn):
        assert np.abs(np.linalg.norm(found, axis=1) - 1.0).max() < 1e-15
        assert np.abs((found * normals).sum(axis=1) - np.sqrt(1.0 - u)).max() < 2e-15

"""Adding–doubling with Fresnel faces, step by step: a thin layer doubled, then two faces added.

Slow and plain; the exact plate model must give the same numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["doubled_plate"]

Matrix = NDArray[np.float64]


def doubled_plate(
    *,
    scattering: float,
    absorption: float,
    moments: NDArray[np.float64],
    thickness: float,
    index: float,
    nodes: int,
    doublings: int,
) -> tuple[NDArray[np.float64], Matrix, Matrix]:
    """Flux matrices of a plate in air.

    Returns
    -------
    cosines : (n,) outside cosines of the nodes inside the critical cone
    reflection, transmission : (n, n) flux leaving at node i per flux incident at node j, from
        and to air
    """
    critical = np.sqrt(1.0 - 1.0 / index**2)
    x, w = np.polynomial.legendre.leggauss(nodes)
    mu = np.concatenate((critical * (x + 1) / 2, critical + (1 - critical) * (x + 1) / 2))
    weight = np.concatenate((critical * w / 2, (1 - critical) * w / 2))
    order = moments.size - 1
    p_forward = np.zeros((mu.size, mu.size))
    p_backward = np.zeros((mu.size, mu.size))
    for degree in range(order + 1):
        legendre = np.polynomial.legendre.Legendre.basis(degree)(mu)
        term = (2 * degree + 1) * moments[degree] * np.outer(legendre, legendre) / 2
        p_forward += term
        p_backward += (-1) ** degree * term
    # A layer thin enough for single scattering, corrected to second order by its own loss
    depth = thickness / 2**doublings
    reflection = depth * scattering * p_backward * weight[:, None] / mu[None, :]
    transmission = np.diag(1.0 - depth * (scattering + absorption) / mu)
    transmission += depth * scattering * p_forward * weight[:, None] / mu[None, :]
    for _ in range(doublings):
        reflection, transmission = _add_equal(reflection, transmission)
    # Put the face in air on both sides
    sin2 = index**2 * (1 - mu**2)
    cos_out = np.sqrt(np.maximum(0.0, 1 - sin2))
    r_s = (index * mu - cos_out) / (index * mu + cos_out)
    r_p = (mu - index * cos_out) / (mu + index * cos_out)
    face = np.where(sin2 >= 1, 1.0, (r_s**2 + r_p**2) / 2)
    let_in = np.diag(1 - face)
    even = _between_faces(reflection + transmission, face)
    odd = _between_faces(reflection - transmission, face)
    inner = [let_in @ both @ let_in for both in (even, odd)]
    cone = mu > critical
    r = np.diag(face) + (inner[0] + inner[1]) / 2
    t = (inner[0] - inner[1]) / 2
    return cos_out[cone], r[np.ix_(cone, cone)], t[np.ix_(cone, cone)]


def _add_equal(reflection: Matrix, transmission: Matrix) -> tuple[Matrix, Matrix]:
    """Two equal layers on each other."""
    identity = np.eye(len(reflection))
    between = np.linalg.solve(identity - reflection @ reflection, transmission)
    return reflection + transmission @ reflection @ between, transmission @ between


def _between_faces(operator: Matrix, face: NDArray[np.float64]) -> Matrix:
    """Flux that meets the faces from inside after all internal reflections."""
    identity = np.eye(len(operator))
    return operator @ np.linalg.inv(identity - face[:, None] * operator)

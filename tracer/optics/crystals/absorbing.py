"""Absorbing crystals exactly: complex tensors at interfaces and in plates.

The tracing engines use the real tensor at interfaces and let each wave decay along its ray, which
is right for weak absorption. Here the tensor is complex. The waves of such a crystal are not
orthogonal in power, so shares of single waves have no meaning: fields outside and totals have.

Plates need no waves at all. A thin slice is the matrix exponential of Berreman's equation, and
slices are doubled as scattering matrices: nothing grows however thick and dark the plate is, and
singular axes, where two waves and their fields coincide (Voigt waves), are no special case. A half
space takes the plane of its two forward waves as the range of (D - q3)(D - q4), q3 and q4 being the
backward ones, which stays well defined where the forward waves coincide.

References
----------
D. W. Berreman, J. Opt. Soc. Am. 62, 502 (1972). W. Voigt, Phil. Mag. 4, 90 (1902).
L. Li, J. Opt. Soc. Am. A 13, 1024 (1996): scattering matrices of layers.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.model.errors import SceneError
from tracer.optics.crystals.media import Crystal
from tracer.optics.crystals.plates import jones_bases, outside_fields

__all__ = ["absorbing_interface", "absorbing_plate", "berreman_matrices"]

Real = NDArray[np.float64]
Complex = NDArray[Any]
Scattering = tuple[Complex, Complex, Complex, Complex]
"""Front reflection, backward transmission, forward transmission, reflection from behind."""

_TAYLOR = 18
_J = np.array([[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1], [0, 0, 1, 0]], np.float64)


def berreman_matrices(medium: Crystal, x: Real, y: Real, wavelength_nm: float) -> Complex:
    """(..., 4, 4) matrices D of d(Psi)/dz = i k0 D Psi, Psi = (E_r, H_a, E_a, -H_r).

    r points along the tangential refraction vector (x, y), a lies at 90 degrees to it.
    """
    xi = np.hypot(x, y)
    radius = np.where(xi > 0.0, xi, 1.0)
    cosine, sine = np.where(xi > 0.0, x / radius, 1.0), np.where(xi > 0.0, y / radius, 0.0)
    frame = np.zeros((*xi.shape, 3, 3))
    frame[..., 0, 0], frame[..., 0, 1] = cosine, sine
    frame[..., 1, 0], frame[..., 1, 1] = -sine, cosine
    frame[..., 2, 2] = 1.0
    e = frame @ medium.complex_tensor(wavelength_nm) @ np.swapaxes(frame, -1, -2)
    e33 = e[..., 2, 2]
    d = np.zeros((*xi.shape, 4, 4), np.complex128)
    d[..., 0, 0], d[..., 0, 1] = -xi * e[..., 2, 0] / e33, 1.0 - xi**2 / e33
    d[..., 0, 2] = -xi * e[..., 2, 1] / e33
    d[..., 1, 0] = e[..., 0, 0] - e[..., 0, 2] * e[..., 2, 0] / e33
    d[..., 1, 1] = -xi * e[..., 0, 2] / e33
    d[..., 1, 2] = e[..., 0, 1] - e[..., 0, 2] * e[..., 2, 1] / e33
    d[..., 2, 3] = 1.0
    d[..., 3, 0] = e[..., 1, 0] - e[..., 1, 2] * e[..., 2, 0] / e33
    d[..., 3, 1] = -xi * e[..., 1, 2] / e33
    d[..., 3, 2] = e[..., 1, 1] - e[..., 1, 2] * e[..., 2, 1] / e33 - xi**2
    return d


def absorbing_plate(
    medium: Crystal,
    s_x: ArrayLike,
    s_y: ArrayLike,
    thickness_mm: float,
    wavelength_nm: float,
    *,
    n_before: float = 1.0,
    n_after: float = 1.0,
) -> tuple[Complex, Complex]:
    """Transmitted and reflected Jones matrices of an absorbing plate, exact.

    Parameters, order and basis "sp" as of `tracer.optics.crystals.plates.plate_jones`.
    """
    if not thickness_mm > 0.0:
        raise SceneError(f"plate: thickness_mm is {thickness_mm:g}, it must be positive")
    x, y, xi = _outer(s_x, s_y, n_before)
    _check_outside(n_after, "n_after")
    d = berreman_matrices(medium, x, y, wavelength_nm)
    # A lossless medium of about the same index carries the slices
    n_own = float(np.sqrt(np.abs(medium.complex_tensor(wavelength_nm)).max()))
    carrier = max(n_own, 1.2 * float(xi.max(initial=0.0)))
    phase = 2.0 * np.pi * thickness_mm * 1e6 / wavelength_nm
    norm = float(np.abs(d).sum(axis=-1).max())
    doublings = max(0, int(np.ceil(np.log2(2.0 * phase * norm))))
    slices = _exponential(1j * phase / 2.0**doublings * d)
    forward, backward = outside_fields(carrier, xi, 1.0), outside_fields(carrier, xi, -1.0)
    basis = np.concatenate([forward, backward], -1)
    inner = _of_transfer(np.linalg.solve(basis, slices @ basis))
    for _ in range(doublings):
        inner = _joined(inner, inner)
    front = _between(n_before, carrier, xi)
    back = _between(carrier, n_after, xi)
    reflection, _, transmission, _ = _joined(_joined(front, inner), back)
    return jones_bases(transmission, reflection)


def absorbing_interface(
    medium: Crystal, s_x: ArrayLike, s_y: ArrayLike, wavelength_nm: float, *, n_before: float = 1.0
) -> tuple[Complex, Real]:
    """Reflected Jones matrix of an absorbing half space, and the flux that enters it.

    Returns
    -------
    reflection : (..., 2, 2) field amplitudes along s and p, [out, in]
    entering : (..., 2) share of the flux of s and of p light that passes the face; with the
        reflected one it adds up to 1
    """
    x, y, xi = _outer(s_x, s_y, n_before)
    d = berreman_matrices(medium, x, y, wavelength_nm)
    inside = _forward_plane(d)
    incident, reflected = outside_fields(n_before, xi, 1.0), outside_fields(n_before, xi, -1.0)
    parts = np.linalg.solve(np.concatenate([inside, -reflected], -1), incident)
    fields = inside @ parts[..., :2, :]
    own = np.einsum("...ik,ij,...jk->...k", incident.conj(), _J, incident).real
    through = np.einsum("...ik,ij,...jk->...k", fields.conj(), _J, fields).real
    _, reflection = jones_bases(parts[..., 2:, :], parts[..., 2:, :])
    # The basis of the fields is p, s
    return reflection, (through / own)[..., ::-1]


def _check_outside(index: float, name: str) -> None:
    """Refuse crystals and absorbing media outside."""
    if isinstance(index, Crystal) or not (np.isrealobj(index) and 0.0 < float(index) < np.inf):
        what = f"crystal {index.name!r}" if isinstance(index, Crystal) else repr(index)
        raise SceneError(
            f"plate: {name} is {what}; an absorbing crystal needs a clear isotropic medium there: "
            "give its index, a positive number"
        )


def _outer(s_x: ArrayLike, s_y: ArrayLike, n_before: float) -> tuple[Real, Real, Real]:
    _check_outside(n_before, "n_before")
    x, y = np.broadcast_arrays(np.asarray(s_x, np.float64), np.asarray(s_y, np.float64))
    xi = np.hypot(x, y)
    if np.any(xi >= n_before):
        raise SceneError("plate: (s_x, s_y) must be shorter than n_before, the index outside")
    return x, y, xi


def _exponential(m: Complex) -> Complex:
    """exp(m) of small matrices by its series."""
    out = np.zeros_like(m) + np.eye(4)
    term = out
    for order in range(1, _TAYLOR + 1):
        term = term @ m / order
        out = out + term
    return out


def _of_transfer(t: Complex) -> Scattering:
    """Scattering matrix of a transfer matrix over forward and backward amplitudes."""
    a, b = t[..., :2, :2], t[..., :2, 2:]
    c, d = t[..., 2:, :2], t[..., 2:, 2:]
    inverse = np.linalg.inv(d)
    return -inverse @ c, inverse, a - b @ inverse @ c, b @ inverse


def _joined(first: Scattering, second: Scattering) -> Scattering:
    """Two layers one behind the other (Redheffer's star product)."""
    r1, u1, t1, b1 = first
    r2, u2, t2, b2 = second
    one = np.eye(2)
    down = np.linalg.solve(one - b1 @ r2, np.concatenate([t1, b1 @ u2], -1))
    straight, returned = down[..., :2], down[..., 2:]
    # Waves between the layers: forward ``straight`` from before, ``returned`` from behind
    return (
        r1 + u1 @ r2 @ straight,
        u1 @ (u2 + r2 @ returned),
        t2 @ straight,
        b2 + t2 @ returned,
    )


def _between(n_first: float, n_second: float, xi: Real) -> Scattering:
    """The face between two isotropic media."""
    before = [outside_fields(n_first, xi, sign) for sign in (1.0, -1.0)]
    behind = [outside_fields(n_second, xi, sign) for sign in (1.0, -1.0)]
    left = np.concatenate([behind[0], -before[1]], -1)
    from_front = np.linalg.solve(left, before[0])
    from_behind = np.linalg.solve(left, -behind[1])
    return (
        from_front[..., 2:, :],
        from_behind[..., 2:, :],
        from_front[..., :2, :],
        from_behind[..., :2, :],
    )


def _forward_plane(d: Complex) -> Complex:
    """(..., 4, 2) orthonormal basis of the fields that travel or decay forward."""
    q, fields = np.linalg.eig(d)
    power = np.einsum("...ik,ij,...jk->...k", fields.conj(), _J, fields).real
    decay = q.imag / np.abs(q).max(axis=-1, keepdims=True)
    # Decay decides where there is any, the flow of power elsewhere
    score = np.where(np.abs(decay) > 1e-9, np.sign(decay) * (1.0 + np.abs(decay)), power)
    order = np.argsort(-score, axis=-1)
    backward = np.take_along_axis(q, order, axis=-1)[..., 2:, np.newaxis, np.newaxis]
    one = np.eye(4)
    both = (d - backward[..., 0, :, :] * one) @ (d - backward[..., 1, :, :] * one)
    plane: Complex = np.linalg.svd(both)[0][..., :2]
    return plane

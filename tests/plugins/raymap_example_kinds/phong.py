"""A surface of kind ``phong``: a diffuse part and a lobe about the mirrored direction."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import lean_kernel
from tracer.description.fields import Positive, Share
from tracer.surfaces.law import Law
from tracer.surfaces.surface import Surface, SurfaceRow

__all__ = ["Phong"]

F64 = NDArray[np.float64]


@lean_kernel
def sample(
    own: F64, wx: float, wy: float, wz: float, n1: float, n2: float, u1: float, u2: float, u3: float
) -> tuple[float, float, float]:
    """A direction of the diffuse part or of the lobe, in proportion to what they reflect."""
    azimuth = 2.0 * math.pi * u2
    if u3 * (own[0] + own[1]) < own[0]:
        radius = math.sqrt(u1)
        return radius * math.cos(azimuth), radius * math.sin(azimuth), math.sqrt(1.0 - u1)
    # About the mirrored direction m = (-wx, -wy, wz)
    cosine = u1 ** (1.0 / (own[2] + 1.0))
    sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
    across = math.sqrt(wx * wx + wy * wy)
    ux, uy = (-wy / across, wx / across) if across > 1e-9 else (1.0, 0.0)
    # v = m x u
    vx, vy, vz = -wz * uy, wz * ux, -wx * uy + wy * ux
    p, q = sine * math.cos(azimuth), sine * math.sin(azimuth)
    return p * ux + q * vx - cosine * wx, p * uy + q * vy - cosine * wy, q * vz + cosine * wz


@lean_kernel
def lobe(wx: float, wy: float, wz: float, x: float, y: float, z: float, exponent: float) -> float:
    """cos^n of the angle to the mirrored direction."""
    cosine = -wx * x - wy * y + wz * z
    return float(cosine**exponent) if cosine > 0.0 else 0.0


@lean_kernel
def pdf(
    own: F64, wx: float, wy: float, wz: float, x: float, y: float, z: float, n1: float, n2: float
) -> float:
    """Density of `sample` per solid angle; the lobe reaches below the surface."""
    diffuse = max(0.0, z) / math.pi
    glossy = (own[2] + 1.0) / (2.0 * math.pi) * lobe(wx, wy, wz, x, y, z, own[2])
    return float((own[0] * diffuse + own[1] * glossy) / (own[0] + own[1]))


@lean_kernel
def evaluate(
    own: F64, wx: float, wy: float, wz: float, x: float, y: float, z: float, n1: float, n2: float,
    channel: int,
) -> float:  # fmt: skip
    """The BSDF; none below the surface."""
    if z <= 0.0:
        return 0.0
    glossy = (own[2] + 1.0) / (2.0 * math.pi) * lobe(wx, wy, wz, x, y, z, own[2])
    return float(own[0] / math.pi + own[1] * glossy)


class Phong(Surface):
    """``diffuse`` reflectance and a lobe cos^n of the exponent ``exponent``, reciprocal.

    The lobe sends on ``glossy`` of the light at most: less at grazing incidence, where it reaches
    below the surface.

    References
    ----------
    E. P. Lafortune, Y. D. Willems, Using the modified Phong reflectance model for physically based
    rendering, K. U. Leuven, CW 197 (1994).
    """

    kind: Literal["phong"] = "phong"
    diffuse: Share = 0.0
    glossy: Share
    exponent: Positive

    law = Law(sample=sample, evaluate=evaluate, pdf=pdf)

    def model_post_init(self, context: Any) -> None:
        if self.diffuse + self.glossy > 1.0:
            raise ValueError("diffuse and glossy are more than 1 together")

    def compile(self, row: SurfaceRow) -> None:
        row.set_own([self.diffuse, self.glossy, self.exponent])

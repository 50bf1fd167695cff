"""A body of kind ``torus``, with a shape of its own: a surface of the fourth order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import lean_kernel
from tracer.bodies.body import Body, FacePlan
from tracer.description.fields import Positive
from tracer.geometry.other_shapes import OtherShape

__all__ = ["Torus", "TorusBody"]

F64 = NDArray[np.float64]


@lean_kernel
def value(c0: float, c1: float, c2: float, s: float) -> float:
    """s⁴ + c2 s² + c1 s + c0: the quartic, from the point of a ray nearest to the centre."""
    return ((s * s + c2) * s + c1) * s + c0


@lean_kernel
def crossing(c0: float, c1: float, c2: float, left: float, right: float) -> float:
    """The root in an interval at whose ends the polynomial has two signs."""
    rises = value(c0, c1, c2, right) > 0.0
    for _ in range(60):
        middle = 0.5 * (left + right)
        if (value(c0, c1, c2, middle) > 0.0) == rises:
            right = middle
        else:
            left = middle
    return 0.5 * (left + right)


@lean_kernel
def turning(c1: float, c2: float, left: float, right: float) -> float:
    """The root of the derivative in an interval, or one of its ends where there is none."""
    rises = (4.0 * right * right + 2.0 * c2) * right + c1 > 0.0
    for _ in range(60):
        middle = 0.5 * (left + right)
        slope = (4.0 * middle * middle + 2.0 * c2) * middle + c1
        if (slope > 0.0) == rises:
            right = middle
        else:
            left = middle
    return 0.5 * (left + right)


@lean_kernel
def hit(
    own: F64, x: float, y: float, z: float, dx: float, dy: float, dz: float, leaves: bool
) -> float:
    """(x² + y² + z² + R² - r²)² = 4 R² (x² + y²), from the point nearest to the centre."""
    ring, tube = own[0], own[1]
    reach = ring + tube
    nearest = -(x * dx + y * dy + z * dz)
    px, py, pz = x + nearest * dx, y + nearest * dy, z + nearest * dz
    p2 = px * px + py * py + pz * pz
    half2 = reach * reach - p2
    if half2 <= 0.0:
        return -1.0
    half = math.sqrt(half2)
    k = p2 + ring * ring - tube * tube
    f = 4.0 * ring * ring
    c0 = k * k - f * (px * px + py * py)
    c1 = -2.0 * f * (px * dx + py * dy)
    c2 = 2.0 * k - f * (dx * dx + dy * dy)
    # Cut the chord of the ball about the shape where the first derivative changes its sign
    inner = -c2 / 6.0
    bend = math.sqrt(inner) if inner > 0.0 else 0.0
    e0, e1, e2 = -half, turning(c1, c2, -half, -bend), turning(c1, c2, -bend, bend)
    e3, e4 = turning(c1, c2, bend, half), half
    # The root nearest to the start is the start itself
    start, spare = -nearest, -1.0
    own_root, least = 2.0 * half, math.inf
    if leaves:
        for n in range(4):
            a = e0 if n == 0 else e1 if n == 1 else e2 if n == 2 else e3
            b = e1 if n == 0 else e2 if n == 1 else e3 if n == 2 else e4
            if (value(c0, c1, c2, a) > 0.0) != (value(c0, c1, c2, b) > 0.0):
                s = crossing(c0, c1, c2, a, b)
                if abs(s - start) < least:
                    own_root, least = s, abs(s - start)
    for n in range(4):
        a = e0 if n == 0 else e1 if n == 1 else e2 if n == 2 else e3
        b = e1 if n == 0 else e2 if n == 1 else e3 if n == 2 else e4
        if (value(c0, c1, c2, a) > 0.0) != (value(c0, c1, c2, b) > 0.0):
            s = crossing(c0, c1, c2, a, b)
            if s > start and s != own_root:
                spare = s - start
                break
    return spare


@lean_kernel
def normal(own: F64, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Away from the circle in the middle of the tube."""
    across = math.sqrt(x * x + y * y)
    shrink = (across - own[0]) / across
    nx, ny, nz = x * shrink, y * shrink, z
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    return nx / length, ny / length, nz / length


class Torus(OtherShape):
    """A tube of radius ``tube`` about a circle of radius ``ring`` across the third axis."""

    word: ClassVar[str] = "torus"
    hit: ClassVar[Any] = hit
    normal: ClassVar[Any] = normal

    def __init__(self, origin: F64, frame: F64, ring: float, tube: float) -> None:
        super().__init__(origin, frame)
        self.ring, self.tube = ring, tube

    def own(self) -> Sequence[float]:
        return self.ring, self.tube

    def box(self) -> tuple[Sequence[float], Sequence[float]]:
        reach = self.ring + self.tube
        return (-reach, -reach, -self.tube), (reach, reach, self.tube)

    def drawn(self, segments: int) -> tuple[F64, NDArray[np.int32]]:
        turns = np.arange(segments)
        about, along = np.meshgrid(*[2.0 * np.pi * turns / segments] * 2, indexing="ij")
        across = self.ring + self.tube * np.cos(along)
        points = [across * np.cos(about), across * np.sin(about), self.tube * np.sin(along)]
        i, j = (k.ravel() for k in np.meshgrid(turns, turns, indexing="ij"))
        a, b = segments * i + j, segments * ((i + 1) % segments) + j
        c, d = (segments * (k // segments) + (k % segments + 1) % segments for k in (b, a))
        corners = np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)
        return np.stack(points, axis=-1).reshape(-1, 3), corners.astype(np.int32)


class TorusBody(Body):
    """A torus about the position: a tube of radius ``tube`` along a circle of radius ``ring``."""

    kind: Literal["torus"]
    ring: Positive
    tube: Positive

    def problems(self) -> list[str]:
        return [] if self.tube < self.ring else ["tube: must be thinner than the radius of ring"]

    def plan(self) -> list[FacePlan]:
        shape = Torus(*self.frame(), self.ring, self.tube)
        return [FacePlan(name="surface", shapes=(shape,))]

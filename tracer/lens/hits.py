"""Where a ray meets the caps and the rim of a lens; all in the lens's own frame.

A cap of curvature c with its vertex at the origin is c |p|^2 - 2 z = 0: one form for spheres and
planes, without a far centre to subtract. Its unit normal (-c x, -c y, 1 - c z) points along +z at
the vertex.
"""

from __future__ import annotations

import math

from raymap.jit.kernels import inner_kernel
from raymap.optics.frames import unit_factor
from tracer.lens.shape import BACK, FRONT, RIM, LensShape

__all__ = ["INSIDE", "MISSED", "cap_normal", "enter", "inner_hit", "unit"]

MISSED = -1
INSIDE = -2
"""Answers of `enter` beside the faces: the ray passes by; it starts inside the glass."""

_EDGE = 1e-13
_TOUCH = 1e-10


@inner_kernel
def unit(x: float, y: float, z: float) -> tuple[float, float, float]:
    """A vector that is a unit vector but for rounding, brought back to length 1."""
    scale = unit_factor(x, y, z)
    return x * scale, y * scale, z * scale


@inner_kernel
def cap_normal(
    curvature: float, x: float, y: float, z_from_vertex: float
) -> tuple[float, float, float]:
    """Unit normal of a cap, along +z at the vertex."""
    return unit(-curvature * x, -curvature * y, 1.0 - curvature * z_from_vertex)


@inner_kernel
def _on_cap(curvature: float, height: float, x: float, y: float, z: float) -> bool:
    """Whether a point of the sphere lies on the vertex side and within the aperture."""
    return 1.0 - curvature * z >= -_EDGE and x * x + y * y <= height * height * (1.0 + _EDGE)


@inner_kernel
def _cap_roots(
    curvature: float, x: float, y: float, z: float, dx: float, dy: float, dz: float
) -> tuple[float, float]:
    """Both distances to the sphere or plane, inf where there is none."""
    b = curvature * (x * dx + y * dy + z * dz) - dz
    c = curvature * (x * x + y * y + z * z) - 2.0 * z
    under = b * b - curvature * c
    if under < 0.0:
        return math.inf, math.inf
    # Avoid the difference of nearly equal numbers: one root from the sum, the other from Vieta
    q = -(b + math.copysign(math.sqrt(under), b))
    first = c / q if q != 0.0 else math.inf
    second = q / curvature if curvature != 0.0 else math.inf
    return first, second


@inner_kernel
def _enter_cap(
    curvature: float, height: float, touch: float,
    x: float, y: float, z: float, dx: float, dy: float, dz: float,
) -> tuple[float, float]:  # fmt: skip
    """Nearest distances to a cap where the ray runs along +n and where it runs against it."""
    first, second = _cap_roots(curvature, x, y, z, dx, dy, dz)
    along, against = math.inf, math.inf
    for t in (first, second):
        if -touch < t < math.inf:
            px, py, pz = x + t * dx, y + t * dy, z + t * dz
            if _on_cap(curvature, height, px, py, pz):
                nx, ny, nz = cap_normal(curvature, px, py, pz)
                if dx * nx + dy * ny + dz * nz > 0.0:
                    along = min(along, t)
                else:
                    against = min(against, t)
    return along, against


@inner_kernel
def _rim_roots(
    shape: LensShape, x: float, y: float, z: float, dx: float, dy: float, dz: float
) -> tuple[float, float]:
    """Distances to the cylinder or cone of the rim, each inf unless it lies between the edges."""
    length = shape.edge_back - shape.edge_front
    if length <= 0.0:
        return math.inf, math.inf
    slope = (shape.semi_aperture_back - shape.semi_aperture_front) / length
    radius = shape.semi_aperture_front + slope * (z - shape.edge_front)
    grow = slope * dz
    a = dx * dx + dy * dy - grow * grow
    b = x * dx + y * dy - radius * grow
    c = x * x + y * y - radius * radius
    under = b * b - a * c
    if under < 0.0:
        return math.inf, math.inf
    q = -(b + math.copysign(math.sqrt(under), b))
    first = c / q if q != 0.0 else math.inf
    second = q / a if a != 0.0 else math.inf
    z_first, z_second = z + first * dz, z + second * dz
    if not (shape.edge_front <= z_first <= shape.edge_back):
        first = math.inf
    if not (shape.edge_front <= z_second <= shape.edge_back):
        second = math.inf
    return first, second


@inner_kernel
def _rim_outward(
    shape: LensShape, t: float,
    x: float, y: float, z: float, dx: float, dy: float, dz: float,
) -> float:  # fmt: skip
    """Sign of the ray's direction along the outward normal of the rim at a distance."""
    length = shape.edge_back - shape.edge_front
    slope = (shape.semi_aperture_back - shape.semi_aperture_front) / length
    radius = shape.semi_aperture_front + slope * (z + t * dz - shape.edge_front)
    return (x + t * dx) * dx + (y + t * dy) * dy - slope * radius * dz


@inner_kernel
def _within(shape: LensShape, x: float, y: float, z: float) -> bool:
    """Whether a point lies in the glass."""
    r2, zb = x * x + y * y, z - shape.thickness
    behind_front = shape.curvature_front * (r2 + z * z) - 2.0 * z < 0.0
    before_back = shape.curvature_back * (r2 + zb * zb) - 2.0 * zb > 0.0
    reach = max(shape.semi_aperture_front, shape.semi_aperture_back)
    length = shape.edge_back - shape.edge_front
    if length > 0.0 and shape.edge_front < z < shape.edge_back:
        share = (z - shape.edge_front) / length
        reach = (1.0 - share) * shape.semi_aperture_front + share * shape.semi_aperture_back
    low, high = min(0.0, shape.edge_front), max(shape.thickness, shape.edge_back)
    return behind_front and before_back and r2 < reach * reach and low < z < high


@inner_kernel
def enter(
    shape: LensShape, x: float, y: float, z: float, dx: float, dy: float, dz: float
) -> tuple[int, float]:
    """First hit of a ray from outside: the face and the distance.

    A ray may start on the boundary: it then enters where it points inward and leaves the lens
    alone where it points outward.

    Returns
    -------
    face : FRONT, BACK, RIM; MISSED; or INSIDE for a ray that starts within the glass
    distance
    """
    touch = _TOUCH * (shape.thickness + shape.semi_aperture_front)
    leave_front, enter_front = 0.0, 0.0
    # The outward normal of the front cap is -n, of the back cap +n
    enter_front, leave_front = _enter_cap(
        shape.curvature_front, shape.semi_aperture_front, touch, x, y, z, dx, dy, dz
    )
    leave_back, enter_back = _enter_cap(
        shape.curvature_back, shape.semi_aperture_back, touch,
        x, y, z - shape.thickness, dx, dy, dz,
    )  # fmt: skip
    face, nearest = FRONT, enter_front
    if enter_back < nearest:
        face, nearest = BACK, enter_back
    leaving = min(
        leave_front if leave_front > touch else math.inf,
        leave_back if leave_back > touch else math.inf,
    )
    first, second = _rim_roots(shape, x, y, z, dx, dy, dz)
    for t in (first, second):
        if -touch < t < math.inf:
            if _rim_outward(shape, t, x, y, z, dx, dy, dz) < 0.0:
                if t < nearest:
                    face, nearest = RIM, t
            elif touch < t < leaving:
                leaving = t
    if leaving < nearest:
        # A ray from outside that meets an edge may slip between cap and rim by rounding
        return (INSIDE if _within(shape, x, y, z) else MISSED), 0.0
    if nearest == math.inf:
        return MISSED, 0.0
    return face, max(nearest, 0.0)


@inner_kernel
def _other_cap(
    curvature: float, height: float,
    x: float, y: float, z: float, dx: float, dy: float, dz: float,
) -> float:  # fmt: skip
    """Nearest distance to the cap that the ray does not stand on."""
    first, second = _cap_roots(curvature, x, y, z, dx, dy, dz)
    if second < first:
        first, second = second, first
    if 0.0 < first < math.inf and _on_cap(
        curvature, height, x + first * dx, y + first * dy, z + first * dz
    ):
        return first
    if 0.0 < second < math.inf and _on_cap(
        curvature, height, x + second * dx, y + second * dy, z + second * dz
    ):
        return second
    return math.inf


@inner_kernel
def _same_cap(
    curvature: float, height: float,
    x: float, y: float, z: float, dx: float, dy: float, dz: float,
) -> float:  # fmt: skip
    """Distance to the second hit of the cap that the ray stands on."""
    if curvature == 0.0:
        return math.inf
    b = curvature * (x * dx + y * dy + z * dz) - dz
    t = -2.0 * b / curvature
    if t > 0.0 and _on_cap(curvature, height, x + t * dx, y + t * dy, z + t * dz):
        return t
    return math.inf


@inner_kernel
def inner_hit(
    shape: LensShape, last: int,
    x: float, y: float, z: float, dx: float, dy: float, dz: float,
) -> tuple[int, float]:  # fmt: skip
    """Next hit of a ray inside the glass that stands on the cap ``last``.

    A ray that finds neither a cap nor the rim has slipped through an edge by rounding; it ends on
    the rim where it stands.
    """
    zb = z - shape.thickness
    if last == FRONT:
        front = _same_cap(shape.curvature_front, shape.semi_aperture_front, x, y, z, dx, dy, dz)
        back = _other_cap(shape.curvature_back, shape.semi_aperture_back, x, y, zb, dx, dy, dz)
    else:
        front = _other_cap(shape.curvature_front, shape.semi_aperture_front, x, y, z, dx, dy, dz)
        back = _same_cap(shape.curvature_back, shape.semi_aperture_back, x, y, zb, dx, dy, dz)
    face, nearest = FRONT, front
    if back < nearest:
        face, nearest = BACK, back

    # The glass lies within a cylinder, so only a ray that meets no cap can meet it; not so a cone
    if nearest == math.inf or shape.semi_aperture_front != shape.semi_aperture_back:
        first, second = _rim_roots(shape, x, y, z, dx, dy, dz)
        for t in (first, second):
            if 0.0 < t < nearest:
                face, nearest = RIM, t
    if nearest == math.inf:
        return RIM, 0.0
    return face, nearest

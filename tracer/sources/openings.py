"""Where light starts from a luminous opening that is a body: a box, an ellipsoid, a cylinder.

Of a convex body that looks equally bright all over, the places from which light goes into one
direction are uniform over its outline as seen from there (that is Lambert's law taken for this
direction alone). Stretching a body keeps "uniform over the outline", so that a cube, a sphere and a
cylinder of size 1 do for all.
"""

from __future__ import annotations

import math

from raymap.jit.kernels import inner_kernel
from raymap.optics.angles import turned
from tracer.compiled import FROM_BOX, FROM_CYLINDER_U, FROM_CYLINDER_V, FROM_ELLIPSOID
from tracer.rays.directions import about

__all__ = ["place_on_body"]

Place = tuple[float, float, float]


@inner_kernel
def place_on_body(
    area: int, a: float, b: float, c: float, p: float, q: float, r: float,
    u1: float, u2: float, u3: float,
) -> Place:  # fmt: skip
    """A place on the side of a body that faces a direction, uniform over its outline from there.

    Parameters
    ----------
    area : FROM_BOX, FROM_ELLIPSOID or one of FROM_CYLINDER_U, _V, _N
    a, b, c : half sizes along u, v and the normal
    p, q, r : the direction, in the same frame
    u1, u2, u3 : uniform numbers

    Returns
    -------
    coordinates along u, v and the normal
    """
    # Shrink the body to size 1: areas across the direction go with the cofactors of the stretch
    p, q, r = b * c * p, a * c * q, a * b * r
    if area == FROM_BOX:
        x, y, z = _on_cube(p, q, r, u1, u2, u3)
    elif area == FROM_ELLIPSOID:
        length = math.sqrt(p * p + q * q + r * r)
        x, y, z = 0.0, 0.0, 0.0
        if length > 0.0:
            x, y, z = about(
                p / length, q / length, r / length, math.sqrt(1.0 - u1), math.sqrt(u1), u2
            )
    elif area == FROM_CYLINDER_U:
        y, z, x = _on_cylinder(q, r, p, u1, u2, u3)
    elif area == FROM_CYLINDER_V:
        z, x, y = _on_cylinder(r, p, q, u1, u2, u3)
    else:
        x, y, z = _on_cylinder(p, q, r, u1, u2, u3)
    return a * x, b * y, c * z


@inner_kernel
def _on_cube(p: float, q: float, r: float, u1: float, u2: float, u3: float) -> Place:
    """On a cube from -1 to 1."""
    # Choose one of the three sides in view by what it shows
    first, second = abs(p), abs(p) + abs(q)
    chosen = u3 * (second + abs(r))
    s, t = 2.0 * u1 - 1.0, 2.0 * u2 - 1.0
    if chosen < first:
        return math.copysign(1.0, p), s, t
    if chosen < second:
        return s, math.copysign(1.0, q), t
    return s, t, math.copysign(1.0, r)


@inner_kernel
def _on_cylinder(p: float, q: float, r: float, u1: float, u2: float, u3: float) -> Place:
    """On a cylinder about the third axis, of radius 1 and from -1 to 1."""
    across = math.sqrt(p * p + q * q)
    if u3 * (4.0 * across + math.pi * abs(r)) < 4.0 * across:
        # On the mantle
        s = 2.0 * u1 - 1.0
        towards = math.sqrt(1.0 - s * s)
        x = (towards * p - s * q) / across
        y = (towards * q + s * p) / across
        return x, y, 2.0 * u2 - 1.0
    radius = math.sqrt(u1)
    cosine, sine = turned(u2)
    return radius * cosine, radius * sine, math.copysign(1.0, r)

"""The body of a lens: two spherical or plane caps and an opaque rim.

In the lens's own frame the front vertex is the origin and the axis is +z; the back vertex stands at
z = thickness. A radius is positive where the centre of curvature lies further along +z, infinite
for a plane. The rim runs from the edge of the front cap to the edge of the back cap: a cylinder
where both semi-apertures are equal, else a cone frustum.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from raymap.jit.kernels import kernel
from tracer.lens.errors import LensError

__all__ = ["BACK", "FRONT", "RIM", "LensShape", "lens_shape", "sag"]

FRONT, BACK, RIM = 0, 1, 2
"""Primitives of a lens, also in recorded ray maps."""

_TOLERANCE = 1e-12


class LensShape(NamedTuple):
    """A valid body as plain numbers, for compiled code; curvatures are inverse radii."""

    curvature_front: float
    curvature_back: float
    thickness: float
    semi_aperture_front: float
    semi_aperture_back: float
    edge_front: float
    edge_back: float


@kernel
def sag(curvature: float, height: float) -> float:
    """Distance along the axis from the vertex to the cap at a distance from the axis."""
    under = 1.0 - (curvature * height) ** 2
    return curvature * height * height / (1.0 + math.sqrt(under if under > 0.0 else 0.0))


def lens_shape(
    *,
    radius_front: float,
    radius_back: float,
    thickness: float,
    semi_aperture_front: float,
    semi_aperture_back: float,
) -> LensShape:
    """Check a body and give it as plain numbers.

    Raises
    ------
    LensError
        names the field: a radius smaller than its semi-aperture, no thickness, a negative edge,
        caps or cap and rim that cross
    """
    radii = {"radius_front": radius_front, "radius_back": radius_back}
    apertures = {
        "semi_aperture_front": semi_aperture_front,
        "semi_aperture_back": semi_aperture_back,
    }
    for name, value in apertures.items():
        if not (math.isfinite(value) and value > 0.0):
            raise LensError(f"{name} is {value:g}: it must be a positive length")
    for (name, radius), (aperture, height) in zip(radii.items(), apertures.items(), strict=True):
        if math.isnan(radius) or radius == 0.0:
            raise LensError(f"{name} is {radius:g}: give a radius of curvature, or inf for a plane")
        if abs(radius) < height:
            raise LensError(
                f"{aperture} is {height:g}, larger than the radius of curvature "
                f"{name} = {radius:g}: a sphere reaches only |{name}| from the axis"
            )
    if not (math.isfinite(thickness) and thickness > 0.0):
        raise LensError(f"thickness is {thickness:g}: the vertices must be a positive length apart")

    c_front, c_back = 1.0 / radius_front, 1.0 / radius_back
    edge_front = float(sag(c_front, semi_aperture_front))
    edge_back = thickness + float(sag(c_back, semi_aperture_back))
    shape = LensShape(
        c_front, c_back, float(thickness), float(semi_aperture_front), float(semi_aperture_back),
        edge_front, edge_back,
    )  # fmt: skip
    _check_caps(shape)
    _check_rim(shape)
    return shape


def _check_caps(shape: LensShape) -> None:
    """Refuse caps that meet inside the aperture.

    The glass between the caps is thinnest on the axis or at the smaller of both apertures: the
    derivative of d + sag_back - sag_front has no zero in between.
    """
    edge = shape.edge_back - shape.edge_front
    scale = shape.thickness + shape.semi_aperture_front + shape.semi_aperture_back
    if edge < -_TOLERANCE * scale:
        raise LensError(
            f"thickness is {shape.thickness:g}, too small for these radii and semi-apertures: the "
            f"edge would be {edge:g} thick; make the lens thicker, flatter or smaller"
        )
    smaller = min(shape.semi_aperture_front, shape.semi_aperture_back)
    glass = (
        shape.thickness + sag(shape.curvature_back, smaller) - sag(shape.curvature_front, smaller)
    )
    equal = shape.semi_aperture_front == shape.semi_aperture_back
    if glass < -_TOLERANCE * scale or (not equal and glass <= 0.0):
        raise LensError(
            f"thickness is {shape.thickness:g}: the front and back caps cross at {smaller:g} from "
            f"the axis (glass {glass:g} thick there); make the lens thicker or flatter"
        )


def _check_rim(shape: LensShape) -> None:
    """Refuse a conical rim that cuts through the cap with the larger aperture."""
    edge = shape.edge_back - shape.edge_front
    step = shape.semi_aperture_back - shape.semi_aperture_front
    if step == 0.0:
        return
    if edge <= 0.0:
        raise LensError(
            "semi_aperture_front and semi_aperture_back differ on a lens whose edge has no "
            f"thickness ({edge:g}): the rim would be a flat ring; make the lens thicker"
        )
    rises = edge / step  # of the cone: height over distance from the axis, along +z
    if step < 0.0:
        wide, curvature, field = shape.semi_aperture_front, shape.curvature_front, "front"
        crosses = rises > _slope(curvature, wide) + _TOLERANCE
    else:
        wide, curvature, field = shape.semi_aperture_back, shape.curvature_back, "back"
        crosses = rises < _slope(curvature, wide) - _TOLERANCE
    if crosses:
        raise LensError(
            f"semi_aperture_{field} is {wide:g}: the conical rim to the smaller aperture would cut "
            f"through the {field} cap; bring both semi-apertures closer together"
        )


def _slope(curvature: float, height: float) -> float:
    """Slope d sag / d height of a cap; infinite at the edge of a hemisphere."""
    under = 1.0 - (curvature * height) ** 2
    if under <= 0.0:
        return math.copysign(math.inf, curvature)
    return curvature * height / math.sqrt(under)

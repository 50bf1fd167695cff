"""Lenses and rays that several tests share, and random ones."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st

from tracer.lens import Lens, LensError
from tracer.optics.polarization_rays import PolarizedRays

N_D = 1.5168000345
LINE_D = 587.5618


def biconvex(**changes: object) -> Lens:
    """The reference lens: N-BK7 at the d line, R = +-50, thickness 6, semi-aperture 12.5."""
    values: dict[str, object] = {
        "radius_front": 50.0,
        "radius_back": -50.0,
        "thickness": 6.0,
        "semi_aperture_front": 12.5,
        "glass": N_D,
    }
    return Lens(**(values | changes))  # type: ignore[arg-type]


def plate(thickness: float, semi_aperture: float = 10.0, glass: float = N_D) -> Lens:
    """A plane-parallel plate."""
    return Lens(
        radius_front=math.inf,
        radius_back=math.inf,
        thickness=thickness,
        semi_aperture_front=semi_aperture,
        glass=glass,
    )


def parallel_ray(x: float, y: float, vibration: tuple[float, float, float]) -> PolarizedRays:
    """One ray along +z that starts at z = -20."""
    return PolarizedRays.linear(
        [[x, y, -20.0]], [[0.0, 0.0, 1.0]], [vibration], wavelength_nm=LINE_D
    )


@st.composite
def lenses(draw: st.DrawFn) -> Lens:
    """Any possible lens, also with planes, menisci, conical rims, absorbing glass, tilted."""
    size = draw(st.floats(1.0, 20.0))
    curvature = st.one_of(st.just(0.0), st.floats(-1.0, 1.0))
    front, back = draw(curvature) / size, draw(curvature) / size
    ratio = draw(st.one_of(st.just(1.0), st.floats(0.6, 1.4)))
    axis = np.array([draw(st.floats(-1.0, 1.0)) for _ in range(3)])
    assume(np.linalg.norm(axis) > 0.1)
    try:
        return Lens(
            radius_front=1.0 / front if front else math.inf,
            radius_back=1.0 / back if back else math.inf,
            thickness=draw(st.floats(0.05, 1.5)) * size,
            semi_aperture_front=0.95 * size,
            semi_aperture_back=0.95 * size * ratio,
            glass=draw(st.floats(1.05, 2.2)),
            outside=draw(st.sampled_from([1.0, 1.33, 1.6])),
            origin=tuple(draw(st.floats(-30.0, 30.0)) for _ in range(3)),  # type: ignore[arg-type]
            axis=tuple(axis),
        )
    except LensError:
        assume(False)
        raise


@st.composite
def rays_at(draw: st.DrawFn, lens: Lens, n: int = 40) -> PolarizedRays:
    """Elliptically polarised rays from all around, aimed near a lens."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    return random_rays(rng, lens, n)


def random_rays(rng: np.random.Generator, lens: Lens, n: int) -> PolarizedRays:
    """Elliptically polarised rays from a sphere around a lens to points near it."""
    size = lens.semi_aperture_front + lens.thickness
    z, place = lens.frame[2], lens.frame[3]
    middle = place + 0.5 * lens.thickness * z
    target = middle + rng.uniform(-0.6, 0.6, (n, 3)) * size
    start = rng.normal(size=(n, 3))
    start = middle + 6.0 * size * start / np.linalg.norm(start, axis=1, keepdims=True)
    d = target - start
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    e = rng.normal(size=(n, 3)) + 1j * rng.normal(size=(n, 3))
    e -= np.sum(e * d, axis=1, keepdims=True) * d
    return PolarizedRays.from_field(start, d, e, wavelength_nm=550.0)

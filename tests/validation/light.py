"""Light in space."""

from __future__ import annotations

import math

import numpy as np

from tests.tracer.transport.tracing import trace
from tests.validation import Row, check


def _share(expected: float, count: int, n: int, of: str = "") -> Row:
    error = math.sqrt(expected * (1.0 - expected) / n)
    return Row(expected=expected, got=count / n, got_error=error, tolerance=4.5 * error, of=of)


@check(
    what="Share of a small Lambertian source on discs of radius 0.5 in a plane at distance 10",
    source="inverse square and cos⁴ law: A cos⁴θ/(π h²)",
)
def cosine_fourth() -> list[Row]:
    rows, n = [], 400_000
    for angle in (0.0, 30.0, 60.0):
        x = 10.0 * math.tan(math.radians(angle))
        found = trace(
            f"""
[sources.lamp]
kind = "lambertian"
diameter = 0.02
[bodies.target]
kind = "disc"
position = [{x}, 0, 10]
outer = 0.5
surface = "absorber"
""",
            n,
        )
        # The disc is small, not a point: average the law over it
        grid = (np.arange(200) + 0.5) / 200.0
        r = 0.5 * np.sqrt(grid)[:, None]
        turn = 2.0 * math.pi * grid[None, :]
        square = (x + r * np.cos(turn)) ** 2 + (r * np.sin(turn)) ** 2
        mean = float(np.mean(100.0 / (square + 100.0) ** 2))
        rows.append(_share(0.25 * mean, found.ended_on("target"), n, f"{angle:g}°"))
    return rows


@check(
    what="View factor of coaxial equal discs, distance = radius",
    source="Howell, configuration factor C-41: (3 − √5)/2",
)
def coaxial_discs() -> Row:
    found = trace(
        """
[sources.disc]
kind = "lambertian"
diameter = 2
[bodies.target]
kind = "disc"
position = [0, 0, 1]
outer = 1
surface = "absorber"
""",
        200_000,
    )
    return _share((3.0 - math.sqrt(5.0)) / 2.0, found.ended_on("target"), 200_000)


@check(
    what="View factor of perpendicular squares with a common edge",
    source="Howell, configuration factor C-14: 0.20004378",
)
def perpendicular_squares() -> Row:
    found = trace(
        """
[sources.floor]
kind = "lambertian"
position = [0.5, 0.5, 0]
size = [1, 1]
[bodies.wall]
kind = "rectangle"
position = [0, 0.5, 0.5]
rotation = [0, 90, 0]
size = [1, 1]
surface = "absorber"
""",
        200_000,
    )
    return _share(0.20004378, found.ended_on("wall"), 200_000)


@check(
    what="Port of the sphere in samples/integrating_sphere.toml, R = 0.97 and aged 0.95",
    source="sphere multiplier: p/(1 − ρ(1 − p)), p the port's share of the solid angle",
)
def integrating_sphere() -> list[Row]:
    from tests.tracer.test_samples import traced

    port = 0.5 * (1.0 - math.sqrt(1.0 - 0.2**2))
    rows = []
    for variants, rho in (((), 0.97), (("aged",), 0.95)):
        found = traced("integrating_sphere.toml", 20_000, *variants)
        expected = port / (1.0 - rho * (1.0 - port))
        rows.append(_share(expected, found.ended_on("port"), 20_000, f"R = {rho}"))
    return rows


@check(
    what="Hits of a ray in a closed diffuse cavity",
    source="geometric series: 1/(1 − ρ)",
)
def closed_cavity() -> list[Row]:
    rows, n = [], 40_000
    for rho in (0.5, 0.9):
        found = trace(
            f"""
[surfaces.wall]
kind = "lambertian"
reflectance = {rho}
[bodies.cavity]
kind = "box"
size = [3, 4, 5]
surface = "wall"
[sources.lamp]
kind = "point"
position = [0.3, -0.2, 0.1]
""",
            n,
        )
        error = math.sqrt(rho) / (1.0 - rho) / math.sqrt(n)
        got = float(np.mean(found.portion.records_per_ray - 1))
        rows.append(
            Row(
                expected=1.0 / (1.0 - rho),
                got=got,
                got_error=error,
                tolerance=4.5 * error,
                of=f"R = {rho}",
            )
        )
    return rows

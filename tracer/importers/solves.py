"""Thicknesses that a file leaves to a ray: marginal heights, paraxial image distances."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

from tracer.importers.bundles import Bundles
from tracer.importers.prescription import ImportWarning, ThicknessSolve
from tracer.importers.sequence import Sequence

__all__ = ["solved"]

SAME = 1e-3
"""Relative difference that is passed over."""

FROM_GLASSES = 1e-2
"""Relative difference that other data of the same glasses may make."""


def solved(sequence: Sequence) -> Sequence:
    """A sequence whose thicknesses are those of its solves.

    A stored thickness that is close is kept: it is what the program found with its own data of the
    glasses. Any other one is replaced, with a warning.
    """
    for solve in sequence.prescription.solves:
        stored = sequence.surfaces[solve.surface].thickness
        found = _thickness(sequence, solve)
        difference = abs(found - stored) / max(abs(found), abs(stored), 1e-300)
        if not math.isfinite(found):
            said = f"from a ray that does not get there; the stored {stored:g} is taken"
        elif difference <= SAME:
            continue
        elif difference <= FROM_GLASSES:
            said = f"from a ray, with our glasses as {found:.6g}; the stored {stored:.6g} is taken"
        else:
            said = f"from a ray as {found:.6g}, which is taken, not the stored {stored:.6g}"
            sequence = _with_thickness(sequence, solve.surface, found)
        warnings.warn(
            f"{sequence.prescription.origin}: surface {solve.surface}: its thickness follows "
            f"{said}",
            ImportWarning,
            stacklevel=2,
        )
    return sequence


def _thickness(sequence: Sequence, solve: ThicknessSolve) -> float:
    """Distance along z from the surface at which the marginal ray has the height."""
    bundles = Bundles(sequence=sequence)
    primary = sequence.prescription.primary
    height, slope = bundles.marginal
    if solve.zone == 0.0:
        heights, optical = sequence.paraxial(height, slope, primary, last=solve.surface)
        mirrors = sum(surface.mirror for surface in sequence.surfaces[: solve.surface + 1])
        n = (-1) ** mirrors * sequence.indices[solve.surface, primary]
        here, along = float(heights[solve.surface]), float(optical[solve.surface] / n)
        return solve.offset + (solve.height - here) / along if along else math.inf
    rays = bundles.trace(bundles.axis, [[0.0, solve.zone * height]])
    point, direction = rays.points[solve.surface, 0], rays.directions[solve.surface, 0]
    if not direction[1]:
        return math.inf
    distance = (solve.height - point[1]) / direction[1] * direction[2]
    return solve.offset + float(point[2] + distance - sequence.z[solve.surface])


def _with_thickness(sequence: Sequence, index: int, thickness: float) -> Sequence:
    surfaces = list(sequence.surfaces)
    surfaces[index] = replace(surfaces[index], thickness=thickness)
    prescription = replace(sequence.prescription, surfaces=tuple(surfaces))
    return Sequence(prescription=prescription, indices=sequence.indices)

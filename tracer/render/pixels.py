"""Radiance of camera rays: the kernel of the backward renderer."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from raymap.jit.kernels import inner_kernel, kernel
from tracer.optics.crystals.rows import EPS_ORDINARY
from tracer.render.bodies import BodyArrays
from tracer.render.room import RoomArrays, wall_radiance
from tracer.render.tree import (
    EXIT,
    NODE,
    TreeScratch,
    grow_tree,
    next_boundary,
    tree_scratch,
)

__all__ = ["CameraRays", "Pruning", "Spectrum", "render_rays"]

Array = np.ndarray[Any, np.dtype[Any]]


_FIRST = 24.0
"""Times more than the darkest pixel may leave out that the first ray of a row is tried with."""

_CLOSER = 0.85
"""The next ray is tried with what the last one would have needed, and a little less."""


@inner_kernel
def _srgb_slope(value: float) -> float:
    """Slope of the sRGB curve, steepest in the dark."""
    if value <= 0.0031308:
        return 12.92
    slope: float = 0.43958333333333333 * min(value, 1.0) ** (-0.58333333333333333)
    return slope


@inner_kernel
def _tree_radiance(
    bodies: BodyArrays,
    room: RoomArrays,
    media: Array,
    wavelength_nm: float,
    primaries: Array,
    start: Array,
    max_events: int,
    tolerance: float,
    scratch: TreeScratch,
    exits: Array,
) -> tuple[float, float, float]:
    """Light that the branches of one tree see; shares pruned and truncated."""
    n = math.sqrt(media[media.shape[0] - 1, EPS_ORDINARY])
    for c in range(3):
        start[3 + c] = n * start[6 + c]
    count, left_out, cut, _ = grow_tree(
        bodies,
        media,
        2e6 * math.pi / wavelength_nm,
        start,
        max_events,
        tolerance,
        False,
        scratch,
        exits,
    )
    total = 0.0
    for k in range(count):
        row = exits[k]
        texel = wall_radiance(room, row[0], row[1], row[2], row[6], row[7], row[8])
        if texel >= 0:
            emitted = 0.0
            for c in range(3):
                emitted += room.texels[texel, c] * primaries[c]
            total += row[15] * emitted
    return total, left_out, cut


@inner_kernel
def _allowance(
    radiance: Array, pruned: Array, weights: Array, bounds: Array, base: Array, steps: float
) -> tuple[bool, float]:
    """Whether a ray is within its error, and how many times the base tolerances it may leave out.

    Errors may grow where the sRGB curve is flat, so the allowance comes from the colour found.
    """
    factor = np.inf
    enough = True
    for c in range(3):
        value = 0.0
        error = 0.0
        for w in range(weights.shape[0]):
            value += weights[w, c] * radiance[w]
            error += bounds[w, c] * pruned[w]
        allowed = steps / 255.0 / _srgb_slope(value - error)
        enough = enough and error <= allowed
        factor = min(factor, allowed / base[c])
    return enough, max(factor, 1.0)


class Spectrum(NamedTuple):
    """What is the same for all rays at the m wavelengths.

    media : (m, n_bodies + 1, ROW)
    wavelengths_nm : (m,)
    primaries : (m, 3) emission of red, green, blue walls
    """

    media: Array
    wavelengths_nm: Array
    primaries: Array


class CameraRays(NamedTuple):
    """(n, 3) each: where rays start, against the light, and vibrate (0: natural light)."""

    origin: Array
    direction: Array
    analyser: Array


class Pruning(NamedTuple):
    """What may be left out of the trees.

    max_events : of a branch
    tolerance : (m,) share that may be left out at each wavelength in the darkest pixel; 0 = nothing
    weights : (m, 3) radiance to linear sRGB
    bounds : (m, 3) largest change of linear sRGB by a share 1 at one wavelength
    base : (3,) sum of bounds times tolerance
    steps : error allowed by pruning, in 8-bit steps of sRGB
    capacity : of waiting branches, and of exits
    """

    max_events: int
    tolerance: Array
    weights: Array
    bounds: Array
    base: Array
    steps: float
    capacity: int


@kernel
def render_rays(
    bodies: BodyArrays, room: RoomArrays, spectrum: Spectrum, rays: CameraRays, pruning: Pruning,
    radiance: Array, pruned: Array, truncated: Array,
) -> None:  # fmt: skip
    """Radiance of n rays at m wavelengths.

    A tree is grown along each ray against the light. By reciprocity the share of a branch is the
    share of the wall's light that comes back along it: natural light for a ray without analyser,
    half of it (one polarisation) for a ray with one. The world is one isotropic medium on all
    sides, so the factors n^2 of radiance cancel.

    Parameters
    ----------
    radiance, pruned, truncated : (n, m), written; the last two are shares
    """
    origin, direction, analyser = rays.origin, rays.direction, rays.analyser
    wavelengths_nm, primaries = spectrum.wavelengths_nm, spectrum.primaries
    tolerance, steps = pruning.tolerance, pruning.steps
    scratch = tree_scratch(pruning.capacity)
    exits = np.zeros((pruning.capacity, EXIT))
    start = np.zeros(NODE)
    stack = np.zeros(64, np.int64)
    factor = _FIRST
    for i in range(origin.shape[0]):
        dx, dy, dz = direction[i, 0], direction[i, 1], direction[i, 2]
        polarised = analyser[i, 0] ** 2 + analyser[i, 1] ** 2 + analyser[i, 2] ** 2 > 0.5
        half = 0.5 if polarised else 1.0

        # A ray that meets no crystal sees a wall, at all wavelengths
        _, met, _, _, _, _ = next_boundary(bodies, origin[i], dx, dy, dz, -1, -1, stack)
        if met < 0:
            texel = wall_radiance(room, origin[i, 0], origin[i, 1], origin[i, 2], dx, dy, dz)
            for w in range(wavelengths_nm.shape[0]):
                radiance[i, w] = 0.0
                pruned[i, w] = 0.0
                truncated[i, w] = 0.0
                if texel >= 0:
                    for c in range(3):
                        radiance[i, w] += half * room.texels[texel, c] * primaries[w, c]
            continue

        # Root of the tree
        for c in range(3):
            start[c] = origin[i, c]
            start[6 + c] = direction[i, c]
            start[9 + c] = analyser[i, c]
            start[12 + c] = 0.0
        start[15] = 1.0
        start[16] = 0.0
        start[17] = -1.0
        start[18] = -1.0
        start[19] = 0.0 if polarised else 1.0

        # Look as closely as its neighbour needed, then as the colour found asks for
        for _ in range(2):
            for w in range(wavelengths_nm.shape[0]):
                radiance[i, w], pruned[i, w], truncated[i, w] = _tree_radiance(
                    bodies,
                    room,
                    spectrum.media[w],
                    wavelengths_nm[w],
                    primaries[w],
                    start,
                    pruning.max_events,
                    factor * tolerance[w],
                    scratch,
                    exits,
                )
                radiance[i, w] *= half
            if steps == 0.0:
                break
            enough, allowed = _allowance(
                radiance[i], pruned[i], pruning.weights, pruning.bounds, pruning.base, steps
            )
            factor = allowed
            if enough:
                break
        factor *= _CLOSER

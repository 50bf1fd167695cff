"""Radiance of camera rays: the kernel of the backward renderer."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from raymap.kernels import kernel
from tracer.crystals.bodies import BodyArrays
from tracer.crystals.rows import EPS_ORDINARY
from tracer.crystals.tree import EXIT, NODE, grow_tree, next_boundary, tree_scratch
from tracer.render.room import RoomArrays, wall_radiance

__all__ = ["render_rays"]

Array = np.ndarray[Any, np.dtype[Any]]


@kernel
def render_rays(
    bodies: BodyArrays,
    room: RoomArrays,
    media: Array,
    wavelengths_nm: Array,
    primaries: Array,
    origin: Array,
    direction: Array,
    analyser: Array,
    max_events: int,
    tolerance: Array,
    capacity: int,
    radiance: Array,
    pruned: Array,
    truncated: Array,
) -> None:
    """Radiance of n rays at m wavelengths.

    A tree is grown along each ray against the light. By reciprocity the share of a branch is the
    share of the wall's light that comes back along it: natural light for a ray without analyser,
    half of it (one polarisation) for a ray with one. The world is one isotropic medium on all
    sides, so the factors n^2 of radiance cancel.

    Parameters
    ----------
    media : (m, n_bodies + 1, ROW)
    primaries : (m, 3) emission of red, green, blue walls
    origin, direction, analyser : (n, 3)
    tolerance : (m,) share that may be left out
    capacity : of waiting branches, and of exits
    radiance, pruned, truncated : (n, m), written; the last two are shares
    """
    scratch = tree_scratch(capacity)
    exits = np.zeros((capacity, EXIT))
    start = np.zeros(NODE)
    stack = np.zeros(64, np.int64)
    for i in range(origin.shape[0]):
        dx, dy, dz = direction[i, 0], direction[i, 1], direction[i, 2]
        polarised = analyser[i, 0] ** 2 + analyser[i, 1] ** 2 + analyser[i, 2] ** 2 > 0.5
        half = 0.5 if polarised else 1.0

        # A ray that meets no crystal sees a wall, at all wavelengths
        _, met, _, _, _ = next_boundary(bodies, origin[i], dx, dy, dz, -1, -1, stack)
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

        for w in range(wavelengths_nm.shape[0]):
            # Root of the tree
            n = math.sqrt(media[w, media.shape[1] - 1, EPS_ORDINARY])
            for c in range(3):
                start[c] = origin[i, c]
                start[3 + c] = n * direction[i, c]
                start[6 + c] = direction[i, c]
                start[9 + c] = analyser[i, c]
                start[12 + c] = 0.0
            start[15] = 1.0
            start[16] = 0.0
            start[17] = -1.0
            start[18] = -1.0
            start[19] = 0.0 if polarised else 1.0
            count, left_out, cut, _ = grow_tree(
                bodies,
                media[w],
                2e6 * math.pi / wavelengths_nm[w],
                start,
                max_events,
                tolerance[w],
                scratch,
                exits,
            )

            # Gather the walls that its branches see
            total = 0.0
            for k in range(count):
                row = exits[k]
                texel = wall_radiance(room, row[0], row[1], row[2], row[6], row[7], row[8])
                if texel >= 0:
                    emitted = 0.0
                    for c in range(3):
                        emitted += room.texels[texel, c] * primaries[w, c]
                    total += row[15] * emitted
            radiance[i, w] = half * total
            pruned[i, w] = left_out
            truncated[i, w] = cut

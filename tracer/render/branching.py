"""The branching tree of one ray for Python: exits with fields, and their coherent sum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.model.errors import SceneError
from tracer.optics.crystals.media import Crystal
from tracer.optics.crystals.rows import ISOTROPIC, KIND
from tracer.render.bodies import CrystalBody, compile_bodies
from tracer.render.tree import EXIT, NODE, grow_tree, tree_scratch

__all__ = ["ExitRays", "coherent_sum", "trace_tree"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, kw_only=True)
class ExitRays:
    """Rays that left all crystals.

    Attributes
    ----------
    point, direction : (n, 3), where each left, and where it goes
    refraction_vector : (n, 3)
    field : (n, 3) complex E at ``point``, phase included
    share : (n,) flux over the flux of the root
    events : (n,) surface events on the way
    pruned, truncated, absorbed : shares that did not get out; with ``share`` they add up to 1
    wavelength_nm : of the light
    """

    point: Real
    direction: Real
    refraction_vector: Real
    field: Complex
    share: Real
    events: NDArray[np.int64]
    pruned: float
    truncated: float
    absorbed: float
    wavelength_nm: float


def trace_tree(
    bodies: Sequence[CrystalBody],
    world: Crystal,
    origin: ArrayLike,
    direction: ArrayLike,
    *,
    wavelength_nm: float,
    field: ArrayLike | None = None,
    max_events: int = 15,
    tolerance: float = 0.0,
    capacity: int = 65536,
    contacts: tuple[tuple[str, str], ...] = (),
) -> ExitRays:
    """All branches of one ray that starts in the world.

    Parameters
    ----------
    field : (3,) complex E across the ray; None = natural light (then fields of exits have no
        common phase and must not be summed)
    max_events : branches that need more are truncated
    tolerance : flux that may be pruned
    contacts : pairs of names of bodies that share an interface
    """
    start = np.zeros(NODE)
    d = np.asarray(direction, np.float64)
    if d.shape != (3,) or not np.linalg.norm(d) > 0.0:
        raise SceneError("tree: direction must be three numbers, not all zero")
    d = d / np.linalg.norm(d)
    row = world.row(wavelength_nm)
    if row[KIND] != ISOTROPIC:
        raise SceneError(f"tree: the world {world.name!r} must be isotropic")
    if max_events < 1:
        raise SceneError("tree: max_events must be at least 1")
    start[0:3] = np.asarray(origin, np.float64)
    start[3:6] = world.principal_indices(wavelength_nm)[0] * d
    start[6:9] = d
    if field is not None:
        e = np.asarray(field, np.complex128)
        if not np.linalg.norm(e) > 0.0 or abs(e @ d) > 1e-9 * np.linalg.norm(e):
            raise SceneError("tree: field must not vanish and must lie across the direction")
        start[9:12], start[12:15] = e.real, e.imag
    start[15], start[17], start[18] = 1.0, -1.0, -1.0
    start[19] = 1.0 if field is None else 0.0
    exits = np.zeros((capacity, EXIT))
    media = np.array([body.medium.row(wavelength_nm) for body in bodies] + [row])
    count, pruned, truncated, absorbed = grow_tree(
        compile_bodies(tuple(bodies), contacts),
        media,
        2e6 * np.pi / wavelength_nm,
        start,
        max_events,
        tolerance,
        field is not None,
        tree_scratch(capacity),
        exits,
    )
    found = exits[:count]
    return ExitRays(
        point=found[:, 0:3],
        direction=found[:, 6:9],
        refraction_vector=found[:, 3:6],
        field=found[:, 9:12] + 1j * found[:, 12:15],
        share=found[:, 15],
        events=found[:, 16].astype(np.int64),
        pruned=pruned,
        truncated=truncated,
        absorbed=absorbed,
        wavelength_nm=wavelength_nm,
    )


def coherent_sum(
    exits: ExitRays, reference: ArrayLike, *, tolerance: float = 1e-9
) -> tuple[Real, Complex]:
    """Plane waves that leave in the same direction, summed with their phases.

    Parameters
    ----------
    reference : (3,) point at which phases are compared
    tolerance : directions closer than this are the same

    Returns
    -------
    directions (k, 3) and fields (k, 3) at the reference point
    """
    k0 = 2e6 * np.pi / exits.wavelength_nm
    offset = np.asarray(reference, np.float64) - exits.point
    phase = k0 * np.einsum("ni,ni->n", exits.refraction_vector, offset)
    fields = exits.field * np.exp(1j * phase)[:, None]
    directions: list[Real] = []
    sums: list[Complex] = []
    for direction, e in zip(exits.direction, fields, strict=True):
        for number, known in enumerate(directions):
            if np.linalg.norm(direction - known) < tolerance:
                sums[number] = sums[number] + e
                break
        else:
            directions.append(direction)
            sums.append(e)
    return np.array(directions).reshape(-1, 3), np.array(sums).reshape(-1, 3)

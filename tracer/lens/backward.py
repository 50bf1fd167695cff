"""A lens used backward, as a camera does: which light would arrive along a ray?

Two phases. `trace_backward` knows a ray and a wavelength only; it follows the reversed paths of
light and hands out the exits of the tree. The application finds out what light arrives at each exit
(travelling against it), and `answer` carries that light through the lens, every coefficient taken
in the true direction of the light. The answer is a bundle, one ray for each arriving ray: what
interferes with what is for the application to decide, so the lens never adds anything up.

Radiance over squared index is constant along a path without losses; with one medium on both sides
the radiance at the root is the arriving one times the shares that the fields carry.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.optics.frames import transverse_axes
from tracer.lens.errors import LensError
from tracer.lens.forward import plain, run_chunks, trace_lens
from tracer.lens.lens import Lens
from tracer.lens.reversed_light import ArrivingLight, Chain, send_back
from tracer.lens.tree import Exits, LensTree
from tracer.optics.polarization_rays import PolarizationError, PolarizedRays, require_transverse

__all__ = ["Arriving", "Bundle", "answer", "trace_backward"]

Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Arriving:
    """Fully polarised light that arrives at exits of a backward tree, against their directions.

    Attributes
    ----------
    exit : (m,) int64, row of the table of exits; one exit may get any number of rays
    field : (m, 3) complex, perpendicular to the exit's direction; squared length the flux
    optical_path : (m,) [mm] from the source to the exit
    coherence, group : (m,) int64, see `PolarizedRays`
    """

    exit: NDArray[np.int64]
    field: NDArray[np.complex128]
    optical_path: Real
    coherence: NDArray[np.int64]
    group: NDArray[np.int64]

    @classmethod
    def at(
        cls,
        exit: ArrayLike,
        field: ArrayLike,
        *,
        optical_path: ArrayLike = 0.0,
        coherence: ArrayLike = 0,
        group: ArrayLike = -1,
    ) -> Arriving:
        """Light at exits; every argument broadcasts over the rows of ``exit``."""
        rows = np.atleast_1d(np.asarray(exit, np.int64))
        n = len(rows)
        return cls(
            exit=rows,
            field=np.ascontiguousarray(np.broadcast_to(np.asarray(field, np.complex128), (n, 3))),
            optical_path=np.array(np.broadcast_to(np.asarray(optical_path, np.float64), (n,))),
            coherence=np.array(np.broadcast_to(np.asarray(coherence, np.int64), (n,))),
            group=np.array(np.broadcast_to(np.asarray(group, np.int64), (n,))),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Bundle:
    """Light at the roots of backward trees, one row for each arriving ray.

    Attributes
    ----------
    ray : (m,) int64, the ray that the tree was started with
    exit : (m,) int64, row of the table of exits
    level : (m,) int64 of that exit
    half_waves : (m,) int64, reflections that turned the vibration by pi
    light : what arrives at the origins of the rays, travelling against them
    """

    ray: NDArray[np.int64]
    exit: NDArray[np.int64]
    level: NDArray[np.int64]
    half_waves: NDArray[np.int64]
    light: PolarizedRays

    def __len__(self) -> int:
        return len(self.ray)


def trace_backward(
    lens: Lens,
    origin: ArrayLike,
    direction: ArrayLike,
    *,
    wavelength_nm: ArrayLike,
    depth: int = 6,
    threads: int = 1,
) -> LensTree:
    """First phase: the tree of reversed paths; no polarisation is known yet.

    Its fluxes are shares of unpolarised light ("scalar"): which exits are worth following.
    """
    d = np.atleast_2d(np.asarray(direction, np.float64))
    x, _ = transverse_axes(d)
    rays = PolarizedRays.from_field(origin, d, x, wavelength_nm=wavelength_nm)
    return trace_lens(lens, rays, depth=depth, mode="scalar", threads=threads)


def answer(
    tree: LensTree,
    exits: Exits,
    arriving: Arriving,
    *,
    mode: Literal["polarized", "published"] = "polarized",
    path_to_origin: bool = True,
    threads: int = 1,
) -> Bundle:
    """Second phase: carry the arriving light to the roots of the trees.

    Parameters
    ----------
    tree, exits : of the first phase
    arriving : light at exits
    mode : Fresnel's phases, or the published rules for comparison
    path_to_origin : count the optical path up to the origin of the root ray (else to the lens)
    threads : for chunks of the arriving rays

    Raises
    ------
    LensError
        an exit that the table does not have
    PolarizationError
        a field that is not perpendicular to its exit
    """
    if len(arriving.exit) and not (arriving.exit.min() >= 0 and arriving.exit.max() < len(exits)):
        raise LensError(f"arriving.exit names an exit outside the {len(exits)} of this tree")
    outward = exits.direction[arriving.exit]
    if not np.all(np.isfinite(arriving.field.view(np.float64))):
        raise PolarizationError("arriving.field holds numbers that are not finite")
    lit = np.any(arriving.field != 0.0, axis=1)
    require_transverse(arriving.field[lit], outward[lit], "arriving.field")

    n = len(arriving.exit)
    root = np.ascontiguousarray(exits.ray[arriving.exit])
    level = np.ascontiguousarray(exits.level[arriving.exit])
    field = np.zeros((n, 3), np.complex128)
    turns = np.zeros(n, np.int64)
    path = arriving.optical_path.copy()
    light = ArrivingLight(root, level, plain(arriving.field), path, field, turns)
    deepest = int(level.max(initial=1))
    lost: list[int] = []

    def run(start: int, stop: int) -> None:
        chain = Chain(np.empty((deepest, 3)), np.empty((deepest + 1, 3)), np.empty(deepest))
        row = send_back(
            tree.lens.shape, tree.media, mode == "published", path_to_origin, light, chain, start,
            stop,
        )  # fmt: skip
        if row >= 0:
            lost.append(row)

    run_chunks(run, n, None, threads)
    if lost:
        raise LensError(f"arriving.exit of row {min(lost)} is not an exit of this tree")
    rays = tree.rays.where(root)
    back = replace(
        rays,
        direction=-rays.direction,
        field=field,
        optical_path=path,
        coherence=arriving.coherence,
        group=arriving.group,
    )
    return Bundle(ray=root, exit=arriving.exit, level=level, half_waves=turns, light=back)

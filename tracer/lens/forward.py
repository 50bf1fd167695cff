"""Light through a lens: rays in, trees out."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor, wait
from dataclasses import replace
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from tracer.lens.arrays import RayArrays, TreeOptions, empty_nodes
from tracer.lens.errors import LensError
from tracer.lens.hits import INSIDE
from tracer.lens.lens import Lens
from tracer.lens.polarized_tree import PUBLISHED_RULES, grow_polarized
from tracer.lens.scalar_tree import SCHLICK_RULES, grow_scalar
from tracer.lens.tree import LensTree
from tracer.optics.polarization_rays import PolarizedRays, natural_light

__all__ = ["MAX_DEPTH", "RGB_NM", "Mode", "trace_lens", "trace_rgb"]

Mode = Literal["polarized", "unpolarized", "scalar", "schlick", "published"]

MODES: tuple[Mode, ...] = ("polarized", "unpolarized", "scalar", "schlick", "published")

MAX_DEPTH = 1000
"""Deepest tree; what a lens still holds after that many hits is nothing."""

RGB_NM = (611.0, 549.0, 464.0)
"""Wavelengths that stand for the channels red, green, blue [nm]."""

_CHUNK = 8192

_Scalar = TypeVar("_Scalar", bound=np.generic)


def trace_lens(
    lens: Lens,
    rays: PolarizedRays,
    *,
    depth: int = 6,
    mode: Mode = "polarized",
    keep_reflection: bool = True,
    keep_backward: bool = True,
    min_share: float = 0.0,
    path_from_origin: bool = True,
    index_wavelength_nm: float | None = None,
    executor: Executor | None = None,
    threads: int = 1,
) -> LensTree:
    """Turn every ray that meets a lens into all its outgoing rays.

    Parameters
    ----------
    lens : the lens
    rays : light from outside; rays that pass the lens by get empty trees
    depth : deepest level dT: hits of caps that are followed
    mode : "polarized": fields by Fresnel's equations. "unpolarized": the exact mean of two
        orthogonal polarised trees; the fields of ``rays`` only give the flux. "scalar": the mean
        reflectance at every hit; "schlick": Schlick's approximation of it. "published": the
        published phase rules, for comparison; they are wrong at internal reflections
    keep_reflection : whether the reflection at the first hit leaves as a ray
    keep_backward : whether rays that leave against the incoming direction are kept
    min_share : exits below this share of the incoming flux are suppressed, and a tree whose inner
        ray falls below it ends
    path_from_origin : count the optical path from the origin of the ray (else from the hit)
    index_wavelength_nm : take refractive indices at this wavelength (no dispersion)
    executor, threads : a thread pool, or how many threads, for chunks of the rays

    Returns
    -------
    LensTree
        light that suppressed exits would have carried is booked as ``suppressed``

    Raises
    ------
    LensError
        names the option, or the ray that starts inside the glass
    """
    _check_options(depth, mode, min_share, threads)
    if mode == "unpolarized":
        return _trace_natural(
            lens, rays, depth=depth, keep_reflection=keep_reflection, keep_backward=keep_backward,
            min_share=min_share, path_from_origin=path_from_origin,
            index_wavelength_nm=index_wavelength_nm, executor=executor, threads=threads,
        )  # fmt: skip
    polarized = mode in ("polarized", "published")
    arrays = ray_arrays(lens, rays, polarized=polarized, index_wavelength_nm=index_wavelength_nm)
    rules = PUBLISHED_RULES if mode == "published" else SCHLICK_RULES if mode == "schlick" else 0
    options = TreeOptions(
        depth, rules, keep_reflection, keep_backward, float(min_share), path_from_origin
    )
    nodes = empty_nodes(len(rays), depth, polarized=polarized)
    grow = grow_polarized if polarized else grow_scalar

    def run(start: int, stop: int) -> None:
        grow(lens.shape, arrays, options, nodes, start, stop)

    run_chunks(run, len(rays), executor, threads)
    _refuse_inside(nodes.status, lens)
    return LensTree.from_nodes(lens, rays, mode, nodes, arrays)


def trace_rgb(
    lens: Lens,
    rays: PolarizedRays,
    *,
    dispersion: bool = False,
    depth: int = 6,
    mode: Mode = "scalar",
    threads: int = 1,
) -> tuple[LensTree, LensTree, LensTree]:
    """The trees of the channels red, green, blue; the wavelengths of ``rays`` do not matter.

    Without ``dispersion`` all channels share the index at the d line, so their rays coincide and
    no coloured fringes appear; with it each channel takes the index at its wavelength `RGB_NM`.
    The glass absorbs by channel in both cases.
    """
    single = None if dispersion else 587.5618
    red, green, blue = (
        trace_lens(
            lens, replace(rays, wavelength_nm=np.float64(wavelength) + np.zeros(())),
            depth=depth, mode=mode, index_wavelength_nm=single, threads=threads,
        )
        for wavelength in RGB_NM
    )  # fmt: skip
    return red, green, blue


def ray_arrays(
    lens: Lens, rays: PolarizedRays, *, polarized: bool, index_wavelength_nm: float | None = None
) -> RayArrays:
    """The columns that compiled code reads."""
    if rays.wavelength_nm.ndim == 0:
        distinct = rays.wavelength_nm.reshape(1)
        medium: NDArray[np.int32] = np.zeros(len(rays), np.int32)
    else:
        distinct, inverse = np.unique(rays.wavelength_nm, return_inverse=True)
        medium = inverse.astype(np.int32)
    outside, glass, absorption = lens.optics(distinct, index_wavelength_nm)
    return RayArrays(
        origin=plain(rays.origin),
        direction=plain(rays.direction),
        field=plain(rays.field) if polarized else np.empty((0, 3), np.complex128),
        flux=np.empty(0) if polarized else plain(rays.flux),
        path=plain(rays.optical_path),
        medium=medium,
        outside_index=plain(outside),
        glass_index=plain(glass),
        absorption=plain(absorption),
        frame=lens.frame,
    )


def plain(column: NDArray[_Scalar]) -> NDArray[_Scalar]:
    """The column as compiled code knows it: it is compiled anew for strided or locked arrays."""
    return np.require(column, requirements=["C", "W"])


def run_chunks(
    run: Callable[[int, int], None], n_rays: int, executor: Executor | None, threads: int
) -> None:
    """Call ``run(start, stop)`` over all rays, on a pool where that is asked for."""
    starts = range(0, n_rays, _CHUNK)
    if executor is None and (threads == 1 or n_rays <= _CHUNK):
        run(0, n_rays)
        return
    pool = executor or ThreadPoolExecutor(threads)
    try:
        pending = [pool.submit(run, start, min(start + _CHUNK, n_rays)) for start in starts]
        wait(pending)
        for done in pending:
            done.result()
    finally:
        if executor is None:
            pool.shutdown()


def _trace_natural(
    lens: Lens,
    rays: PolarizedRays,
    *,
    depth: int,
    keep_reflection: bool,
    keep_backward: bool,
    min_share: float,
    path_from_origin: bool,
    index_wavelength_nm: float | None,
    executor: Executor | None,
    threads: int,
) -> LensTree:
    halves = natural_light(
        rays.origin,
        rays.direction,
        wavelength_nm=rays.wavelength_nm,
        flux=rays.flux,
        coherence=rays.coherence,
    )
    first, second = (
        trace_lens(
            lens, replace(half, optical_path=rays.optical_path), depth=depth,
            keep_reflection=keep_reflection, keep_backward=keep_backward, min_share=min_share,
            path_from_origin=path_from_origin, index_wavelength_nm=index_wavelength_nm,
            executor=executor, threads=threads,
        )
        for half in halves
    )  # fmt: skip
    return LensTree.mean_of(first, second, rays)


def _check_options(depth: int, mode: str, min_share: float, threads: int) -> None:
    if not 1 <= depth <= MAX_DEPTH:
        raise LensError(f"depth (dT) is {depth}: a tree has 1 to {MAX_DEPTH} levels")
    if mode not in MODES:
        raise LensError(f"mode is {mode!r}: choose one of {', '.join(MODES)}")
    if not 0.0 <= min_share < 1.0:
        raise LensError(f"min_share is {min_share:g}: a share of the flux lies in 0 .. 1")
    if threads < 1:
        raise LensError(f"threads is {threads}: at least 1")


def _refuse_inside(status: NDArray[np.int8], lens: Lens) -> None:
    inside = status == INSIDE
    if np.any(inside):
        raise LensError(
            f"origin of ray {int(np.argmax(inside))} lies inside the glass of {lens.name!r}: "
            "light must come from outside"
        )

"""Open surfaces that lie on one another: light meets one, and the hidden one is warned about.

An open surface has no thickness, so of two in one place only one surface can act: a detector's,
otherwise that of the body named first. That must be neither left to rounding nor a surprise.
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from tracer.compiled import CoincidentFaces
from tracer.geometry.shapes import Annulus, Polygon, Rectangle, Shape
from tracer.scene.faces import Primitive
from tracer.surfaces.surface import Surface

__all__ = ["HiddenSurface", "open_surfaces_overlap", "warn_of_hidden_surfaces"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Flat = Annulus | Rectangle | Polygon

_SLIVER = 1e-6
"""Share of the scene's radius by which typed numbers let surfaces side by side overlap."""

_NAMED = 3


class HiddenSurface(UserWarning):
    """An open surface that light does not meet where another one lies on it."""


def warn_of_hidden_surfaces(
    coincident: CoincidentFaces | None,
    faces: Sequence[Primitive],
    bodies: Sequence[str],
    surfaces: Sequence[Surface],
    size: float,
    where: str,
) -> None:
    """Warn of open surfaces that lie on one another, once for each that hides others.

    Nothing is said where nothing is lost: of a detector on a wall, of opaque boxes that touch.

    Parameters
    ----------
    coincident : faces that lie on one another
    faces, bodies, surfaces : of the scene, by number
    size : radius of the scene
    where : names the scene
    """
    if coincident is None:
        return
    pairs = list(_pairs(coincident, faces, surfaces))
    ones, others = ([faces[pair[k]] for pair in pairs] for k in (0, 1))
    lies = open_surfaces_overlap(
        [face.shape for face in ones], [face.shape for face in others], _SLIVER * size
    )
    hidden: dict[str, dict[str, None]] = {}
    for a, b, on in zip(ones, others, lies, strict=True):
        if on:
            hidden.setdefault(bodies[a.object], {})[bodies[b.object]] = None
    for first, below in hidden.items():
        known = list(below)
        names = ", ".join(repr(name) for name in known[:_NAMED])
        if len(known) > _NAMED:
            names += f" and {len(known) - _NAMED} more"
        warnings.warn(
            f"{where}: open surface {first!r} lies on {names}: light meets only {first!r} there, "
            "which is named first; leave a micrometre between them if light shall meet both, or "
            "name first what it shall meet",
            HiddenSurface,
            stacklevel=4,
        )


def _pairs(
    coincident: CoincidentFaces, faces: Sequence[Primitive], surfaces: Sequence[Surface]
) -> Iterator[tuple[int, int]]:
    """The one that light meets and the one it does not, where that changes what happens."""
    parts = Counter(face.object for face in faces)
    for one in np.flatnonzero(np.diff(coincident.first)).tolist():
        for other in coincident.face[coincident.first[one] : coincident.first[one + 1]].tolist():
            a, b = faces[one], faces[other]
            if other < one or a.inside >= 0 or b.inside >= 0:
                continue
            if (a.detector >= 0) != (b.detector >= 0):
                continue
            opaque = not (surfaces[a.surface].transmits() or surfaces[b.surface].transmits())
            alike = a.surface == b.surface or parts[a.object] > 1 or parts[b.object] > 1
            if not (opaque and alike):
                yield one, other


def open_surfaces_overlap(one: Sequence[Shape], other: Sequence[Shape], least: float) -> Flags:
    """Which pairs of flat faces of one plane share more than a strip of the width ``least``.

    Faces of other shapes do: they are known to be parts of one surface, along the same stretch.

    Parameters
    ----------
    one, other : n faces each
    """
    found = np.ones(len(one), bool)
    alike: dict[tuple[int, int, bool, bool], list[int]] = {}
    for k, (a, b) in enumerate(zip(one, other, strict=True)):
        if isinstance(a, Flat) and isinstance(b, Flat):
            rings = isinstance(a, Annulus), isinstance(b, Annulus)
            alike.setdefault((len(_corners(a)), len(_corners(b)), *rings), []).append(k)
    for numbers in alike.values():
        found[numbers] = _overlap(
            _Flats([one[k] for k in numbers]), _Flats([other[k] for k in numbers]), least
        )
    return found


class _Flats:
    """Flat faces of one kind, with equally many corners.

    corners : (n, k, 3), of rings their centre
    edges : (n, k, 3) from each corner to the next
    ring, inner, outer : whether they are rings, and their radii (n,); 0 without
    """

    def __init__(self, shapes: Sequence[Shape]) -> None:
        flats = [shape for shape in shapes if isinstance(shape, Flat)]
        self.corners = np.array([_corners(shape) for shape in flats])
        self.normal = np.array([shape.normal for shape in flats])
        self.edges = np.roll(self.corners, -1, axis=1) - self.corners
        rings = [shape for shape in flats if isinstance(shape, Annulus)]
        self.ring = bool(rings)
        self.inner, self.outer = np.zeros((2, len(flats)))
        if rings:
            self.inner = np.array([shape.inner for shape in rings])
            self.outer = np.array([shape.outer for shape in rings])

    def extent(self, n: Array) -> tuple[Array, Array]:
        """From where to where they reach along directions (n, m, 3) in their planes: (n, m)."""
        along = np.einsum("nkc,nmc->nmk", self.corners, n)
        outer = self.outer[:, None]
        return along.min(axis=2) - outer, along.max(axis=2) + outer


def _overlap(one: _Flats, other: _Flats, least: float) -> Flags:
    """Which pairs share more than a strip of the width ``least``."""
    n = _directions(one, other)
    (low, high), (lower, higher) = one.extent(n), other.extent(n)
    shared = np.minimum(high, higher) - np.maximum(low, lower)
    # A direction of no length, of a ring with the corner of its centre, separates nothing
    apart = ((shared <= least) & n.any(axis=2)).any(axis=1)
    return ~(apart | _in_hole(one, other, least) | _in_hole(other, one, least))


def _directions(one: _Flats, other: _Flats) -> Array:
    """Directions along one of which convex faces in a plane are apart, if they are at all."""
    found = []
    for flats, partner in ((one, other), (other, one)):
        if flats.ring:
            found.append(partner.corners - flats.corners)
        else:
            found.append(np.cross(flats.edges, flats.normal[:, None]))
    n = np.concatenate(found, axis=1)
    lengths = np.linalg.norm(n, axis=2, keepdims=True)
    return np.asarray(n / np.where(lengths > 0.0, lengths, 1.0))


def _corners(shape: Flat) -> Array:
    if isinstance(shape, Annulus):
        return np.asarray(shape.origin)[None]
    return shape.corners() if isinstance(shape, Rectangle) else shape.vertices


def _in_hole(rings: _Flats, other: _Flats, least: float) -> Flags:
    """Which faces lie in the hole of a ring."""
    if not rings.ring:
        return np.zeros(len(rings.corners), bool)
    farthest = np.linalg.norm(other.corners - rings.corners, axis=2).max(axis=1) + other.outer
    return np.asarray((rings.inner > 0.0) & (farthest <= rings.inner + least))

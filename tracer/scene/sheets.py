"""Sheets that lie on one another: light meets one of them, and the hidden one is warned about.

A sheet has no thickness, so of two in one place only one surface can act: a detector's, otherwise
that of the body named first. That must be neither left to rounding nor a surprise.
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from tracer.geometry.shapes import Annulus, Polygon, Rectangle, Shape
from tracer.scene.arrays import Contacts
from tracer.scene.faces import Primitive
from tracer.scene.model import SurfaceModel

__all__ = ["HiddenSheet", "sheets_overlap", "warn_of_hidden_sheets"]

Array = NDArray[np.float64]
Flat = Annulus | Rectangle | Polygon

_SLIVER = 1e-6
"""Share of the scene's radius by which typed numbers let sheets overlap that stand side by side."""

_NAMED = 3


class HiddenSheet(UserWarning):
    """A sheet that light does not meet where another one lies on it."""


def warn_of_hidden_sheets(
    contacts: Contacts | None,
    faces: Sequence[Primitive],
    bodies: Sequence[str],
    surfaces: Sequence[SurfaceModel],
    size: float,
    place: str,
) -> None:
    """Warn of sheets that lie on one another, once for each that hides others.

    Nothing is said where nothing is lost: of a detector on a wall, of opaque boxes that touch.

    Parameters
    ----------
    contacts : faces that lie on one another
    faces, bodies, surfaces : of the scene, by number
    size : radius of the scene
    place : names the scene
    """
    if contacts is None:
        return
    hidden: dict[str, list[str]] = {}
    for a, b in _pairs(contacts, faces, surfaces):
        first, other = bodies[faces[a].object], bodies[faces[b].object]
        known = hidden.setdefault(first, [])
        if other not in known and sheets_overlap(faces[a].shape, faces[b].shape, _SLIVER * size):
            known.append(other)
    for first, others in hidden.items():
        if not others:
            continue
        names = ", ".join(repr(name) for name in others[:_NAMED])
        if len(others) > _NAMED:
            names += f" and {len(others) - _NAMED} more"
        warnings.warn(
            f"{place}: sheet {first!r} lies on {names}: light meets only {first!r} there, which "
            "is named first; leave a micrometre between them if light shall meet both, or name "
            "first what it shall meet",
            HiddenSheet,
            stacklevel=4,
        )


def _pairs(
    contacts: Contacts, faces: Sequence[Primitive], surfaces: Sequence[SurfaceModel]
) -> Iterator[tuple[int, int]]:
    """The sheet that light meets and the one it does not, where that changes what happens."""
    parts = Counter(face.object for face in faces)
    for one in np.flatnonzero(np.diff(contacts.first)).tolist():
        for other in contacts.face[contacts.first[one] : contacts.first[one + 1]].tolist():
            a, b = faces[one], faces[other]
            if other < one or a.inside >= 0 or b.inside >= 0:
                continue
            if (a.detector >= 0) != (b.detector >= 0):
                continue
            opaque = not (_transmits(surfaces[a.surface]) or _transmits(surfaces[b.surface]))
            alike = a.surface == b.surface or parts[a.object] > 1 or parts[b.object] > 1
            if not (opaque and alike):
                yield one, other


def _transmits(surface: SurfaceModel) -> bool:
    """Whether light goes through a sheet of this surface."""
    if surface.kind in ("dielectric", "rough_dielectric", "filter"):
        return True
    return bool(surface.transmittance) or surface.transmitted is not None


def sheets_overlap(one: Shape, other: Shape, least: float) -> bool:
    """Whether flat faces of one plane share more than a strip of the width ``least``.

    Faces of other shapes do: they are known to be parts of one surface, along the same stretch.
    """
    if not (isinstance(one, Flat) and isinstance(other, Flat)):
        return True
    for n in _directions(one, other):
        (low, high), (lower, higher) = _extent(one, n), _extent(other, n)
        if min(high, higher) - max(low, lower) <= least:
            return False
    return not (_in_hole(one, other, least) or _in_hole(other, one, least))


def _directions(one: Flat, other: Flat) -> list[Array]:
    """Directions along one of which convex faces in a plane are apart, if they are at all."""
    found: list[Array] = []
    for shape, partner in ((one, other), (other, one)):
        if not isinstance(shape, Annulus):
            corners = _corners(shape)
            found += list(np.cross(np.roll(corners, -1, axis=0) - corners, shape.normal))
        elif isinstance(partner, Annulus):
            found.append(partner.origin - shape.origin)
        else:
            found += list(_corners(partner) - shape.origin)
    lengths = [float(np.linalg.norm(n)) for n in found]
    return [n / length for n, length in zip(found, lengths, strict=True) if length > 0.0]


def _corners(shape: Rectangle | Polygon) -> Array:
    return shape.corners() if isinstance(shape, Rectangle) else shape.vertices


def _extent(shape: Flat, n: Array) -> tuple[float, float]:
    """From where to where a face reaches along a direction in its plane."""
    if isinstance(shape, Annulus):
        middle = float(shape.origin @ n)
        return middle - shape.outer, middle + shape.outer
    along = _corners(shape) @ n
    return float(along.min()), float(along.max())


def _in_hole(ring: Flat, other: Flat, least: float) -> bool:
    """Whether a face lies in the hole of a ring."""
    if not isinstance(ring, Annulus) or ring.inner <= 0.0:
        return False
    if isinstance(other, Annulus):
        farthest = float(np.linalg.norm(other.origin - ring.origin)) + other.outer
    else:
        farthest = float(np.linalg.norm(_corners(other) - ring.origin, axis=1).max())
    return farthest <= ring.inner + least

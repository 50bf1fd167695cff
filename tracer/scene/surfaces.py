"""Surfaces of a scene by number: the rows that their kinds fill, and the pool of tables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from raymap.laws.law import Law
from tracer.compiled import S_AIMED, S_COLUMNS, S_KIND, S_MODEL, SURFACE_ROW
from tracer.description.asking import asking
from tracer.scene.media import MediumTable
from tracer.surfaces.linking import number_of
from tracer.surfaces.surface import Surface, SurfaceRow, TablePool

__all__ = ["compile_surfaces"]

Array = NDArray[np.float64]


def compile_surfaces(
    surfaces: Sequence[tuple[str, Surface]], media: MediumTable, wavelengths_nm: Array, origin: str
) -> tuple[NDArray[np.int64], Array, Array, list[Law | None]]:
    """Integers (n, S_COLUMNS), numbers (n, SURFACE_ROW + 2 C), the flat pool of all tables, laws.

    Parameters
    ----------
    surfaces : by number, with their names
    media : of the scene; their tables come first in the pool
    wavelengths_nm : of the C channels
    origin : names the scene in messages

    Raises
    ------
    SceneError
    """
    pool = TablePool(media.tables)
    rows = [
        SurfaceRow(name, origin, wavelengths_nm, pool, media.index, media.number)
        for name, _ in surfaces
    ]
    for row, (name, surface) in zip(rows, surfaces, strict=True):
        row.integers[S_KIND] = number_of(type(surface))
        with asking(surface, f"{origin}: surfaces.{name}"):
            surface.compile(row)
        row.integers[S_AIMED] = surface.aimed_sides()
        if surface.law is not None:
            row.integers[S_MODEL] = int(surface.law.diffuse)
    width = SURFACE_ROW + 2 * len(wavelengths_nm)
    return (
        np.array([row.integers for row in rows], np.int64).reshape(-1, S_COLUMNS),
        np.array([row.numbers for row in rows]).reshape(-1, width),
        pool.joined(),
        [surface.stated(row) for row, (_, surface) in zip(rows, surfaces, strict=True)],
    )

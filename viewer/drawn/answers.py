"""The rays of a selection that are drawn: the one place where pictures ask questions."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from query import select
from query.answers.images.images import detector_image as query_image
from query.answers.images.lit import LitCells
from query.answers.images.pictures import DetectorImage
from query.answers.paths.ghosts import GhostMatrix, matrix_of
from query.answers.paths.ghosts import ghost_table as query_ghosts
from query.answers.paths.tables import path_table as query_table
from query.answers.reports.ray_report import report
from query.answers.selections.selector import bind_all
from query.engine.context import PathContext
from query.engine.path_text import PathNames, exact_criterion, path_text
from query.engine.scan import default_threads
from query.expression.spellings import as_criterion
from raymap.model.directory import ChannelSet, Detector
from raymap.model.errors import DamagedPortion, RayMapError
from raymap.optics.cells import is_pinhole
from viewer.drawn.gather import read_rays, thin
from viewer.drawn.itinerary import headline
from viewer.drawn.rays import DrawnRays

if TYPE_CHECKING:
    from query.answers.selections.selection import Selection
    from raymap.file.reader import RayMap

__all__ = [
    "Drawing",
    "check_criterion",
    "count_rays",
    "detector_image",
    "draw_rays",
    "ghost_matrix",
    "join_criteria",
    "path_labels",
    "path_of_ray",
    "path_table",
    "ray_report",
    "read_one",
]

Cancel = Callable[[], bool]
Preview = Callable[[DrawnRays], None]

PREVIEW_SECONDS = 0.3
"""Rays read within this time are shown before the others are there."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawing:
    """Rays to draw.

    Attributes
    ----------
    rays : the rays
    labels : text of the paths by path number, for the legend; empty if they have no names
    """

    rays: DrawnRays
    labels: dict[int, str]


def join_criteria(*criteria: str) -> str:
    """All of several criteria, given as text; empty ones are left out."""
    parts = [text.strip() for text in criteria if text.strip()]
    return parts[0] if len(parts) == 1 else " & ".join(f"({text})" for text in parts)


def draw_rays(
    ray_map: RayMap,
    criterion: Any,
    limit: int,
    *,
    paths: Sequence[tuple[str, str]] = (),
    cancel: Cancel | None = None,
    preview: Preview | None = None,
) -> Drawing:
    """Find and read at most ``limit`` rays that satisfy a criterion, the same ones every time.

    Parameters
    ----------
    criterion : text, tree or JSON; None or "" selects every ray
    paths : (criterion, label) of paths to be shown alone; each gets an equal part of ``limit`` and
        is one path of the drawing
    cancel : becomes true when the rays are no longer wanted
    preview : called with the rays read so far, when all of them take a while
    """
    given = None if isinstance(criterion, str) and not criterion.strip() else criterion
    if not paths:
        rays = _draw(ray_map, given, limit, cancel, preview)
        return Drawing(rays=rays, labels=path_labels(ray_map, rays.path))
    share = max(1, limit // len(paths))
    parts, labels = [], {}
    for number, (path, label) in enumerate(paths):
        text = join_criteria(_as_text(given), path)
        rays = _draw(ray_map, text, share, cancel)
        parts.append(replace(rays, path=np.full(rays.n_rays, number, np.int64)))
        labels[number] = label
    return Drawing(rays=DrawnRays.join(parts), labels=labels)


def _as_text(criterion: Any) -> str:
    node = as_criterion(criterion)
    return "" if node is None else str(node)


def _draw(
    ray_map: RayMap,
    criterion: Any,
    limit: int,
    cancel: Cancel | None,
    preview: Preview | None = None,
) -> DrawnRays:
    try:
        found = select(ray_map, criterion, limit=limit, cancel=cancel)
    except DamagedPortion:
        if ray_map.on_damage == "raise":
            raise
        # The first rays cannot be told where a damaged portion is among them: search all
        found = select(ray_map, criterion, cancel=cancel)
        return _read(ray_map, list(found.parts()), limit, cancel, preview)
    parts = list(found.parts())
    if found.matched == limit and len(parts) == 1:
        # The first numbers of a portion may belong to one source: choose among all of it
        n_rays = ray_map.portions[parts[0][0]].n_rays
        if n_rays > limit:
            found = select(ray_map, criterion, limit=n_rays, cancel=cancel)
            parts = list(found.parts())
    return _read(ray_map, parts, limit, cancel, preview)


def _read(
    ray_map: RayMap,
    parts: Sequence[tuple[int, NDArray[np.int64]]],
    limit: int,
    cancel: Cancel | None,
    preview: Preview | None,
) -> DrawnRays:
    """Read the rays of portions, several at the same time, until there are enough."""
    plan: list[tuple[int, NDArray[np.int64]]] = []
    left = limit
    for index, rows in parts:
        if left <= 0:
            break
        chosen = rows[thin(ray_map.portions[index].ray_ids()[rows], left)]
        plan.append((index, chosen))
        left -= len(chosen)
    drawn: list[DrawnRays] = []
    shown = time.perf_counter()
    with ThreadPoolExecutor(default_threads()) as pool:
        waiting = [pool.submit(_read_part, ray_map, *part, cancel) for part in plan]
        for number, part in enumerate(waiting):
            found = part.result()
            if found is not None:
                drawn.append(found)
            slow = time.perf_counter() - shown > PREVIEW_SECONDS
            if preview is not None and slow and drawn and number + 1 < len(waiting):
                preview(DrawnRays.join(drawn))
                shown = time.perf_counter() + PREVIEW_SECONDS
    return DrawnRays.join(drawn)


def _read_part(
    ray_map: RayMap, index: int, rows: NDArray[np.int64], cancel: Cancel | None
) -> DrawnRays | None:
    """Rays of one portion; None if they are no longer wanted, or damaged and to be skipped."""
    if cancel is not None and cancel():
        return None
    try:
        return read_rays(ray_map, index, rows)
    except DamagedPortion:
        if ray_map.on_damage == "raise":
            raise
        return None


def read_one(ray_map: RayMap, ray_id: int) -> DrawnRays:
    """One ray by its number.

    Raises
    ------
    RayNotFound
    """
    index, row = ray_map.find_ray(ray_id)
    try:
        return read_rays(ray_map, index, np.array([row], np.int64))
    except IndexError as error:
        raise RayMapError(f"ray {ray_id} cannot be read: {error}") from None


def check_criterion(ray_map: RayMap, text: str) -> None:
    """Refuse a criterion that cannot be read or does not fit the map.

    Raises
    ------
    CriterionError
    """
    bind_all(ray_map, [text or None])


def count_rays(
    ray_map: RayMap,
    text: str,
    *,
    cancel: Cancel | None = None,
    progress: Callable[[Any], None] | None = None,
) -> Selection:
    """How many rays satisfy a criterion, and their flux."""
    return select(ray_map, text or None, rays=False, cancel=cancel, progress=progress)


def path_table(
    ray_map: RayMap, text: str, *, by: str, top: int, cancel: Cancel | None = None
) -> list[dict[str, Any]]:
    """The strongest paths of a selection; the remainder is the last row, if there is any."""
    rows = query_table(ray_map, text or None, by=by, cancel=cancel).to_json(top)
    return [row for row in rows if row["rays"] > 0]


def path_labels(ray_map: RayMap, paths: NDArray[np.int64], most: int = 12) -> dict[int, str]:
    """Itineraries of the commonest of the merged paths, by path number."""
    if ray_map.merged is None or len(paths) == 0 or int(paths.min()) < 0:
        return {}
    different, counts = np.unique(paths, return_counts=True)
    base, names = PathContext(ray_map.merged.paths), PathNames(ray_map.directory)
    chosen = different[np.argsort(-counts, kind="stable")[:most]]
    return {int(p): headline(path_text(base, int(p), names, "face")) for p in chosen}


def path_of_ray(ray_map: RayMap, ray_id: int) -> str:
    """A criterion that selects the rays that took the path of this one."""
    index, row = ray_map.find_ray(ray_id)
    portion = ray_map.portions[index]
    number = int(portion.path_numbers()[row])
    base, names = PathContext(portion.paths()), PathNames(ray_map.directory)
    return str(exact_criterion(path_text(base, number, names, "face")))


def ray_report(ray_map: RayMap, ray_id: int) -> dict[str, Any]:
    """Everything recorded of one ray.

    Raises
    ------
    RayNotFound
    """
    return report(ray_map, ray_id)


def detector_image(
    ray_map: RayMap, name: str, text: str, *, cancel: Cancel | None = None
) -> DetectorImage:
    """The picture that the rays of a selection made on a detector.

    A pinhole's picture is there as a whole only: no ray meets it, so selections leave it dark. So
    do those in a map without rays, and all is dark in one that is only begun.
    """
    entry = next(entry for entry in ray_map.directory.detectors if entry.name == name)
    selects = bool(text.strip())
    if selects and (is_pinhole(entry) or not ray_map.rays):
        return _dark(ray_map, entry)
    if not ray_map.rays and not ray_map.without_rays:
        return _dark(ray_map, entry)
    return query_image(ray_map, name, text if selects else None, cancel=cancel)


def _dark(ray_map: RayMap, entry: Detector) -> DetectorImage:
    # A map that is only begun has no channels yet; any will do for darkness
    begun = ChannelSet(kind="spectral", wavelengths_nm=(555.0,))
    channels = ray_map.channel_sets[0] if ray_map.channel_sets else begun
    lit = LitCells(
        detector=entry,
        channel_set=channels,
        flux_unit=ray_map.directory.flux_unit,
        length_unit=ray_map.directory.length_unit,
        cell=np.zeros(0, np.int64),
        channels=np.zeros((0, channels.n_channels)),
        variance=np.zeros(0),
        rays=np.zeros(0, np.int64),
    )
    return DetectorImage(lit=lit)


def ghost_matrix(ray_map: RayMap, text: str, *, cancel: Cancel | None = None) -> GhostMatrix | str:
    """Flux of two-reflection ghosts by the faces that reflect; if there are none, a sentence."""
    table = query_ghosts(ray_map, None, text or None, cancel=cancel)
    return matrix_of(table) if len(table) else table.nothing()

"""Changes as the differences between a recorded map and another scene of the same geometry.

Scenes are the tracer's: what reads them registers under the entry-point group ``raymap.scenes``, a
function from a path to the directory and the channel set that a map of it would have.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from query.answers.what_if.changes import Changes, without_laws
from raymap.laws.law import Law
from raymap.laws.stored import laws_of
from raymap.model.directory import ChannelSet, Directory
from raymap.model.errors import RayMapError

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["changes_of_scene"]

_OF_SOURCES = {"flux", "on", "spectrum", "color", "share"}


def changes_of_scene(map: RayMap, scene: str | Path) -> Changes:
    """What another scene changes of the laws, media and sources of a map.

    Parameters
    ----------
    scene : a scene file; its geometry, indices, channels and detectors are those of the map

    Raises
    ------
    RayMapError
        They are not, as a change there would bend light elsewhere; or nothing reads scenes.
    """
    readers = [point.load() for point in entry_points(group="raymap.scenes")]
    if not readers:
        raise RayMapError("nothing is installed that reads scenes; use --set")
    directory, channels = readers[0](scene)
    own, own_channels = map.directory, map.channel_sets[0]
    if len(map.channel_sets) > 1:
        raise RayMapError("the map was continued with other channels: use --set")
    _check_geometry(own, directory)
    _check_channels(own, own_channels, channels)
    changes = Changes(((str(scene), "scene"),))
    known, new = map.laws(), laws_of(directory, channels)
    if known is None or new is None:
        raise RayMapError(without_laws(map))
    for face, (before, after) in enumerate(
        zip(own.faces.surface.tolist(), directory.faces.surface.tolist(), strict=True)
    ):
        old_law = known.surfaces[before] if before >= 0 else None
        new_law = new.surfaces[after] if after >= 0 else None
        if old_law != new_law and new_law is not None:
            changes.faces[face] = [_to(new_law)]
    for number, name in enumerate(medium.name for medium in own.media):
        old_medium, new_medium = known.media[number], new.media[number]
        if old_medium is None or new_medium is None:
            continue
        if old_medium.phase != new_medium.phase:
            raise RayMapError(f"{name!r} has another phase function in {scene}: that is not built")
        absorption = [np.asarray(s.absorption)[number] for s in (own_channels, channels)]
        if not np.array_equal(absorption[0], absorption[1]):
            changes.media.setdefault(number, {})["absorption"] = absorption[1].tolist()
        if old_medium.scattering != new_medium.scattering:
            zeros = (0.0,) * channels.n_channels
            changes.media.setdefault(number, {})["scattering"] = list(
                new_medium.scattering or zeros
            )
    colors = [np.asarray(each.source_colors) for each in (own_channels, channels)]
    for number, (old_source, new_source) in enumerate(
        zip(own.sources, directory.sources, strict=True)
    ):
        was, now = (
            each.flux if each.parameters.get("on", True) else 0.0
            for each in (old_source, new_source)
        )
        if was != now:
            changes.sources[number] = old_source.model_copy(update={"flux": now})
        if not np.allclose(colors[0][number], colors[1][number], rtol=1e-12):
            changes.colors[number] = colors[1][number].tolist()
    return changes


def _to(law: Law) -> Callable[[Law, ChannelSet], Law]:
    return lambda old, channels: law


def _check_geometry(own: Directory, other: Directory) -> None:
    surfaces = {entry.name for each in (own, other) for entry in each.surfaces}
    for kind in ("sources", "objects", "media", "detectors"):
        names = [[entry.name for entry in getattr(each, kind)] for each in (own, other)]
        if names[0] != names[1]:
            different = set(names[0]) ^ set(names[1])
            raise RayMapError(
                f"the scene has other {kind} than the map"
                + (f" ({', '.join(sorted(different)[:5])})" if different else "")
                + ": only a new trace shows that"
            )
    if own.faces.names != other.faces.names:
        raise RayMapError("the scene has other faces than the map: only a new trace shows that")
    for unit in ("length_unit", "flux_unit"):
        if getattr(own, unit) != getattr(other, unit):
            raise RayMapError(f"the scene has another {unit} than the map")
    for kind in ("objects", "detectors", "sources"):
        for mine, theirs in zip(getattr(own, kind), getattr(other, kind), strict=True):
            pair = [_without(entry.model_dump(), surfaces, kind) for entry in (mine, theirs)]
            if pair[0] != pair[1]:
                raise RayMapError(
                    f"{kind[:-1]} {mine.name!r} is another one in the scene: that bends light "
                    "elsewhere, and only a new trace shows it"
                )


def _without(value: Any, surfaces: set[str], kind: str) -> Any:
    """A description without what may differ: names of surfaces, and light of sources."""
    if isinstance(value, dict):
        dropped = _OF_SOURCES if kind == "sources" else {"surface"}
        return {
            key: _without(item, surfaces, kind)
            for key, item in value.items()
            if key not in dropped and not (isinstance(item, str) and item in surfaces)
        }
    if isinstance(value, list | tuple):
        return [_without(item, surfaces, kind) for item in value]
    return value


def _check_channels(directory: Directory, own: ChannelSet, other: ChannelSet) -> None:
    if (own.kind, own.wavelengths_nm) != (other.kind, other.wavelengths_nm):
        raise RayMapError("the scene has other wavelengths than the map: record it again")
    indices = [np.asarray(each.refractive_index, np.float64) for each in (own, other)]
    if indices[0].shape != indices[1].shape or not np.array_equal(indices[0], indices[1]):
        rows = np.flatnonzero((indices[0] != indices[1]).any(axis=1))
        name = directory.media[int(rows[0])].name
        raise RayMapError(
            f"medium {name!r} has another index in the scene: that bends light elsewhere, and only "
            "a new trace shows it"
        )

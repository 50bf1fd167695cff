"""Write a 3D file; its suffix chooses the format."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast, get_args

from raymap.model.errors import RayMapError
from raymap.model.fileformat import by_suffix, known_suffixes
from raymap.model.replacing import refuse_existing, replacing
from viewer.drawn.state import COLOR_RULES
from viewer.export.content import Grouping, gather
from viewer.export.format import EXPORT_FORMATS

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["DEFAULT_RAYS", "export_3d"]

DEFAULT_RAYS = 500


def export_3d(
    map: RayMap,
    path: str | os.PathLike[str],
    criterion: Any = None,
    *,
    rays: int = DEFAULT_RAYS,
    color: str = "path",
    group: str = "source",
    tail: float | None = None,
    scene: bool = True,
    force: bool = False,
) -> dict[str, Any]:
    """Write rays of a selection and the scene as a 3D file.

    Parameters
    ----------
    map : an open ray map
    path : ``*.glb``, ``*.gltf`` (metres, as glTF has it), ``*.vtp``, ``*.dxf`` (scene units),
        ``*.step`` (millimetres), others as they are installed (``raymap kinds export_formats``)
    criterion : text, tree or JSON; None selects every ray
    rays : at most so many, the same ones every time
    color : one of `viewer.drawn.state.COLOR_RULES`
    group : rays of one "source" or "path" form a layer, node or part; "none": all
    tail : length to which the last segments of rays that leave the scene are cut [scene unit]
    scene : with bodies and the frames of flat detectors; STEP holds the edges of bodies
    force : replace an existing file

    Returns
    -------
    ``rays`` written of those ``selected``, ``segments``, ``objects``, ``groups``

    Raises
    ------
    RayMapError, MapExists, MissingExtra
    """
    target = Path(path)
    chosen = by_suffix(EXPORT_FORMATS, target)
    if chosen is None:
        known = known_suffixes(EXPORT_FORMATS.kinds())
        raise RayMapError(f"3D files end in {known}, not {target.name!r}")
    if color not in COLOR_RULES:
        raise RayMapError(f"no colour rule {color!r}; there are {', '.join(COLOR_RULES)}")
    if group not in get_args(Grouping):
        raise RayMapError(f"rays are grouped by source, path or none, not {group!r}")
    refuse_existing(target, force=force)
    content = gather(
        map,
        criterion,
        rays=rays,
        color=color,
        group=cast(Grouping, group),
        tail=tail,
        scene=scene,
    )
    with replacing(target) as beside:
        chosen.write(content, beside)
    written = content.rays.n_rays
    return {
        "rays": written,
        "selected": written if written < rays else _selected(map, criterion),
        "segments": len(content.lines),
        "objects": [body.name for body in content.bodies],
        "groups": content.groups if content.rays.n_rays else [],
    }


def _selected(map: RayMap, criterion: Any) -> int:
    """How many rays satisfy the criterion."""
    from query import select

    given = None if isinstance(criterion, str) and not criterion.strip() else criterion
    return int(select(map, given, rays=False).matched)

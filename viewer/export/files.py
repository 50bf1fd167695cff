"""Write a 3D file; its suffix chooses the format."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast, get_args

from raymap.model.errors import RayMapError
from raymap.model.replacing import refuse_existing, replacing
from viewer.drawn.state import COLOR_RULES
from viewer.export.content import Content, Grouping, gather
from viewer.export.gltf import to_glb, to_gltf, to_vtp
from viewer.paint.rendering import write_beside

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["DEFAULT_RAYS", "SUFFIXES", "export_3d"]

SUFFIXES = (".glb", ".gltf", ".vtp", ".dxf", ".step", ".stp")
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
        ``*.step`` (millimetres)
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
    suffix = target.suffix.lower()
    if suffix not in SUFFIXES:
        raise RayMapError(f"3D files end in {', '.join(SUFFIXES)}, not {target.name!r}")
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
    _write(content, target, suffix)
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


def _write(content: Content, target: Path, suffix: str) -> None:
    if suffix in (".step", ".stp"):
        from viewer.export.step import write_step

        with replacing(target) as beside:
            write_step(content, beside)
        return
    if suffix == ".dxf":
        from viewer.export.dxf import to_dxf

        data = to_dxf(content)
    elif suffix == ".vtp":
        unit = content.length_unit
        data = to_vtp(content.rays, content.lines, content.rgba, content.bodies, length_unit=unit)
    else:
        make = to_glb if suffix == ".glb" else to_gltf
        data = make(
            content.bodies,
            content.lines,
            content.rgba,
            groups=content.segment_groups(),
            length_unit=content.length_unit,
            title=content.title,
        )
    write_beside(target, data)

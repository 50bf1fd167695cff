"""What worker processes do: describe a scene, record it, paint a map."""

from __future__ import annotations

import base64
import os
import tempfile
import warnings
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any, Protocol

from raymap.model.errors import RayMapError
from service.files.bounds import limit_process, permitted, read_only_from
from service.files.confine import OutsideFolder, ServedFolder
from service.files.library import check_inside
from service.files.mirror import SceneMirror
from service.files.naming import names_of

__all__ = ["JOBS"]


class Listener(Protocol):
    """Hears of a job while it runs."""

    def tell(self, message: dict[str, Any]) -> None:
        """Take news."""

    def stopped(self) -> bool:
        """Whether the job is to end early."""


def describe_scene(
    arguments: dict[str, Any], bounds: dict[str, Any], listener: Listener
) -> dict[str, Any]:
    """Names and units of a scene that was not traced yet."""
    mirror = _begin(arguments, bounds, [])
    try:
        compilation = _compile(arguments, mirror)
    except RayMapError as error:
        raise type(error)(mirror.plain(str(error))) from None
    directory = compilation.directory
    return {
        "title": directory.title,
        **names_of(directory),
        "channels": [compilation.channel_set.labels],
        "scene_hash": directory.scene_hash,
    }


def record_scene(
    arguments: dict[str, Any], bounds: dict[str, Any], listener: Listener
) -> dict[str, Any]:
    """Record a scene, with news of the progress."""
    from tracer.run.recording import record

    target = Path(arguments["map"])
    mirror = _begin(arguments, bounds, [target])
    folder = ServedFolder(arguments["folder"])
    options = dict(arguments["options"])
    # Write in the folder that is held, not in what its name may come to mean
    with permitted():
        folder.enter(target.parent)
        written = _opened(folder, target) if options["append"] else None
    if written is None:
        # What appears under its name from now on is in the way, and is not continued
        options["append"], written = False, Path(target.name)

    def progress(news: Any) -> None:
        listener.tell({"event": {"progress": asdict(news)}})

    try:
        with warnings.catch_warnings():
            # What there is to warn of stands in the result
            warnings.simplefilter("ignore")
            result = record(
                _compile(arguments, mirror),
                written,
                threads=arguments["threads"],
                progress=progress,
                cancel=listener.stopped,
                **options,
            )
    except RayMapError as error:
        text = str(error)
        if written.is_absolute():
            text = text.replace(str(written), folder.shown(target))
        raise type(error)(mirror.plain(text)) from None
    return {"done": result.to_json()}


def _opened(folder: ServedFolder, target: Path) -> Path | None:
    """The map that is to be continued, by its descriptor: no link can take its place any more.

    None if there is no such map. Where descriptors have no names, the map by its own name.
    """
    with folder.holding(target.parent) as held:
        try:
            descriptor = held.open_to_write(target.name)
        except FileNotFoundError:
            return None
        except OutsideFolder:
            raise OutsideFolder(f"{folder.shown(target)!r} has become a link") from None
        except OSError as error:
            raise RayMapError(
                f"{folder.shown(target)} cannot be written: {error.strerror}"
            ) from None
    named = Path(f"/dev/fd/{descriptor}")
    if named.exists():
        return named
    os.close(descriptor)
    return Path(target.name)


def paint_map(
    arguments: dict[str, Any], bounds: dict[str, Any], listener: Listener
) -> dict[str, Any]:
    """A picture of the scene of a map with selected rays, as PNG."""
    from raymap.file.opening import open as open_map
    from raymap.pictures.png import png_bytes
    from viewer.paint.rendering import picture

    limit_process(**bounds)
    paths = [Path(path) for path in arguments["paths"]]
    with open_map(paths[0] if len(paths) == 1 else paths, on_damage="skip") as ray_map:
        check_inside(ServedFolder(arguments["folder"]), ray_map, paths)
        pixels = picture(ray_map, arguments["criterion"], **arguments["options"])
    return {"png": base64.b64encode(png_bytes(pixels)).decode()}


JOBS = {"scene": describe_scene, "record": record_scene, "picture": paint_map}


def _begin(arguments: dict[str, Any], bounds: dict[str, Any], written: list[Path]) -> SceneMirror:
    """Set the bounds of this process, and open no file but through the mirror."""
    from raymap.jit.compilecache import cache_folder

    folder = ServedFolder(arguments["folder"])
    private = Path(tempfile.gettempdir())
    mirrored = private / "scene"
    mirrored.mkdir(mode=0o700)
    caches = [Path(path) for path in (os.environ.get("NUMBA_CACHE_DIR"), cache_folder()) if path]
    limit_process(**bounds)
    read_only_from(folder.root, [private, *caches, *written])
    return SceneMirror(folder, mirrored, arguments["scene_files_bytes"])


def _compile(arguments: dict[str, Any], mirror: SceneMirror) -> Any:
    """Read, check and compile the scene, by the compiler of its kind."""
    from tracer.description.named_files import reading_through
    from tracer.run.traces import trace_of
    from tracer.scene.load import is_of_other_program, load_scene, parse_scene

    with reading_through(mirror):
        name, options = arguments["scene"], arguments["selected"]
        if name is None:
            scene = parse_scene(arguments["text"], folder=mirror.place, **options)
        else:
            copy = mirror(mirror.place / name)
            if is_of_other_program(copy):
                scene = load_scene(copy, **options)
            else:
                # Whatever else it is called, it is read as TOML
                text = _read(copy, name)
                scene = parse_scene(text, origin=copy.name, folder=copy.parent, **options)
        return trace_of(scene)


def _read(path: Path, name: str) -> str:
    from raymap.model.errors import SceneError

    with suppress(FileNotFoundError):
        try:
            return path.read_text(encoding="utf-8-sig")
        except UnicodeDecodeError as error:
            raise SceneError(f"{name} cannot be read as a scene: {error}") from None
    raise SceneError(f"there is no scene file {name!r}")

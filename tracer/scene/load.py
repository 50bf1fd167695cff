"""Read a scene file: TOML, variants, validation; every complaint is one line with its key."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from raymap.model.errors import SceneError
from raymap.model.givenfile import given_text
from raymap.model.giventext import toml_tables
from raymap.model.names import meant, nearest_names
from raymap.model.registry import Registry
from tracer.bodies.body import Body
from tracer.bodies.registry import BODIES
from tracer.description.named_files import noting_files
from tracer.detectors.registry import DETECTORS
from tracer.geometry.mesh_format import MESH_FORMATS
from tracer.media.keys.key import MEDIUM_KEYS
from tracer.media.model import MediumModel, medium_class
from tracer.scene.copies import CopiesModel, with_copies
from tracer.scene.files import FILE_TABLES, table_of_bodies, table_of_scene_file
from tracer.scene.model import Scene
from tracer.scene.selecting import KINDS, SimulationModel, select_parts
from tracer.sources.registry import SOURCES
from tracer.surfaces.registry import SURFACES
from tracer.surfaces.surface import Surface

__all__ = ["is_of_other_program", "load_scene", "parse_scene"]

_MESH = '[bodies.NAME] with kind = "mesh", file and scale'
"""How a scene takes a mesh file."""

Model = TypeVar("Model", bound=BaseModel)

_INTERNAL = {"text", "origin", "folder", "selecting", "files"}
_TABLES = (set(Scene.model_fields) - _INTERNAL) | {
    "use", "leave_out", "variants", "simulations", "room", "camera", "render",
}  # fmt: skip
"""What may stand at the top of a scene file, beside tables that name files."""

_PICTURE = ("room", "camera", "render")
"""What only `raymap render` reads (`tracer.render.load`)."""

_TAGS = ("model", "table", "white")
"""Kinds of a source's spectrum, which are no keys of the file."""

_WORDS = (
    ("should be a list in brackets", "should be a valid (tuple|list)"),
    ("should be a table", r"should be a valid dictionary( or (instance|object).*)?"),
    ("should be a number", "should be a valid number(, unable to parse string as a number)?"),
    ("input should be a whole number", r"input should be a valid integer(, .*)?"),
    ("input should be a whole number", "unable to parse input string as an integer.*"),
    ("should be a text", "should be a valid string"),
    ("should be true or false", "should be a valid boolean(, .*)?"),
    (r"takes at \1 \2 entries, not \3", r"\w+ should have at (\w+) (\d+) items? after.*not (\d+)"),
)
"""Complaints as users say them: (ours, those of the validation)."""


def is_of_other_program(path: Path) -> bool:
    """Whether a file's suffix is that of a format of another program: a lens, solids, a mesh."""
    tables = (table_of_scene_file(path), table_of_bodies(path))
    return path.suffix.lower() in MESH_FORMATS or any(table is not None for table in tables)


def load_scene(
    path: str | Path, *, variants: Sequence[str] = (), simulation: str | None = None
) -> Scene:
    """Read and validate a scene file.

    Parameters
    ----------
    path : a TOML file, or a lens file (.zmx, .seq) that is a scene of its own
    variants : names of tables ``[variants.NAME]`` that are laid over the scene, in this order
    simulation : name of the table ``[simulations.NAME]`` that says what takes part

    Raises
    ------
    SceneError
        with the file, the key, what is wrong and what to do
    """
    path = Path(path)
    if path.suffix.lower() not in ("", ".toml"):
        taker = table_of_scene_file(path)
        if taker is not None and taker.scene_text is not None:
            return parse_scene(
                taker.scene_text(path),
                variants=variants,
                simulation=simulation,
                origin=path.name,
                folder=path.parent,
            )
        bodies = table_of_bodies(path)
        taken = f"[{bodies.name}.NAME] with file" if bodies is not None else ""
        if path.suffix.lower() in MESH_FORMATS:
            taken = _MESH
        if taken:
            raise SceneError(
                f"{path.name}: has no light and no detectors; write a scene file that takes it: "
                f"{taken}"
            )
    text = given_text(path, "scene file", SceneError)
    return parse_scene(
        text, variants=variants, simulation=simulation, origin=path.name, folder=path.parent
    )


def parse_scene(
    text: str,
    *,
    variants: Sequence[str] = (),
    simulation: str | None = None,
    origin: str = "scene",
    folder: str | Path = ".",
) -> Scene:
    """As `load_scene`, from the text of a scene file.

    ``origin`` names it in messages; mesh files are looked up from ``folder``.
    """
    with noting_files() as noted:
        scene = _parse(text, variants, simulation, origin, folder)
    files = {name: str(path) for name, path in noted.items()}
    return scene.model_copy(update={"files": files})


def _parse(
    text: str, variants: Sequence[str], simulation: str | None, origin: str, folder: str | Path
) -> Scene:
    tree = toml_tables(text, origin, SceneError)
    chosen = _simulation(tree, simulation, origin)
    known = _table(tree, "variants", origin)
    tree.pop("variants", None)
    for name in (*chosen.variants, *variants):
        if name not in known:
            raise SceneError(f"{origin}: there is no variant {name!r}{nearest_names(name, known)}")
        tree = _overlaid(tree, known[name])
    for key in tree:
        if key == "name" and "bodies" not in tree:
            raise SceneError(
                f"{origin}: this is not a scene: configurations with a name (conoscopy, conical "
                "refraction) are for raymap verify-crystals --scenes FOLDER"
            )
        if key not in _TABLES and key not in FILE_TABLES:
            every = sorted({*_TABLES, *FILE_TABLES})
            raise SceneError(f"{origin}: {key}: unknown key{nearest_names(key, every)}")
    for key in _PICTURE:
        tree.pop(key, None)
    tree["variants"] = (*chosen.variants, *variants)
    tree["text"] = text
    tree["origin"] = origin
    tree["folder"] = str(folder)
    _merge_files(tree, origin, Path(folder))
    for table in KINDS:
        tree[table] = _with_copies(_table(tree, table, origin), table, origin)
    general = {key: tree.pop(key) for key in ("use", "leave_out") if key in tree}
    always = _validated(SimulationModel, general, "", origin)
    tree["selecting"] = select_parts(
        tree,
        always.use if chosen.use is None else chosen.use,
        (*always.leave_out, *chosen.leave_out),
        simulation=simulation or "",
        origin=origin,
    )
    tree["media"] = {
        name: _validated(medium_class(entry), entry, f"media.{name}", origin)
        for name, entry in _table(tree, "media", origin).items()
    }
    tree["surfaces"] = {
        name: _of_kind(SURFACES, "surface", entry, f"surfaces.{name}", origin)
        for name, entry in _table(tree, "surfaces", origin).items()
    }
    tree["sources"] = {
        name: _of_kind(SOURCES, "source", entry, f"sources.{name}", origin)
        for name, entry in _table(tree, "sources", origin).items()
    }
    tree["detectors"] = {
        name: _of_kind(
            DETECTORS, "detector", {"kind": "plane"} | entry, f"detectors.{name}", origin
        )
        for name, entry in _table(tree, "detectors", origin).items()
    }
    tree["bodies"] = {
        name: entry
        if isinstance(entry, Body)
        else _of_kind(BODIES, "body", entry, f"bodies.{name}", origin)
        for name, entry in _table(tree, "bodies", origin).items()
    }
    return _validated(Scene, tree, "", origin)


def _simulation(tree: dict[str, Any], name: str | None, origin: str) -> SimulationModel:
    """The simulation that was asked for; all are checked, so that a slip shows at once."""
    entries = _table(tree, "simulations", origin)
    models = {
        key: _validated(SimulationModel, entry, f"simulations.{key}", origin)
        for key, entry in entries.items()
    }
    tree.pop("simulations", None)
    if name is None:
        return SimulationModel()
    if name not in models:
        raise SceneError(f"{origin}: there is no simulation {name!r}{nearest_names(name, models)}")
    return models[name]


def _merge_files(tree: dict[str, Any], origin: str, folder: Path) -> None:
    """Replace tables that name files of other programs by what these hold."""
    for key in [name for name in tree if name in FILE_TABLES]:
        table = FILE_TABLES[key]
        for name, entry in _table(tree, key, origin).items():
            model = _validated(table.model, entry, f"{key}.{name}", origin)
            table.merge(tree, name, model, folder, origin)
        tree.pop(key)


def _overlaid(base: Any, over: Any) -> Any:
    """``over`` laid over ``base``: tables are merged, all else is replaced."""
    if not (isinstance(base, Mapping) and isinstance(over, Mapping)):
        return over
    merged = dict(base)
    for key, value in over.items():
        merged[key] = _overlaid(base[key], value) if key in base else value
    return merged


def _table(tree: dict[str, Any], key: str, origin: str) -> dict[str, Any]:
    entries = tree.get(key, {})
    if not isinstance(entries, dict):
        raise SceneError(f"{origin}: {key}: must be a table of named entries, [{key}.NAME]")
    for name, entry in entries.items():
        if not isinstance(entry, dict | Body):
            raise SceneError(f"{origin}: {key}.{name}: must be a table, [{key}.{name}]")
        if not name or any(letter in name for letter in "*?\\\"'()"):
            raise SceneError(
                f"{origin}: {key}: the name {name!r} cannot be asked for in criteria; "
                "use letters, digits, '_', '-' or '.'"
            )
    return entries


def _of_kind(
    kinds: Registry[type[Model]], what: str, entry: dict[str, Any], where: str, origin: str
) -> Model:
    """An entry that says of which kind it is."""
    kind = entry.get("kind")
    if kind is None:
        raise SceneError(f"{origin}: {where}: kind is missing; one of {', '.join(kinds)}")
    if not isinstance(kind, str) or kind not in kinds:
        raise SceneError(
            f"{origin}: {where}.kind: there is no {what} {kind!r}{kinds.nearest(str(kind))}"
        )
    return _validated(kinds[kind], entry, where, origin)


def _with_copies(entries: dict[str, Any], table: str, origin: str) -> dict[str, Any]:
    """Tables that ask for copies of themselves, replaced by these."""
    for name, entry in list(entries.items()):
        if isinstance(entry, dict) and "copies" in entry:
            where = f"{table}.{name}"
            model = _validated(CopiesModel, entry["copies"], f"{where}.copies", origin)
            entries = with_copies(entries, name, model, f"{origin}: {where}")
    return entries


def _validated(model: type[Model], entry: Any, where: str, origin: str) -> Model:
    try:
        return model.model_validate(entry)
    except ValidationError as error:
        raise SceneError(f"{origin}: {_first_line(error, model, where)}") from None
    except ArithmeticError:
        raise SceneError(
            f"{origin}: {where}: its numbers are too large or too small to compute with"
        ) from None


def _first_line(error: ValidationError, model: type[BaseModel], where: str) -> str:
    """The first complaint as 'key: what is wrong; remedy'."""
    # A misspelt key is reported before the key that it leaves missing.
    problems = sorted(error.errors(), key=lambda problem: problem["type"] != "extra_forbidden")
    problem = problems[0]
    parts = [str(part) for part in problem["loc"]]
    models: list[type[BaseModel]] = [model]
    for part in parts[:-1]:
        inner = [m.model_fields[part].annotation for m in models if part in m.model_fields]
        models = [found for item in inner for found in _models_in(item)] if inner else models
    key = ".".join(part for part in [where, *parts] if part and part not in _TAGS)
    if problem["type"] == "extra_forbidden":
        if issubclass(model, Body) and (parts[-1] in MEDIUM_KEYS or parts[-1] == "scattering"):
            return (
                f"{key}: unknown key; {parts[-1]} belongs to a medium: write [media.NAME] with "
                f'{parts[-1]}, and medium = "NAME" here'
            )
        if issubclass(model, Surface) and len(parts) == 1:
            keys = [name for name in model.model_fields if name != "kind"]
            return (
                f"{key}: a {model.model_fields['kind'].default} surface has no {parts[-1]}; it "
                f"takes {', '.join(keys) or 'nothing else'}{meant(parts[-1], keys)}"
            )
        known = dict.fromkeys(name for item in models for name in item.model_fields)
        if models == [model] and issubclass(model, MediumModel):
            known |= dict.fromkeys(MEDIUM_KEYS)
        return f"{key}: unknown key{nearest_names(parts[-1], known)}"
    if problem["type"] == "missing":
        if issubclass(model, Body) and parts[-1] == "medium":
            return f'{key}: is missing; the body is solid: write [media.NAME] and medium = "NAME"'
        return f"{key}: is missing"
    message = problem["msg"].removeprefix("Value error, ")
    message = message[0].lower() + message[1:]
    for ours, theirs in _WORDS:
        message = re.sub(theirs, ours, message)
    given = problem.get("input")
    shown = f" (it is {given!r})" if isinstance(given, int | float | str) else ""
    if problem["type"] == "literal_error" and isinstance(given, str):
        shown += meant(given, re.findall(r"'([^']*)'", str(problem["ctx"]["expected"])))
    more = len(problems) - 1
    rest = f" [and {more} more]" if more else ""
    return f"{key}: {message}{shown}{rest}"


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    """The tables that may stand where a field has an annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [found for item in get_args(annotation) for found in _models_in(item)]

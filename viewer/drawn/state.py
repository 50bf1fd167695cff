"""What the application shows: plain immutable values without any drawing library.

The whole session is one `ViewState`. It can be written to JSON and into the fragment of an
address, and read back; what is read is checked field by field, so that a hand-made or outdated
file gives one clear line instead of a broken page.
"""

from __future__ import annotations

import base64
import binascii
import dataclasses
import json
import math
import re
import types
import typing
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar

from raymap.model.errors import RayMapError
from raymap.model.givenfile import given_bytes
from raymap.model.giventext import json_value
from raymap.model.replacing import replacing

__all__ = [
    "COLOR_RULES",
    "MOST_PATHS",
    "Camera",
    "Clip",
    "Region",
    "Section",
    "StateError",
    "Upward",
    "ViewState",
    "load_state",
    "read_camera",
    "save_state",
    "state_from_address",
    "state_from_json",
    "state_to_address",
    "state_to_json",
]

Vector = tuple[float, float, float]

ColorRule = Literal[
    "natural", "path", "source", "reflections", "ending", "flux", "wavelength", "optical_length"
]
COLOR_RULES: tuple[str, ...] = typing.get_args(ColorRule)

Upward = Literal["y", "z", "x"]

MOST_PATHS = 64
"""Paths of the table that are shown together."""

_MAX_BYTES = 1 << 20
_MOST_CRITERION = 20_000
_LARGEST = 1e15
_RANGES = {
    "rays": (1, 10_000_000),
    "width": (0.01, 100),
    "opacity": (0, 1),
    "body_opacity": (0, 3),
    "ray": (0, 2**62),
    "point": (0, 2**31),
}


class StateError(RayMapError, ValueError):
    """A saved session cannot be read."""


@dataclass(frozen=True, kw_only=True)
class Camera:
    """Where the scene is seen from.

    Attributes
    ----------
    position, focal_point : [scene units]
    view_up : unit vector
    height : height of the picture at the focal point [scene units]
    parallel : orthographic, else perspective
    """

    position: Vector
    focal_point: Vector
    view_up: Vector
    height: float
    parallel: bool = True


@dataclass(frozen=True, kw_only=True)
class Section:
    """A plane that cuts bodies and rays; what lies on the side of ``normal`` is taken away."""

    on: bool = False
    normal: Vector = (-1.0, 0.0, 0.0)
    offset: float = 0.0
    """Distance of the plane from the origin along ``normal`` [scene units]."""
    rays: bool = True
    """Cut the rays too."""


@dataclass(frozen=True, kw_only=True)
class Clip:
    """The part of each ray that is drawn, counted in points where an event happened.

    ``after = 2`` draws from the second such point on, ``until = 3`` ends at the third; 0 means no
    bound. A ray with fewer than ``after`` such points is not drawn.
    """

    event: str = "reflected"
    after: int = 0
    until: int = 0


@dataclass(frozen=True, kw_only=True)
class Region:
    """A region of a detector, in cells, as criteria write it.

    ``rect``: x0, y0, x1, y1; ``ellipse``: center x, center y, radius x, radius y.
    """

    shape: Literal["rect", "ellipse"] = "rect"
    values: tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class ViewState:
    """Everything that a session restores.

    Attributes
    ----------
    criterion : text; empty selects all rays
    rays : at most this many rays are drawn
    color : rule for the colour of rays
    width : of rays [pixels]
    opacity : of rays, 0 … 1
    fade : fade rays by their flux
    body_opacity : multiplies the opacity of all bodies
    opacities : own opacity of single objects, by name
    hidden : names of objects that are not drawn
    names : write the names of the objects into the picture
    dark : dark background
    camera : None fits the whole scene
    up : the axis that points upward in the standard views
    paths : paths of the table shown alone, as criteria
    ray : number of the ray in the report, and ``point`` in it
    detector : name; None takes the first
    binning : so many cells each way are shown as one; 0: as many as the light needs
    """

    criterion: str = ""
    rays: int = 1000
    color: ColorRule = "natural"
    width: float = 1.0
    opacity: float = 0.5
    fade: bool = False
    body_opacity: float = 1.0
    opacities: dict[str, float] = dataclasses.field(default_factory=dict)
    hidden: tuple[str, ...] = ()
    names: bool = False
    dark: bool = True
    camera: Camera | None = None
    up: Upward = "y"
    section: Section = Section()
    clip: Clip = Clip()
    paths: tuple[str, ...] = ()
    ray: int | None = None
    point: int | None = None
    panel: str = "paths"
    detector: str | None = None
    log_scale: bool = True
    colormap: str = "inferno"
    image: Literal["selected", "full", "both"] = "both"
    binning: Literal[0, 1, 2, 4, 8, 16] = 0


T = TypeVar("T")


def _fail(where: str, expected: str, value: object) -> StateError:
    where = where or "the file"
    shown = repr(value)
    shown = shown if len(shown) <= 40 else shown[:37] + "..."
    return StateError(f"saved session: {where} must be {expected}, not {shown}")


def _read_number(kind: type, value: Any, where: str) -> Any:
    """A plain int or finite float."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _fail(where, "a number", value)
    # Compared before it is converted: an integer may be too large for a float
    if not -1e300 < value < 1e300 or (kind is int and value != int(value)):
        raise _fail(where, "a whole number" if kind is int else "a finite number", value)
    return kind(value)


def _read_union(options: tuple[Any, ...], value: Any, where: str) -> Any:
    """``X | None``."""
    if value is None and types.NoneType in options:
        return None
    return _read(next(option for option in options if option is not types.NoneType), value, where)


def _read(kind: Any, value: Any, where: str) -> Any:
    """Check ``value`` against the annotation ``kind`` and make it that."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin in (types.UnionType, typing.Union):
        return _read_union(arguments, value, where)
    if origin is Literal:
        if value not in arguments:
            raise _fail(where, "one of " + ", ".join(map(str, arguments)), value)
        return value
    if origin is tuple:
        if not isinstance(value, list | tuple):
            raise _fail(where, "a list", value)
        kinds = [arguments[0]] * len(value) if arguments[1:] == (...,) else list(arguments)
        if len(kinds) != len(value):
            raise _fail(where, f"a list of {len(kinds)}", value)
        pairs = enumerate(zip(kinds, value, strict=True))
        return tuple(_read(part, item, f"{where}[{number}]") for number, (part, item) in pairs)
    if origin is dict:
        if not isinstance(value, dict):
            raise _fail(where, "a table", value)
        return {
            str(key): _read(arguments[1], item, f"{where}.{key}") for key, item in value.items()
        }
    if dataclasses.is_dataclass(kind):
        return _read_dataclass(typing.cast(type, kind), value, where)
    if kind in (int, float):
        return _read_number(kind, value, where)
    if not isinstance(value, kind):
        raise _fail(where, {"str": "a text", "bool": "true or false"}[kind.__name__], value)
    return value


def _read_dataclass(kind: type[T], value: Any, where: str) -> T:
    """Read the known fields; keys of newer versions are ignored."""
    if not isinstance(value, dict):
        raise _fail(where, "a table", value)
    hints = typing.get_type_hints(kind)
    known = {
        name: _read(hint, value[name], f"{where}.{name}".lstrip("."))
        for name, hint in hints.items()
        if name in value
    }
    try:
        return kind(**known)
    except TypeError:
        missing = sorted(set(hints) - set(known))
        raise StateError(f"saved session: {where} lacks {', '.join(missing)}") from None


def state_to_json(state: ViewState) -> dict[str, Any]:
    """The fields that differ from a fresh session, as JSON values."""
    fresh = dataclasses.asdict(ViewState())
    return {
        name: value for name, value in dataclasses.asdict(state).items() if value != fresh[name]
    }


def state_from_json(values: Any) -> ViewState:
    """Check and read what `state_to_json` wrote.

    Raises
    ------
    StateError
        A field has the wrong kind of value; the message names it.
    """
    state = _read_dataclass(ViewState, values, "")
    for name, (least, most) in _RANGES.items():
        value = getattr(state, name)
        if value is not None and not least <= value <= most:
            raise _fail(name, f"between {least} and {most}", value)
    for name, size in (("after", state.clip.after), ("until", state.clip.until)):
        if not 0 <= size <= 10**6:
            raise _fail(f"clip.{name}", "between 0 and 1000000", size)
    if not all(0 <= value <= 1 for value in state.opacities.values()):
        raise _fail("opacities", "between 0 and 1", state.opacities)
    if not re.fullmatch(r"[a-z_]{1,64}", state.panel):
        raise _fail("panel", "the name of a panel", state.panel)
    if len(state.paths) > MOST_PATHS:
        raise _fail("paths", f"at most {MOST_PATHS} paths", state.paths)
    if len(state.criterion) > _MOST_CRITERION:
        raise _fail("criterion", f"at most {_MOST_CRITERION} characters", state.criterion)
    if not math.hypot(*state.section.normal) <= _LARGEST:
        raise _fail("section.normal", "a direction", state.section.normal)
    if abs(state.section.offset) > _LARGEST:
        raise _fail("section.offset", f"at most {_LARGEST:g}", state.section.offset)
    if state.camera is not None:
        check_camera(state.camera)
    return state


def check_camera(camera: Camera) -> None:
    """Refuse a camera that sees nothing."""
    numbers = (*camera.position, *camera.focal_point, *camera.view_up, camera.height)
    if not all(abs(number) <= _LARGEST for number in numbers):
        raise _fail("camera", f"numbers of at most {_LARGEST:g}", numbers)
    direction = [b - a for a, b in zip(camera.position, camera.focal_point, strict=True)]
    up = camera.view_up
    across = (
        direction[1] * up[2] - direction[2] * up[1],
        direction[2] * up[0] - direction[0] * up[2],
        direction[0] * up[1] - direction[1] * up[0],
    )
    if camera.height <= 0 or not math.hypot(*across) > 0:
        raise _fail("camera", "a position away from its focal point, upright", camera.position)


def read_camera(values: Any) -> Camera:
    """Check and read a camera from JSON values.

    Raises
    ------
    StateError
    """
    camera = _read_dataclass(Camera, values, "camera")
    check_camera(camera)
    return camera


def state_to_address(state: ViewState) -> str:
    """The session as a short text for the fragment of an address."""
    text = json.dumps(state_to_json(state), separators=(",", ":"), ensure_ascii=False)
    return base64.urlsafe_b64encode(zlib.compress(text.encode(), 9)).decode().rstrip("=")


def state_from_address(text: str) -> ViewState:
    """Read what `state_to_address` wrote.

    Raises
    ------
    StateError
        The text was cut or changed.
    """
    try:
        packed = base64.urlsafe_b64decode(text + "=" * (-len(text) % 4))
        plain = zlib.decompressobj().decompress(packed, _MAX_BYTES)
        values = json_value(plain)
    except (binascii.Error, zlib.error, UnicodeError, ValueError):
        raise StateError(
            "the session in the address is incomplete; copy the whole address"
        ) from None
    return state_from_json(values)


def save_state(state: ViewState, path: str | Path) -> None:
    """Write the session to a small JSON file."""
    text = json.dumps(state_to_json(state), indent=1, ensure_ascii=False)
    with replacing(Path(path)) as beside:
        beside.write_text(text + "\n", encoding="utf-8")


def load_state(path: str | Path) -> ViewState:
    """Read a session file.

    Raises
    ------
    StateError
        There is no such file, or it is no session.
    """
    text = given_bytes(path, "saved session", StateError, largest=_MAX_BYTES)
    try:
        values = json_value(text)
    except ValueError:
        raise StateError(f"saved session {str(path)!r} is not JSON") from None
    return state_from_json(values)

"""What worker processes answer, checked like any other input before a client gets it."""

from __future__ import annotations

import base64
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from raymap.model.errors import RayMapError

__all__ = ["check_done", "check_progress", "check_scene", "read_png"]

_PNG = b"\x89PNG\r\n\x1a\n"


class _Told(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class _Progress(_Told):
    rays: int = Field(ge=0)
    records: int = Field(ge=0)
    seconds: float = Field(ge=0)
    bytes: int = Field(ge=0)
    total_rays: int | None
    total_seconds: float | None


class _Done(_Told):
    rays: int = Field(ge=0)
    records: int = Field(ge=0)
    seconds: float = Field(ge=0)
    rays_per_second: float = Field(ge=0)
    bytes: int = Field(ge=0)
    threads: int = Field(ge=1)
    seed: int = Field(ge=0)
    audit: dict[str, dict[str, float]]
    absorbed_by: dict[str, dict[str, float]]
    fluxes: dict[str, Any]
    warnings: list[str]
    interrupted: bool


class _Units(_Told):
    length: str
    flux: str


class _Scene(_Told):
    title: str | None
    sources: list[str]
    objects: list[str]
    faces: list[str]
    media: list[str]
    detectors: list[str]
    detector_grids: dict[str, dict[str, Any]]
    source_fluxes: dict[str, float]
    units: _Units
    channels: list[Any]
    scene_hash: str


Model = TypeVar("Model", bound=_Told)


def check_progress(told: Any) -> dict[str, Any]:
    """News of a recording.

    Raises
    ------
    RayMapError
    """
    return _checked(_Progress, told)


def check_done(told: Any) -> dict[str, Any]:
    """The result of a recording; `RayMapError` where it is none."""
    return _checked(_Done, told)


def check_scene(told: Any) -> dict[str, Any]:
    """Names and units of a scene; `RayMapError` where they are none."""
    return _checked(_Scene, told)


def read_png(told: Any) -> bytes:
    """The bytes of a picture; `RayMapError` where it is none."""
    try:
        data = base64.b64decode(told["png"], validate=True)
    except (KeyError, TypeError, ValueError):
        data = b""
    if not data.startswith(_PNG):
        raise RayMapError("the process that painted answered no picture")
    return data


def _checked(model: type[Model], told: Any) -> dict[str, Any]:
    try:
        return model.model_validate(told).model_dump()
    except ValidationError as error:
        where = ".".join(str(part) for part in error.errors()[0]["loc"])
        raise RayMapError(f"the process that did it answered nonsense ({where})") from None

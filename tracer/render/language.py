"""Tables of TOML files beside a scene: rooms, cameras, checks; errors name the key."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from raymap.model.errors import SceneError
from raymap.model.givenfile import given_text
from raymap.model.giventext import toml_tables

__all__ = [
    "Model",
    "Number",
    "Vector",
    "checked",
    "parse_toml",
    "read_text",
]

Vector = tuple[float, float, float]
Number = Annotated[float, Field(allow_inf_nan=False)]


class Model(BaseModel):
    """Unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


Description = TypeVar("Description", bound=BaseModel)


def parse_toml(kind: type[Description], text: str, source: str) -> Description:
    """A validated description.

    Raises
    ------
    SceneError
        naming the key that is wrong
    """
    return checked(kind, toml_tables(text, source, SceneError), source)


def checked(kind: type[Description], tables: Any, source: str) -> Description:
    """As `parse_toml`, from tables that are read already."""
    try:
        return kind.model_validate(tables)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise SceneError(f"{source}: {key}: {first['msg']}") from None


def read_text(path: Path) -> str:
    """The text of a scene file."""
    return given_text(path, "scene file", SceneError)

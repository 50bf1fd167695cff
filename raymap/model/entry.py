"""What all entries of a directory have in common."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from raymap.model.limits import MAX_NAME, MAX_NUMBER
from raymap.model.plaintext import plain_text

__all__ = ["Component", "Entry", "Name", "Parameters", "PlainText", "Vector"]

Component = Annotated[float, Field(ge=-MAX_NUMBER, le=MAX_NUMBER)]
Vector = tuple[Component, Component, Component]
Parameters = dict[str, Any]
PlainText = Annotated[str, AfterValidator(plain_text)]
"""A text that people read; what acts on a terminal or a line is spelt out."""

Name = Annotated[PlainText, Field(min_length=1, max_length=MAX_NAME)]


class Entry(BaseModel):
    """An immutable entry; keys that this version does not know are carried along."""

    model_config = ConfigDict(frozen=True, extra="allow", allow_inf_nan=False)

"""Rows and grids of bodies, sources and detectors that a scene describes once."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Annotated, Any

from pydantic import Field, field_validator

from raymap.model.errors import SceneError
from tracer.description.fields import Node, Vector

__all__ = ["CopiesModel", "with_copies"]

_PLACES = ("position", "aim")
_MOST = 10_000

Count = Annotated[int, Field(ge=1, le=_MOST)]


class CopiesModel(Node):
    """``count`` copies, each ``step`` further than the one before; of grids one per direction."""

    count: Annotated[tuple[Count, ...], Field(min_length=1, max_length=3)]
    step: tuple[Vector, ...]

    @field_validator("count", mode="before")
    @classmethod
    def _one_number(cls, value: Any) -> Any:
        return (value,) if isinstance(value, int) else value

    @field_validator("step", mode="before")
    @classmethod
    def _one_vector(cls, value: Any) -> Any:
        plain = isinstance(value, list | tuple) and value and isinstance(value[0], int | float)
        return (value,) if plain else value

    def model_post_init(self, context: Any) -> None:
        if len(self.count) != len(self.step):
            raise ValueError(f"{len(self.count)} counts need as many steps, not {len(self.step)}")
        number = 1
        for count in self.count:
            number *= count
        if number > _MOST:
            raise ValueError(f"{number:,} copies are too many; {_MOST:,} at most")

    def places(self) -> Iterator[tuple[str, Vector]]:
        """Ending of the name, from 1, and shift of each copy."""
        for index in product(*(range(count) for count in self.count)):
            shift = [sum(k * step[axis] for k, step in zip(index, self.step, strict=True)) for axis in range(3)]  # fmt: skip # noqa: E501
            yield "_".join(str(k + 1) for k in index), (shift[0], shift[1], shift[2])


def with_copies(
    entries: dict[str, Any], name: str, copies: CopiesModel, where: str
) -> dict[str, Any]:
    """The tables with one of them replaced by its copies, in its place in the order.

    Parameters
    ----------
    entries : tables by name, as the scene file holds them
    name : of the table to copy
    where : where it stands, for messages

    Raises
    ------
    SceneError
        where a copy has the name of another table, or the place that is to be shifted is no vector
    """
    original = {key: value for key, value in entries[name].items() if key != "copies"}
    if not any(key in original for key in _PLACES):
        original["position"] = [0.0, 0.0, 0.0]
    made = {}
    for ending, shift in copies.places():
        copy = dict(original)
        for key in _PLACES:
            if key in copy:
                copy[key] = _shifted(copy[key], shift, f"{where}.{key}")
        made[f"{name}_{ending}"] = copy
    for taken in made:
        if taken in entries:
            raise SceneError(f"{where}.copies: makes {taken!r}, which is there already; rename it")
    found: dict[str, Any] = {}
    for key, value in entries.items():
        found |= made if key == name else {key: value}
    return found


def _shifted(value: Any, shift: Vector, where: str) -> list[float]:
    numbers = isinstance(value, list | tuple) and all(
        isinstance(x, int | float) and not isinstance(x, bool) for x in value
    )
    if not numbers or len(value) != 3:
        raise SceneError(f"{where}: must be three numbers")
    return [x + d for x, d in zip(value, shift, strict=True)]

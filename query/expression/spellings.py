"""A criterion from any of its spellings."""

from __future__ import annotations

from query.expression.atom import Quantity
from query.expression.criterion import Criterion
from query.expression.grammar import parse
from query.expression.json_form import from_json
from raymap.model.errors import CriterionError

__all__ = ["as_criterion"]


def as_criterion(value: object) -> Criterion | None:
    """A criterion from any of its spellings: tree, text, JSON tree; None stays None.

    Raises
    ------
    CriterionError
        the spelling cannot be read.
    """
    if value is None or isinstance(value, Criterion):
        return value
    if isinstance(value, str):
        return parse(value)
    if isinstance(value, dict):
        return from_json(value)
    if isinstance(value, Quantity):
        raise CriterionError(f"{value.word} is a number; compare it to get a criterion")
    raise CriterionError(f"a criterion is a text, a tree or JSON, not {type(value).__name__}")

"""Numbers of a command line: finite, and whole ones within 64 bits, for all options alike."""

from __future__ import annotations

import math
from typing import Any

import typer

from raymap.model.giventext import WHOLE_BITS

__all__ = ["check_numbers"]


def check_numbers(value: Any, parameter: Any, context: Any) -> None:
    """Refuse numbers that are none, or that no compiled code takes, wherever they stand.

    Ranges of options do not see to it: no comparison with NaN is true.

    Raises
    ------
    typer.BadParameter
    """
    if isinstance(value, list | tuple):
        for each in value:
            check_numbers(each, parameter, context)
    if isinstance(value, float) and not math.isfinite(value):
        raise typer.BadParameter(f"{value} is no finite number", ctx=context, param=parameter)
    if isinstance(value, int) and value.bit_length() >= WHOLE_BITS:
        raise typer.BadParameter(
            f"a whole number has fewer than {WHOLE_BITS} bits", ctx=context, param=parameter
        )

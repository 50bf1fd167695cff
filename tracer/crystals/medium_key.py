"""A crystal as a medium of a scene."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import SceneError
from tracer.media.keys.key import At, MediumKey

__all__ = ["CRYSTAL"]


def _no_index(value: Any, at: At) -> NDArray[np.float64]:
    raise SceneError(f"{at.place}: a crystal has no single index; raymap record traces crystals")


CRYSTAL = MediumKey(
    word="crystal",
    title="A crystal that splits light in two",
    value=dict[str, Any],
    index=_no_index,
    light="crystals",
    alone="absorption of a crystal stands in its table: crystal.absorption",
    place=5.0,
)

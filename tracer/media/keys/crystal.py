"""A crystal as a medium of a scene: principal indices and axes, or a mineral by name."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import SceneError
from tracer.description.fields import Finite, Node, Vector
from tracer.media.keys.key import At, MediumKey
from tracer.optics.crystals.media import Crystal, calcite, rotation_between

__all__ = ["CRYSTAL", "CrystalModel", "Sellmeier"]


class Sellmeier(Node):
    """n^2 = a + sum b / (L - c) - d L with L = lambda^2 in um^2."""

    a: Finite
    b: tuple[Finite, ...] = ()
    c: tuple[Finite, ...] = ()
    d: Finite = 0.0

    def model_post_init(self, context: object) -> None:
        if len(self.b) != len(self.c):
            raise ValueError(f"b has {len(self.b)} terms and c has {len(self.c)}; give as many")

    def __call__(self, wavelength_nm: float) -> float:
        square = (wavelength_nm * 1e-3) ** 2
        terms = sum(b / (square - c) for b, c in zip(self.b, self.c, strict=True))
        value = self.a + terms - self.d * square
        return math.sqrt(value) if value > 0.0 else math.nan


class CrystalModel(Node):
    """A named crystal: ``calcite``, or principal indices with axes."""

    material: Literal["calcite"] | None = None
    indices: tuple[Finite | Sellmeier, Finite | Sellmeier, Finite | Sellmeier] | None = None
    axes: tuple[Vector, Vector, Vector] | None = None
    optic_axis: Vector | None = None
    absorption: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)

    def model_post_init(self, context: object) -> None:
        if (self.material is None) == (self.indices is None):
            raise ValueError("give either material or indices")
        if self.axes is not None and self.optic_axis is not None:
            raise ValueError("give either axes or optic_axis, not both")

    def crystal(self, name: str, axis: NDArray[np.float64] | None = None) -> Crystal:
        """The crystal; ``axis`` counts where the description says none.

        Raises
        ------
        SceneError
            axes that are not orthogonal
        """
        direction = self.optic_axis if self.optic_axis is not None else axis
        if self.indices is None:
            indices = calcite().indices
        else:
            indices = self.indices
        if self.axes is not None:
            orientation = np.array(self.axes, np.float64).T
        elif direction is not None:
            if not np.linalg.norm(direction) > 0.0:
                raise SceneError(f"media.{name}.crystal.optic_axis has length zero")
            orientation = rotation_between((0.0, 0.0, 1.0), direction)
        else:
            orientation = np.eye(3)
        return Crystal(
            name=name, indices=indices, orientation=orientation, absorption=self.absorption
        )


def _mean_index(value: CrystalModel, at: At) -> NDArray[np.float64]:
    """Mean of the principal indices, as maps state it; tracing takes the tensor."""
    crystal = value.crystal(at.place.rpartition(".")[2])
    try:
        return np.array([crystal.principal_indices(w).mean() for w in at.wavelengths_nm.tolist()])
    except SceneError as error:
        raise SceneError(f"{at.place}.crystal: {error}") from None


CRYSTAL = MediumKey(
    word="crystal",
    title="A crystal that splits light in two",
    value=CrystalModel,
    index=_mean_index,
    splits=True,
    alone="absorption of a crystal stands in its table: crystal.absorption",
    place=5.0,
)

KINDS = (CRYSTAL,)

"""What every source of the scene description has, and how kinds of other distributions emit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Discriminator, Field, Tag

from raymap.jit.compiling import Door
from raymap.model.errors import SceneError
from tracer.description.fields import ByWavelength, Placed, Positive, Vector, is_direction
from tracer.sources.spectra import SpectrumModel

__all__ = ["EMIT", "EMITS_TOWARDS", "Source", "SourceLaw", "check_emission"]

Array = NDArray[np.float64]

_WAY = (0.0, 0.0, 1.0)

EMIT = Door((*_WAY, *_WAY), (np.zeros(1), 0.0, 0.0, 0.0, 0.0, 0.0))
"""``emit(own, u1, u2, u3, u4, u5) -> x, y, z, dx, dy, dz``: place [scene units] and direction."""

EMITS_TOWARDS = Door(0.0, (np.zeros(1), *_WAY, *_WAY))
"""``towards(own, x, y, z, dx, dy, dz) -> density``: share of the light that leaves the place into
the direction, per solid angle [1/sr]."""


@dataclass(frozen=True, kw_only=True)
class SourceLaw:
    """Compiled functions of a kind of source, in the frame of the source; units as in the scene.

    emit : see `EMIT`; with five uniform numbers
    towards : see `EMITS_TOWARDS`, for pinholes; None where the light has no width
    """

    emit: Any
    towards: Any = None


def check_emission(law: SourceLaw, own: Array, half_size: Array, place: str) -> None:
    """Refuse a law that emits no unit vectors, or from outside the box that it says.

    Parameters
    ----------
    own, half_size : what its kind says of the source
    place : in the scene, for messages

    Raises
    ------
    SceneError
    """
    emit = law.emit
    for uniform in np.random.default_rng(0).random((64, 5)):
        drawn = np.array(emit(own, *uniform), np.float64)
        if drawn.shape != (6,):
            raise SceneError(
                f"{place}: its law emits {len(drawn)} numbers, not place and direction"
            )
        start, way = drawn[:3], drawn[3:]
        if not abs(way @ way - 1.0) <= 1e-6:
            raise SceneError(
                f"{place}: its law emits into ({way[0]:g}, {way[1]:g}, {way[2]:g}), no unit vector"
            )
        if not (np.abs(start) <= half_size * (1.0 + 1e-6) + 1e-9).all():
            raise SceneError(
                f"{place}: its law emits from ({start[0]:g}, {start[1]:g}, {start[2]:g}), outside "
                f"its half_size() of ({half_size[0]:g}, {half_size[1]:g}, {half_size[2]:g})"
            )


def _as_spectrum(value: Any) -> Any:
    """A bare word is an illuminant by name."""
    if isinstance(value, str) and value != "white":
        return {"illuminant": value}
    return value


def _spectrum_kind(value: Any) -> str:
    if value == "white" or isinstance(value, str):
        return "white"
    keys = set(value) if isinstance(value, dict) else set()
    table = isinstance(value, ByWavelength) or keys & {"wavelength_nm", "value", "rgb"}
    return "table" if table else "model"


SourceLight = Annotated[
    Annotated[Literal["white"], Tag("white")]
    | Annotated[ByWavelength, Tag("table")]
    | Annotated[SpectrumModel, Tag("model")],
    Discriminator(_spectrum_kind),
    BeforeValidator(_as_spectrum),
]


def _as_names(value: Any) -> Any:
    """A bare word is one name."""
    return (value,) if isinstance(value, str) else value


Names = Annotated[tuple[str, ...], Field(max_length=7), BeforeValidator(_as_names)]


class Source(Placed):
    """What all sources share.

    ``inside`` names the solids in which the source stands, from the outside in: at most seven
    (four in scenes of more than 510 solids). ``direction`` turns the axis; ``aim`` and ``distance``
    place the source before a point.

    ``polarisation`` is the direction in which light vibrates as far as it lies across the ray; the
    polarised tracer and crystals heed it, the tracer of natural light does not.

    ``flux`` is that of the file or table where it has one, else 1, unless given; ``flux_unit`` that
    of the map unless given.
    """

    kind: str
    on: bool = True
    flux: Positive | None = None
    flux_unit: Literal["W", "lm"] | None = None
    share: Positive | None = None
    spectrum: SourceLight = "white"
    direction: Vector | None = None
    aim: Vector | None = None
    distance: Positive | None = None
    inside: Names = ()
    polarisation: Vector | None = None

    law: ClassVar[SourceLaw | None] = None
    """How a kind emits that the engine does not know."""

    def model_post_init(self, context: Any) -> None:
        super().model_post_init(context)
        if (self.aim is None) != (self.distance is None):
            raise ValueError("aim and distance go together")
        if self.aim is not None and "position" in self.model_fields_set:
            raise ValueError("give position, or aim and distance")
        if self.direction is not None and not is_direction(self.direction):
            raise ValueError("direction must not be the zero vector")
        if self.direction is not None and (self.axis or self.rotation):
            raise ValueError("direction already turns the source; drop axis and rotation")

    def frame(self) -> tuple[Array, Array]:
        origin, frame = super().frame()
        if self.direction is not None:
            _, frame = Placed(axis=self.direction).frame()
        if self.aim is not None and self.distance is not None:
            origin = np.array(self.aim) - self.distance * frame[:, 2]
        return origin, frame

    def own(self) -> Sequence[float]:
        """Numbers that the functions of ``law`` are handed."""
        return ()

    def half_size(self) -> tuple[float, float, float]:
        """Half the box, about the position and along the source's axes, that light starts in."""
        return 0.0, 0.0, 0.0

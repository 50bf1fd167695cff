"""Light sources in the scene description."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    field_serializer,
    model_serializer,
    model_validator,
)

from raymap.model.errors import SceneError
from tracer.description.fields import Node, Positive
from tracer.description.named_files import named_file
from tracer.light import IntensityGrid, RayList
from tracer.sources.source import Source

__all__ = ["IntensityTable", "SourceModel"]

Array = NDArray[np.float64]
Angles = tuple[float, ...]


class IntensityTable(Node):
    """An intensity table in the scene file: a row of values per gamma (or theta).

    Either ``gamma_deg`` and ``c_deg`` (type C, see `tracer.light`), or ``theta_deg`` and
    ``phi_deg``, right-handed about the axis. Without azimuths the values are one per angle.
    """

    gamma_deg: Angles = ()
    c_deg: Angles = (0.0,)
    theta_deg: Angles = ()
    phi_deg: Angles = (0.0,)
    value: tuple[tuple[float, ...], ...]

    @model_validator(mode="before")
    @classmethod
    def _rows(cls, data: Any) -> Any:
        if isinstance(data, dict):
            values = data.get("value")
            if isinstance(values, list | tuple) and values and not isinstance(values[0], list):
                data = data | {"value": [[value] for value in values]}
        return data

    def model_post_init(self, context: Any) -> None:
        if bool(self.gamma_deg) == bool(self.theta_deg):
            raise ValueError(
                "an intensity table takes gamma_deg (and c_deg) or theta_deg (phi_deg)"
            )
        for azimuths, along, other in (
            ("phi_deg", "theta_deg", self.gamma_deg),
            ("c_deg", "gamma_deg", self.theta_deg),
        ):
            if other and azimuths in self.model_fields_set:
                raise ValueError(f"{azimuths} are azimuths of a table over {along}")
        angles, turns = self.gamma_deg or self.theta_deg, self.phi_deg
        if self.gamma_deg:
            turns = self.c_deg
        if len(self.value) != len(angles) or any(len(row) != len(turns) for row in self.value):
            raise ValueError(
                f"value needs {len(angles)} rows of {len(turns)} (one per angle from the axis, "
                "with one number per azimuth)"
            )

    def build(self, name: str) -> IntensityGrid:
        """The table as light.

        Raises
        ------
        SceneError
        """
        values = np.array(self.value, np.float64)
        if self.gamma_deg:
            return IntensityGrid(
                gamma_deg=np.array(self.gamma_deg),
                c_deg=np.array(self.c_deg),
                intensity=values,
                name=name,
            )
        return IntensityGrid.from_theta_phi(self.theta_deg, self.phi_deg, values, name=name)


_COMMON = {
    "kind", "on", "flux", "flux_unit", "share", "spectrum", "inside", "position", "axis",
    "rotation", "direction", "aim", "distance", "polarisation",
}  # fmt: skip


class SourceModel(Source):
    """What sources of the kinds that the engine knows may say; each kind has some of the keys."""

    model_config = ConfigDict(arbitrary_types_allowed=True)

    diameter: Positive | None = None
    inner_diameter: Annotated[float, Field(ge=0)] = 0.0
    size: tuple[Positive, Positive] | None = None
    cone_deg: Annotated[float, Field(gt=0, le=180)] | None = None
    tilt_deg: Annotated[float, Field(gt=-90, lt=90)] = 0.0
    file: str | None = None
    intensity: IntensityTable | None = None
    light: IntensityGrid | RayList | None = None
    draw: Literal["flux", "in_order"] = "flux"
    flux_from: Literal["header", "rays"] = "header"
    scale: Positive | None = None

    keys: ClassVar[tuple[str, ...]] = ()
    """Of the kind, beside those of all sources."""
    widest_deg: ClassVar[float] = 90.0
    """Largest angle of its directions with its axis."""

    @model_serializer(mode="wrap")
    def _as_ever(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """What only few sources have leaves no trace in the fingerprint of a scene."""
        given: dict[str, Any] = handler(self)
        if given.get("polarisation", 0) is None:
            del given["polarisation"]
        if given.get("flux_from") == "header":
            del given["flux_from"]
        if len(self.inside) < 2 and "inside" in given:
            given["inside"] = self.inside[0] if self.inside else None
        return given

    @field_serializer("light")
    def _fingerprint(self, light: IntensityGrid | RayList | None) -> dict[str, str] | None:
        return None if light is None else {"name": light.name, "digest": light.digest()}

    def model_post_init(self, context: Any) -> None:
        for name in type(self).model_fields:
            if name in self.model_fields_set - {*_COMMON, *self.keys}:
                allowed = ", ".join(self.keys)
                raise ValueError(f"a {self.kind} source has no {name}; its own keys are {allowed}")
        self.check()
        if self.inner_diameter and self.diameter is None:
            raise ValueError("inner_diameter is that of a disc: give a diameter, or drop it")
        if self.diameter is not None and self.inner_diameter > self.diameter:
            raise ValueError("inner_diameter is larger than diameter")
        super().model_post_init(context)
        if (self.cone_deg or 0.0) > self.widest_deg:
            raise ValueError(f"cone_deg of a {self.kind} source is at most {self.widest_deg:g}")

    def check(self) -> None:
        """Refuse keys that do not go together.

        Raises
        ------
        ValueError
        """

    def cone_cosine(self) -> float:
        """Cosine that limits its directions."""
        return math.cos(math.radians(self.cone_deg or self.widest_deg))

    def measured(self, folder: Any, where: str) -> IntensityGrid | RayList:
        """The table or list of a source of kind ``intensity`` or ``rays``.

        Raises
        ------
        SceneError
            naming ``where`` where the file or table makes no such source
        """
        from tracer.light import read_light

        try:
            if self.intensity is not None:
                light: IntensityGrid | RayList = self.intensity.build("intensity")
            elif self.file is not None:
                light = read_light(named_file(folder, self.file), flux_from=self.flux_from)
            else:
                assert self.light is not None
                light = self.light
        except SceneError as error:
            raise SceneError(f"{where}: {error}") from None
        if isinstance(light, RayList) != (self.kind == "rays"):
            other = "rays" if isinstance(light, RayList) else "intensity"
            raise SceneError(f"{where}.kind: {light.name} makes a source of kind {other!r}")
        return light

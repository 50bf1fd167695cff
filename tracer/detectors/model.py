"""Detectors in the scene description."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_serializer

from tracer.description.fields import Positive, Vector, is_direction
from tracer.detectors.detector import DetectorKind

__all__ = ["DetectorModel"]

Array = NDArray[np.float64]
Field180 = Annotated[float, Field(gt=0, lt=180)]


def _parallel(a: Vector, b: Vector) -> bool:
    """Whether two directions are the same or opposite."""
    u, v = np.array(a) / np.linalg.norm(a), np.array(b) / np.linalg.norm(b)
    return bool(np.linalg.norm(np.cross(u, v)) < 1e-9)


class DetectorModel(DetectorKind):
    """What detectors of the kinds that the engine knows may say; each kind has some of the keys."""

    position: Vector = (0.0, 0.0, 0.0)
    looks: Vector = (0.0, 0.0, 1.0)
    up: Vector | None = None
    size: tuple[Positive, Positive] = (1.0, 1.0)
    blocking: bool = False
    surface: str | None = None
    acceptance_deg: Annotated[float, Field(gt=0, le=90)] = 90.0
    both_sides: bool = False
    axis: Vector = (0.0, 0.0, 1.0)
    c0: Vector | None = None
    gamma_deg: tuple[float, float] = (0.0, 180.0)
    angles: Literal["type_c", "theta_phi"] = "type_c"
    field_deg: Field180 | tuple[Field180, Field180] = 40.0
    aperture: Positive = 1.0
    focus: Annotated[float, Field(gt=0)] = math.inf
    face: str = ""
    side: Literal["outside", "inside", "both"] = "outside"

    keys: ClassVar[tuple[str, ...]] = ()
    """Of the kind."""
    needed: ClassVar[tuple[str, ...]] = ()
    """Those that must be there."""

    def model_post_init(self, context: Any) -> None:
        for name in type(self).model_fields:
            if name != "kind" and name in self.model_fields_set - set(self.keys):
                allowed = ", ".join(self.keys)
                raise ValueError(f"a {self.kind} detector has no {name}; its keys are {allowed}")
        for name in self.needed:
            if name not in self.model_fields_set:
                raise ValueError(f"{name} is missing: a {self.kind} detector needs it")
        if not (is_direction(self.looks) and (self.up is None or is_direction(self.up))):
            raise ValueError("looks and up must not be the zero vector")
        if self.up is not None and _parallel(self.looks, self.up):
            raise ValueError("looks and up must be two different directions")
        if self.surface is not None and not self.blocking:
            raise ValueError("only a blocking detector has a surface")
        if not is_direction(self.axis):
            raise ValueError("axis must not be the zero vector")
        if self.c0 is not None and (not is_direction(self.c0) or _parallel(self.axis, self.c0)):
            raise ValueError("c0 must lie across the axis")
        low, high = self.gamma_deg
        if not 0.0 <= low < high <= 180.0:
            raise ValueError("gamma_deg must be two rising angles within 0 .. 180")

    @field_serializer("up")
    def _upward(self, up: Vector | None) -> Vector:
        """Detectors of one place have one fingerprint, with ``up`` in words or without."""
        return self.upward

    @property
    def upward(self) -> Vector:
        """``up`` as given; without it +y, or +z where the detector looks along y."""
        if self.up is not None:
            return self.up
        return (0.0, 0.0, 1.0) if _parallel(self.looks, (0.0, 1.0, 0.0)) else (0.0, 1.0, 0.0)

    @property
    def virtual_plane(self) -> bool:
        """Whether it is a plane that lets light pass."""
        return self.kind == "plane" and not self.blocking

    def axes(self) -> tuple[Array, Array, Array]:
        """Unit vectors u, v and the looking direction.

        Of a plane u x v is where it looks, as seen by someone in front of it; of a camera u points
        to the right of its picture, and it looks along v x u; of a far field u is C = 0, v is
        C = 90 (or phi = 90), and the third its axis.
        """
        if self.kind == "far_field":
            return self._far_axes()
        n = np.array(self.looks) / np.linalg.norm(self.looks)
        v = np.array(self.upward) - (np.array(self.upward) @ n) * n
        v /= np.linalg.norm(v)
        if self.kind in ("camera", "pinhole"):
            return np.cross(n, v), v, n
        return np.cross(v, n), v, n

    def _far_axes(self) -> tuple[Array, Array, Array]:
        from tracer.description.fields import Placed

        _, frame = Placed(axis=self.axis).frame()
        n = frame[:, 2]
        u = frame[:, 0] if self.c0 is None else np.array(self.c0, float)
        u = u - (u @ n) * n
        u /= np.linalg.norm(u)
        v = np.cross(n, u)
        return u, -v if self.angles == "type_c" else v, n

    def half_fields(self) -> tuple[float, float]:
        """Tangents of half the field, along u and v of the picture.

        One angle is the field along the longer side; pixels are then square.
        """
        assert self.cells is not None
        if isinstance(self.field_deg, tuple):
            a, b = (math.tan(math.radians(angle / 2.0)) for angle in self.field_deg)
            return a, b
        half = math.tan(math.radians(self.field_deg / 2.0))
        longer = max(self.cells)
        return half * self.cells[0] / longer, half * self.cells[1] / longer

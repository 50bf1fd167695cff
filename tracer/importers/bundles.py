"""The light that a prescription is made for: fields, chief rays, edges of the pupil.

A *bundle* is the light of one field. Rays are aimed at the real stop, not at its paraxial image, so
that oblique beams fill it as they do in the lens that is built.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.model.errors import SceneError
from tracer.importers.prescription import FieldPoint
from tracer.importers.sequence import Sequence, ThroughRays

__all__ = ["Bundles", "FieldOrigin", "LitField"]

Array = NDArray[np.float64]

EDGE_RAYS = 24
_AROUND = np.linspace(0.0, 2.0 * math.pi, EDGE_RAYS, endpoint=False)
PUPIL_RINGS = 24
_STEPS = 40


@dataclass(frozen=True, kw_only=True)
class FieldOrigin:
    """Where the light of a field comes from, in object space.

    ``slope`` (dx/dz, dy/dz) of its parallel rays for an object at infinity, else the ``height``
    (x, y) of its point on the object.
    """

    slope: tuple[float, float] | None = None
    height: tuple[float, float] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class LitField:
    """A field whose light gets through the stop.

    Attributes
    ----------
    number : from 1, as the file counts
    field, origin : what the file says of it, and where its light comes from
    centre : (2,) where its chief ray crosses the tangent plane of surface 1
        or, where the field is vignetted, the ray through the middle of what is left of the pupil
    edge : (n, 2) where rays at the edge of the pupil do; those that get through
    angles : (n,) of these on the pupil [rad]
    """

    number: int
    field: FieldPoint
    origin: FieldOrigin
    centre: Array
    edge: Array
    angles: Array

    @property
    def pupil(self) -> Array:
        """(n, 2) places over the whole pupil, evenly from its centre to its edge."""
        shares = np.linspace(0.0, 1.0, PUPIL_RINGS + 1)
        spokes = self.centre + shares[:, None, None] * (self.edge - self.centre)
        return np.asarray(spokes.reshape(-1, 2))


def _left_of_pupil(field: FieldPoint) -> tuple[Array, Array]:
    """Middle and half axes (x, y) of the ellipse that a field's vignetting leaves of a pupil of
    radius 1, before it is turned."""
    right, left, up, down = field.vignetting
    middle = np.array([0.5 * (left - right), 0.5 * (down - up)])
    return middle, np.array([1.0 - 0.5 * (right + left), 1.0 - 0.5 * (up + down)])


def _turned(places: Array, degrees: float) -> Array:
    """(n, 2) places turned about the origin, from +x to +y."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.asarray(places @ np.array([[c, s], [-s, c]]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Bundles:
    """Rays of the fields of a sequence, in the unit of the file."""

    sequence: Sequence

    def fail(self, message: str) -> SceneError:
        return SceneError(f"{self.sequence.prescription.origin}: {message}")

    @property
    def primary(self) -> int:
        """Index of the wavelength that pupils and chief rays are for."""
        return self.sequence.prescription.primary

    # -- the axis --------------------------------------------------------------------------------

    @cached_property
    def marginal(self) -> tuple[float, float]:
        """Height on the tangent plane of surface 1 and slope of the ray at the edge of the axial
        beam; of the real ray, where the aperture is an angle."""
        sequence, aperture = self.sequence, self.sequence.prescription.aperture
        distance = -sequence.z[0]
        if aperture.kind == "stop":
            aimed = self.aim(self.axis, [[0.0, self.stop_radius]])
            height = float(aimed[0, 1])
            return height, height / distance if sequence.finite else 0.0
        value = aperture.value
        if value <= 0.0:
            raise self.fail(f"the aperture ({aperture.kind}) is {value:g}; it must be positive")
        if aperture.kind == "object_na":
            if not sequence.finite:
                raise self.fail("the aperture is a numerical aperture of an object at infinity")
            slope = math.tan(math.asin(min(value / sequence.indices[0, self.primary], 0.999999)))
            return slope * distance, slope
        if aperture.kind == "entrance_diameter":
            return self._through_entrance(value / 2.0)
        if sequence.finite and aperture.kind == "working_f_number":
            _, optical = sequence.paraxial(distance, 1.0, self.primary)
            slope = abs(0.5 / value / optical[-2]) if optical[-2] else 0.0
            return slope * distance, slope
        focal = abs(sequence.focal_length(self.primary))
        if not math.isfinite(focal):
            raise self.fail("the aperture is an f-number, but the lens has no power")
        return self._through_entrance(focal / value / 2.0)

    def _through_entrance(self, height: float) -> tuple[float, float]:
        """The marginal ray through the edge of an entrance pupil of this radius."""
        if not self.sequence.finite:
            return height, 0.0
        distance = -self.sequence.z[0]
        slope = height / (distance + self.entrance_pupil)
        return slope * distance, slope

    @cached_property
    def entrance_pupil(self) -> float:
        """Place of the paraxial entrance pupil behind surface 1; inf where there is none."""
        a, b = self.sequence.stop_matrix(self.primary)
        # The ray through the centre of the stop crosses the axis there: y + z u = 0, A y + B u = 0
        return b / a if a != 0.0 else math.inf

    @cached_property
    def stop_radius(self) -> float:
        """Radius of the stop: as given, or where the marginal ray of the axis passes it."""
        sequence = self.sequence
        number = sequence.prescription.stop
        stop = sequence.surfaces[number]
        if stop.semi_diameter and (not stop.automatic or sequence.prescription.telecentric):
            return stop.semi_diameter
        if sequence.prescription.aperture.kind == "stop":
            if stop.semi_diameter is None:
                raise self.fail(
                    "says neither how wide its beam is nor how wide its stop; give one of them in "
                    "the design program"
                )
            return stop.semi_diameter
        rays = self.trace(self.axis, [[0.0, self.marginal[0]]])
        radius = float(np.hypot(*rays.points[number, 0, :2]))
        if not math.isfinite(radius):
            raise self.fail("the marginal ray of the axis does not reach the stop")
        return radius

    @property
    def axis(self) -> FieldOrigin:
        """The field on the axis."""
        zero = (0.0, 0.0)
        return FieldOrigin(height=zero) if self.sequence.finite else FieldOrigin(slope=zero)

    # -- rays of a field -------------------------------------------------------------------------

    def launch(self, origin: FieldOrigin, places: ArrayLike) -> tuple[Array, Array]:
        """Rays of a field through ``places`` (n, 2) of the tangent plane of surface 1.

        Returns origins (the object's point, or the places) and unit directions, (n, 3) each.
        """
        flat = np.asarray(places, float).reshape(-1, 2)
        on_plane = np.column_stack([flat, np.zeros(len(flat))])
        if origin.slope is not None:
            d = np.array([*origin.slope, 1.0])
            d /= np.linalg.norm(d)
            return on_plane, np.tile(d, (len(flat), 1))
        point = np.array([*(origin.height or (0.0, 0.0)), self.sequence.z[0]])
        d = on_plane - point
        return np.tile(point, (len(flat), 1)), d / np.linalg.norm(d, axis=1)[:, None]

    def trace(
        self, origin: FieldOrigin, places: ArrayLike, channel: int | None = None
    ) -> ThroughRays:
        """Launch rays of a field and take them through the sequence."""
        p, d = self.launch(origin, places)
        return self.sequence.trace(p, d, self.primary if channel is None else channel)

    def aim(self, origin: FieldOrigin, targets: ArrayLike) -> Array:
        """(n, 2) places on the tangent plane of surface 1 from where rays of a field reach
        ``targets`` (n, 2) on the stop; nan where none was found."""
        goal = np.asarray(targets, float).reshape(-1, 2)
        a, b = self.sequence.stop_matrix(self.primary)
        if origin.slope is not None:
            moved, reach = goal - b * np.array(origin.slope), a
        else:
            distance, height = -self.sequence.z[0], np.array(origin.height)
            moved, reach = goal + b * height / distance, a + b / distance
        if reach == 0.0:
            # Rays of one field all cross the stop at one point: its pupil is at infinity
            return np.full(goal.shape, np.nan)
        start = moved / reach
        scale = float(np.max(np.abs(start))) + 1e-9
        places = start
        for _ in range(_STEPS):
            miss = self._at_stop(origin, places) - goal
            step = 1e-7 * scale
            aside = [
                self._at_stop(origin, places + step * np.eye(2)[axis]) - goal - miss
                for axis in range(2)
            ]
            jacobian = np.stack(aside, axis=2) / step
            lost = ~np.isfinite(miss).all(axis=1) | ~np.isfinite(jacobian).all(axis=(1, 2))
            lost |= np.abs(np.linalg.det(np.where(lost[:, None, None], 1.0, jacobian))) < 1e-30
            jacobian[lost] = np.eye(2)
            change = -np.linalg.solve(jacobian, np.where(lost[:, None], 0.0, miss)[:, :, None])
            change = np.where(lost[:, None], -0.1 * places, change[:, :, 0])
            places = places + np.clip(change, -scale, scale)
            if not np.any(np.abs(change) > 1e-13 * scale):
                break
        miss = self._at_stop(origin, places) - goal
        good = np.linalg.norm(miss, axis=1) < 1e-8 * (1.0 + np.abs(goal).max())
        return np.asarray(np.where(good[:, None], places, np.nan))

    def _at_stop(self, origin: FieldOrigin, places: Array) -> Array:
        """(n, 2) where rays of a field cross the stop."""
        p, d = self.launch(origin, places)
        number = self.sequence.prescription.stop
        return self.sequence.trace(p, d, self.primary, last=number).points[number, :, :2]

    def chief(self, origin: FieldOrigin) -> Array:
        """(2,) where the chief ray of a field crosses the tangent plane of surface 1."""
        return np.asarray(self._through(origin, np.zeros((1, 2)))[0])

    def edge(self, origin: FieldOrigin, field: FieldPoint | None = None) -> Array:
        """(n, 2) where rays at the edge of the pupil cross the tangent plane of surface 1.

        They go around the pupil in even steps from +x; with ``field`` its vignetting narrows it.
        """
        rim = np.column_stack([np.cos(_AROUND), np.sin(_AROUND)])
        if field is not None:
            middle, half = _left_of_pupil(field)
            rim = _turned(middle + half * rim, field.turn_deg)
        return self._through(origin, rim)

    def _through(self, origin: FieldOrigin, places: Array) -> Array:
        """(n, 2) where rays to places of the pupil, of radius 1, cross that plane."""
        if self.sequence.prescription.telecentric and origin.height is not None:
            reach = abs(self.marginal[1] * self.sequence.z[0])
            return np.asarray(np.array(origin.height) + reach * places)
        a, b = self.sequence.stop_matrix(self.primary)
        turned = math.copysign(1.0, a - b / self.sequence.z[0] if self.sequence.finite else a)
        return np.asarray(self.aim(origin, turned * self.stop_radius * places))

    # -- fields ----------------------------------------------------------------------------------

    @cached_property
    def origins(self) -> tuple[FieldOrigin, ...]:
        """Where the light of each field of the file comes from."""
        return tuple(self._origin(field) for field in self.sequence.prescription.fields)

    def _origin(self, field: FieldPoint) -> FieldOrigin:
        sequence = self.sequence
        kind = sequence.prescription.field_kind
        if field.x == 0.0 and field.y == 0.0:
            return self.axis
        if kind == "angle":
            slope = (math.tan(math.radians(field.x)), math.tan(math.radians(field.y)))
            if not sequence.finite:
                return FieldOrigin(slope=slope)
            reach = self.entrance_pupil - sequence.z[0]
            return FieldOrigin(height=(-slope[0] * reach, -slope[1] * reach))
        if kind == "object_height":
            if not sequence.finite:
                raise self.fail("fields are heights of an object at infinity; use angles")
            return FieldOrigin(height=(field.x, field.y))
        size = math.hypot(field.x, field.y)
        wanted = size
        for _ in range(1 if kind == "paraxial_image_height" else 30):
            scale = wanted / self._paraxial_image_of_one
            value = (scale * field.x / size, scale * field.y / size)
            origin = FieldOrigin(height=value) if sequence.finite else FieldOrigin(slope=value)
            if kind == "paraxial_image_height":
                break
            # Scale the paraxial field until the real chief ray arrives where it should
            end = self.trace(origin, self.chief(origin)).points[-1, 0]
            reached = (end[0] * field.x + end[1] * field.y) / size
            if not math.isfinite(reached) or reached == 0.0:
                raise self.fail(f"no chief ray reaches the image height {size:g}")
            if abs(reached - size) < 1e-13 * size:
                break
            wanted *= size / reached
        return origin

    @cached_property
    def _paraxial_image_of_one(self) -> float:
        """Paraxial image height of a field of slope 1, or of an object of height 1."""
        sequence, channel = self.sequence, self.primary
        a, b = sequence.stop_matrix(channel)
        last = len(sequence.surfaces) - 2
        if sequence.finite:
            distance = -sequence.z[0]
            slope = 0.0 if sequence.prescription.telecentric else -a / (a * distance + b)
            chief = sequence.paraxial(1.0 + slope * distance, slope, channel, last=last)
            axial = sequence.paraxial(distance, 1.0, channel, last=last)
        else:
            chief = sequence.paraxial(-b / a, 1.0, channel, last=last)
            axial = sequence.paraxial(1.0, 0.0, channel, last=last)
        if axial[1][last] == 0.0:
            raise self.fail("fields are image heights, but the lens has no power")
        return float(chief[0][last] - chief[1][last] * axial[0][last] / axial[1][last])

    @cached_property
    def lit(self) -> tuple[LitField, ...]:
        """The fields whose light gets through the stop and the apertures that the file fixes."""
        found = []
        for number, (field, origin) in enumerate(
            zip(self.sequence.prescription.fields, self.origins, strict=True), 1
        ):
            lit = self.light_of(origin, number, field)
            if lit is not None:
                found.append(lit)
        return tuple(found)

    @property
    def dark(self) -> tuple[tuple[int, FieldPoint], ...]:
        """Numbers and fields of which no light gets through."""
        lit = {field.number for field in self.lit}
        fields = enumerate(self.sequence.prescription.fields, 1)
        return tuple((number, field) for number, field in fields if number not in lit)

    def light_of(
        self, origin: FieldOrigin, number: int = 0, field: FieldPoint | None = None
    ) -> LitField | None:
        """The light of a field over its pupil; None where nothing gets through.

        Without ``field`` that is the whole stop.
        """
        middle = np.zeros(2)
        if field is not None:
            middle, half = _left_of_pupil(field)
            if half.min() <= 0.0:
                return None
            middle = _turned(middle[None], field.turn_deg)[0]
        edge, centre = self.edge(origin, field), self._through(origin, middle[None])[0]
        through = np.isfinite(edge).all(axis=1)
        edge = edge[through]
        if not len(edge):
            return None
        if not np.isfinite(centre).all():
            centre = edge.mean(axis=0)
        lit = LitField(
            number=number,
            field=field or FieldPoint(x=0.0, y=0.0),
            origin=origin,
            centre=centre,
            edge=edge,
            angles=_AROUND[through],
        )
        points = self.trace(origin, lit.pupil).points
        limits = [
            np.inf if surface.automatic or surface.semi_diameter is None else surface.semi_diameter
            for surface in self.sequence.surfaces[:-1]
        ]
        return lit if self.passes(points[:-1], np.array(limits)).any() else None

    def passes(self, points: Array, limits: Array) -> NDArray[np.bool_]:
        """(n_rays,) whether rays pass surfaces (n_surfaces,) within these radii."""
        with np.errstate(invalid="ignore"):
            across = np.hypot(points[1:, :, 0], points[1:, :, 1])
            inside = across <= limits[1:, None] * (1.0 + 1e-9)
        return np.asarray(inside.all(axis=0))

    # -- what the light needs --------------------------------------------------------------------

    @cached_property
    def reach(self) -> Array:
        """(n_surfaces,) largest distance from the axis of the light of all fields."""
        reach = np.zeros(len(self.sequence.surfaces))
        for lit in self.lit:
            for channel in range(len(self.sequence.prescription.wavelengths_nm)):
                points = self.trace(lit.origin, lit.edge, channel).points
                across = np.hypot(points[:, :, 0], points[:, :, 1])
                reach = np.fmax(
                    reach, np.nanmax(np.where(np.isfinite(across), across, 0.0), axis=1)
                )
        return reach

    def image_light(self, limits: Array) -> Array:
        """(n, 3) where light over the whole pupil of all fields and wavelengths meets the image.

        ``limits`` (n_surfaces,) are the radii within which it passes the surfaces.
        """
        ends = [np.empty((0, 3))]
        axis = self.light_of(self.axis)
        for lit in (*self.lit, *((axis,) if axis else ())):
            for channel in range(len(self.sequence.prescription.wavelengths_nm)):
                points = self.trace(lit.origin, lit.pupil, channel).points
                ends.append(points[-1, self.passes(points, limits)])
        return np.concatenate(ends)

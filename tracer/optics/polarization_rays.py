"""Rays of fully polarised light in arrays, and their checks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.model.errors import RayMapError
from raymap.optics.frames import transverse_axes
from tracer.optics.polarization import linear_field

__all__ = ["PolarizationError", "PolarizedRays", "natural_light", "require_transverse"]

Real = NDArray[np.float64]

TOLERANCE = 1e-9
"""Largest |d| - 1, and largest |E . d| / |E|, that is taken for rounding."""


class PolarizationError(RayMapError, ValueError):
    """A state of polarised light, or a ray that carries it, makes no sense."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PolarizedRays:
    """Rays that each carry one fully polarised wave.

    Attributes
    ----------
    origin : (n, 3) [mm]
    direction : (n, 3) unit vectors
    field : (n, 3) complex, perpendicular to the direction; its squared length is the flux
    wavelength_nm : (n,) or one number for all; vacuum wavelength
    optical_path : (n,) [mm] from the source to the origin of the ray
    coherence : (n,) int64; only light of one coherence id and one wavelength interferes
    group : (n,) int64; -1, or a number that the linear halves of one elliptical state share
    """

    origin: Real
    direction: Real
    field: NDArray[np.complex128]
    wavelength_nm: Real
    optical_path: Real
    coherence: NDArray[np.int64]
    group: NDArray[np.int64]

    @classmethod
    def from_field(
        cls,
        origin: ArrayLike,
        direction: ArrayLike,
        field: ArrayLike,
        *,
        wavelength_nm: ArrayLike,
        optical_path: ArrayLike = 0.0,
        coherence: ArrayLike = 0,
        group: ArrayLike = -1,
    ) -> PolarizedRays:
        """Rays of given fields; every argument broadcasts over the rays.

        Raises
        ------
        PolarizationError
            names the argument and the ray: a direction that is no unit vector, a field along the
            ray, a wavelength that is not positive
        """
        places = np.atleast_2d(np.asarray(origin, np.float64))
        directions = np.atleast_2d(np.asarray(direction, np.float64))
        fields = np.atleast_2d(np.asarray(field, np.complex128))
        for name, values in (("origin", places), ("direction", directions), ("field", fields)):
            if values.ndim != 2 or values.shape[1] != 3:
                raise PolarizationError(f"{name} has the shape {values.shape}: expected (n, 3)")
        n = max(len(places), len(directions), len(fields))
        try:
            rays = cls(
                origin=_spread(places, (n, 3)),
                direction=_spread(directions, (n, 3)),
                field=np.ascontiguousarray(np.broadcast_to(fields, (n, 3))),
                wavelength_nm=_spread(wavelength_nm, (n,), keep_scalar=True),
                optical_path=_spread(optical_path, (n,)),
                coherence=np.array(np.broadcast_to(np.asarray(coherence, np.int64), (n,))),
                group=np.array(np.broadcast_to(np.asarray(group, np.int64), (n,))),
            )
        except ValueError as error:
            raise PolarizationError(f"the columns of {n} rays differ in length: {error}") from None
        if not np.all(np.isfinite(rays.origin)):
            raise PolarizationError("origin holds numbers that are not finite")
        if not np.all((rays.wavelength_nm > 0.0) & np.isfinite(rays.wavelength_nm)):
            raise PolarizationError("wavelength_nm must be a positive length for every ray")
        require_transverse(rays.field, rays.direction, "field")
        return rays

    @classmethod
    def linear(
        cls,
        origin: ArrayLike,
        direction: ArrayLike,
        vibration: ArrayLike,
        *,
        wavelength_nm: ArrayLike,
        flux: ArrayLike = 1.0,
        optical_path: ArrayLike = 0.0,
        coherence: ArrayLike = 0,
    ) -> PolarizedRays:
        """Rays of linearly polarised light; ``vibration`` is normalised.

        Raises
        ------
        PolarizationError
            names the argument and the ray: a vibration that is zero or not perpendicular to the
            ray, a negative flux, and what `from_field` refuses
        """
        v = np.atleast_2d(np.asarray(vibration, np.float64))
        length = np.linalg.norm(v, axis=-1)
        if not np.all(length > 0.0):
            ray = int(np.argmin(length > 0.0))
            raise PolarizationError(
                f"vibration (v_p) of ray {ray} is zero or not a number: give the direction in "
                "which the electric field swings"
            )
        unit = v / length[:, np.newaxis]
        d = np.atleast_2d(np.asarray(direction, np.float64))
        require_transverse(unit, np.broadcast_to(d, np.broadcast_shapes(d.shape, unit.shape)))
        power = np.atleast_1d(np.asarray(flux, np.float64))
        if not np.all((power >= 0.0) & np.isfinite(power)):
            raise PolarizationError("flux must be a finite number, zero or more, for every ray")
        return cls.from_field(
            origin,
            direction,
            linear_field(power, unit),
            wavelength_nm=wavelength_nm,
            optical_path=optical_path,
            coherence=coherence,
        )

    def __len__(self) -> int:
        return len(self.direction)

    @property
    def flux(self) -> Real:
        """Flux of every ray, (n,)."""
        e = self.field
        return np.asarray(np.sum(e.real**2 + e.imag**2, axis=1))

    @property
    def wavelengths(self) -> Real:
        """Wavelength of every ray [nm], (n,)."""
        return np.broadcast_to(self.wavelength_nm, (len(self),))

    def where(self, chosen: ArrayLike | slice) -> PolarizedRays:
        """The rays that a mask, an index array or a slice chooses."""
        index = chosen if isinstance(chosen, slice) else np.asarray(chosen)
        return PolarizedRays(
            origin=self.origin[index],
            direction=self.direction[index],
            field=self.field[index],
            wavelength_nm=self.wavelengths[index]
            if self.wavelength_nm.ndim
            else self.wavelength_nm,
            optical_path=self.optical_path[index],
            coherence=self.coherence[index],
            group=self.group[index],
        )

    def with_field(self, field: NDArray[np.complex128]) -> PolarizedRays:
        """The same rays with other fields."""
        return replace(self, field=field)

    @staticmethod
    def join(parts: Sequence[PolarizedRays]) -> PolarizedRays:
        """All rays of several sets, in order."""
        return PolarizedRays(
            origin=np.concatenate([part.origin for part in parts]),
            direction=np.concatenate([part.direction for part in parts]),
            field=np.concatenate([part.field for part in parts]),
            wavelength_nm=np.concatenate([part.wavelengths for part in parts]),
            optical_path=np.concatenate([part.optical_path for part in parts]),
            coherence=np.concatenate([part.coherence for part in parts]),
            group=np.concatenate([part.group for part in parts]),
        )


def natural_light(
    origin: ArrayLike,
    direction: ArrayLike,
    *,
    wavelength_nm: ArrayLike,
    flux: ArrayLike = 1.0,
    coherence: ArrayLike = 0,
) -> tuple[PolarizedRays, PolarizedRays]:
    """Unpolarised light: two orthogonal linear halves that must never interfere.

    The halves of the ray with coherence id c get the ids 2 c and 2 c + 1.
    """
    d = np.atleast_2d(np.asarray(direction, np.float64))
    x, y = transverse_axes(d)
    number = np.asarray(coherence, np.int64)
    half = 0.5 * np.asarray(flux, np.float64)
    first, second = (
        PolarizedRays.linear(
            origin, d, axis, wavelength_nm=wavelength_nm, flux=half, coherence=2 * number + which
        )
        for which, axis in enumerate((x, y))
    )
    return first, second


def require_transverse(
    field: ArrayLike, direction: ArrayLike, name: str = "vibration (v_p)"
) -> None:
    """Refuse directions that are no unit vectors and fields that are not perpendicular to them.

    Raises
    ------
    PolarizationError
        names the argument and the first ray
    """
    d = np.asarray(direction)
    e = np.asarray(field)
    length = np.einsum("...i,...i->...", d, d)
    bad = ~(np.abs(length - 1.0) <= TOLERANCE)
    if np.any(bad):
        ray = int(np.argmax(bad))
        raise PolarizationError(
            f"direction of ray {ray} has the length {np.sqrt(length.flat[ray]):g}: "
            "directions are unit vectors"
        )
    along = np.abs(np.einsum("...i,...i->...", e, d))
    size2 = np.einsum("...i,...i->...", e, np.conj(e)).real
    bad = ~(along * along <= TOLERANCE * TOLERANCE * size2)
    if np.any(bad):
        ray = int(np.argmax(bad))
        share = along.flat[ray] / np.sqrt(size2.flat[ray]) if size2.flat[ray] else np.nan
        raise PolarizationError(
            f"{name} of ray {ray} is not perpendicular to the ray: its component along the "
            f"direction is {share:.3g} of its length; remove it"
        )


def _spread(values: ArrayLike, shape: tuple[int, ...], *, keep_scalar: bool = False) -> Real:
    array = np.asarray(values, np.float64)
    if keep_scalar and array.ndim == 0:
        return array
    return np.ascontiguousarray(np.broadcast_to(array, shape))

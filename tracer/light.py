"""Measured light as a source: a grid of intensities, or a list of rays.

These are the doors for files of photometry and of rays: a reader turns its file into one of the two
classes, and a source of kind ``intensity`` or ``rays`` emits it. Readers are found by the ending of
the file's name in `LIGHT_FORMATS`.

Angles are those of CIE type C photometry (CIE 121): gamma is counted from the first axis of the
light, which is the axis of the source in a scene. C planes turn about it, counter-clockwise for
someone who looks against that axis (from above on a luminaire that shines down); C = 0 is the
source's own x axis, C = 90 its negative y axis. A luminaire with ``axis = [0, 0, -1]`` so has C0
along x of the scene and C90 along y.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.model.errors import SceneError
from raymap.model.fileformat import (
    FileFormat,
    by_content,
    by_suffix,
    known_suffixes,
    of_other_program,
    suffixes_of,
)
from raymap.model.givenfile import check_given
from raymap.model.registry import Registry

__all__ = ["LIGHT_FORMATS", "IntensityGrid", "LightFormat", "Opening", "RayList", "read_light"]

Array = NDArray[np.float64]
FluxUnit = Literal["W", "lm"]


OpeningShape = Literal[
    "ellipse", "box", "ellipsoid", "cylinder along C0", "cylinder along C90", "upright cylinder"
]


@dataclass(frozen=True, kw_only=True)
class Opening:
    """A luminous opening that is neither a disc nor a rectangle, its middle at the source.

    It looks equally bright all over from any one direction: its luminance there is the intensity
    over the area of its outline as seen from there.

    Attributes
    ----------
    shape : cylinders have elliptic ends that shine, too
    size : full sizes along C0, C90 and the axis of the light [length_unit]; 0 along the axis for an
        ellipse
    """

    shape: OpeningShape
    size: tuple[float, float, float]

    def __post_init__(self) -> None:
        if not (min(self.size) >= 0.0 and sum(size > 0.0 for size in self.size) >= 2):
            raise SceneError(f"a luminous opening ({self.shape}) has sizes {self.size}")


@dataclass(frozen=True, kw_only=True, eq=False)
class IntensityGrid:
    """Intensity over directions, linear in gamma and C between its values.

    Attributes
    ----------
    gamma_deg : (n,) rising, within 0 .. 180; there is no light outside
    c_deg : (m,) rising, within 0 .. 360: one plane (rotational symmetry), a quadrant 0 .. 90,
        halves 0 .. 180 or 90 .. 270 (or -90 .. 90), or all around (with or without 360)
    intensity : (n, m) [candela, watt per steradian, or relative]
    unit : "lm" for candela, "W" for watt per steradian, None for relative values
    opening : the luminous opening across the axis: a diameter, or (along C0, along C90)
        [length_unit], or another shape; light starts evenly from it. None: from one point
    length_unit : of ``opening``
    name : for messages
    """

    gamma_deg: Array
    c_deg: Array
    intensity: Array
    unit: FluxUnit | None = None
    opening: float | tuple[float, float] | Opening | None = None
    length_unit: str = "m"
    name: str = "intensity table"

    def __post_init__(self) -> None:
        gamma = np.atleast_1d(np.asarray(self.gamma_deg, np.float64))
        planes = np.atleast_1d(np.asarray(self.c_deg, np.float64))
        values = np.asarray(self.intensity, np.float64)
        if values.ndim == 1 and planes.size == 1:
            values = values[:, None]
        for key, array in (("gamma_deg", gamma), ("c_deg", planes), ("intensity", values)):
            if not np.all(np.isfinite(array)):
                raise SceneError(f"{self.name}: {key} has a gap (a value is not a finite number)")
            object.__setattr__(self, key, array)
        if gamma.size < 2 or values.shape != (gamma.size, planes.size):
            raise SceneError(
                f"{self.name}: needs two or more gamma and an intensity for every gamma and C; "
                f"given: {gamma.size} gamma, {planes.size} C, values {values.shape}"
            )
        if np.any(np.diff(gamma) <= 0.0) or gamma[0] < 0.0 or gamma[-1] > 180.0 + 1e-9:
            raise SceneError(f"{self.name}: gamma must rise within 0 .. 180 degrees")
        if np.any(np.diff(planes) <= 0.0):
            raise SceneError(f"{self.name}: C angles must rise")
        if values.min() < 0.0 or not values.max() > 0.0:
            raise SceneError(f"{self.name}: intensity must not be negative, and not 0 everywhere")
        self.full()

    @classmethod
    def from_theta_phi(
        cls, theta_deg: ArrayLike, phi_deg: ArrayLike, intensity: ArrayLike, **rest: Any
    ) -> IntensityGrid:
        """Of polar angle and azimuth, phi right-handed about the axis from the source's x axis.

        ``intensity`` is (thetas, phis); phi runs once around, or is one value.
        """
        phi = np.atleast_1d(np.asarray(phi_deg, np.float64))
        values = np.asarray(intensity, np.float64).reshape(-1, phi.size)
        turned = np.mod(-phi, 360.0)
        if phi.size > 1 and math.isclose(phi[-1] - phi[0], 360.0):
            turned, values = turned[:-1], values[:, :-1]
        order = np.argsort(turned)
        return cls(
            gamma_deg=np.asarray(theta_deg, np.float64),
            c_deg=turned[order],
            intensity=values[:, order],
            **rest,
        )

    def full(self) -> tuple[Array, Array]:
        """C planes once around, the first repeated at + 360, and their values (n, planes).

        Raises
        ------
        SceneError
            for planes that are none of the known symmetries
        """
        planes, values = self.c_deg, self.intensity
        if planes.size == 1:
            return np.array([0.0, 360.0]), np.repeat(values, 2, axis=1)
        low, high = float(planes[0]), float(planes[-1])
        span = high - low
        if _near(span, 90.0) and _near(low, 0.0):
            # The quadrant seen in the planes C0-C180 and C90-C270
            half = np.concatenate([planes, 180.0 - planes[-2::-1]])
            values = np.concatenate([values, values[:, -2::-1]], axis=1)
            planes, low, span = half, 0.0, 180.0
        if _near(span, 180.0):
            # One half seen in the plane through both of its ends
            planes = np.concatenate([planes, 2.0 * (low + 180.0) - planes[-2::-1]])
            values = np.concatenate([values, values[:, -2::-1]], axis=1)
            return planes, values
        if _near(span, 360.0):
            return planes, np.concatenate([values[:, :-1], values[:, :1]], axis=1)
        largest = float(np.diff(planes).max())
        if span > 360.0 or 360.0 - span > 1.5 * largest:
            raise SceneError(
                f"{self.name}: C runs from {low:g} to {high:g} degrees; it must be one plane, "
                "0 .. 90, a half of 180 degrees, or all around"
            )
        return np.append(planes, low + 360.0), np.concatenate([values, values[:, :1]], axis=1)

    @property
    def flux(self) -> float:
        """Integral over all directions [lumen, watt, or relative]."""
        return float(self.cell_fluxes().sum())

    def cell_fluxes(self) -> Array:
        """(n - 1, planes - 1) flux between neighbouring gammas and C planes of `full`."""
        planes, values = self.full()
        gamma = np.radians(self.gamma_deg)
        low, high = gamma[:-1, None], gamma[1:, None]
        # Integrate (a + b gamma) sin(gamma) for the mean over C, which is linear in gamma
        mean = 0.5 * (values[:, :-1] + values[:, 1:])
        slope = np.diff(mean, axis=0) / (high - low)
        level = mean[:-1] - slope * low
        whole = level * (np.cos(low) - np.cos(high))
        whole = whole + slope * (
            (np.sin(high) - high * np.cos(high)) - (np.sin(low) - low * np.cos(low))
        )
        return np.asarray(whole * np.radians(np.diff(planes)))

    def at(self, gamma_deg: ArrayLike, c_deg: ArrayLike) -> Array:
        """Intensity in given directions; 0 outside the table."""
        planes, values = self.full()
        gamma, around = np.broadcast_arrays(
            np.asarray(gamma_deg, np.float64), np.asarray(c_deg, np.float64)
        )
        around = planes[0] + np.mod(around - planes[0], 360.0)
        j = np.clip(np.searchsorted(planes, around, side="right") - 1, 0, planes.size - 2)
        i = np.clip(
            np.searchsorted(self.gamma_deg, gamma, side="right") - 1, 0, self.gamma_deg.size - 2
        )
        v = (around - planes[j]) / (planes[j + 1] - planes[j])
        u = (gamma - self.gamma_deg[i]) / (self.gamma_deg[i + 1] - self.gamma_deg[i])
        found = (1 - u) * ((1 - v) * values[i, j] + v * values[i, j + 1])
        found = found + u * ((1 - v) * values[i + 1, j] + v * values[i + 1, j + 1])
        return np.where((u < -1e-12) | (u > 1.0 + 1e-12), 0.0, found)

    def digest(self) -> str:
        """Fingerprint of the values, for the hash of a scene."""
        return _digest(self.gamma_deg, self.c_deg, self.intensity, repr((self.unit, self.opening)))


@dataclass(frozen=True, kw_only=True, eq=False)
class RayList:
    """Rays that start with given fluxes.

    Attributes
    ----------
    positions : (n, 3) starting points in the frame of the source [length_unit]
    directions : (n, 3); normalised here
    flux : (n,) per ray [lumen, watt, or relative]
    wavelength_nm : (n,) vacuum wavelengths, or None where the file has none
    rgb : (n, 3) linear sRGB that each ray looks like, of any scale, or None; negative parts count
        as 0
    unit : "lm", "W", or None for relative fluxes
    total : flux of the whole list; None: the sum of ``flux``
    length_unit : of the positions ("mm", "m", …), None for the unit of the scene
    name : for messages
    """

    positions: NDArray[np.float32]
    directions: NDArray[np.float32]
    flux: Array
    wavelength_nm: Array | None = None
    rgb: Array | None = None
    unit: FluxUnit | None = None
    total: float | None = None
    length_unit: str | None = "mm"
    name: str = "ray list"

    def __post_init__(self) -> None:
        positions = np.asarray(self.positions, np.float32)
        directions = np.asarray(self.directions, np.float64)
        flux = np.asarray(self.flux, np.float64)
        n = len(flux)
        if flux.ndim != 1 or n == 0 or positions.shape != (n, 3) or directions.shape != (n, 3):
            raise SceneError(
                f"{self.name}: needs positions (n, 3), directions (n, 3) and n fluxes; given: "
                f"{positions.shape}, {directions.shape}, {flux.shape}"
            )
        length = np.linalg.norm(directions, axis=1)
        sound = np.isfinite(positions).all(axis=1) & np.isfinite(length) & np.isfinite(flux)
        sound &= (length > 0.0) & (flux >= 0.0)
        if not sound.all():
            first = int(np.argmin(sound))
            raise SceneError(
                f"{self.name}: ray {first} (counted from 0; {n - int(sound.sum())} in all) has no "
                "finite position, no direction, or a negative flux"
            )
        if not flux.sum() > 0.0:
            raise SceneError(f"{self.name}: all rays have flux 0")
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "directions", (directions / length[:, None]).astype(np.float32))
        object.__setattr__(self, "flux", flux)
        if self.wavelength_nm is not None:
            nm = np.asarray(self.wavelength_nm, np.float64)
            if nm.shape != (n,) or not np.all(nm > 0.0):
                raise SceneError(f"{self.name}: wavelengths must be n positive numbers [nm]")
            object.__setattr__(self, "wavelength_nm", nm)
        if self.rgb is not None:
            rgb = np.maximum(np.asarray(self.rgb, np.float64), 0.0)
            if rgb.shape != (n, 3) or not np.isfinite(rgb).all():
                raise SceneError(f"{self.name}: rgb must be three finite numbers per ray")
            object.__setattr__(self, "rgb", rgb)

    @property
    def n_rays(self) -> int:
        return len(self.flux)

    def digest(self) -> str:
        """Fingerprint of the values, for the hash of a scene."""
        nm = np.zeros(0) if self.wavelength_nm is None else self.wavelength_nm
        rgb = np.zeros(0) if self.rgb is None else self.rgb
        rest = repr((self.unit, self.total, self.length_unit))
        return _digest(self.positions, self.directions, self.flux, nm, rgb, rest)


@dataclass(frozen=True, kw_only=True)
class LightFormat(FileFormat):
    """Files of light.

    Attributes
    ----------
    read : what the file emits; raises `SceneError` in one clear line for a file that it cannot use.
        Its second argument says what counts where the header of a ray file states another flux than
        its rays carry, the "header" or the "rays"
    """

    read: Callable[[Path, Literal["header", "rays"]], IntensityGrid | RayList]


LIGHT_FORMATS: Registry[LightFormat] = Registry(
    "tracer.light_formats",
    "tracer.photometry",
    words=suffixes_of,
    of=LightFormat,
    sort="files of light that sources emit",
)
"""Formats by suffix."""


def read_light(
    path: Path, *, flux_from: Literal["header", "rays"] = "header"
) -> IntensityGrid | RayList:
    """Read a file of photometry or rays, known by its suffix, else by its first bytes.

    Parameters
    ----------
    path : of the file
    flux_from : what counts where the header of a ray file states another flux than its rays carry

    Raises
    ------
    SceneError
        for a file that is not there or of no known format
    """
    try:
        found = by_suffix(LIGHT_FORMATS, path)
        if found is None and path.is_file():
            found = by_content(LIGHT_FORMATS, path)
        if found is None:
            known = known_suffixes(LIGHT_FORMATS.kinds())
            raise SceneError(
                f"no reader for {path.name!r}{of_other_program(path)}; files may end in {known}"
            )
        check_given(path, "file", SceneError)
        return found.read(path, flux_from)
    except OSError as error:
        raise SceneError(f"{path.name} cannot be read: {error.strerror or error}") from None


def _near(a: float, b: float) -> bool:
    return abs(a - b) < 1e-6


def _digest(*parts: Any) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(
            part.encode() if isinstance(part, str) else np.ascontiguousarray(part).tobytes()
        )
    return digest.hexdigest()[:32]

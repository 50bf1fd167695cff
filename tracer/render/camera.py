"""Pinhole and thin-lens cameras, with an analyser in front if wanted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import SceneError

__all__ = ["Camera", "CameraRays"]

Real = NDArray[np.float64]


@dataclass(frozen=True)
class CameraRays:
    """Rays of some pixels.

    Attributes
    ----------
    origin, direction : (n, 3)
    analyser : (n, 3) field that the analyser lets through, zero without one
    """

    origin: Real
    direction: Real
    analyser: Real


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A camera that looks from ``position`` to ``target``.

    Attributes
    ----------
    position, target, up : (3,) [mm]
    sensor : width and height of the sensor [mm]
    focal_length : distance of the sensor behind the pinhole or lens [mm]
    pixels : width and height of the picture
    samples : n x n rays per pixel, on a regular grid (with a lens: also over the aperture)
    aperture_radius : 0 = pinhole [mm]
    focus_distance : of the plane that a lens images sharply, along the axis [mm]
    analyser_deg : direction that a sheet analyser in front of the camera lets through, from the
        picture's horizontal counter-clockwise as the camera sees it; None = no analyser
    """

    position: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)
    sensor: tuple[float, float]
    focal_length: float
    pixels: tuple[int, int]
    samples: int = 1
    aperture_radius: float = 0.0
    focus_distance: float | None = None
    analyser_deg: float | None = None

    def __post_init__(self) -> None:
        if min(self.sensor) <= 0.0:
            raise SceneError("camera: sensor must be two positive lengths")
        if not self.focal_length > 0.0:
            raise SceneError("camera: focal_length must be positive")
        if min(self.pixels) < 1 or self.samples < 1:
            raise SceneError("camera: pixels and samples must be at least 1")
        if self.aperture_radius < 0.0:
            raise SceneError("camera: aperture_radius must not be negative")
        if self.aperture_radius > 0.0 and not (self.focus_distance or 0.0) > 0.0:
            raise SceneError("camera: a lens (aperture_radius > 0) needs a positive focus_distance")
        self.axes()

    def axes(self) -> Real:
        """(3, 3) rows right, up, forward."""
        forward = np.subtract(self.target, self.position)
        if not np.linalg.norm(forward) > 0.0:
            raise SceneError("camera: target must differ from position")
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, self.up)
        if not np.linalg.norm(right) > 1e-12:
            raise SceneError("camera: up must not point along the line of sight")
        right /= np.linalg.norm(right)
        return np.array([right, np.cross(right, forward), forward])

    @property
    def rays_per_pixel(self) -> int:
        """Number of rays of one pixel."""
        return self.samples * self.samples

    def rays(self, columns: NDArray[np.int64], rows: NDArray[np.int64]) -> CameraRays:
        """Rays of pixels, all samples of a pixel together; row 0 is the top of the picture."""
        right, up, forward = self.axes()
        count = len(columns)
        n = self.samples
        grid = (np.arange(n) + 0.5) / n
        u, v = (a.ravel() for a in np.meshgrid(grid, grid))

        # Aim through the centre of perspective
        x = ((columns[:, None] + u) / self.pixels[0] - 0.5) * self.sensor[0]
        y = (0.5 - (rows[:, None] + v) / self.pixels[1]) * self.sensor[1]
        aim = x[..., None] * right + y[..., None] * up + self.focal_length * forward
        origin = np.broadcast_to(np.asarray(self.position, np.float64), aim.shape)
        if self.aperture_radius > 0.0 and self.focus_distance is not None:
            # Move the origin over the aperture, keep the point in the plane of focus; each pixel
            # turns the pattern, so that lens samples do not repeat from pixel to pixel
            focus = origin + aim * (self.focus_distance / self.focal_length)
            number = np.arange(n * n)
            golden = (number + 0.5) / (n * n)
            angle = (
                2.399963229728653 * number[None, :] + 2.0 * np.pi * _hash(columns, rows)[:, None]
            )
            radius = self.aperture_radius * np.sqrt(golden)[None, :]
            shift = (radius * np.cos(angle))[..., None] * right
            shift = shift + (radius * np.sin(angle))[..., None] * up
            origin = origin + shift
            aim = focus - origin
        direction = aim / np.linalg.norm(aim, axis=-1, keepdims=True)
        direction = direction.reshape(count * n * n, 3)

        # A sheet analyser absorbs along one axis b and passes d x b
        analyser = np.zeros_like(direction)
        if self.analyser_deg is not None:
            angle_deg = np.radians(self.analyser_deg + 90.0)
            absorbing = np.cos(angle_deg) * right + np.sin(angle_deg) * up
            analyser = np.cross(direction, absorbing)
            analyser /= np.linalg.norm(analyser, axis=-1, keepdims=True)
        return CameraRays(
            origin=np.ascontiguousarray(origin.reshape(count * n * n, 3)),
            direction=np.ascontiguousarray(direction),
            analyser=analyser,
        )


def _hash(columns: NDArray[np.int64], rows: NDArray[np.int64]) -> Real:
    """A number in 0 .. 1 for each pixel, the same whatever the tiles and threads."""
    mixed = (columns * 73856093) ^ (rows * 19349663)
    return np.asarray((mixed * 2654435761 % 4294967296) / 4294967296.0)

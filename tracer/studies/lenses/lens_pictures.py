"""Pictures of a simple scene with a lens: spectral against RGB, Fresnel against Schlick.

A small camera looks through a lens, near its rim and past it, at a board of squares. Light is
followed backward: every sample's ray is a root of a backward tree, the exits of the tree look at
the board, and the radiance they find times their share of the light comes back. The board and its
surroundings send natural light, so a share is that of unpolarised light; behind an analyser it is
the share of the light that vibrates as the analyser lets through, which by reciprocity is the tree
of that linear light. Schlick's approximation knows no polarisation: its share is halved.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from raymap.optics.colorimetry import xyz_to_linear_srgb
from raymap.optics.frames import transverse_axes
from tracer.lens import Lens, LensError, LensTree, trace_lens
from tracer.lens.forward import RGB_NM, Mode
from tracer.optics.polarization_rays import PolarizedRays
from tracer.studies.interference_colors import white_weights

__all__ = ["Board", "LensCamera", "lens_picture"]

Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Board:
    """A square board across the z axis, with light and dark squares, before a grey background.

    Attributes
    ----------
    z : of its plane [mm]
    half_size : half a side [mm]
    square : side of a square [mm]
    light, dark, background : radiances
    """

    z: float = 90.0
    half_size: float = 60.0
    square: float = 6.0
    light: float = 1.0
    dark: float = 0.03
    background: float = 0.25

    def radiance(self, point: Real, direction: Real) -> Real:
        """(n,) radiance that comes from where rays (n, 3) go."""
        with np.errstate(divide="ignore", invalid="ignore"):
            way = (self.z - point[:, 2]) / direction[:, 2]
            x, y = (point[:, :2] + way[:, np.newaxis] * direction[:, :2]).T
        on_board = (way > 0.0) & (np.abs(x) < self.half_size) & (np.abs(y) < self.half_size)
        x, y = np.where(on_board, x, 0.0), np.where(on_board, y, 0.0)
        odd = (np.floor(x / self.square) + np.floor(y / self.square)) % 2.0 == 1.0
        return np.where(on_board, np.where(odd, self.dark, self.light), self.background)


@dataclass(frozen=True, kw_only=True)
class LensCamera:
    """A pinhole camera that looks along +z.

    Attributes
    ----------
    eye : (3,) the pinhole [mm]
    half_angle_deg : from the middle of the picture to the middle of a side
    pixels : along a side
    samples : along a side of a pixel
    """

    eye: tuple[float, float, float] = (0.0, 0.0, -60.0)
    half_angle_deg: float = 16.0
    pixels: int = 200
    samples: int = 2

    def directions(self) -> Real:
        """(n, 3) of all samples, pixel rows from the top, samples of a pixel together."""
        if self.pixels < 1 or self.samples < 1:
            raise LensError("pixels and samples of a camera must be at least 1")
        fine = self.pixels * self.samples
        side = (np.arange(fine) + 0.5) / fine * 2.0 - 1.0
        x, y = np.meshgrid(side, -side)
        tangent = math.tan(math.radians(self.half_angle_deg))
        d = np.stack([tangent * x, tangent * y, np.ones_like(x)], axis=-1)
        return np.asarray(d / np.linalg.norm(d, axis=-1, keepdims=True)).reshape(-1, 3)

    def picture(self, values: Real) -> Real:
        """(pixels, pixels) means over the samples (n,) of each pixel."""
        shape = (self.pixels, self.samples, self.pixels, self.samples)
        return np.asarray(values.reshape(shape).mean(axis=(1, 3)))


def lens_picture(
    lens: Lens,
    *,
    camera: LensCamera | None = None,
    board: Board | None = None,
    color: Literal["spectral", "rgb"] = "spectral",
    rules: Literal["fresnel", "schlick"] = "fresnel",
    analyser_deg: float | None = None,
    depth: int = 4,
    spectral_samples: int = 21,
    threads: int = 1,
) -> Real:
    """A picture through a lens, linear sRGB (pixels, pixels, 3), white board = 1.

    Parameters
    ----------
    color : "spectral": ``spectral_samples`` wavelengths from 400 to 700 nm under D65, each with its
        index; "rgb": three channels that share the index at the d line, hence no coloured fringes
    rules : Fresnel's equations for natural light, exact over the whole tree, or Schlick's
        approximation at every hit
    analyser_deg : angle from x that an analyser before the camera lets through; None for no
        analyser. The share of unpolarised light counts half of the light as passed at best
    depth : of the trees
    """
    eye, target = camera or LensCamera(), board or Board()
    d = eye.directions()
    x, _ = transverse_axes(d, (1.0, 0.0, 0.0))
    mode: Mode = "unpolarized" if rules == "fresnel" else "schlick"
    vibration, factor = x, 1.0
    if analyser_deg is not None:
        angle = math.radians(analyser_deg)
        vibration, _ = transverse_axes(d, (math.cos(angle), math.sin(angle), 0.0))
        mode, factor = ("polarized" if rules == "fresnel" else "schlick"), 0.5
    roots = PolarizedRays.linear(eye.eye, d, vibration, wavelength_nm=587.5618)

    def seen(wavelength: float, index_nm: float | None) -> Real:
        at = replace(roots, wavelength_nm=np.float64(wavelength) + np.zeros(()))
        tree = trace_lens(
            lens, at, depth=depth, mode=mode, index_wavelength_nm=index_nm, threads=threads
        )
        return factor * eye.picture(_look(tree, target))

    if color == "rgb":
        return np.stack([seen(nm, 587.5618) for nm in RGB_NM], axis=-1)
    wavelengths = np.linspace(400.0, 700.0, spectral_samples)
    weights = white_weights(wavelengths)
    xyz = np.zeros((eye.pixels, eye.pixels, 3))
    for wavelength, weight in zip(wavelengths, weights, strict=True):
        xyz += seen(float(wavelength), None)[..., np.newaxis] * weight
    rgb = xyz_to_linear_srgb(xyz)
    return np.asarray(rgb / xyz_to_linear_srgb(weights.sum(axis=0)))


def _look(tree: LensTree, board: Board) -> Real:
    """(n,) radiance at the roots of backward trees."""
    result = np.zeros(len(tree))
    past = tree.missed
    result[past] = board.radiance(tree.rays.origin[past], tree.rays.direction[past])
    exits = tree.exits()
    found = board.radiance(exits.point, exits.direction) * exits.flux
    result += np.bincount(exits.ray, weights=found, minlength=len(tree))
    return result

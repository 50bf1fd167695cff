"""Conical refraction on a screen: the double ring behind a plate cut across a binormal."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from raymap.pictures.files import write_pixels
from tracer.optics.crystals.conical import conical_rays, ring_of_plate
from tracer.optics.crystals.local import s_and_p, solve_interface
from tracer.optics.crystals.media import Crystal, biaxial, isotropic, rotation_between
from tracer.render.images import to_bytes
from tracer.studies.crystals.crystal_statements import Check
from tracer.studies.crystals.quasi_random import quasi_random

__all__ = ["ConicalScene", "ScreenRays", "conical_checks", "trace_pencil"]

Real = NDArray[np.float64]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
_NORMAL = np.array([0.0, 0.0, 1.0])


class ConicalScene(BaseModel):
    """Plate, filter with a hole, screen; lengths in mm, wavelength in nm."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = "conical refraction"
    indices: tuple[Positive, Positive, Positive]
    thickness: Positive
    filter_thickness: Positive
    hole_radius: Positive
    screen_distance: Positive
    wavelength: Positive = 589.3
    rays: Annotated[int, Field(ge=1000)] = 600_000
    pixels: Annotated[int, Field(ge=16)] = 160

    def crystal(self, turn_deg: float = 0.0) -> Crystal:
        """The crystal with one binormal along z, turned about z."""
        crystal = biaxial(*self.indices, name=self.name)
        crystal = crystal.turned(
            rotation_between(crystal.binormals(self.wavelength)[0], (0.0, 0.0, 1.0))
        )
        c, s = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
        return crystal.turned([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


class ScreenRays(BaseModel):
    """Where light meets the screen: x, y [mm] and share of flux; and the worst energy sum."""

    model_config = ConfigDict(arbitrary_types_allowed=True, frozen=True)

    x: Real
    y: Real
    share: Real
    energy_error: float


def trace_pencil(scene: ConicalScene, turn_deg: float = 0.0, *, shift: float = 0.0) -> ScreenRays:
    """Trace natural light through the hole and the plate to the screen.

    Parameters
    ----------
    turn_deg : of the crystal about the normal of the plate
    shift : of the quasi-random sequence, for an independent second picture
    """
    # Go evenly from the points of the upper to the points of the lower end of the hole
    u = quasi_random(scene.rays, 5, shift=shift)
    radius = scene.hole_radius * np.sqrt(u[:, 0])
    lower = scene.hole_radius * np.sqrt(u[:, 1])
    start = np.stack([radius * np.cos(2 * np.pi * u[:, 2]), radius * np.sin(2 * np.pi * u[:, 2])])
    end = np.stack([lower * np.cos(2 * np.pi * u[:, 3]), lower * np.sin(2 * np.pi * u[:, 3])])
    slope = (end - start) / scene.filter_thickness
    direction = np.column_stack([slope[0], slope[1], np.ones(scene.rays)])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)

    # Natural light: each ray one random azimuth
    s, p = s_and_p(direction, _NORMAL)
    azimuth = np.pi * u[:, 4, None]
    field = np.cos(azimuth) * s + np.sin(azimuth) * p
    crystal = scene.crystal(turn_deg)
    air = isotropic(1.0, name="air")
    enter = solve_interface(air, crystal, direction, field, _NORMAL, wavelength_nm=scene.wavelength)
    energy = float(np.abs(enter.share.sum(axis=1) - 1.0).max())
    xs, ys, shares = [], [], []
    for slot in (2, 3):
        ray = enter.direction[:, slot]
        leave = solve_interface(
            crystal,
            air,
            enter.refraction_vector[:, slot],
            enter.field[:, slot],
            _NORMAL,
            wavelength_nm=scene.wavelength,
        )
        energy = max(energy, float(np.abs(leave.share.sum(axis=1) - 1.0).max()))
        inside = scene.thickness * ray[:, :2] / ray[:, 2:]
        outside = scene.screen_distance * direction[:, :2] / direction[:, 2:]
        xs.append(end[0] + inside[:, 0] + outside[:, 0])
        ys.append(end[1] + inside[:, 1] + outside[:, 1])
        shares.append(enter.share[:, slot] * leave.refracted / scene.rays)
    return ScreenRays(
        x=np.concatenate(xs),
        y=np.concatenate(ys),
        share=np.concatenate(shares),
        energy_error=energy,
    )


def _image(rays: ScreenRays, pixels: int, half: float) -> Real:
    """(pixels, pixels) flux per pixel, row 0 at the largest y."""
    edges = np.linspace(-half, half, pixels + 1)
    image, _, _ = np.histogram2d(-rays.y, rays.x, bins=(edges, edges), weights=rays.share)
    return image


def _profile(rays: ScreenRays, centre: Real, limit: float, bins: int) -> tuple[Real, Real]:
    """Radii and mean irradiance around a centre."""
    r = np.hypot(rays.x - centre[0], rays.y - centre[1])
    edges = np.linspace(0.0, limit, bins + 1)
    flux, _ = np.histogram(r, bins=edges, weights=rays.share)
    middle = 0.5 * (edges[1:] + edges[:-1])
    return middle, flux / (2.0 * np.pi * middle)


def conical_checks(scene: ConicalScene, folder: Path | None) -> Iterator[Check]:
    """Double ring, its rotation, polarisation around it, energy; writes conical_refraction.png."""
    crystal = scene.crystal()
    centre, radius = ring_of_plate(crystal, _NORMAL, scene.thickness, scene.wavelength)
    rays = trace_pencil(scene)
    picture = ""
    turned = trace_pencil(scene, 30.0, shift=0.37)
    half = 2.6 * radius + 0.5 * scene.screen_distance * scene.hole_radius / scene.filter_thickness
    if folder is not None:
        picture = "conical_refraction.png"
        # The ring lies beside the axis, up to the edge of this square: show a margin around it
        both = [_image(one, scene.pixels, 1.2 * half) for one in (rays, turned)]
        scale = float(np.quantile(both[0], 0.998))
        write_pixels(folder / picture, to_bytes(np.concatenate(both, axis=1) / scale))

    # Two bright rings, and a dark one between them at the radius of the closed form
    r, irradiance = _profile(rays, centre, 2.0 * radius, 240)
    near = np.abs(r - radius) < 0.15 * radius
    dark = int(np.flatnonzero(near)[np.argmin(irradiance[near])])
    inner, outer = irradiance[:dark].max(), irradiance[dark + 1 :].max()
    fit = np.polyfit(r[dark - 6 : dark + 7], irradiance[dark - 6 : dark + 7], 2)
    yield Check(
        name="conical.dark_ring",
        statement="dark ring at R0 = (d / 2) tan(chi) around the predicted centre, relative",
        deviation=abs(-0.5 * fit[1] / fit[0] - radius) / radius,
        limit=0.02,
        picture=picture,
    )
    yield Check(
        name="conical.two_rings",
        statement="irradiance of the dark ring over that of the fainter bright one",
        deviation=float(irradiance[dark] / min(inner, outer)),
        limit=0.5,
    )

    # Turning the crystal by 30 deg turns the picture by 30 deg
    c, s = math.cos(math.radians(30.0)), math.sin(math.radians(30.0))
    expected = ScreenRays(
        x=c * rays.x - s * rays.y, y=s * rays.x + c * rays.y, share=rays.share, energy_error=0.0
    )
    a, b = (_image(one, 64, half).ravel() for one in (expected, turned))
    correlation = float(np.corrcoef(a, b)[0, 1])
    yield Check(
        name="conical.rotation",
        statement="1 - correlation of the picture of the crystal turned by 30 deg, turned back",
        deviation=1.0 - correlation,
        limit=0.01,
    )
    yield Check(
        name="conical.energy",
        statement="fluxes of every ray of the pencil add up at both faces",
        deviation=max(rays.energy_error, turned.energy_error),
        limit=1e-12,
    )
    yield from _around_the_ring(scene, crystal, centre, radius)


def _around_the_ring(
    scene: ConicalScene, crystal: Crystal, centre: Real, radius: float
) -> Iterator[Check]:
    """Rays near and on the binormal against the closed forms."""
    air = isotropic(1.0, name="air")
    n_y = float(np.sort(crystal.principal_indices(scene.wavelength))[1])
    through = 4.0 * n_y / (n_y + 1.0) ** 2
    towards = centre[:2] / np.linalg.norm(centre[:2])
    psi = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
    delta = 1e-3
    across = np.array([-towards[1], towards[0]])
    azimuth = -np.cos(psi)[:, None] * towards - np.sin(psi)[:, None] * across
    direction = np.column_stack([delta * azimuth, np.full(72, math.sqrt(1.0 - delta**2))])

    # Natural light feeds both rays alike; linear light leaves one dark point
    s, p = s_and_p(direction, _NORMAL)
    waves = [
        solve_interface(air, crystal, direction, e, _NORMAL, wavelength_nm=scene.wavelength)
        for e in (s, p)
    ]
    natural = 0.5 * (waves[0].share + waves[1].share)
    yield Check(
        name="conical.natural",
        statement="both rays carry (1 - R) / 2 of natural light all around the ring",
        deviation=float(np.abs(natural[:, 2:] - 0.5 * through).max()),
        limit=1e-3,
    )
    # Each direction of the cone feeds a ray at its own azimuth outside the dark ring
    spots = scene.thickness * waves[0].direction[:, 2:, :2] / waves[0].direction[:, 2:, 2:]
    offset = spots - centre[:2]
    distance = np.linalg.norm(offset, axis=2)
    expected = np.stack(
        [radius - scene.thickness * delta / n_y, radius + scene.thickness * delta / n_y]
    )
    yield Check(
        name="conical.radii",
        statement="rays at delta from the binormal meet the ring at R0 -+ d delta / n_y, relative",
        deviation=float(np.abs(np.sort(distance, axis=1) - expected).max() / radius),
        limit=1e-3,
    )
    plane = np.array([towards[0], towards[1], 0.0])
    linear = solve_interface(
        air,
        crystal,
        direction,
        plane - direction * (direction @ plane)[:, None],
        _NORMAL,
        wavelength_nm=scene.wavelength,
    )
    around = np.einsum("nki,i->nk", offset, -towards) / distance
    yield Check(
        name="conical.polarisation",
        statement="light polarised in the optic plane: share (1 - R) sin^2(psi / 2) at azimuth psi",
        deviation=float(np.abs(linear.share[:, 2:] - through * 0.5 * (1.0 - around)).max()),
        limit=5e-3,
    )

    # On the binormal itself the rays lie on the ring
    cone = conical_rays(crystal, _NORMAL, scene.wavelength, count=96)
    ring = scene.thickness * cone.direction[:, :2] / cone.direction[:, 2:] - centre[:2]
    yield Check(
        name="conical.cone",
        statement="rays on the binormal lie on the circle of radius R0, relative",
        deviation=float(np.abs(np.linalg.norm(ring, axis=1) - radius).max() / radius),
        limit=1e-12,
    )

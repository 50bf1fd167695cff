"""What a lens answers: the trees of a batch of rays, and their exits as rays."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracer.lens.arrays import NodeArrays, RayArrays
from tracer.lens.errors import LensError
from tracer.lens.lens import Lens
from tracer.optics.polarization_rays import PolarizedRays

__all__ = ["Exits", "LensTree"]

Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Exits:
    """All rays that leave a lens, one row each, ordered by incoming ray and level.

    Attributes
    ----------
    ray : (m,) int64, the incoming ray
    level : (m,) int64, hits up to the exit: 1 reflected at once, 2 directly transmitted, …
    face : (m,) int8, where it leaves
    point, direction : (m, 3)
    flux : (m,)
    optical_path : (m,) [mm]
    field : (m, 3) complex, or None in the scalar modes
    tube : (m,) flux over squared electric field, relative to the incoming ray; None if scalar
    half_waves : (m,) int64, reflections that turned the vibration by pi; None if scalar
    """

    ray: NDArray[np.int64]
    level: NDArray[np.int64]
    face: NDArray[np.int8]
    point: Real
    direction: Real
    flux: Real
    optical_path: Real
    field: NDArray[np.complex128] | None
    tube: Real | None
    half_waves: NDArray[np.int64] | None

    def __len__(self) -> int:
        return len(self.ray)


@dataclass(frozen=True, kw_only=True, eq=False)
class LensTree:
    """The trees of n rays to a depth; arrays of shape (n, depth), column level - 1.

    Attributes
    ----------
    lens, rays, mode : what was asked
    face : (n, depth) int8, face of each hit, -1 where the tree has ended
    point : (n, depth, 3) of each hit [mm]
    flux : (n, depth) of the ray that leaves there, 0 where none leaves
    direction : (n, depth, 3) of that ray
    optical_path : (n, depth) up to there [mm]
    field : (n, depth, 3) complex field of that ray, squared length its flux; None if scalar
    tube : (n, depth) product of the tube factors (n2 cos t) / (n1 cos i) of its refractions: the
        electric field itself is field / sqrt(tube); None if scalar
    half_waves : (n, depth) int8, reflections that turned the vibration by pi; None if scalar
    absorbed_glass, absorbed_rim, suppressed, remainder : (n,) flux that did not leave; with the
        exits they add up to the flux that came in
    status : (n,) int8, first face met, -1 where the ray passes the lens by
    media : what the compiled tree read: indices and absorption by wavelength
    halves : the two polarised trees of mode "unpolarized"
    """

    lens: Lens
    rays: PolarizedRays
    mode: str
    face: NDArray[np.int8]
    point: Real
    flux: Real
    direction: Real
    optical_path: Real
    field: NDArray[np.complex128] | None
    tube: Real | None
    half_waves: NDArray[np.int8] | None
    absorbed_glass: Real
    absorbed_rim: Real
    suppressed: Real
    remainder: Real
    status: NDArray[np.int8]
    media: RayArrays = dataclasses.field(repr=False)
    halves: tuple[LensTree, LensTree] | None = None

    @classmethod
    def from_nodes(
        cls, lens: Lens, rays: PolarizedRays, mode: str, nodes: NodeArrays, media: RayArrays
    ) -> LensTree:
        """Wrap what compiled code wrote."""
        polarized = nodes.field.shape[0] == nodes.flux.shape[0] and nodes.tube.size > 0
        return cls(
            lens=lens, rays=rays, mode=mode, face=nodes.face, point=nodes.point, flux=nodes.flux,
            direction=nodes.direction, optical_path=nodes.path,
            field=nodes.field if polarized else None,
            tube=nodes.tube if polarized else None,
            half_waves=nodes.half_waves if polarized else None,
            absorbed_glass=nodes.absorbed_glass, absorbed_rim=nodes.absorbed_rim,
            suppressed=nodes.suppressed, remainder=nodes.remainder, status=nodes.status,
            media=media,
        )  # fmt: skip

    @classmethod
    def mean_of(cls, first: LensTree, second: LensTree, rays: PolarizedRays) -> LensTree:
        """The tree of natural light: fluxes of both halves, summed without interference."""
        out = first.flux > 0.0
        either = out[..., np.newaxis]
        return cls(
            lens=first.lens, rays=rays, mode="unpolarized",
            face=np.where(first.face >= 0, first.face, second.face).astype(np.int8),
            point=np.where((first.face >= 0)[..., np.newaxis], first.point, second.point),
            flux=first.flux + second.flux,
            direction=np.where(either, first.direction, second.direction),
            optical_path=np.where(out, first.optical_path, second.optical_path),
            field=None, tube=None, half_waves=None,
            absorbed_glass=first.absorbed_glass + second.absorbed_glass,
            absorbed_rim=first.absorbed_rim + second.absorbed_rim,
            suppressed=first.suppressed + second.suppressed,
            remainder=first.remainder + second.remainder,
            status=first.status, media=first.media, halves=(first, second),
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.status)

    @property
    def depth(self) -> int:
        """Deepest level of the trees."""
        return int(self.flux.shape[1])

    @property
    def missed(self) -> NDArray[np.bool_]:
        """(n,) rays that pass the lens by; their light is in none of the sums."""
        return self.status < 0

    @property
    def level_flux(self) -> Real:
        """(depth,) flux that leaves at each level, over all rays."""
        result: Real = self.flux.sum(axis=0)
        return result

    def energy_error(self) -> Real:
        """(n,) relative difference between the flux in and everything that became of it."""
        incoming = self.rays.flux
        booked = (
            self.flux.sum(axis=1)
            + self.absorbed_glass
            + self.absorbed_rim
            + self.suppressed
            + self.remainder
        )
        lit = ~self.missed & (incoming > 0.0)
        return np.where(lit, booked / np.where(lit, incoming, 1.0) - 1.0, 0.0)

    def exits(self) -> Exits:
        """The rays that leave, as a flat table."""
        ray, column = np.nonzero(self.flux > 0.0)
        at = (ray, column)
        return Exits(
            ray=ray.astype(np.int64),
            level=(column + 1).astype(np.int64),
            face=self.face[at],
            point=self.point[at],
            direction=self.direction[at],
            flux=self.flux[at],
            optical_path=self.optical_path[at],
            field=None if self.field is None else self.field[at],
            tube=None if self.tube is None else self.tube[at],
            half_waves=None if self.half_waves is None else self.half_waves[at].astype(np.int64),
        )

    def exit_rays(self, exits: Exits | None = None) -> PolarizedRays:
        """The exits of a polarised tree as rays for the next element.

        Natural light gives the exits of both halves, with their own coherence ids.
        """
        if self.halves is not None and exits is None:
            return PolarizedRays.join([half.exit_rays() for half in self.halves])
        chosen = self.exits() if exits is None else exits
        if chosen.field is None:
            raise LensError(
                f"mode {self.mode!r} knows no fields: trace the lens with mode 'polarized'"
            )
        rays = self.rays
        wavelength = rays.wavelength_nm
        return PolarizedRays(
            origin=chosen.point,
            direction=chosen.direction,
            field=chosen.field,
            wavelength_nm=wavelength[chosen.ray] if wavelength.ndim else wavelength,
            optical_path=chosen.optical_path,
            coherence=rays.coherence[chosen.ray],
            group=rays.group[chosen.ray],
        )

"""The goniophotometer around any scene: plates, stacks, meshes, traced by the general engine.

Light that leaves the scene is counted by its direction. With a path the rays are recorded, so that
the paths behind a peak of the BTDF can be asked for afterwards.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.model.errors import SceneError
from raymap.model.events import Event
from raymap.model.portion import Portion
from raymap.model.schema import COLOR_SCALE, NORMAL_SCALE
from raymap.optics.fluxes import variances
from tracer.scattering.plates.goniophotometer import AngularGrid, Goniogram
from tracer.scene.compilations import compilation_of
from tracer.scene.compile import Compilation
from tracer.scene.model import Scene
from tracer.scene.supported import refuse_weighting

__all__ = ["measure_scene"]

Array = NDArray[np.float64]
_BATCHES = 20


def measure_scene(
    scene: str | Path | Scene | Compilation,
    *,
    normal: ArrayLike = (0.0, 0.0, -1.0),
    rays: int = 100_000,
    seed: int = 1,
    grid: AngularGrid | None = None,
    path: str | Path | None = None,
    force: bool = False,
) -> list[Goniogram]:
    """Measure a sample in a scene whose only source is a parallel beam.

    The sample must be wide enough that light leaving through its sides does not count; side light
    is sorted by its direction like all other.

    Parameters
    ----------
    scene : a scene file, a `Scene`, or the result of `compile_scene`
    normal : of the sample's lit side, against the beam; reflected light leaves towards it
    rays, seed : of the trace
    grid : cells of the detector
    path : record the rays in this ray map; ``force`` writes over an existing one

    Returns
    -------
    One `Goniogram` per colour channel, as for light of that channel alone.
    """
    if rays < 2 * _BATCHES:
        raise SceneError(f"goniophotometer: at least {2 * _BATCHES} rays are needed, got {rays}")
    compilation = compilation_of(scene)
    refuse_weighting(compilation.scene, "the goniophotometer")
    if compilation.scene.light != "natural":
        raise SceneError(
            f"{compilation.scene.origin}: trace: the goniophotometer follows natural light; what "
            f"asks for {compilation.scene.light} would have no effect: leave it out"
        )
    if len(compilation.directory.sources) != 1:
        raise SceneError("the goniophotometer needs a scene with exactly one source, a beam")
    cells = grid or AngularGrid()
    counts = np.array([len(part) for part in np.array_split(np.arange(rays), _BATCHES)])
    portions = (
        _traced(compilation, counts, seed)
        if path is None
        else _recorded(compilation, rays, seed, Path(path), force)
    )
    tally = _Tally(cells, np.asarray(normal, np.float64), rays)
    for portion in portions:
        tally.add(portion)
    colors = np.array(compilation.channel_set.source_colors[0])
    wavelengths = compilation.channel_set.wavelengths_nm
    return [tally.goniogram(k, float(colors[k]), wavelengths[k]) for k in range(len(wavelengths))]


def _traced(compilation: Compilation, counts: NDArray[np.int64], seed: int) -> Iterator[Portion]:
    from tracer.transport.wavefront import Wavefront

    engine = Wavefront(compilation.arrays, seed, meshes=compilation.solids)
    first = 0
    for count in counts:
        yield engine.trace(first, int(count), reuse=True)
        first += int(count)


def _recorded(
    compilation: Compilation, rays: int, seed: int, path: Path, force: bool
) -> Iterator[Portion]:
    import raymap
    from tracer.run.recording import record

    record(compilation, path, rays=rays, seed=seed, force=force)
    with raymap.open(path) as stored:
        for portion in stored.portions:
            yield portion.read()


class _Tally:
    """Flux by side, cell and channel, in batches of consecutive rays."""

    def __init__(self, grid: AngularGrid, normal: Array, rays: int) -> None:
        self.grid = grid
        self.rays = rays
        self.axis = normal / np.linalg.norm(normal)
        self.forward: Array | None = None
        self.cos_incidence = 1.0
        self.scatterings = 0
        self.bins: Array | None = None
        self.left: Array | None = None

    def add(self, portion: Portion) -> None:
        """Sort the rays of a portion that left by direction."""
        ends = np.cumsum(portion.records_per_ray) - 1
        if self.forward is None:
            self._orient(portion)
        assert self.forward is not None
        gone = (portion.event[ends] & int(Event.LEFT_SCENE)) != 0
        last = ends[gone]
        self.scatterings += int(np.sum((portion.event & int(Event.VOLUME_SCATTER)) != 0))
        direction = portion.normal[last].astype(np.float64) / NORMAL_SCALE
        height = direction @ self.axis
        along = direction @ self.forward
        across = direction @ np.cross(self.forward, self.axis)
        # Find side, ring and azimuth of each ray
        side = (height < 0.0).astype(np.int64)
        falling = self.grid.cosine_edges
        ring = np.searchsorted(-falling, -np.abs(height), side="right") - 1
        ring = np.clip(ring, 0, falling.size - 2)
        n_phi = self.grid.n_phi
        turn = np.floor(np.arctan2(across, along) / (2.0 * math.pi) * n_phi + 0.5)
        column = turn.astype(np.int64) % n_phi
        colors = _colors(portion)[last]
        weight = np.ones(portion.n_rays) if portion.weight is None else portion.weight
        colors = colors * np.asarray(weight, np.float64)[gone][:, None]
        number = portion.first_ray + np.arange(portion.n_rays)
        batch = (number[gone] - self._first) * _BATCHES // self.rays
        shape = (_BATCHES, 2, falling.size - 1, n_phi, colors.shape[1])
        if self.bins is None:
            self.bins = np.zeros(shape)
            self.left = np.zeros((2, 2, colors.shape[1]))
        assert self.left is not None
        np.add.at(self.bins, (np.clip(batch, 0, _BATCHES - 1), side, ring, column), colors)
        for k in (0, 1):
            self.left[0, k] += colors[side == k].sum(axis=0)
            self.left[1, k] += (colors[side == k] ** 2).sum(axis=0)

    def _orient(self, portion: Portion) -> None:
        """Take the plane of incidence from the first ray."""
        self._first = portion.first_ray
        if portion.records_per_ray[0] < 2:
            raise SceneError("the beam misses the sample: its first ray met nothing")
        beam = portion.position[1].astype(np.float64) - portion.position[0]
        beam /= np.linalg.norm(beam)
        self.cos_incidence = float(-beam @ self.axis)
        if self.cos_incidence <= 0.0:
            raise SceneError("the beam comes from behind: normal must point against it")
        tangent = beam + self.cos_incidence * self.axis
        size = float(np.linalg.norm(tangent))
        if size < 1e-4:
            spare = np.eye(3)[int(np.argmin(np.abs(self.axis)))]
            tangent = spare - (spare @ self.axis) * self.axis
            size = float(np.linalg.norm(tangent))
        self.forward = tangent / size

    def goniogram(self, channel: int, share: float, wavelength_nm: float) -> Goniogram:
        """The measurement in one channel, whose share of the source's light is given."""
        if self.bins is None or self.left is None or share <= 0.0:
            raise SceneError("no light of this channel left the scene")
        per_batch = self.rays / _BATCHES * share
        values = self.bins[..., channel] / per_batch / self.grid.projected_solid_angle
        mean, error = values.mean(axis=0), values.std(axis=0, ddof=1) / math.sqrt(_BATCHES)
        per_ray = 1.0 / (self.rays * share)
        sums, squares = self.left[:, :, channel]
        flux = per_ray * sums
        flux_error = np.sqrt(variances(per_ray, self.rays, sums, squares))
        angle = math.degrees(math.acos(min(1.0, self.cos_incidence)))
        return Goniogram(
            grid=self.grid,
            incidence_deg=round(angle, 4),
            wavelength_nm=float(wavelength_nm),
            rays=self.rays,
            brdf=mean[0],
            brdf_se=error[0],
            btdf=mean[1],
            btdf_se=error[1],
            reflectance=float(flux[0]),
            reflectance_se=float(flux_error[0]),
            transmittance=float(flux[1]),
            transmittance_se=float(flux_error[1]),
            absorbed=float(1.0 - flux.sum()),
            scatterings=self.scatterings / self.rays,
        )


def _colors(portion: Portion) -> Array:
    """(n_records, n_channels) shares of the light of each record."""
    channels = portion.color_table.shape[1]
    table = np.vstack((np.eye(channels), portion.color_table / COLOR_SCALE))
    return np.asarray(table[portion.color_code])

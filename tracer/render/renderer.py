"""Render a scene: tiles on an executor, progress, resumable, with a bound of what was left out."""

from __future__ import annotations

import hashlib
import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import SceneError
from raymap.model.replacing import replacing
from raymap.optics.colorimetry import encode_srgb
from raymap.pictures.files import write_pixels
from raymap.tables.exr import spectral_channels, write_exr
from tracer.optics.crystals.media import Crystal, isotropic
from tracer.optics.crystals.rows import ISOTROPIC, KIND
from tracer.render.bodies import BodyArrays, CrystalBody, compile_bodies
from tracer.render.camera import Camera
from tracer.render.images import to_bytes
from tracer.render.room import Room, RoomArrays
from tracer.render.spectra import primary_spectra, rgb_weights

__all__ = ["Picture", "PixelSamples", "RenderScene", "error_in_steps", "render", "sample_pixels"]

Real = NDArray[np.float64]

_STEEPEST = 12.92
"""Largest slope of the sRGB curve."""

_TILE = 24


@dataclass(frozen=True, kw_only=True)
class RenderScene:
    """Crystals in a room before a camera.

    Attributes
    ----------
    bodies : of crystal
    room : the emitting walls
    camera : with or without analyser
    wavelengths_nm : (m,) samples of the spectrum
    max_events : depth of the tree, in surface events
    pruning_error : largest error by pruning in any pixel, in 8-bit steps of sRGB; 0 grows the
        whole tree
    world : isotropic medium between the bodies
    contacts : pairs of bodies that share an interface
    name : for progress and messages
    """

    bodies: tuple[CrystalBody, ...]
    room: Room
    camera: Camera
    wavelengths_nm: Real
    max_events: int = 15
    pruning_error: float = 0.5
    world: Crystal = field(default_factory=lambda: isotropic(1.0, name="air"))
    contacts: tuple[tuple[str, str], ...] = ()
    name: str = "scene"

    def __post_init__(self) -> None:
        if self.max_events < 1:
            raise SceneError("render: depth must be at least 1")
        if self.pruning_error < 0.0:
            raise SceneError("render: pruning_error must not be negative")
        if len(self.wavelengths_nm) < 1 or not np.all(np.asarray(self.wavelengths_nm) > 0.0):
            raise SceneError("render: wavelengths must be positive")
        low, high = np.array(self.room.low), np.array(self.room.high)
        for body in self.bodies:
            if not (np.all(body.vertices > low) and np.all(body.vertices < high)):
                raise SceneError(f"body {body.name!r} sticks out of the room; enlarge the room")


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A rendered picture.

    Attributes
    ----------
    spectral : (h, w, m) radiance at each wavelength
    rgb : (h, w, 3) linear sRGB
    error_bound : (h, w, 3) bound of the error by pruning, linear sRGB
    truncated : (h, w) largest share at any wavelength that was cut at the depth limit
    wavelengths_nm : (m,)
    seconds : of computation
    """

    spectral: Real
    rgb: Real
    error_bound: Real
    truncated: Real
    wavelengths_nm: Real
    seconds: float

    @property
    def error_steps(self) -> Real:
        """(h, w) bound of the error by pruning in 8-bit steps of sRGB."""
        return error_in_steps(self.rgb, self.error_bound)

    def save(self, path: str | Path) -> None:
        """Write an .exr (RGB, spectral channels, error bound), or colours in any other format.

        Raises
        ------
        RayMapError
            there is no such format (``raymap kinds pixel_formats``).
        """
        target = Path(path)
        if target.suffix.lower() != ".exr":
            write_pixels(target, to_bytes(self.rgb))
        else:
            channels = dict(zip("RGB", np.moveaxis(self.rgb, -1, 0), strict=True))
            channels |= spectral_channels(self.wavelengths_nm, self.spectral)
            channels |= {"pruning.steps": self.error_steps, "depth.truncated": self.truncated}
            write_exr(target, channels, text={"spectralLayoutVersion": "1.0"})


@dataclass(frozen=True, kw_only=True)
class PixelSamples:
    """Some pixels: (n, m) radiance, (n, 3) linear sRGB and bound of the pruning error, (n, m)
    shares pruned and truncated, (m,) radiance of a white wall."""

    spectral: Real
    rgb: Real
    error_bound: Real
    pruned: Real
    truncated: Real
    white: Real


def error_in_steps(rgb: Real, error: Real) -> Real:
    """(h, w) largest change of an encoded sRGB value, in 8-bit steps, by a linear error."""
    middle = encode_srgb(rgb)
    up = encode_srgb(rgb + error) - middle
    down = middle - encode_srgb(rgb - error)
    return np.asarray(255.0 * np.maximum(up, down).max(axis=-1))


@dataclass
class _Work:
    """What all tiles share, and what they fill."""

    scene: RenderScene
    bodies: BodyArrays
    room: RoomArrays
    media: Real
    primaries: Real
    weights: Real
    tolerance: Real
    bounds: Real
    spectral: Real
    bound: Real
    truncated: Real
    capacity: int
    stop: threading.Event = field(default_factory=threading.Event)


def _tolerances(bounds: Real, steps: float) -> Real:
    """Share that may be pruned at each wavelength so that no sRGB value is off by more.

    A wavelength counts by its weight g; cost falls slowly with tolerance, so the tolerance is
    spread as g^-0.7, scaled to what the darkest pixel may lose.
    """
    g = np.maximum(bounds.max(axis=1), 1e-12)
    spread = g**-0.7
    allowed = steps / 255.0 / _STEEPEST
    result: Real = np.minimum(spread * allowed / float((spread @ bounds).max() or 1.0), 1.0)
    return result


def _prepare(scene: RenderScene) -> _Work:
    wavelengths = np.asarray(scene.wavelengths_nm, np.float64)
    media = np.array(
        [
            [body.medium.row(float(wavelength)) for body in scene.bodies]
            + [scene.world.row(float(wavelength))]
            for wavelength in wavelengths
        ]
    )
    if not np.all(media[:, -1, KIND] == ISOTROPIC):
        raise SceneError(f"render: the world {scene.world.name!r} must be isotropic")
    room = scene.room.compile()
    primaries = primary_spectra(wavelengths)
    weights = rgb_weights(wavelengths)
    brightest = float(room.texels.max()) if room.texels.size else 0.0
    bounds = np.abs(weights) * (primaries.max(axis=1) * (brightest or 1.0))[:, None]
    width, height = scene.camera.pixels
    exact = scene.pruning_error == 0.0
    return _Work(
        scene=scene,
        bodies=compile_bodies(scene.bodies, scene.contacts),
        room=room,
        media=media,
        primaries=primaries,
        weights=weights,
        tolerance=_tolerances(bounds, scene.pruning_error),
        bounds=bounds,
        spectral=np.zeros((height, width, len(wavelengths))),
        bound=np.zeros((height, width, 3)),
        truncated=np.zeros((height, width)),
        capacity=min(4 << scene.max_events, 400_000) if exact else 8192,
    )


def _pixels(work: _Work, columns: NDArray[np.int64], rows: NDArray[np.int64]) -> Real:
    """(3, n, m) radiance and shares pruned and truncated of some pixels."""
    from tracer.render.pixels import CameraRays, Pruning, Spectrum, render_rays

    rays = work.scene.camera.rays(columns, rows)
    sums = np.zeros((3, len(rays.origin), len(work.scene.wavelengths_nm)))
    wavelengths = np.asarray(work.scene.wavelengths_nm, np.float64)
    render_rays(
        work.bodies,
        work.room,
        Spectrum(work.media, wavelengths, work.primaries),
        CameraRays(rays.origin, rays.direction, rays.analyser),
        Pruning(
            max_events=work.scene.max_events,
            tolerance=work.tolerance,
            weights=work.weights,
            bounds=work.bounds,
            base=work.tolerance @ work.bounds,
            steps=work.scene.pruning_error,
            capacity=work.capacity,
        ),
        sums[0],
        sums[1],
        sums[2],
    )
    per_pixel = work.scene.camera.rays_per_pixel
    result: Real = sums.reshape(3, len(columns), per_pixel, -1).mean(axis=2)
    return result


def _tile(work: _Work, x0: int, y0: int) -> tuple[int, int]:
    """Render one tile into the shared arrays."""
    camera = work.scene.camera
    columns = np.arange(x0, min(x0 + _TILE, camera.pixels[0]))
    for y in range(y0, min(y0 + _TILE, camera.pixels[1])):
        if work.stop.is_set():
            return -1, -1
        radiance, pruned, truncated = _pixels(work, columns, np.full(len(columns), y))
        x = slice(x0, x0 + len(columns))
        work.spectral[y, x] = radiance
        work.bound[y, x] = pruned @ work.bounds
        work.truncated[y, x] = truncated.max(axis=-1)
    return x0, y0


def sample_pixels(
    scene: RenderScene, columns: NDArray[np.int64], rows: NDArray[np.int64]
) -> PixelSamples:
    """Single pixels of a scene, without the rest of the picture."""
    work = _prepare(scene)
    radiance, pruned, truncated = _pixels(work, columns, rows)
    return PixelSamples(
        spectral=radiance,
        rgb=radiance @ work.weights,
        error_bound=pruned @ work.bounds,
        pruned=pruned,
        truncated=truncated,
        white=work.primaries.sum(axis=1),
    )


def _fingerprint(work: _Work) -> str:
    digest = hashlib.sha256(repr(work.scene.camera).encode())
    digest.update(repr((work.scene.max_events, work.scene.pruning_error)).encode())
    for array in (*work.bodies[:6], *work.room, work.media, work.scene.wavelengths_nm):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _load_state(path: Path, work: _Work, fingerprint: str) -> set[tuple[int, int]]:
    """Tiles that an interrupted rendering of the same scene has left."""
    try:
        with np.load(path) as state:
            if str(state["fingerprint"]) != fingerprint:
                return set()
            work.spectral[...] = state["spectral"]
            work.bound[...] = state["bound"]
            work.truncated[...] = state["truncated"]
            return {(int(x), int(y)) for x, y in state["done"]}
    except Exception:  # whatever is wrong with what was left: the tiles are rendered anew
        return set()


def _save_state(path: Path, work: _Work, fingerprint: str, done: set[tuple[int, int]]) -> None:
    with replacing(path) as beside, beside.open("wb") as file:
        np.savez(
            file,
            fingerprint=fingerprint,
            spectral=work.spectral,
            bound=work.bound,
            truncated=work.truncated,
            done=np.array(sorted(done), np.int64).reshape(-1, 2),
        )


def render(
    scene: RenderScene,
    *,
    threads: int | None = None,
    executor: Executor | None = None,
    state: str | Path | None = None,
    keep_state: bool = False,
    progress: Callable[[int, int], Any] | None = None,
) -> Picture:
    """Render a scene.

    Parameters
    ----------
    threads : of an own pool, default all cores
    executor : used instead of an own pool; its workers must share memory (threads)
    state : file that keeps finished tiles, so that an interrupted rendering of the same scene
        goes on where it stopped; removed at the end, unless it is kept until the picture is saved
    progress : called with tiles done and tiles in all
    """
    work = _prepare(scene)
    width, height = scene.camera.pixels
    tiles = [(x, y) for y in range(0, height, _TILE) for x in range(0, width, _TILE)]
    fingerprint = _fingerprint(work)
    path = Path(state) if state is not None else None
    done = _load_state(path, work, fingerprint) if path is not None else set()
    started = saved = time.perf_counter()
    pool = executor or ThreadPoolExecutor(threads or os.cpu_count() or 1)
    pending: set[Future[tuple[int, int]]] = set()
    try:
        pending = {pool.submit(_tile, work, x, y) for x, y in tiles if (x, y) not in done}
        while pending:
            finished, pending = wait(pending, return_when=FIRST_COMPLETED)
            done |= {future.result() for future in finished}
            if progress is not None:
                progress(len(done), len(tiles))
            if path is not None and time.perf_counter() - saved > 10.0:
                saved = time.perf_counter()
                _save_state(path, work, fingerprint, done)
    except BaseException:
        work.stop.set()
        for future in pending:
            future.cancel()
        if path is not None:
            _save_state(path, work, fingerprint, done)
        raise
    finally:
        if executor is None:
            pool.shutdown(wait=True)
    if path is not None and keep_state:
        _save_state(path, work, fingerprint, done)
    elif path is not None:
        path.unlink(missing_ok=True)
    return Picture(
        spectral=work.spectral,
        rgb=work.spectral @ work.weights,
        error_bound=work.bound,
        truncated=work.truncated,
        wavelengths_nm=np.asarray(scene.wavelengths_nm, np.float64),
        seconds=time.perf_counter() - started,
    )

"""The rays of a selection at a face, an object or a detector: light for a source elsewhere.

Every crossing of the place by a selected ray gives one ray with the flux that it carries there, so
that the fluxes of all of them add up to what the place receives, as a detector there would count.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from query.answers.images.narrow import narrow
from query.engine.light import light_at
from query.expression.names import FaceNames, ObjectMatch, match_objects
from raymap import rayfiles
from raymap.model.directory import ChannelSet
from raymap.model.errors import RayMapError
from raymap.optics.photometry import Photometry, channel_xyz
from raymap.rayfiles import RaySet

if TYPE_CHECKING:
    from query.answers.selections.selection import Selection
    from raymap.file.reader import RayMap

__all__ = ["Coloring", "Crossings", "rays_at", "write_ray_file"]

Crossings = Literal["all", "first", "last"]
Coloring = Literal["auto", "wavelength", "xyz", "none"]
Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

_BLOCK = 2**18


def rays_at(
    selection: Selection,
    at: str,
    *,
    leaving: bool = False,
    crossings: Crossings = "all",
    before: float = 0.0,
    color: Coloring = "auto",
    seed: int = 0,
) -> Iterator[RaySet]:
    """The selected rays where they meet a place, a piece at a time.

    Parameters
    ----------
    selection : the rays
    at : a detector, an object, a face, with wildcards as in criteria. At a detector the rays that
        it registers count
    leaving : rays as they leave the surface instead of as they arrive
    crossings : every crossing of the place by a ray, or its first or last one only
    before : how far before the place arriving rays start [scene unit]; never before the point
        where they come from
    color : "wavelength": each ray gets one wavelength, drawn from its colour; "xyz": tristimulus
        values; "none"; "auto": wavelengths in maps in watt, tristimulus values in lumen
    seed : of the draw of wavelengths

    Yields
    ------
    RaySet, in the map's units of length and flux

    Raises
    ------
    UnknownName, RayMapError
        There is no such place, or it has none in space (a far field).
    """
    ray_map = selection.map
    place = _find_place(ray_map, at, leaving)
    if color == "auto":
        color = "wavelength" if ray_map.directory.flux_unit == "W" else "xyz"
    for index, rays in selection.parts():
        stored = ray_map.portions[index]
        offsets = stored.record_offsets()
        end, owner = _crossings_of(stored, place, rays, offsets, leaving)
        chosen = _choose(owner, crossings)
        end, owner = end[chosen], owner[chosen]
        random = np.random.default_rng([seed, index])
        light = ray_map.photometry(stored.channel_set)
        watt = light.radiant_factors(selection.emitted)[stored.column("source")[owner]]
        position = stored.column("position")
        records = end if leaving else end - 1
        amounts = light_at(stored, light, owner, records)
        palette = _palette(amounts, light, ray_map.channel_sets[stored.channel_set])
        for first in range(0, len(end), _BLOCK):
            part = slice(first, first + _BLOCK)
            point, direction, sound = _lines(position, end[part], place, leaving, before)
            yield _ray_set(
                ray_map,
                point[sound],
                direction[sound],
                watt[part][sound],
                palette,
                np.arange(len(end))[part][sound],
                color,
                random,
            )


def write_ray_file(
    selection: Selection,
    path: str | Path,
    at: str,
    *,
    force: bool = False,
    color: Coloring = "auto",
    **options: Any,
) -> dict[str, Any]:
    """Write the selected rays at a place as a ray file; its suffix chooses the format.

    Parameters
    ----------
    path : ``*.tm25ray``, ``*.dat`` or ``*.sdf``
    color, options : as of `rays_at`; Zemax files have no tristimulus values, so that light in lumen
        loses its colour there
    force : replace an existing file

    Returns
    -------
    what was written: ``rays``, ``flux``, ``flux_unit``, ``at``

    Raises
    ------
    RayMapError
        No selected ray meets the place; nothing is written.
    """
    path = Path(path)
    if color == "auto" and path.suffix.lower() != ".tm25ray":
        color = "wavelength" if selection.map.directory.flux_unit == "W" else "none"
    rays, flux = 0, 0.0
    pieces = rays_at(selection, at, color=color, **options)
    first = next((piece for piece in pieces if len(piece)), None)
    if first is None:
        raise RayMapError(
            f"no selected ray meets {at!r}; {path.name} would hold no ray and was not written"
        )
    with rayfiles.create(path, first, force=force) as writer:
        for piece in _chain(first, pieces):
            writer.append(piece)
            rays += len(piece)
            flux += piece.total_flux
    return {"rays": rays, "flux": flux, "flux_unit": first.flux_unit, "at": at}


def _chain(first: RaySet, rest: Iterator[RaySet]) -> Iterator[RaySet]:
    yield first
    yield from rest


@dataclass(frozen=True, eq=False)
class _Place:
    """A surface (``match``) or a detector with its frame where it is flat."""

    match: ObjectMatch | None = None
    detector: int = -1
    center: Floats | None = None
    normal: Floats | None = None


def _find_place(ray_map: RayMap, at: str, leaving: bool) -> _Place:
    directory = ray_map.directory
    names = [detector.name for detector in directory.detectors]
    if at not in names:
        return _Place(match=match_objects(at, FaceNames(directory)))
    index = names.index(at)
    detector = directory.detectors[index]
    if detector.kind not in ("plane", "surface"):
        raise RayMapError(
            f"detector {at!r} is a {detector.kind.replace('_', ' ')}: it has no place where rays "
            "could start; name a face, an object, or a flat detector"
        )
    if detector.kind == "surface" or detector.uv_meaning == "projection":
        if leaving:
            raise RayMapError(
                f"detector {at!r} registers what arrives at a surface; for light that leaves it "
                "name the object or face"
            )
        return _Place(detector=index)
    normal = np.cross(detector.axis_u, detector.axis_v)
    return _Place(detector=index, center=np.array(detector.center), normal=normal)


def _crossings_of(
    stored: Any, place: _Place, rays: Ints, offsets: Ints, leaving: bool
) -> tuple[Ints, Ints]:
    """Records at which selected rays meet the place, and their rays, ray after ray.

    At a detector the record is the one behind the crossing, or with ``leaving`` the one before it.
    """
    wanted = np.zeros(stored.n_rays, np.bool_)
    wanted[rays] = True
    owner = np.repeat(np.arange(stored.n_rays), np.diff(offsets))
    if place.match is None:
        descriptors = stored.descriptors()
        record = np.repeat(np.arange(stored.n_records), stored.column("descriptor_count"))
        hit = descriptors.registered & (descriptors.detector == place.detector)
        start = record[hit & wanted[owner[record]]]
        return (start if leaving else start + 1), owner[start]
    hit = place.match.objects[stored.column("object")] | place.match.faces[stored.column("face")]
    if place.match.triangle >= 0:
        hit &= stored.column("triangle") == place.match.triangle
    # Nothing arrives at the first point of a ray, and nothing leaves from its last one
    hit[offsets[1:] - 1 if leaving else offsets[:-1]] = False
    found = np.flatnonzero(hit & wanted[owner])
    return found, owner[found]


def _choose(owner: Ints, crossings: Crossings) -> Any:
    if crossings == "all" or not len(owner):
        return slice(None)
    changes = np.flatnonzero(np.diff(owner)) + 1
    if crossings == "first":
        return np.concatenate(([0], changes))
    return np.append(changes - 1, len(owner) - 1)


def _lines(
    position: NDArray[np.float32], record: Ints, place: _Place, leaving: bool, before: float
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Starting points and unit directions; False where a segment has no length."""
    start = position[record if leaving else record - 1].astype(np.float64)
    end = position[record + 1 if leaving else record].astype(np.float64)
    along = end - start
    length = np.linalg.norm(along, axis=1)
    sound = length > 0
    direction = along / np.where(sound, length, 1.0)[:, None]
    if place.center is not None and place.normal is not None:
        # Meet the detector's plane; positions are rounded, so stay within the segment
        slope = direction @ place.normal
        distance = ((place.center - start) @ place.normal) / np.where(slope == 0, np.inf, slope)
        reach = np.clip(distance, 0.0, length)
    else:
        reach = np.zeros(len(start)) if leaving else length
    if before and not leaving:
        reach = np.maximum(reach - before, 0.0)
    return start + reach[:, None] * direction, direction, sound


@dataclass(frozen=True, eq=False)
class _Palette:
    """What the light of each crossing is, of a watt of its source's flux per ray.

    Attributes
    ----------
    flux : (n,) in the unit of the map
    by_channel : (n, n_channels) how that is shared out to the channels
    xyz : (n, 3) tristimulus values, Y in lumen
    wavelength_nm : (n_channels,)
    """

    flux: Floats
    by_channel: Floats
    xyz: Floats
    wavelength_nm: Floats


def _palette(amounts: Floats, light: Photometry, channels: ChannelSet) -> _Palette:
    by_channel = light.flux_by_channel(amounts)
    flux = by_channel.sum(axis=1)
    return _Palette(
        flux=flux,
        by_channel=by_channel / np.where(flux > 0.0, flux, 1.0)[:, None],
        xyz=amounts @ channel_xyz(channels),
        wavelength_nm=np.array(channels.wavelengths_nm, np.float64),
    )


def _ray_set(
    ray_map: RayMap,
    point: Floats,
    direction: Floats,
    watt: Floats,
    palette: _Palette,
    crossings: NDArray[np.int64],
    color: Coloring,
    random: np.random.Generator,
) -> RaySet:
    directory = ray_map.directory
    wavelength = xyz = None
    flux = watt * palette.flux[crossings]
    if color == "wavelength":
        # Draw a channel in proportion to its share of the flux
        levels = np.cumsum(palette.by_channel, axis=1)
        drawn = (random.random(len(crossings))[:, None] >= levels[crossings, :-1]).sum(axis=1)
        wavelength = narrow(palette.wavelength_nm[drawn])
    elif color == "xyz":
        if directory.flux_unit != "lm":
            raise RayMapError("tristimulus values go with flux in lumen; this map is in watt")
        values = palette.xyz[crossings] * watt[:, None]
        values[:, 1] = flux
        xyz = narrow(values)
    return RaySet(
        position=narrow(point),
        direction=narrow(direction),
        flux=narrow(flux),
        length_unit=directory.length_unit,
        flux_unit=directory.flux_unit,
        wavelength_nm=wavelength,
        tristimulus=xyz,
        title=directory.title or Path(str(ray_map.path)).name,
        description={"equipment": "Raymap"},
    )

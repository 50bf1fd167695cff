"""How what a ray carries changes with the reflectance of a face, or the absorption of a medium.

A reflectance R becomes (1 + ε) R at all angles. What is absorbed at the face stays, so that
interfaces let less through; where nothing goes through, less is absorbed. The factor f' / f of a
ray (`raymap.passes.reweighting`) then has the derivative

========================  ==================================================
d ln f / dε               of what happened
========================  ==================================================
R / R_s                   specular reflection; R_s without what is scattered
1                         scattering back by a diffuser or a rough surface
- R / T_s                 transmission
- R / A                   absorption where nothing goes through, else 0
0                         total reflection, scattering about specular light
========================  ==================================================

and sums over all that happened to it. Of the absorption coefficient µ of a medium it is 1 where
light was absorbed, and - µ s along a way s inside.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.file.stored import StoredPortion
from raymap.laws.lambertian import LambertianLaw
from raymap.laws.law import Law
from raymap.laws.mirror import MirrorLaw
from raymap.laws.retroreflector import RetroreflectorLaw
from raymap.laws.smooth import AbsorberLaw
from raymap.laws.table import TableLaw
from raymap.laws.tabulated import TabulatedLaw
from raymap.model.directory import ChannelSet, Directory
from raymap.model.errors import RayMapError
from raymap.model.events import Event
from raymap.passes.branches import (
    ABSORBED,
    BACK,
    SCATTERED_BACK,
    SCATTERED_THROUGH,
    THROUGH,
    TOTAL,
    Partners,
)
from raymap.passes.likelihoods import Incidence, Likelihoods, needs_index
from raymap.passes.reweighting import ChangedLaws, Read, Reweighting

__all__ = ["Derivatives", "Slopes", "is_diffuse", "is_opaque"]

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


class Slopes(NamedTuple):
    """What happened at a face, or in a medium.

    Attributes
    ----------
    rays : (n,) places in the portion, each as often as something happened to it
    slope : (n_channels, n) d ln f / dε
    lost : (n_channels, n) d ln f / dR where R = 0, which no factor makes more; else 0
    reflectance : (n_channels, n) R that was met; none of media and of total reflection (NaN)
    """

    rays: I64
    slope: F64
    lost: F64
    reflectance: F64


def is_opaque(law: Law) -> bool:
    """Whether nothing goes through, so that what is not reflected is absorbed."""
    if isinstance(law, LambertianLaw):
        return not any(law.transmittance)
    if isinstance(law, TabulatedLaw):
        return law.transmitted is None
    if isinstance(law, TableLaw):
        return not any(any(row) for row in law.transmittance)
    return isinstance(law, AbsorberLaw | MirrorLaw | RetroreflectorLaw)


def is_diffuse(law: Law) -> bool:
    """Whether all that it reflects is scattered."""
    if isinstance(law, LambertianLaw | RetroreflectorLaw | TabulatedLaw):
        return True
    return bool(getattr(law, "roughness", 0.0))


class Derivatives:
    """Derivatives of the factors of rays in one channel set.

    Parameters
    ----------
    directory, channels : of the map
    faces : laws by face index
    media : (n_channels,) absorption coefficients [1 / length unit] by number of the medium
    partners : which media lie beyond faces (`Partners.learn` was told all paths)

    Attributes
    ----------
    unknown : by face, why its law cannot be evaluated everywhere
    """

    def __init__(
        self,
        directory: Directory,
        channels: ChannelSet,
        faces: Mapping[int, Law],
        media: Mapping[int, F64],
        partners: Partners,
    ) -> None:
        self.faces, self.media = faces, media
        pairs = {face: (law, law) for face, law in faces.items()}
        self._events = Reweighting(directory, channels, ChangedLaws(faces=pairs), partners)
        self._laws = {id(law): Likelihoods(law, channels) for law in faces.values()}
        self.unknown: dict[int, str] = {}

    def at_faces(
        self, portion: StoredPortion, rays: NDArray[np.bool_]
    ) -> Iterator[tuple[int, Slopes]]:
        """What happened to chosen rays (n_rays,) at each face."""
        read = Read(portion)
        for kind, records, met_by, met in self._events.hits(read, even=True, rays=rays):
            if not len(records) or kind.branch == TOTAL:
                continue
            law = self.faces[kind.face]
            try:
                n_i, n_o = self._events.indices(kind)
            except RayMapError as error:
                self.unknown[kind.face] = str(error)
                continue
            met = met._replace(n_i=n_i, n_o=n_o)
            slope, lost, back = _slopes(self._laws[id(law)], kind.branch, met)
            yield kind.face, Slopes(met_by, slope, lost, back)

    def in_media(
        self, portion: StoredPortion, rays: NDArray[np.bool_]
    ) -> Iterator[tuple[int, Slopes]]:
        """What happened to chosen rays in each medium that absorbs."""
        read = Read(portion)
        points = read.paths.medium
        if not np.isin(points, list(self.media)).any():
            return
        medium, event = portion.column("medium"), portion.column("event")
        goes_on = rays[read.ray_of]
        goes_on[read.offsets[1:] - 1] = False
        position = read.position.astype(np.float64)
        absorbed = int(Event.VOLUME_ABSORPTION)
        for number, coefficient in self.media.items():
            begin = np.flatnonzero((medium == number) & goes_on)
            way = np.linalg.norm(position[begin + 1] - position[begin], axis=1)
            ended = (event[begin + 1] & absorbed) != 0
            slope = ended[None, :] - coefficient[:, None] * way[None, :]
            slope[coefficient == 0.0] = 0.0
            nothing = np.zeros(slope.shape)
            yield number, Slopes(read.ray_of[begin], slope, nothing, nothing)

    def arriving(self, portion: StoredPortion) -> dict[int, F64]:
        """Light that reaches what reflects nothing: by face, (n_sources, n_channels) Σ w c."""
        dark = {face for face, law in self.faces.items() if _may_be_dark(law)}
        found: dict[int, F64] = {}
        if not dark:
            return found
        read = Read(portion)
        source = portion.column("source")
        n_sources = len(portion.emitted)
        for kind, records, rays, met in self._events.hits(read, even=True):
            if kind.face not in dark or kind.branch == TOTAL or not len(records):
                continue
            try:
                n_i, n_o = self._events.indices(kind)
            except RayMapError:
                continue
            back, _ = self._laws[id(self.faces[kind.face])].shares_met(
                kind.branch, met._replace(n_i=n_i, n_o=n_o)
            )
            if (back > 0.0).all():
                continue
            weight, shares = portion.carried(rays, records - 1, whole=False)
            lit = np.where(back.T > 0.0, 0.0, shares * weight[:, None])
            if not lit.any():
                continue
            sums = np.stack(
                [np.bincount(source[rays], column, n_sources) for column in lit.T], axis=1
            )
            found[kind.face] = found.get(kind.face, np.zeros(sums.shape)) + sums
        return found


def _may_be_dark(law: Law) -> bool:
    """Whether there may be channels and angles at which nothing is reflected."""
    if isinstance(law, MirrorLaw | LambertianLaw | RetroreflectorLaw):
        return bool(law.reflectance) and min(law.reflectance) == 0.0
    if isinstance(law, TableLaw):
        return min(min(row) for row in law.reflectance) == 0.0
    return isinstance(law, AbsorberLaw) or not needs_index(law)


def _slopes(law: Likelihoods, branch: int, met: Incidence) -> tuple[F64, F64, F64]:
    """(n_channels, n) each: d ln f / dε, d ln f / dR where R = 0, and R."""
    back, through = law.shares_met(branch, met)
    if branch == BACK:
        slope = _over(back, law.of(BACK, met))
    elif branch == SCATTERED_BACK:
        slope = np.full(back.shape, float(is_diffuse(law.law)))
    elif branch == THROUGH:
        slope = -1.0 / _nonzero(law.of(THROUGH, met))
    elif branch == SCATTERED_THROUGH:
        slope = -1.0 / _nonzero(through) if is_diffuse(law.law) else np.zeros(back.shape)
    elif branch == ABSORBED and is_opaque(law.law):
        slope = -1.0 / _nonzero(1.0 - back - through)
    else:
        slope = np.zeros(back.shape)
    lost = np.zeros(back.shape)
    if branch in (THROUGH, SCATTERED_THROUGH, ABSORBED):
        lost = np.where(back > 0.0, 0.0, slope)
        slope = slope * back
    if needs_index(law.law) and branch not in (THROUGH, SCATTERED_THROUGH):
        # Beyond the critical angle of a channel nothing can be let through instead
        cos_i = law.cosine_met(branch, met)
        sine2 = (1.0 - cos_i**2)[None, :] * ((met.n_i / met.n_o) ** 2)[:, None]
        slope = np.where(sine2 > 1.0, 0.0, slope)
    return slope, lost, back


def _over(a: F64, b: F64) -> F64:
    return np.divide(a, b, out=np.zeros_like(a), where=b > 0.0)


def _nonzero(share: F64) -> F64:
    """Infinite where a share is 0: what never happens has no slope."""
    return np.where(share > 0.0, share, np.inf)

"""Which faces and media matter: derivatives of the light of a criterion, in one pass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from query.answers.selections.selector import bind_all
from query.answers.what_if.changes import without_laws
from query.engine.scan import Cancel, Scan
from query.engine.search import Found
from query.engine.second_try import asked_again
from query.engine.tally import Estimate, Tally, estimate, source_factors
from raymap.file.views import MapView
from raymap.laws.law import Law
from raymap.model.doubt import with_doubts
from raymap.model.errors import RayMapError
from raymap.model.rows import squares_by_emission
from raymap.optics.fluxes import variances
from raymap.passes.branches import partners_of
from raymap.passes.derivatives import Derivatives, Slopes, is_diffuse
from raymap.passes.revised import LOOKED_AT

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["By", "Sensitivity", "SensitivityRow", "sensitivity"]

By = Literal["face", "object", "surface"]
Floats = NDArray[np.float64]
_Label = tuple[str, str]


@dataclass(frozen=True, kw_only=True)
class SensitivityRow:
    """What one face, object, surface or medium does to the light of a criterion.

    Attributes
    ----------
    name, what : whose; ``reflectance``, ``diffuse reflectance`` or ``absorption``
    mean : reflectance that the light met, total reflection left out; None of media
    rays : of the criterion that met it
    derivative, derivative_se : dΦ/dε of R → (1 + ε) R, or of µ → (1 + ε) µ [flux unit]
    share : derivative / Φ: percent by which the flux changes with one percent of R
    from_zero : bounds of dΦ/dR where R = 0 [flux unit], which no factor makes more; None elsewhere
    """

    name: str
    what: str
    mean: float | None
    rays: int
    derivative: float
    derivative_se: float
    share: float | None
    from_zero: tuple[float, float] | None

    def to_json(self) -> dict[str, Any]:
        """Plain values, doubtful ones marked."""
        row = dict(self.__dict__)
        row["from_zero"] = None if self.from_zero is None else list(self.from_zero)
        return with_doubts(row)


@dataclass(frozen=True, kw_only=True)
class Sensitivity:
    """How the light of a criterion depends on faces and media, the strongest first.

    Attributes
    ----------
    flux : of the criterion
    rays : that satisfy it
    rows : what changes it; what no ray of the criterion met is left out, but for what reflects
        nothing
    unknown : faces whose law is not known or cannot be evaluated, and why
    """

    flux: Estimate
    rays: int
    rows: tuple[SensitivityRow, ...]
    unknown: tuple[tuple[str, str], ...]
    flux_unit: str

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return with_doubts(
            {
                "flux": self.flux.flux,
                "flux_se": self.flux.se,
                "rays": self.rays,
                "flux_unit": self.flux_unit,
                "rows": [row.to_json() for row in self.rows],
                "unknown": [{"face": name, "reason": why} for name, why in self.unknown],
            }
        )


@asked_again
def sensitivity(
    map: RayMap,
    criterion: object = None,
    *,
    by: By = "face",
    threads: int | None = None,
    cancel: Cancel = None,
) -> Sensitivity:
    """How the flux of a criterion changes with each reflectance and each absorption.

    Every reflectance R becomes (1 + ε) R, of one face (object, surface) at a time. What is absorbed
    stays and T = 1 - A - R; where nothing goes through, the absorption gives way. Total reflection
    stays total.

    Parameters
    ----------
    map : an open map of rays that states its laws, or a view of one (`query.what_if`)
    by : whose reflectances change together

    Raises
    ------
    UnknownName, CriterionError, RayMapError
        The map does not state its laws, or is of polarised light.
    """
    map.need_rays()
    _refuse_polarised(map)
    [node] = bind_all(map, [criterion])
    passes = _Pass(map, by)
    scan = Scan(map, [node], visit=passes.visit, take=passes.take, threads=threads, cancel=cancel)
    scan.run()
    emitted = scan.emitted if scan.complete else map.emitted
    return passes.result(emitted)


def _refuse_polarised(map: RayMap) -> None:
    if any("stokes" in portion.column_names for portion in map.portions[:1]):
        raise RayMapError(
            f"{map.path} is of polarised light, whose states would change with its surfaces: its "
            "sensitivities are not built"
        )


class _Sums:
    """Of one label: by source, Σ of slopes and of their squares; what was met."""

    def __init__(self, n_sources: int) -> None:
        self.slope, self.squares, self.lost = np.zeros((3, n_sources))
        self.met, self.reflected = 0.0, 0.0
        self.rays = 0

    def add(self, other: _Sums) -> None:
        self.slope += other.slope
        self.squares += other.squares
        self.lost += other.lost
        self.met += other.met
        self.reflected += other.reflected
        self.rays += other.rays


class _Pass:
    """Sums over the rays of a criterion."""

    def __init__(self, map: RayMap, by: By) -> None:
        self.map = map
        self.n_sources = len(map.directory.sources)
        self.partners = partners_of(map)
        self.by_set: list[Derivatives] = []
        self.labels: dict[int, _Label] = {}
        self.unknown: dict[int, str] = {}
        for number in range(len(map.channel_sets)):
            faces = self._faces(number, by)
            channels, media = map.channel_sets[number], _absorption(map, number)
            self.by_set.append(Derivatives(map.directory, channels, faces, media, self.partners))
        self.sums: dict[_Label, _Sums] = {}
        self.whole = Tally.zeros(self.n_sources)

    def _faces(self, channel_set: int, by: By) -> dict[int, Law]:
        directory = self.map.directory
        known = self.map.laws(channel_set)
        if known is None:
            raise RayMapError(without_laws(self.map))
        changed = self.map.changed(channel_set) if isinstance(self.map, MapView) else None
        new = {} if changed is None else changed.faces
        found = {}
        names = directory.faces
        for face, surface in enumerate(names.surface.tolist()):
            law = new[face][1] if face in new else known.surfaces[surface] if surface >= 0 else None
            if law is None:
                self.unknown[face] = "the map does not state its law"
                continue
            found[face] = law
            name = names.names[face]
            if by == "object":
                name = names.object_names[names.object[face]]
            elif by == "surface":
                name = directory.surfaces[surface].name
            what = "diffuse reflectance" if is_diffuse(law) else "reflectance"
            self.labels[face] = (name, what)
        return found

    # -- the pass ------------------------------------------------------------------------------

    def visit(self, found: Found) -> tuple[dict[_Label, _Sums], Tally]:
        """Sums over the chosen rays of a portion; runs in a worker."""
        portion, mask = found.portion, found.masks[0]
        derivatives = self.by_set[portion.channel_set]
        rays = np.flatnonzero(mask)
        ends = portion.record_offsets()[1:][rays] - 1
        weight, shares = portion.carried(rays, ends, whole=True)
        source = portion.column("source").astype(np.int64)
        worth = self.map.photometry(portion.channel_set).channel_worth
        # What each ray carries by channel, in units of the flux per ray of its source
        lit = np.zeros((portion.n_rays, shares.shape[1]))
        lit[rays] = weight[:, None] * shares * worth[source[rays]]
        emission = portion.column("emission") if portion.grouped else None
        parts: dict[_Label, list[Slopes]] = {}
        for face, slopes in derivatives.at_faces(portion, mask):
            parts.setdefault(self.labels[face], []).append(slopes)
        for number, slopes in derivatives.in_media(portion, mask):
            label = self.map.directory.media[number].name, "absorption"
            parts.setdefault(label, []).append(slopes)
        sums = {
            label: self._sums(entries, lit, source, emission) for label, entries in parts.items()
        }
        own = None if emission is None else emission[rays]
        return sums, Tally.of_rays(source[rays], lit[rays].sum(axis=1), own, self.n_sources)

    def _sums(self, parts: list[Slopes], lit: Floats, source: Any, emission: Any) -> _Sums:
        total = _Sums(self.n_sources)
        rays = np.concatenate([part.rays for part in parts])
        slope = np.concatenate([(lit[p.rays] * p.slope.T).sum(axis=1) for p in parts])
        for part in parts:
            carried = lit[part.rays].T
            total.lost += np.bincount(
                source[part.rays], (carried * part.lost).sum(axis=0), self.n_sources
            )
            total.met += float(carried.sum())
            total.reflected += float((carried * part.reflectance).sum())
        own, place = np.unique(rays, return_inverse=True)
        of_ray = np.bincount(place.ravel(), slope, len(own)).astype(np.float64)
        total.rays = len(own)
        total.slope += np.bincount(source[own], of_ray, self.n_sources)
        same = None if emission is None else emission[own]
        total.squares += squares_by_emission(source[own], of_ray, same, self.n_sources)
        return total

    def take(self, _: int, product: tuple[dict[_Label, _Sums], Tally]) -> None:
        """Add what a portion has."""
        sums, whole = product
        for label, entry in sums.items():
            if label in self.sums:
                self.sums[label].add(entry)
            else:
                self.sums[label] = entry
        self.whole = self.whole + whole

    # -- the answer ----------------------------------------------------------------------------

    def result(self, emitted: NDArray[np.int64]) -> Sensitivity:
        """Rows by how much they change the flux."""
        directory = self.map.directory
        factors = source_factors(directory, emitted)
        flux = estimate(self.whole, directory, emitted)
        arriving = self._arriving(factors)
        rows = []
        for label in dict.fromkeys((*self.sums, *arriving)):
            sums = self.sums.get(label) or _Sums(self.n_sources)
            derivative = float(factors @ sums.slope)
            variance = variances(factors, emitted, sums.slope, sums.squares).sum()
            lost, reached = float(factors @ sums.lost), arriving.get(label, 0.0)
            name, what = label
            rows.append(
                SensitivityRow(
                    name=name,
                    what=what,
                    mean=None
                    if what == "absorption" or not sums.met
                    else sums.reflected / sums.met,
                    rays=sums.rays,
                    derivative=derivative,
                    derivative_se=float(variance) ** 0.5,
                    share=derivative / flux.flux if flux.flux > 0.0 else None,
                    from_zero=(lost, lost + reached) if reached or lost else None,
                )
            )
        rows.sort(key=lambda row: (-abs(row.derivative), -_reach(row), row.name))
        names = directory.faces.names
        unknown = {**self.unknown, **{f: w for d in self.by_set for f, w in d.unknown.items()}}
        return Sensitivity(
            flux=flux,
            rays=int(self.whole.rays.sum()),
            rows=tuple(rows),
            unknown=tuple((names[face], why) for face, why in sorted(unknown.items())),
            flux_unit=directory.flux_unit,
        )

    def _arriving(self, factors: Floats) -> dict[_Label, float]:
        """Flux that reaches what reflects nothing, of all rays, as the first portions show it."""
        found: dict[_Label, float] = {}
        some = [portion for portion in self.map.portions if portion.n_rays][:LOOKED_AT]
        seen = np.sum([portion.emitted for portion in some], axis=0) if some else np.zeros(1)
        emitted = self.map.emitted
        scale = np.divide(emitted, seen, out=np.zeros(len(emitted)), where=seen > 0)
        for portion in some:
            worth = self.map.photometry(portion.channel_set).channel_worth
            for face, sums in self.by_set[portion.channel_set].arriving(portion).items():
                label = self.labels[face]
                flux = float((factors * scale) @ (sums * worth).sum(axis=1))
                found[label] = found.get(label, 0.0) + flux
        return found


def _reach(row: SensitivityRow) -> float:
    return 0.0 if row.from_zero is None else max(abs(bound) for bound in row.from_zero)


def _absorption(map: RayMap, channel_set: int) -> dict[int, Floats]:
    """Absorption coefficients by channel of the media that absorb."""
    found = {}
    changed = map.changed(channel_set) if isinstance(map, MapView) else None
    new = {} if changed is None else changed.media
    for number, row in enumerate(map.channel_sets[channel_set].absorption):
        own = np.asarray(row, np.float64)
        coefficient = new[number].absorption[1] if number in new else own
        if coefficient.any():
            found[number] = coefficient
    return found

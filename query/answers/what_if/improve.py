"""Which few faces to coat: the best combination of changes, found by weighing rays anew.

Half of the emissions chooses, the other half judges what was chosen: the best of many combinations
is partly the luckiest one, and the rays that chose it would say too much good of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from math import comb
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from query.answers.selections.selector import bind_all, select
from query.answers.what_if.changes import Changes, faces_of, step_of, without_laws
from query.engine.scan import Cancel, Scan
from query.engine.search import Found
from query.engine.second_try import asked_again
from query.engine.tally import source_factors
from query.expression.names import escape
from raymap.file.views import MapView
from raymap.jit.kernels import lean_kernel
from raymap.laws.rough import RoughLaw
from raymap.laws.smooth import FresnelLaw
from raymap.laws.stack import StackLaw
from raymap.laws.table import TableLaw
from raymap.model.doubt import with_doubts
from raymap.model.errors import RayMapError
from raymap.model.rows import squares_by_emission
from raymap.passes.branches import partners_of
from raymap.passes.reweighting import Read, Reweighting

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["MOST_COMBINATIONS", "Improvement", "Judged", "improve"]

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

MOST_COMBINATIONS = 100_000
"""More than these are not all tried: then faces are added and exchanged one by one."""
_WORK = 4e9
"""Multiplications that choosing may take."""
_FEWEST, _MOST_RAYS = 1_000, 200_000
"""Rays of either light that choose, at least and at most."""
_ROOM = 2e7
"""Factors that are held at once."""
SPECIAL = "*?\\"
"""Signs of names that mean something in patterns."""
_TOLD = 5
"""Combinations that are judged: the best, and those behind it."""


@dataclass(frozen=True, kw_only=True)
class Judged:
    """What a combination does, by rays that did not choose it.

    Attributes
    ----------
    faces : their names
    before, before_se, after, after_se : flux of the light [flux unit of the map]
    difference, difference_se : of the same rays
    keep : the same six numbers of the light that is to stay; None where none was named
    """

    faces: tuple[str, ...]
    before: float
    before_se: float
    after: float
    after_se: float
    difference: float
    difference_se: float
    keep: tuple[float, ...] | None

    def to_json(self) -> dict[str, Any]:
        """Plain values, doubtful ones marked."""
        told: dict[str, Any] = {
            "faces": list(self.faces),
            "flux_before": self.before,
            "flux_before_se": self.before_se,
            "flux": self.after,
            "flux_se": self.after_se,
            "difference": self.difference,
            "difference_se": self.difference_se,
        }
        if self.keep is not None:
            names = [name for name in told if name != "faces"]
            told["keep"] = with_doubts(dict(zip(names, self.keep, strict=True)))
        return with_doubts(told)


@dataclass(frozen=True, kw_only=True)
class Improvement:
    """The best few changes found.

    Attributes
    ----------
    rows : combinations, the best first
    reflectance : that faces of a combination get
    faces : how many at most
    candidates : names of the faces among which was chosen
    tried : combinations that were weighed
    exhaustive : whether these are all
    chosen_by, judged_by : rays of the light that chose and that judged
    flux_unit : of the map
    """

    rows: tuple[Judged, ...]
    reflectance: float
    faces: int
    candidates: tuple[str, ...]
    tried: int
    exhaustive: bool
    chosen_by: int
    judged_by: int
    flux_unit: str

    @property
    def settings(self) -> tuple[str, ...]:
        """The best combination as changes: ``L5.back.reflectance=0.002``."""
        faces = self.rows[0].faces if self.rows else ()
        return tuple(f"{escape(name, SPECIAL)}.reflectance={self.reflectance:g}" for name in faces)

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        own = {key: value for key, value in self.__dict__.items() if key != "rows"}
        own["candidates"] = list(self.candidates)
        rows = [row.to_json() for row in self.rows]
        return {**own, "settings": list(self.settings), "rows": rows}


@asked_again
def improve(
    map: RayMap,
    criterion: object,
    *,
    reflectance: float,
    faces: int = 3,
    keep: object = None,
    of: Sequence[str] = (),
    more: bool = False,
    threads: int | None = None,
    cancel: Cancel = None,
) -> Improvement:
    """The few faces that should be coated so that the light of a criterion becomes least.

    All combinations are weighed where there are no more than `MOST_COMBINATIONS`; else faces are
    added one by one, and exchanged as long as that helps.

    Parameters
    ----------
    map : an open map of rays that states its laws, as it was recorded
    criterion : the light that should become less
    reflectance : that a coated face has at all angles, 0 to 1
    faces : at most so many
    keep : light that should not: then the first over the second becomes least
    of : names of faces, objects or surfaces to choose among; all smooth interfaces that light meets
        otherwise
    more : the light should become most instead

    Raises
    ------
    UnknownName, CriterionError, RayMapError
        The map does not state its laws, is of polarised light or a view; no face can be coated.
    """
    map.need_rays()
    _refuse(map, reflectance, faces)
    choice = _Choice(map, reflectance, of)
    lights = [criterion] if keep is None else [criterion, keep]
    most = min(_MOST_RAYS, int(_ROOM / (len(choice.faces) * choice.n_channels)))
    share = [_share_of(map, each, max(_FEWEST, most), threads, cancel) for each in lights]
    samples = choice.gather(lights, share, threads, cancel)
    chosen, tried, whole = _choose(samples, choice, faces, more)
    rows, judged_by = choice.judge(lights, chosen, threads, cancel)
    return Improvement(
        rows=rows,
        reflectance=float(reflectance),
        faces=faces,
        candidates=tuple(choice.names),
        tried=tried,
        exhaustive=whole,
        chosen_by=len(samples[0].carried),
        judged_by=judged_by,
        flux_unit=map.directory.flux_unit,
    )


def _refuse(map: RayMap, reflectance: float, faces: int) -> None:
    if not 0.0 <= reflectance <= 1.0:
        raise RayMapError(f"a reflectance lies from 0 to 1, {reflectance:g} was given")
    if faces < 1:
        raise RayMapError("the number of faces that are coated is at least 1")
    if isinstance(map, MapView):
        raise RayMapError("improve starts from a map as it was recorded, not from a view of one")
    if any("stokes" in portion.column_names for portion in map.portions[:1]):
        raise RayMapError(
            f"{map.path} is of polarised light: try changes one by one (raymap what-if)"
        )
    if map.laws() is None:
        raise RayMapError(without_laws(map))


def _share_of(map: RayMap, criterion: object, most: int, threads: Any, cancel: Cancel) -> float:
    """Share of the rays of a light of which at most so many may choose."""
    rays = select(map, criterion, rays=False, threads=threads, cancel=cancel).matched
    return min(1.0, most / max(1, rays // 2))


class _Sample:
    """Rays that choose.

    Attributes
    ----------
    carried : (n, n_channels) flux of each ray, up to one factor of all
    factors : (n_candidates, n, n_channels) by which they change with each face
    """

    def __init__(self, carried: F64, factors: F64) -> None:
        self.carried, self.factors = carried, factors


def _draw(emission: I64, salt: int) -> F64:
    """(n,) numbers from 0 to 1 that are the emissions' own (the finaliser of splitmix64)."""
    x = emission.astype(np.uint64) + np.uint64(0x9E3779B97F4A7C15 * (salt + 1) % 2**64)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    x = x ^ (x >> np.uint64(31))
    return (x >> np.uint64(11)).astype(np.float64) / 2.0**53


class _Choice:
    """The faces among which is chosen, and what they do to rays."""

    def __init__(self, map: RayMap, reflectance: float, of: Sequence[str]) -> None:
        self.map = map
        directory = map.directory
        known = map.laws()
        assert known is not None
        named = {face for pattern in of for face in faces_of(directory, pattern)}
        self.faces = []
        for face, surface in enumerate(directory.faces.surface.tolist()):
            law = known.surfaces[surface] if surface >= 0 else None
            interface = isinstance(law, FresnelLaw | TableLaw | StackLaw)
            if interface and not isinstance(law, RoughLaw) and (not of or face in named):
                self.faces.append(face)
        met = self._met()
        self.faces = [face for face in self.faces if face in met]
        if not self.faces:
            raise RayMapError(
                "none of these faces is a smooth interface that light meets, which could be coated"
            )
        self.names = [directory.faces.names[face] for face in self.faces]
        changes = Changes(())
        for face, name in zip(self.faces, self.names, strict=True):
            step = step_of(f"{name}.reflectance", "reflectance", reflectance, map)
            changes.faces[face] = [step]
        partners = partners_of(map)
        self.by_set = [
            Reweighting(directory, channels, changes.laws(map, number), partners)
            for number, channels in enumerate(map.channel_sets)
        ]
        self.n_channels = max(channels.n_channels for channels in map.channel_sets)

    def _met(self) -> set[int]:
        """Faces that any ray meets, as far as the paths of the map say."""
        merged = self.map.merged
        if merged is None:
            return set(self.faces)
        return set(np.unique(merged.paths.face).tolist())

    # -- rays ----------------------------------------------------------------------------------

    def _emission(self, portion: Any) -> I64:
        ids: I64 = portion.column("emission") if portion.grouped else portion.ray_ids()
        return ids

    def _rays(self, found: Found, rays: I64, wanted: Sequence[int]) -> tuple[F64, F64]:
        """Carried light (n, n_channels) without the source's factor, and factors of some faces."""
        portion = found.portion
        read = Read(portion)
        mask = np.zeros(portion.n_rays, np.bool_)
        mask[rays] = True
        place = np.full(portion.n_rays, -1)
        place[rays] = np.arange(len(rays))
        weight, shares = portion.carried(rays, portion.record_offsets()[1:][rays] - 1, whole=True)
        worth = self.map.photometry(portion.channel_set).channel_worth
        n = shares.shape[1]
        carried = np.zeros((len(rays), self.n_channels))
        carried[:, :n] = weight[:, None] * shares * worth[portion.column("source")[rays]]
        factors = np.ones((len(wanted), len(rays), self.n_channels))
        reweighting = self.by_set[portion.channel_set]
        number = {self.faces[face]: k for k, face in enumerate(wanted)}
        for kind, _, met_by, met in reweighting.hits(read, even=True, rays=mask):
            if len(met_by) and kind.face in number:
                own = factors[number[kind.face]]
                np.multiply.at(own[:, :n], place[met_by], reweighting.ratios(kind, met).T)
        return carried, factors

    def gather(
        self, lights: list[object], share: list[float], threads: Any, cancel: Cancel
    ) -> list[_Sample]:
        """Rays of each light that choose."""
        factors = source_factors(self.map.directory, self.map.emitted)
        parts: list[list[tuple[F64, F64]]] = [[] for _ in lights]

        def visit(found: Found) -> list[tuple[F64, F64]]:
            emission = self._emission(found.portion)
            chooses = _draw(emission, 0) < 0.5
            source = found.portion.column("source")
            products = []
            for number, mask in enumerate(found.masks):
                rays = np.flatnonzero(mask & chooses & (_draw(emission, 1) < share[number]))
                carried, changes = self._rays(found, rays, range(len(self.faces)))
                products.append((carried * factors[source[rays], None], changes))
            return products

        def take(_: int, products: list[tuple[F64, F64]]) -> None:
            for own, product in zip(parts, products, strict=True):
                own.append(product)

        nodes = bind_all(self.map, lights)
        Scan(self.map, nodes, visit=visit, take=take, threads=threads, cancel=cancel).run()
        return [
            _Sample(
                np.concatenate([carried for carried, _ in own]),
                np.concatenate([changes for _, changes in own], axis=1),
            )
            if own
            else _Sample(
                np.zeros((0, self.n_channels)), np.ones((len(self.faces), 0, self.n_channels))
            )
            for own in parts
        ]

    def judge(
        self, lights: list[object], chosen: list[tuple[int, ...]], threads: Any, cancel: Cancel
    ) -> tuple[tuple[Judged, ...], int]:
        """What combinations do to the rays that did not choose them."""
        n_sources = len(self.map.directory.sources)
        n = len(lights)
        wanted = sorted({face for combination in chosen for face in combination})
        # Of each light and combination, by source: Σ w, Σ w², Σ w', Σ w'², Σ (w' - w)²
        sums = np.zeros((n, len(chosen), 5, n_sources))
        counts = np.zeros((2, n_sources))
        judged = 0

        def visit(found: Found) -> tuple[F64, F64, int]:
            portion = found.portion
            emission = self._emission(portion)
            judges = _draw(emission, 0) >= 0.5
            source = portion.column("source").astype(np.int64)
            own = np.zeros(sums.shape)
            for number, mask in enumerate(found.masks[:n]):
                rays = np.flatnonzero(mask & judges)
                carried, changes = self._rays(found, rays, wanted)
                before = carried.sum(axis=1)
                group = partial(
                    squares_by_emission,
                    source[rays],
                    emission=emission[rays] if portion.grouped else None,
                    size=n_sources,
                )
                for k, combination in enumerate(chosen):
                    own_faces = [wanted.index(face) for face in combination]
                    after = (carried * changes[own_faces].prod(axis=0)).sum(axis=1)
                    own[number, k] = [
                        np.bincount(source[rays], before, n_sources),
                        group(weight=before),
                        np.bincount(source[rays], after, n_sources),
                        group(weight=after),
                        group(weight=after - before),
                    ]
            first = np.unique(emission[judges], return_index=True)[1]
            seen = np.bincount(source[judges][first], minlength=n_sources)
            all_seen = np.bincount(source[np.unique(emission, return_index=True)[1]],
                                   minlength=n_sources)  # fmt: skip
            return own, np.stack((seen, all_seen)), int((found.masks[0] & judges).sum())

        def take(_: int, product: tuple[F64, F64, int]) -> None:
            nonlocal sums, counts, judged
            sums, counts = sums + product[0], counts + product[1]
            judged += product[2]

        nodes = bind_all(self.map, [*lights, None])
        scan = Scan(self.map, nodes, visit=visit, take=take, threads=threads, cancel=cancel)
        scan.run()
        emitted = scan.emitted if scan.complete else self.map.emitted
        # Emissions of which nothing is stored fall into either half alike
        sent = counts[0] + 0.5 * np.maximum(0.0, emitted - counts[1])
        flux = np.array([source.flux for source in self.map.directory.sources])
        per_ray = np.divide(flux, sent, out=np.zeros(n_sources), where=sent > 0)
        rows = []
        for k, combination in enumerate(chosen):
            told = [_told(sums[number, k], per_ray, sent) for number in range(n)]
            names = tuple(self.names[face] for face in combination)
            before, before_se, after, after_se, difference, difference_se = told[0]
            rows.append(
                Judged(
                    faces=names,
                    before=before,
                    before_se=before_se,
                    after=after,
                    after_se=after_se,
                    difference=difference,
                    difference_se=difference_se,
                    keep=told[1] if n > 1 else None,
                )
            )
        return tuple(rows), judged


def _told(sums: F64, per_ray: F64, sent: F64) -> tuple[float, ...]:
    """Flux before, after, difference, each with its standard error."""
    told: list[float] = []
    mean = np.maximum(sent, 1.0)
    for total, squares in ((sums[0], sums[1]), (sums[2], sums[3]), (sums[2] - sums[0], sums[4])):
        variance = per_ray**2 * np.maximum(0.0, squares - total**2 / mean)
        told += [float(per_ray @ total), float(variance.sum()) ** 0.5]
    return tuple(told)


# -- choosing ----------------------------------------------------------------------------------


def _choose(
    samples: list[_Sample], choice: _Choice, faces: int, more: bool
) -> tuple[list[tuple[int, ...]], int, bool]:
    """The best combinations, how many were weighed, and whether these are all."""
    n = len(choice.faces)
    faces = min(faces, n)
    if not len(samples[0].carried):
        raise RayMapError("no ray does what is asked, so that none tells which faces matter")
    if len(samples) > 1 and not len(samples[1].carried):
        raise RayMapError("no ray is of the light that is to stay")
    count = sum(comb(n, k) for k in range(1, faces + 1))
    whole = count <= MOST_COMBINATIONS
    sign = -1.0 if more else 1.0

    def score(sums: list[F64]) -> F64:
        value = sums[0] if len(sums) == 1 else sums[0] / np.maximum(sums[1], 1e-300)
        return sign * value

    if whole:
        combinations = _all_combinations(n, faces)
        values = score(
            [_weigh(_thinned(each, len(combinations)), combinations) for each in samples]
        )
        order = np.argsort(values, kind="stable")[:_TOLD]
        rows = [tuple(int(k) for k in combinations[i] if k >= 0) for i in order.tolist()]
        return rows, len(combinations), True
    found, tried = _greedy(samples, n, faces, score)
    return found, tried, False


def _thinned(sample: _Sample, combinations: int) -> _Sample:
    """As many of the rays as there is time for; they stand in no order of importance."""
    n, channels = sample.carried.shape
    most = max(_FEWEST, int(_WORK / max(1, combinations * channels)))
    step = -(-n // most)
    return _Sample(sample.carried[::step], sample.factors[:, ::step])


def _all_combinations(n: int, faces: int) -> I64:
    """(m, faces) numbers of candidates, -1 behind the last, each behind what it begins with."""
    from itertools import combinations

    rows = sorted(row for k in range(1, faces + 1) for row in combinations(range(n), k))
    found = np.full((len(rows), faces), -1)
    for number, row in enumerate(rows):
        found[number, : len(row)] = row
    return found


def _weigh(sample: _Sample, combinations: I64) -> F64:
    """(m,) light of each combination, in the order of `_all_combinations`."""
    n, channels = sample.carried.shape
    faces = combinations.shape[1]
    products = np.empty((faces + 1, n, channels))
    products[0] = sample.carried
    sums = np.empty(len(combinations))
    _weigh_all(np.ascontiguousarray(sample.factors), combinations, products, sums)
    return sums


@lean_kernel
def _weigh_all(factors: F64, combinations: I64, products: F64, sums: F64) -> None:
    """Products of factors, each made of that of the combination that it begins with."""
    n, channels = products.shape[1], products.shape[2]
    for row in range(len(combinations)):
        depth = 0
        while depth < combinations.shape[1] and combinations[row, depth] >= 0:
            depth += 1
        face = combinations[row, depth - 1]
        total = 0.0
        for ray in range(n):
            for channel in range(channels):
                value = products[depth - 1, ray, channel] * factors[face, ray, channel]
                products[depth, ray, channel] = value
                total += value
        sums[row] = total


def _greedy(
    samples: list[_Sample], n: int, faces: int, score: Any
) -> tuple[list[tuple[int, ...]], int]:
    """Faces added one by one, then exchanged as long as that helps."""
    tried = 0

    def value(chosen: list[int], candidates: list[int]) -> F64:
        nonlocal tried
        tried += len(candidates)
        rows = np.array(candidates, np.int64)[:, None]
        sums = []
        for each in samples:
            carried = each.carried * each.factors[chosen].prod(axis=0)
            sums.append(_weigh(_Sample(carried, each.factors), rows))
        found: F64 = score(sums)
        return found

    chosen: list[int] = []
    for _ in range(faces):
        free = [k for k in range(n) if k not in chosen]
        chosen.append(free[int(np.argmin(value(chosen, free)))])
    best = float(value(chosen[:-1], chosen[-1:])[0])
    others: dict[tuple[int, ...], float] = {}
    helps = True
    while helps:
        helps = False
        for index in range(faces):
            rest = chosen[:index] + chosen[index + 1 :]
            free = [k for k in range(n) if k not in rest]
            values = value(rest, free)
            for k, each in zip(free, values.tolist(), strict=True):
                others[tuple(sorted([*rest, k]))] = each
            if float(values.min()) < best * (1.0 - np.sign(best) * 1e-12):
                chosen = [*rest, free[int(np.argmin(values))]]
                best, helps = float(values.min()), True
    others[tuple(sorted(chosen))] = best
    rows = sorted(others, key=lambda row: others[row])[:_TOLD]
    return rows, tried

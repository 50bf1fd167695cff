"""A selection: the rays that satisfy a criterion, their flux, and ways to get at them."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from query.answers.selections import output
from query.engine.bound import BoundNode
from query.engine.scan import Scan
from query.engine.scans import number_rays
from query.engine.second_try import asked_again
from query.engine.tally import Estimate, Tally, estimate
from raymap.model.doubt import FOOTNOTE, MARK, is_doubtful, marked, with_doubts
from raymap.model.portion import Portion
from raymap.model.rows import take_rays

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["Selection"]


@asked_again
def _with_rays(map: RayMap, node: BoundNode, threads: int) -> Scan:
    """A search that kept the rays."""
    scan = Scan(map, [node], rays=True, threads=threads)
    scan.run()
    return scan


class Selection:
    """Rays of a map that satisfy a criterion.

    Attributes
    ----------
    map : the map that was asked
    criterion : as it was asked
    matched : how many rays satisfy it
    tally : rays and sums of weights per source
    emitted : (n_sources,) rays emitted in the portions that the answer speaks for
    seconds : from opened map and parsed criterion to the answer
    complete : False if the search was cancelled; the numbers speak of what was searched
    limited : more rays may satisfy the criterion than the limit let in
    reason : why nothing matched, None if something did
    """

    def __init__(
        self,
        map: RayMap,
        node: BoundNode,
        criterion: object,
        scan: Scan,
        number: int,
        tally: Tally,
        emitted: NDArray[np.int64],
    ) -> None:
        self.map, self.criterion, self.tally, self.emitted = map, criterion, tally, emitted
        self._node, self._scan, self._number = node, scan, number
        self.complete = scan.complete
        self.limited = False
        self.seconds = 0.0
        self.reason: str | None = None
        self.portions_read = len(scan.served)
        self.bytes_read = scan.bytes_read
        self.damaged_portions = [map.portions[index].number for index in scan.damaged]

    # -- numbers -------------------------------------------------------------------------------

    @property
    def matched(self) -> int:
        return int(self.tally.rays.sum())

    def __len__(self) -> int:
        return self.matched

    def __bool__(self) -> bool:
        return self.matched > 0

    @cached_property
    def rays(self) -> int:
        """Rays of the map that the answer speaks for."""
        served = self._scan.portions_served
        return sum(self.map.portions[index].n_rays for index in served)

    @cached_property
    def estimate(self) -> Estimate:
        return estimate(self.tally, self.map.directory, self.emitted)

    @property
    def flux(self) -> float:
        """Flux of the rays [flux unit of the map]."""
        return self.estimate.flux

    @property
    def flux_se(self) -> float:
        """Standard error of the flux."""
        return self.estimate.se

    @property
    def flux_bound_95(self) -> float | None:
        """Where nothing matched: with 95 % confidence the flux is below this."""
        return self.estimate.bound_95

    @property
    def damaged(self) -> list[dict[str, Any]]:
        """Damage of the map that is known by now."""
        return [
            {
                "portion": damage.portion,
                "offset": damage.offset,
                "length": damage.length,
                "reason": damage.reason,
            }
            for damage in self.map.damage
        ]

    def summary(self) -> dict[str, Any]:
        """What ``raymap query --count --json`` prints."""
        found: dict[str, Any] = {
            "rays": self.rays,
            "matched": self.matched,
            "flux": self.flux,
            "flux_se": self.flux_se,
            "flux_bound_95": self.flux_bound_95,
            "flux_unit": self.map.directory.flux_unit,
            "seconds": self.seconds,
            "portions": len(self.map.portions),
            "portions_read": self.portions_read,
            "bytes_read": self.bytes_read,
            "complete": self.complete,
            "limited": self.limited,
            "damaged": self.damaged,
            "verified": self.map.verified,
        }
        return with_doubts(found) | ({"reason": self.reason} if self.reason else {})

    # -- rays ----------------------------------------------------------------------------------

    def parts(self) -> Iterator[tuple[int, NDArray[np.int64]]]:
        """(index of the portion, increasing indices of rays in it), in order of ray numbers."""
        scan = self._with_rays
        for index, masks in scan.masks.items():
            n_rays = self.map.portions[index].n_rays
            rays = np.flatnonzero(np.unpackbits(masks[self._number], count=n_rays))
            if len(rays):
                yield index, rays

    @cached_property
    def _with_rays(self) -> Scan:
        """The search that kept the rays; a count alone searches once more."""
        if self._scan.keep_masks:
            return self._scan
        scan = _with_rays(self.map, self._node, self._scan.threads)
        self._number = 0
        return scan

    @cached_property
    def ray_ids(self) -> NDArray[np.int64]:
        """(matched,) increasing ray numbers."""
        scan = self._with_rays
        bits = {index: masks[self._number] for index, masks in scan.masks.items()}
        ends = np.cumsum([int(np.bitwise_count(mask).sum()) for mask in bits.values()])
        ids = np.empty(int(ends[-1]) if len(ends) else 0, np.int64)
        begin, reached, in_order = 0, -1, True
        for (index, mask), end in zip(bits.items(), ends.tolist(), strict=True):
            part, portion = ids[begin:end], self.map.portions[index]
            if not len(part):
                continue
            if portion.last_ray - portion.first_ray + 1 == portion.n_rays:
                number_rays(mask, portion.first_ray, part)
            else:
                part[:] = portion.ray_ids()[scan.rays_of(index, self._number)]
            in_order &= int(part[0]) > reached
            begin, reached = end, int(part[-1])
        # Shards may interleave their numbers.
        if not in_order:
            ids.sort()
        return ids

    def __iter__(self) -> Iterator[int]:
        return iter(self.ray_ids.tolist())

    def portions(self) -> Iterator[Portion]:
        """The rays with everything that is recorded of them, decoded portion by portion."""
        for index, rays in self.parts():
            stored = self.map.portions[index]
            yield take_rays(stored.read(), rays, stored.ray_ids()[rays])

    def to_arrow(self, rows: str = "segments") -> Any:
        """The rays as one Arrow table; ``rows`` is "segments" or "rays"."""
        return output.to_arrow(self, rows)

    def to_numpy(self, rows: str = "segments") -> dict[str, NDArray[Any]]:
        """The rays as NumPy columns; ``rows`` is "segments" or "rays"."""
        table = self.to_arrow(rows)
        return {name: table[name].to_numpy(zero_copy_only=False) for name in table.column_names}

    def write(self, path: str | Path, rows: str = "segments", *, force: bool = False) -> Path:
        """Write the rays to ``.raymap``, ``.parquet``, ``.arrow`` or ``.csv``.

        The file is written beside the target and renamed.

        Parameters
        ----------
        rows : of tables: "segments", one per segment record, or "rays", their records nested
        force : replace an existing file; never the map that the selection comes from

        Raises
        ------
        MapExists, RayMapError
        """
        return output.write(self, Path(path), rows, force=force)

    # -- display -------------------------------------------------------------------------------

    def __repr__(self) -> str:
        state = "" if self.complete else ", cancelled"
        return f"<Selection {self.matched} of {self.rays} rays, flux {self._flux_in_words}{state}>"

    @property
    def _flux_in_words(self) -> str:
        unit = self.map.directory.flux_unit
        return marked(f"{self.flux:.6g} ± {self.flux_se:.2g} {unit}", self.flux, self.flux_se)

    def _repr_html_(self) -> str:
        unit = self.map.directory.flux_unit
        rows = [
            ("criterion", "every ray" if self.criterion is None else str(self.criterion)),
            ("rays", f"{self.matched:,} of {self.rays:,}"),
            ("flux", self._flux_in_words),
            ("answered in", f"{self.seconds:.3f} s, {self.portions_read} portions read"),
        ]
        if self.reason:
            rows.append(("nothing because", self.reason))
        if is_doubtful(self.flux, self.flux_se):
            rows.append((MARK, FOOTNOTE.removeprefix(f"{MARK} ")))
        if self.flux_bound_95 is not None:
            rows.append(("flux below (95 %)", f"{self.flux_bound_95:.3g} {unit}"))
        if not self.complete:
            rows.append(("state", "cancelled: numbers speak of the portions searched"))
        body = "".join(
            f"<tr><th style='text-align:left'>{escape(name)}</th><td>{escape(value)}</td></tr>"
            for name, value in rows
        )
        return f"<table>{body}</table>"

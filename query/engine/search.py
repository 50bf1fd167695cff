"""One portion searched for the rays that satisfy criteria.

Rays whose path decides take the verdict of the path; the others alone get the streams they need.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.engine.bound import BoundNode, evaluate
from query.engine.context import PathContext, RayContext
from query.engine.kleene import Pair
from query.engine.scans import look_up
from raymap.model.directory import ChannelSet

__all__ = ["Found", "PathVerdicts", "PortionPaths", "search_portion"]

Bools = NDArray[np.bool_]
Ints = NDArray[np.integer]


@dataclass(frozen=True, eq=False)
class PathVerdicts:
    """Criteria, and what the merged paths of a map say of them.

    Attributes
    ----------
    nodes : bound criteria
    base : the merged paths, None where the map has none
    pairs : per criterion its truth on every merged path
    """

    nodes: Sequence[BoundNode]
    base: PathContext | None
    pairs: Sequence[Pair]


class PortionPaths:
    """The paths of one portion's rays.

    Parameters
    ----------
    local : row of each of the portion's paths in ``merged``; None where it stands alone
    """

    def __init__(self, portion: Any, merged: PathContext | None, local: Ints | None) -> None:
        self.portion, self.local = portion, local
        self.is_merged = local is not None and merged is not None
        self.base = merged if local is not None and merged else PathContext(portion.paths())

    @cached_property
    def numbers(self) -> Ints:
        """(n_rays,) path of each ray in the portion's own dictionary."""
        result: Ints = self.portion.path_numbers()
        return result

    @cached_property
    def of_ray(self) -> Ints:
        """(n_rays,) row of each ray's path in ``base``.

        Whoever looks at rays one by one comes through here, so that no length and no index of a
        merged path is used before it is known to be the portion's own.

        Raises
        ------
        FalseFooter
            the merged paths are not those of the portion (`query.engine.second_try`).
        DamagedPortion
            the paths do not account for the portion's records and crossings.
        """
        self.portion.check_rows(self.numbers)
        if self.local is None:
            return self.numbers
        if self.is_merged:
            self.portion.compare(self.base.paths, self.local)
        rows: Ints = self.local[self.numbers]
        return rows

    def spread(self, mask: Bools) -> Bools:
        """What holds for paths of the base, for the rays that take them."""
        if not self.portion.has_paths:
            return mask
        return look_up(mask if self.local is None else mask[self.local], self.numbers)


@dataclass(frozen=True, eq=False)
class Found:
    """Rays of one portion that satisfy the criteria.

    Attributes
    ----------
    index : of the portion in the map
    paths : of its rays
    certain : per criterion (n_rays,) rays whose path alone decides that they match
    masks : per criterion (n_rays,) all rays that match; the same array where nothing was open
    """

    index: int
    paths: PortionPaths
    certain: Sequence[Bools]
    masks: Sequence[Bools]
    channel_sets: Sequence[ChannelSet]
    check: Callable[[], None]

    @property
    def portion(self) -> Any:
        return self.paths.portion

    def context(self, rays: Ints | None) -> RayContext:
        """Chosen rays with their streams."""
        return RayContext(
            self.portion, self.paths.base, self.paths.of_ray, rays, self.channel_sets, self.check
        )


def search_portion(
    index: int,
    portion: Any,
    verdicts: PathVerdicts,
    local: Ints | None,
    channel_sets: Sequence[ChannelSet],
    check: Callable[[], None],
) -> Found:
    """Find the rays of a portion that satisfy each criterion.

    Raises
    ------
    Cancelled
        by ``check``, between any two reads.
    DamagedPortion
        a stream that is needed fails its checksum.
    FalseFooter
        the merged paths are not those of the portion (`query.engine.second_try`).
    """
    check()
    paths = PortionPaths(portion, verdicts.base, local)
    pairs = verdicts.pairs
    if not paths.is_merged:
        pairs = [evaluate(paths.base, node) for node in verdicts.nodes]
    check()
    certain = [paths.spread(pair.certain) for pair in pairs]
    found = Found(index, paths, certain, certain, channel_sets, check)
    if all(pair.exact for pair in pairs):
        return found
    masks = _resolve(found, verdicts.nodes, pairs)
    return Found(index, paths, certain, masks, channel_sets, check)


def _resolve(found: Found, nodes: Sequence[BoundNode], pairs: Sequence[Pair]) -> list[Bools]:
    """Decide the open rays with their streams; one context serves all criteria."""
    waiting = [
        None if pair.exact else found.paths.spread(pair.possible) & ~sure
        for pair, sure in zip(pairs, found.certain, strict=True)
    ]
    union = np.logical_or.reduce([mask for mask in waiting if mask is not None])
    if not union.any():
        return list(found.certain)
    rays = None if union.all() else np.flatnonzero(union)
    context = found.context(rays)
    masks = []
    for node, mask, sure in zip(nodes, waiting, found.certain, strict=True):
        found.check()
        if mask is None or not mask.any():
            masks.append(sure)
            continue
        truth = evaluate(context, node).certain
        if rays is None:
            masks.append(sure | truth)
        else:
            whole = sure.copy()
            whole[rays] |= truth
            masks.append(whole)
    return masks

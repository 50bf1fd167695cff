"""What a map says twice, compared: dictionaries with the rays, the footer with the portions.

`raymap.file.totals` compares what the footer alone says twice. Checksums prove that bytes are as
they were written, not that what was written is true. Counts and sums that a dictionary states
follow from the rays, the merged dictionary from the portions' own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from raymap.encoding.paths import MergedPaths, PathDictionary
from raymap.encoding.pathstreams import CheckedPaths
from raymap.file.owner import ReadPortion
from raymap.file.totals import worth_squares
from raymap.model.errors import DamagedPortion, FormatError
from raymap.model.rows import squares_by_emission
from raymap.model.schema import COLOR_SCALE

__all__ = [
    "FALSE_COLORS",
    "FALSE_COUNTS",
    "FALSE_RAYS",
    "FALSE_WEIGHTS",
    "FalseFooter",
    "compare_all",
    "difference",
    "false_sums",
    "unlike_merged",
]

FALSE_RAYS = "rays per path contradict the rays, which were counted instead"
FALSE_WEIGHTS = "sums of weights contradict the rays"
FALSE_COLORS = "sums of colour contradict the rays"
FALSE_COUNTS = (FALSE_RAYS, FALSE_WEIGHTS, FALSE_COLORS)
"""What damage reads like that costs no ray."""

_POINTS = ("object", "face", "event", "medium")
_ROUNDING = 1e-9


class FalseFooter(FormatError):
    """The merged dictionary contradicts the portions; they are asked one by one from here on."""


def unlike_merged(
    merged: PathDictionary, local: NDArray[np.int32], own: CheckedPaths | PathDictionary
) -> str:
    """In words, where a portion's paths differ from those that the footer says they are.

    Parameters
    ----------
    local : (own's,) row of each in ``merged``
    """
    lengths = merged.offsets[local + 1] - merged.offsets[local]
    if not np.array_equal(lengths, np.diff(own.offsets)):
        return "lengths of paths"
    if not np.array_equal(merged.source[local], own.source):
        return "sources of paths"
    rows = np.repeat(merged.offsets[local] - own.offsets[:-1], lengths) + np.arange(lengths.sum())
    for name in _POINTS:
        if not np.array_equal(getattr(merged, name)[rows], getattr(own, name)):
            return f"{name} of paths"
    starts = merged.detector_offsets[rows]
    counts = merged.detector_offsets[rows + 1] - starts
    if not np.array_equal(counts, np.diff(own.detector_offsets)):
        return "crossings of paths"
    crossings = np.repeat(starts - own.detector_offsets[:-1], counts) + np.arange(counts.sum())
    for name in ("detector", "registered"):
        if not np.array_equal(getattr(merged, name)[crossings], getattr(own, name)):
            return f"{name} of paths"
    return ""


def compare_all(merged: MergedPaths, portions: Sequence[ReadPortion]) -> None:
    """Compare a merged dictionary with every portion: their paths, counts and sums.

    Raises
    ------
    FormatError
        The dictionary contradicts them.
    """
    paths = merged.paths
    rays = np.zeros(paths.n_paths, np.int64)
    sums = [np.zeros(paths.n_paths), np.zeros(paths.n_paths), *(0.0 * s for s in paths.sum_wc)]
    of_worth = [np.zeros(paths.n_paths) for _ in worth_squares(paths)]
    # Portions of a map that is one of several count channel sets as all of these do
    lost = False
    for portion, local in zip(portions, merged.local_to_global, strict=True):
        if local is None:
            continue
        try:
            own = portion.paths()
        except DamagedPortion as error:
            if error.reason in FALSE_COUNTS:
                raise FormatError(f"merged dictionary: {error.reason}") from None
            # Its rays are lost: nobody can say what it held
            lost = True
            continue
        unlike = unlike_merged(paths, local, own)
        if unlike:
            raise FormatError(f"merged dictionary: {unlike} contradict portion {portion.number}")
        np.add.at(rays, local, own.rays)
        colors = own.sum_wc[portion.channel_set]
        own_set = 2 + portion.index.meta.channel_set
        if colors.shape[1:] != sums[own_set].shape[1:]:
            raise FormatError("merged dictionary: a channel set without sums of colour")
        for index, more in ((0, own.sum_w), (1, own.sum_w2), (own_set, colors)):
            np.add.at(sums[index], local, more)
        for total in of_worth:
            if own.sum_wy2 is None:
                raise FormatError("merged dictionary: squares of lumens that a portion lacks")
            np.add.at(total, local, own.sum_wy2)
    if lost:
        return
    if not np.array_equal(rays, paths.rays):
        raise FormatError("merged dictionary: rays of paths contradict the portions")
    all_stated = (paths.sum_w, paths.sum_w2, *paths.sum_wc, *worth_squares(paths))
    for total, stated in zip([*sums, *of_worth], all_stated, strict=True):
        if not np.allclose(total, stated, rtol=_ROUNDING, atol=1e-12):
            raise FormatError("merged dictionary: sums of paths contradict the portions")


def false_sums(portion: ReadPortion) -> str:
    """In words, which sums of a portion's dictionary its rays contradict; "" for none."""
    own, numbers = portion.paths(), portion.path_numbers()
    n = own.n_paths
    weight = portion.column("weight").astype(np.float64)
    emission = portion.column("emission") if portion.grouped else None
    expected = {
        "path.sum_w": np.bincount(numbers, weight, n),
        "path.sum_w2": squares_by_emission(numbers, weight, emission, n),
    }
    if own.sum_wy2 is not None:
        light = portion.map.photometry(portion.channel_set)
        codes, table = portion.column("last_color"), portion.color_table()
        worth = light.worth_of_rays(portion.column("source"), codes, table)
        expected["path.sum_wy2"] = squares_by_emission(numbers, weight * worth, emission, n)
    for name, values in expected.items():
        stated = getattr(own, name.removeprefix("path."))
        if not np.allclose(stated, values, rtol=_ROUNDING, atol=0):
            return FALSE_WEIGHTS
    colors = _colors_of(portion)
    for channel_set, stated in enumerate(own.sum_wc):
        if channel_set != portion.channel_set:
            continue
        for channel in range(stated.shape[1]):
            values = np.bincount(numbers, weight * colors[:, channel], n)
            if not np.allclose(stated[:, channel], values, rtol=_ROUNDING, atol=1e-12):
                return FALSE_COLORS
    return ""


def _colors_of(portion: ReadPortion) -> NDArray[np.float64]:
    """(n_rays, n_channels) colours at the rays' ends."""
    codes, table = portion.column("last_color"), portion.color_table()
    n_channels = table.shape[1]
    colors: NDArray[np.float64] = np.concatenate((np.eye(n_channels), table / COLOR_SCALE))
    own: NDArray[np.float64] = colors[codes]
    return own


def difference(a: PathDictionary, b: PathDictionary) -> str:
    """In words, where ``a`` says other than ``b``; sums may differ by rounding."""
    exact = ("source", "offsets", *_POINTS, "rays", "detector_offsets", "detector", "registered")
    for name in exact:
        if not np.array_equal(getattr(a, name), getattr(b, name)):
            return f"{name} contradicts the portions"
    for name in ("sum_w", "sum_w2"):
        if not np.allclose(getattr(a, name), getattr(b, name), rtol=_ROUNDING, atol=0):
            return f"{name} contradicts the portions"
    if a.sum_wy2 is not None and (
        b.sum_wy2 is None or not np.allclose(a.sum_wy2, b.sum_wy2, rtol=_ROUNDING, atol=0)
    ):
        return "sum_wy2 contradicts the portions"
    for number in range(max(len(a.sum_wc), len(b.sum_wc))):
        x, y = (
            sums[number] if number < len(sums) else np.zeros((0, 0))
            for sums in (a.sum_wc, b.sum_wc)
        )
        if not x.shape[1] and not y.shape[1]:
            continue
        if x.shape != y.shape or not np.allclose(x, y, rtol=_ROUNDING, atol=1e-12):
            return "sums of colour contradict the portions"
    if a.grouped != b.grouped:
        return "it contradicts the portions on emissions"
    return ""

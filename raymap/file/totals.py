"""A merged dictionary compared with the index of the footer in which it stands."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raymap.encoding.paths import MergedPaths, PathDictionary
from raymap.model.errors import FormatError

__all__ = ["compare_totals", "worth_squares"]


def compare_totals(
    merged: MergedPaths, n_rays: int, stated: list[bool], *, weighted: bool, grouped: bool
) -> None:
    """Compare a merged dictionary with the index of the footer in which it stands.

    Parameters
    ----------
    n_rays : of the portions that have dictionaries
    stated : per channel set, whether it may have sums
    weighted, grouped : some of these portions has weights, emissions

    Raises
    ------
    FormatError
        Counts do not add up, or a sum is no number.
    """
    paths = merged.paths
    if len(paths.rays) and int(paths.rays.min()) < 1:
        raise FormatError("merged dictionary: a path that no ray takes")
    # No sum of counts below the number of rays wraps around
    if (len(paths.rays) and int(paths.rays.max()) > n_rays) or int(paths.rays.sum()) != n_rays:
        raise FormatError(f"merged dictionary: rays of the paths do not add up to {n_rays}")
    if bool(paths.grouped) != grouped:
        raise FormatError("merged dictionary: it contradicts the portions on emissions")
    # Weights are float32, squares of their sums no more than that of all of them
    most = (n_rays * float(np.finfo(np.float32).max)) ** 2
    for sums in (paths.sum_w, paths.sum_w2, *worth_squares(paths), *paths.sum_wc):
        if not ((sums >= 0) & (sums <= most)).all():
            raise FormatError(
                "merged dictionary: a sum of weights is negative, no number, or more than rays have"
            )
    if not weighted:
        plain = paths.rays.astype(np.float64)
        if not np.array_equal(paths.sum_w, plain):
            raise FormatError("merged dictionary: sums of weights are not the numbers of rays")
        if not grouped and not np.array_equal(paths.sum_w2, plain):
            raise FormatError("merged dictionary: sums of squares are not the numbers of rays")
    shares = np.zeros(paths.n_paths)
    for present, sums in zip(stated, paths.sum_wc, strict=True):
        if sums.shape[1] and not present:
            raise FormatError("merged dictionary: colours in a channel set that no portion has")
        shares += sums.sum(axis=1)
    # Colours are normalised: their channels add up to the weight
    if not np.allclose(shares, paths.sum_w, rtol=1e-6, atol=0):
        raise FormatError("merged dictionary: sums of colours are not those of the weights")
    present_in = np.concatenate(
        [numbers for numbers in merged.local_to_global if numbers is not None]
        or [np.empty(0, np.int32)]
    )
    if len(np.unique(present_in)) != paths.n_paths:
        raise FormatError("merged dictionary: a path that no portion has")


def worth_squares(paths: PathDictionary) -> list[NDArray[np.float64]]:
    """The sums of (weight × worth)², where they are kept."""
    return [] if paths.sum_wy2 is None else [paths.sum_wy2]

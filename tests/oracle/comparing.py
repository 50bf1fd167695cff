"""Differences of two maps, and of two answers."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import raymap
from raymap.file.reader import RayMap
from raymap.file.stored import StoredPortion

__all__ = ["answer_differences", "end_probability", "map_differences"]

UNCOMPARED = {
    "bytes", "bytes_per_record", "seconds", "rays_per_second", "records_per_second", "runs",
    "verified", "map", "output", "started", "threads",
    # An object of Python that slipped into an answer of the earlier build
    "counts",
}  # fmt: skip
"""Members of answers that speak of the file or the clock and not of the light."""

ROUNDING = 1e-12
"""Numbers of answers that are nearer than this share of them are one number."""

SMALLEST_END = 25
"""Ends that fewer rays than this reach are taken together in the test of fluxes."""


def map_differences(old: Path, new: Path) -> list[str]:
    """What differs between two maps, in words; nothing where every column is the same."""
    with raymap.open(old) as one, raymap.open(new) as other:
        return list(_differences(one, other))


def _differences(one: RayMap, other: RayMap) -> Iterator[str]:
    for what in ("sources", "objects", "faces", "media", "detectors", "surfaces"):
        a, b = (_names(ray_map, what) for ray_map in (one, other))
        if a != b:
            yield f"{what}: {a[:5]} … and {b[:5]} …"
    if one.directory.scene_hash != other.directory.scene_hash:
        yield "scene hash"
    if len(one.portions) != len(other.portions):
        yield f"portions: {len(one.portions)} and {len(other.portions)}"
        return
    for k, (a, b) in enumerate(zip(one.channel_sets, other.channel_sets, strict=True)):
        for name in ("labels", "wavelengths_nm", "luminous", "refractive_index", "absorption", "source_colors"):  # fmt: skip # noqa: E501
            if not _same(getattr(a, name), getattr(b, name)):
                yield f"channel set {k}: {name}"
    for p, q in zip(one.portions, other.portions, strict=True):
        yield from _portion_differences(p, q)
    for detector in one.directory.detectors:
        for k in range(len(one.channel_sets)):
            results = [m.detector_result(detector.name, k) for m in (one, other)]
            if (results[0] is None) != (results[1] is None):
                yield f"results of {detector.name}: only one has them"
            elif not all(_same(x, y) for x, y in zip(*(r or () for r in results), strict=True)):
                yield f"results of {detector.name}"


def _names(ray_map: RayMap, what: str) -> list[str]:
    directory = ray_map.directory
    if what == "objects":
        return list(directory.object_columns.names)
    if what == "faces":
        return list(directory.faces.names)
    return [item.name for item in getattr(directory, what)]


def _portion_differences(one: StoredPortion, other: StoredPortion) -> Iterator[str]:
    place = f"portion {one.number}"
    for name in ("number", "first_ray", "n_rays", "n_records", "n_descriptors", "channel_set"):
        if getattr(one, name) != getattr(other, name):
            yield f"{place}: {name} {getattr(one, name)} and {getattr(other, name)}"
    if not _same(one.emitted, other.emitted):
        yield f"{place}: emitted"
    if one.n_records != other.n_records or one.n_rays != other.n_rays:
        return
    if not _same(one.ray_ids(), other.ray_ids()):
        yield f"{place}: ray numbers"
    for name in sorted({*one.column_names} ^ {*other.column_names}):
        yield f"{place}: only one has column {name}"
    for name in sorted({*one.column_names} & {*other.column_names}):
        a, b = one.column(name), other.column(name)
        if not _same(a, b):
            yield f"{place}: column {name}{_by_how_much(a, b)}"


def _same(a: Any, b: Any) -> bool:
    """Equal in type, shape and every bit that a number shows."""
    x, y = np.asarray(a), np.asarray(b)
    if x.dtype != y.dtype or x.shape != y.shape:
        return False
    return np.array_equal(x, y, equal_nan=x.dtype.kind == "f")


def _by_how_much(a: NDArray[Any], b: NDArray[Any]) -> str:
    if a.shape != b.shape or a.dtype.kind not in "iuf" or not len(a):
        return ""
    apart = np.abs(a.astype(float) - b.astype(float))
    rows = np.count_nonzero(apart.reshape(len(a), -1).any(1))
    return f": {rows} of {len(a)} rows, by {np.nanmax(apart):.3g} at most"


def end_probability(old: Path, new: Path) -> float:
    """Probability that the fluxes of all ends (source, object, events) differ so by chance.

    χ² of the differences over their standard errors; ends that few rays reach count together.
    """
    one, other = _ends(old), _ends(new)
    rare = {
        end for end in one.keys() | other.keys()
        if min(one.get(end, (0, 0, 0))[2], other.get(end, (0, 0, 0))[2]) < SMALLEST_END
    }  # fmt: skip
    pairs = [(one[end], other[end]) for end in one.keys() - rare]
    if rare:
        merged = [
            tuple(sum(found.get(end, (0.0, 0.0, 0))[k] for end in rare) for k in range(3))
            for found in (one, other)
        ]
        pairs.append((merged[0], merged[1]))  # type: ignore[arg-type]
    chi2 = 0.0
    for (a, va, _), (b, vb, _) in pairs:
        if a != b:
            chi2 += (a - b) ** 2 / (va + vb) if va + vb else math.inf
    from scipy.stats import chi2 as distribution

    return float(distribution.sf(chi2, len(pairs)))


def _ends(path: Path) -> dict[tuple[int, int, int], tuple[float, float, int]]:
    """Share of a source's emitted rays, its variance and the rays, by source, object and events."""
    sums: dict[tuple[int, int, int], list[float]] = {}
    with raymap.open(path) as ray_map:
        for stored in ray_map.portions:
            portion = stored.read()
            last = np.cumsum(portion.records_per_ray) - 1
            keys = np.stack([portion.source, portion.object[last], portion.event[last]], axis=1)
            weight = np.ones(portion.n_rays) if portion.weight is None else portion.weight
            group = np.arange(portion.n_rays) if portion.emission is None else portion.emission
            rows = np.column_stack([group, keys])
            distinct, place = np.unique(rows, axis=0, return_inverse=True)
            per_emission = np.bincount(place.ravel(), weight.astype(float), len(distinct))
            for (_, *key), w in zip(distinct.tolist(), per_emission.tolist(), strict=True):
                total = sums.setdefault((key[0], key[1], key[2]), [0.0, 0.0, 0.0])
                total[0] += w
                total[1] += w * w
                total[2] += 1
        emitted = ray_map.emitted
    found = {}
    for key, (w, w2, rays) in sums.items():
        n = max(int(emitted[key[0]]), 1)
        found[key] = (w / n, max(w2 - w * w / n, 0.0) / n**2, int(rays))
    return found


def answer_differences(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """What differs between two answers of a command, in words; a later one may say more."""
    if old["status"] != new["status"]:
        return [f"exit {old['status']} and {new['status']}: {(new['err'] or old['err'])[-300:]}"]
    try:
        one, other = json.loads(old["out"] or "null"), json.loads(new["out"] or "null")
    except json.JSONDecodeError:
        return [] if old["out"] == new["out"] else ["printed text"]
    return list(_apart(one, other, ""))[:5]


def _apart(one: Any, other: Any, place: str) -> Iterator[str]:
    if isinstance(one, dict) and isinstance(other, dict):
        for key in sorted({*one} - UNCOMPARED):
            yield from _apart(one[key], other.get(key, "nothing"), f"{place}.{key}")
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        for k, (a, b) in enumerate(zip(one, other, strict=True)):
            yield from _apart(a, b, f"{place}[{k}]")
    elif isinstance(one, float) and isinstance(other, float):
        if not math.isclose(one, other, rel_tol=ROUNDING):
            yield f"{place.lstrip('.')}: {one!r} and {other!r}"
    elif one != other:
        yield f"{place.lstrip('.')}: {str(one)[:60]} and {str(other)[:60]}"

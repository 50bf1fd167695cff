"""A bound criterion on a context: true, false or unknown for every ray.

One evaluator serves both contexts. On path dictionaries streams beyond the path are unknown and
the answer is a Kleene pair; on rays with their streams the pair is exact. `count` is the interval
[certain, possible].
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from query.engine import bound as b
from query.engine.context import Context, RayContext
from query.engine.kleene import Bools, Pair, apply, combine, exactly, gather, interval
from query.engine.measures import incidence_angles, optical_lengths, path_lengths
from query.engine.path_machine import PRINCIPAL
from query.engine.path_matching import match_path
from query.engine.recorded import recorded_values
from query.engine.scans import (
    any_before_last,
    any_of_ray,
    count_of_ray,
    expand_rows,
    look_up,
    mark_events,
    match_sequence,
    ray_offsets,
)
from query.engine.surface_parameters import COMPARISONS
from raymap.model.schema import UV_SCALE

__all__ = ["evaluate"]


def evaluate(context: Context, node: b.BoundNode) -> Pair:
    """Truth of a criterion for every ray of the context."""
    known = context.ray_results.get(node)
    if known is None:
        if isinstance(context, RayContext) and not node.streams:
            # The path decides: no need to look at the ray.
            known = gather(evaluate(context.base, node), context.path)
        else:
            known = _RAY[type(node)](context, node)
        context.ray_results[node] = known
    return known


def at_points(context: Context, node: b.BoundNode) -> Pair:
    """Truth of a point condition at every point of the context."""
    known = context.point_results.get(node)
    if known is None:
        if isinstance(context, RayContext) and not node.streams:
            known = gather(at_points(context.base, node), context.rows)
        else:
            known = _POINT[type(node)](context, node)
        context.point_results[node] = known
    return known


def _unknown(context: Context) -> Pair:
    return Pair(np.zeros(context.n_rays, np.bool_), np.ones(context.n_rays, np.bool_))


# Logic, the same for points and for rays.


def _ray_logic(context: Context, node: b.BoundLogic) -> Pair:
    return combine(node.operator, [evaluate(context, arg) for arg in node.args])


def _point_logic(context: Context, node: b.BoundLogic) -> Pair:
    return combine(node.operator, [at_points(context, arg) for arg in node.args])


def _point_all(context: Context, node: b.BoundAll) -> Pair:
    if not node.args:
        return exactly(np.ones(context.n_points, np.bool_))
    return combine("and", [at_points(context, arg) for arg in node.args])


# Point conditions.


def _point_hit(context: Context, node: b.BoundHit) -> Pair:
    if node.any_place:
        return exactly(_events(context, node.events))
    place = _places(context, node)
    # Emission is not a hit.
    if context.n_rays:
        for mask in {id(m): m for m in place}.values():
            mask[context.offsets[:-1]] = False
    if not node.events:
        return place
    happened = _events(context, node.events)
    return apply(place, lambda mask: mask & happened)


def _places(context: Context, node: b.BoundHit) -> Pair:
    certain = np.zeros(context.n_points, np.bool_)
    maybe = None
    for match in node.places:
        if match.triangle >= 0:
            on_face = look_up(match.faces, context.face)
            triangle = context.triangle
            if triangle is None:
                maybe = on_face if maybe is None else maybe | on_face
            else:
                certain |= on_face & (triangle == match.triangle)
            continue
        if match.objects.any():
            certain |= look_up(match.objects, context.object)
        if match.faces.any():
            certain |= look_up(match.faces, context.face)
    return Pair(certain, certain if maybe is None else certain | maybe)


def _events(context: Context, events: b.EventMasks) -> Bools:
    result: Bools | None = None
    for masks in events:
        one = mark_events(context.event, masks[0])
        for mask in masks[1:]:
            one &= mark_events(context.event, mask)
        result = one if result is None else result | one
    assert result is not None
    return result


def _some_point(context: Context, node: b.BoundNode) -> Pair:
    """A point condition asked of a ray: at some point."""
    return apply(at_points(context, node), lambda mask: any_of_ray(mask, context.offsets))


def _last(context: Context, node: b.BoundLast) -> Pair:
    return apply(at_points(context, node.point), lambda mask: mask[context.last_rows])


# Sources, media, detectors.


def _everything(context: Context, node: b.BoundEverything) -> Pair:
    return exactly(np.ones(context.n_rays, np.bool_))


def _source(context: Context, node: b.BoundSource) -> Pair:
    return exactly(look_up(node.table, context.source))


def _medium(context: Context, node: b.BoundMedium) -> Pair:
    # No segment starts at the last point.
    return exactly(any_before_last(look_up(node.table, context.medium), context.offsets))


def _meetings(context: Context, node: b.BoundDetected) -> Pair:
    """Truth at every meeting of a segment with a detector."""
    met = look_up(node.table, context.detector)
    if node.registered:
        met &= context.registered
    if not node.regions:
        return exactly(met)
    uv = context.uv
    if uv is None:
        return Pair(np.zeros_like(met), met)
    inside = np.zeros_like(met)
    for detector, regions in node.regions.items():
        chosen = np.flatnonzero(met & (context.detector == detector))
        place = uv[chosen].astype(np.float64)
        here = np.zeros(len(chosen), np.bool_)
        for region in regions:
            here |= _inside(region, place)
        inside[chosen] = here
    return exactly(inside)


def _inside(region: b.BoundRegion, uv: NDArray[np.float64]) -> Bools:
    x = uv[:, 0] * region.cells[0] / UV_SCALE
    y = uv[:, 1] * region.cells[1] / UV_SCALE
    first, second, third, fourth = region.numbers
    inside: Bools
    if region.shape == "rect":
        inside = (first <= x) & (x < third) & (second <= y) & (y < fourth)
    else:
        inside = ((x - first) / third) ** 2 + ((y - second) / fourth) ** 2 <= 1
    return inside


def _detected(context: Context, node: b.BoundDetected) -> Pair:
    offsets = context.ray_meeting_offsets
    return apply(_meetings(context, node), lambda mask: any_of_ray(mask, offsets))


# Order and path expressions: monotone in their marks, so each side of the pair is one run.


def _then(context: Context, node: b.BoundThen) -> Pair:
    is_detector = np.array([isinstance(arg, b.BoundDetected) for arg in node.args])
    pairs = [
        _meetings(context, arg) if isinstance(arg, b.BoundDetected) else at_points(context, arg)
        for arg in node.args
    ]
    begins = np.concatenate(([0], np.cumsum([len(pair.certain) for pair in pairs])))[:-1]
    meeting_offsets = context.meeting_offsets if is_detector.any() else np.empty(0, np.int64)

    def run(masks: list[Bools]) -> Bools:
        return match_sequence(
            context.offsets,
            is_detector,
            np.concatenate(masks),
            begins,
            meeting_offsets,
        )

    certain = run([pair.certain for pair in pairs])
    if all(pair.exact for pair in pairs):
        return exactly(certain)
    return Pair(certain, run([pair.possible for pair in pairs]))


def _path(context: Context, node: b.BoundPath) -> Pair:
    machine = node.machine
    triangle = context.triangle if machine.needs_triangles else None

    columns = context.columns(
        face=machine.needs_faces, event=machine.needs_events, meetings=machine.needs_detectors
    )
    known = np.empty(0, np.int32) if triangle is None else triangle

    def run(triangle_mode: int) -> Bools:
        return match_path(columns, known, triangle_mode, machine, PRINCIPAL)

    if not machine.needs_triangles:
        return exactly(run(0))
    if triangle is not None:
        return exactly(run(2))
    return Pair(run(0), run(1))


# Quantities. A comparison with something undefined is false, also `!=`.


def _compare(operator: str, values: NDArray[np.generic], value: float) -> Bools:
    result: Bools = COMPARISONS[operator](values, value)
    if values.dtype.kind == "f":
        result = result & ~np.isnan(values)
    return result


def _count(context: Context, node: b.BoundCount) -> Pair:
    pair = at_points(context, node.point)
    least = count_of_ray(pair.certain, context.offsets)
    if pair.exact:
        return exactly(_compare(node.operator, least, node.value))
    most = count_of_ray(pair.possible, context.offsets)
    return interval(node.operator, least, most, node.value)


def _bounces(context: Context, node: b.BoundBounces) -> Pair:
    between = np.maximum(context.lengths - 2, 0)
    return exactly(_compare(node.operator, between, node.value))


def _flux(context: Context, node: b.BoundFlux) -> Pair:
    flux = node.per_weight[context.source]
    if node.weighted or node.worth_by_color:
        if not isinstance(context, RayContext):
            return _unknown(context)
        flux = flux * context.carried
    return exactly(_compare(node.operator, flux, node.value))


def _wavelength(context: Context, node: b.BoundWavelength) -> Pair:
    if not node.possible:
        return exactly(np.zeros(context.n_rays, np.bool_))
    if not isinstance(context, RayContext):
        return _unknown(context)
    return exactly(_compare(node.operator, context.wavelength, node.value))


def _length(context: Context, node: b.BoundLength) -> Pair:
    if not isinstance(context, RayContext):
        return _unknown(context)
    return exactly(_compare(node.operator, _lengths(context, node.optical), node.value))


def _lengths(context: RayContext, optical: bool) -> NDArray[np.float64]:
    if not optical:
        return path_lengths(context.position, context.starts, context.lengths, context.left)
    channel_set = context.channel_set
    shape = (-1, channel_set.n_channels)
    return optical_lengths(
        context.position,
        context.starts,
        context.lengths,
        context.left,
        context.medium,
        context.offsets,
        context.last_color,
        context.channels,
        np.array(channel_set.refractive_index, np.float64).reshape(shape),
    )


def _incidence(context: Context, node: b.BoundIncidence) -> Pair:
    if not isinstance(context, RayContext):
        points = at_points(context, node.point)
        met = apply(points, lambda mask: any_of_ray(mask, context.offsets))
        return Pair(np.zeros_like(met.possible), met.possible)
    ray, step, face = _surface_points(context, node.point)
    records = context.starts[ray] + step
    normal = context.normals_at(records, face)
    angles = incidence_angles(context.position, normal, records)
    found = np.zeros(context.n_rays, np.bool_)
    found[ray[_compare(node.operator, angles, node.value)]] = True
    return exactly(found)


def _surface_points(
    context: RayContext, node: b.BoundNode
) -> tuple[NDArray[np.integer], NDArray[np.integer], NDArray[np.integer]]:
    """Ray, step along it and face of the points on surfaces that satisfy a node, emission aside."""
    if node.streams:
        marked = at_points(context, node).certain & (context.object >= 0)
        chosen = np.flatnonzero(marked)
        ray = np.searchsorted(context.offsets, chosen, side="right") - 1
        step = chosen - context.offsets[ray]
        later = step > 0
        return ray[later], step[later], context.face[chosen[later]]
    # The paths say which points: list them per path, then per ray
    base = context.base
    marked = at_points(base, node).certain & (base.object >= 0)
    marked[base.offsets[:-1]] = False
    places = np.flatnonzero(marked)
    ends = np.searchsorted(places, base.offsets)
    offsets = ray_offsets(ends, context.path)
    rows = expand_rows(ends[:-1][context.path], offsets)
    ray = np.repeat(np.arange(context.n_rays), np.diff(offsets))
    place = places[rows]
    return ray, place - base.offsets[:-1][context.path[ray]], base.face[place]


def _recorded(context: Context, node: b.BoundRecorded) -> Pair:
    if not node.stored:
        return exactly(np.zeros(context.n_rays, np.bool_))
    points = None if node.point is None else at_points(context, node.point)
    if not isinstance(context, RayContext):
        if points is None:
            return _unknown(context)
        met = any_of_ray(points.possible, context.offsets)
        return Pair(np.zeros_like(met), met)
    if points is None:
        values = recorded_values(context, node.word, None)
        return exactly(_compare(node.operator, values, node.value))
    chosen = np.flatnonzero(points.certain)
    marks = np.zeros(context.n_points, np.bool_)
    values = recorded_values(context, node.word, chosen)
    marks[chosen] = _compare(node.operator, values, node.value)
    return exactly(any_of_ray(marks, context.offsets))


_RAY: dict[type[b.BoundNode], Callable[..., Pair]] = {
    b.BoundEverything: _everything,
    b.BoundSource: _source,
    b.BoundHit: _some_point,
    b.BoundAll: _some_point,
    b.BoundLogic: _ray_logic,
    b.BoundDetected: _detected,
    b.BoundMedium: _medium,
    b.BoundLast: _last,
    b.BoundThen: _then,
    b.BoundPath: _path,
    b.BoundCount: _count,
    b.BoundBounces: _bounces,
    b.BoundFlux: _flux,
    b.BoundWavelength: _wavelength,
    b.BoundLength: _length,
    b.BoundIncidence: _incidence,
    b.BoundRecorded: _recorded,
}

_POINT: dict[type[b.BoundNode], Callable[..., Pair]] = {
    b.BoundHit: _point_hit,
    b.BoundAll: _point_all,
    b.BoundLogic: _point_logic,
}

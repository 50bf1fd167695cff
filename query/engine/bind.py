"""Binding: a criterion against the names, units and channels of one map."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from query.engine import bound as b
from query.engine.path_machine import bind_path
from query.engine.surface_parameters import COMPARISONS, passes, sides_of
from query.expression import criteria as c
from query.expression.grammar import mark
from query.expression.names import FaceNames, ObjectMatch, match_indices, match_objects, unknown
from query.expression.printer import quoted, to_text
from query.expression.units import ANGLES, convert, length_factor
from raymap.model.directory import ChannelSet, Detector, Directory
from raymap.model.errors import CriterionError, UnknownName
from raymap.model.events import FAMILIES
from raymap.optics.cells import cells_by_angle

__all__ = ["Binder", "MapFacts", "bind"]


@dataclass(frozen=True, eq=False, kw_only=True)
class MapFacts:
    """What binding needs to know of a map.

    Attributes
    ----------
    emitted : (n_sources,) int64, rays emitted by each source in the portions served
    weighted : some portion stores weights
    worth_by_color : the flux of a ray depends on its colour, as lumens do
    has_column : whether some portion has an optional column of this name
    """

    directory: Directory
    channel_sets: Sequence[ChannelSet] = ()
    emitted: NDArray[np.int64]
    weighted: bool = False
    worth_by_color: bool = False
    has_column: Callable[[str], bool] = lambda name: False


class Binder:
    """Binds criteria to one map; equal sub-expressions become one node."""

    def __init__(self, facts: MapFacts) -> None:
        self.facts = facts
        self.directory = facts.directory
        self.names = FaceNames(facts.directory)
        self.known: dict[c.Criterion, b.BoundNode] = {}

    def bind(self, node: c.Criterion, text: str | None = None) -> b.BoundNode:
        """Resolve a criterion; ``text`` is how the user wrote it, for carets.

        Raises
        ------
        UnknownName, CriterionError
            with the place in the text.
        """
        try:
            return self._bind(node)
        except _Misfit as misfit:
            shown = text if text is not None else to_text(node)
            raise misfit.located(shown) from None

    def _bind(self, node: c.Criterion) -> b.BoundNode:
        if node not in self.known:
            self.known[node] = self._new(node)
        return self.known[node]

    def _new(self, node: c.Criterion) -> b.BoundNode:
        text = to_text(node)
        if isinstance(node, c.Not | c.And | c.Or | c.Xor):
            args = (node.arg,) if isinstance(node, c.Not) else node.args
            return b.BoundLogic(
                text=text,
                operator=type(node).__name__.lower(),
                args=tuple(self._bind(arg) for arg in args),
                is_point=node.is_point,
            )
        if isinstance(node, c.All | c.Then):
            bound = tuple(self._bind(arg) for arg in node.args)
            return (b.BoundAll if isinstance(node, c.All) else b.BoundThen)(text=text, args=bound)
        if isinstance(node, c.Source):
            names = [source.name for source in self.directory.sources]
            return b.BoundSource(text=text, table=self._table(node.names, names, "source")[:-1])
        if isinstance(node, c.Medium):
            names = [medium.name for medium in self.directory.media]
            return b.BoundMedium(text=text, table=self._table(node.names, names, "medium"))
        if isinstance(node, c.Hit):
            return self._hit(node, text)
        if isinstance(node, c.EventAt):
            return b.BoundHit(text=text, any_place=True, events=_event_masks(node.events))
        if isinstance(node, c.Detected):
            return self._detected(node, text)
        if isinstance(node, c.Last):
            return b.BoundLast(text=text, point=self._bind(node.point))
        if isinstance(node, c.Path):
            return self._path(node, text)
        if isinstance(node, c.Compare):
            return self._compare(node, text)
        raise CriterionError(f"cannot ask for {type(node).__name__}")

    def _table(self, patterns: Sequence[str], names: Sequence[str], kind: str) -> b.Bools:
        table = np.zeros(len(names) + 1, np.bool_)
        for pattern in patterns:
            try:
                table[match_indices(pattern, names, kind)] = True
            except UnknownName as error:
                raise _Misfit(error, quoted(pattern)) from None
        return table

    def _hit(self, node: c.Hit, text: str) -> b.BoundNode:
        matches = []
        # In a map of sources and detectors alone "any surface" is none, not a name that is wrong
        patterns = node.names if self.directory.objects else [x for x in node.names if x != "*"]
        for pattern in patterns:
            try:
                matches.append(match_objects(pattern, self.names))
            except UnknownName as error:
                raise _Misfit(error, quoted(pattern)) from None
        surfaces = self._surfaces(node.surface)
        places = _merged(matches, surfaces, self.names)
        return b.BoundHit(text=text, places=places, events=_event_masks(node.events))

    def _surfaces(self, tests: Sequence[c.SurfaceTest]) -> b.Bools | None:
        """Faces whose surface passes all tests on one side; None without tests."""
        if not tests:
            return None
        sides = [
            sides_of(surface.parameters | {"transmits": int(surface.transmits)})
            for surface in self.directory.surfaces
        ]
        known = sorted({name for surface in sides for side in surface for name in side})
        known = known or ["transmits"]
        for test in tests:
            if test.parameter not in known:
                error = unknown("surface parameter", test.parameter, known)
                raise _Misfit(error, test.parameter)
        passing = [any(passes(side, tests) for side in surface) for surface in sides]
        table = np.array([*passing, False], np.bool_)
        return np.append(table[self.names.table.surface], False)

    def _detected(self, node: c.Detected, text: str) -> b.BoundNode:
        detectors = self.directory.detectors
        table = self._table(node.names, [detector.name for detector in detectors], "detector")
        regions = {}
        if node.regions:
            for index in np.flatnonzero(table).tolist():
                regions[index] = tuple(
                    self._region(region, detectors[index]) for region in node.regions
                )
        return b.BoundDetected(
            text=text, table=table, registered=not isinstance(node, c.Crossed), regions=regions
        )

    def _region(self, region: c.Region, detector: Detector) -> b.BoundRegion:
        """In cells from the lower left corner."""
        numbers = region.numbers
        if region.unit:
            numbers = self._region_in_cells(region, detector)
        return b.BoundRegion(shape=region.shape, numbers=numbers, cells=detector.cells)

    def _region_in_cells(
        self, region: c.Region, detector: Detector
    ) -> tuple[float, float, float, float]:
        if detector.kind == "camera" and region.unit in ANGLES:
            return self._field_in_cells(region, detector)
        scale = self._region_scale(region.unit, detector)
        angles = cells_by_angle(detector)
        if angles is not None:
            per_unit = [scale * per_degree for per_degree, _ in angles]
            zero = [at_zero for _, at_zero in angles]
        else:
            per_unit = [scale * detector.cells[axis] / detector.size[axis] for axis in (0, 1)]
            zero = [detector.cells[0] / 2, detector.cells[1] / 2]
        zero += [0.0, 0.0] if region.shape == "ellipse" else zero
        cells = [n * per_unit[place % 2] + zero[place] for place, n in enumerate(region.numbers)]
        return cells[0], cells[1], cells[2], cells[3]

    def _field_in_cells(
        self, region: c.Region, detector: Detector
    ) -> tuple[float, float, float, float]:
        """Field angles of a camera, across and up; its picture is even in their tangents."""
        degrees = [n * convert(1.0, region.unit, "incidence", "mm", "W") for n in region.numbers]
        half = detector.parameters.get("half_field") or [size / 2 for size in detector.size]
        problem = ""
        if region.shape == "ellipse":
            problem = "an ellipse in angles is none in the picture of a camera; write cells"
        elif max(abs(angle) for angle in degrees) >= 90.0:
            problem = "field angles of a camera are less than 90° from its axis"
        if problem:
            message = f"region of detector {detector.name!r}: {problem}"
            raise _Misfit(CriterionError(message), region.unit)
        cells = [
            (np.tan(np.radians(angle)) / half[place % 2] + 1.0) * detector.cells[place % 2] / 2
            for place, angle in enumerate(degrees)
        ]
        return float(cells[0]), float(cells[1]), float(cells[2]), float(cells[3])

    def _region_scale(self, unit: str, detector: Detector) -> float:
        own = detector.parameters.get("size_unit")
        try:
            if own in ANGLES:
                degrees = convert(1.0, unit, "incidence", "mm", "W")
                return degrees if own == "deg" else float(np.radians(degrees))
            return length_factor(unit, own or self.directory.length_unit)
        except CriterionError as error:
            message = f"region of detector {detector.name!r}: {error}"
            raise _Misfit(CriterionError(message), unit) from None

    def _path(self, node: c.Path, text: str) -> b.BoundNode:
        try:
            machine = bind_path(node.text, node.exact, self.directory, self.names)
        except UnknownName as error:
            name = str(error).split('"')[1] if '"' in str(error) else node.text
            raise _Misfit(error, name) from None
        return b.BoundPath(text=text, machine=machine)

    def _compare(self, node: c.Compare, text: str) -> b.BoundNode:
        quantity = node.quantity
        try:
            value = convert(
                node.value,
                node.unit,
                quantity.word,
                self.directory.length_unit,
                self.directory.flux_unit,
            )
        except CriterionError as error:
            raise _Misfit(error, node.unit) from None
        if isinstance(quantity, c.Count):
            point = self._bind(quantity.point)
            return b.BoundCount(text=text, operator=node.operator, value=value, point=point)
        if isinstance(quantity, c.Incidence):
            point = self._bind(quantity.point)
            return b.BoundIncidence(text=text, operator=node.operator, value=value, point=point)
        if isinstance(quantity, c.Bounces):
            return b.BoundBounces(text=text, operator=node.operator, value=value)
        if isinstance(quantity, c.Wavelength):
            channels = [w for chosen in self.facts.channel_sets for w in chosen.wavelengths_nm]
            possible = any(COMPARISONS[node.operator](w, value) for w in channels)
            return b.BoundWavelength(
                text=text, operator=node.operator, value=value, possible=possible
            )
        if isinstance(quantity, c.Flux):
            fluxes = np.array([source.flux for source in self.directory.sources], np.float64)
            return b.BoundFlux(
                text=text,
                operator=node.operator,
                value=value,
                per_weight=fluxes / np.maximum(self.facts.emitted, 1),
                weighted=self.facts.weighted,
                worth_by_color=self.facts.worth_by_color,
            )
        if isinstance(quantity, c.Recorded):
            column = "optical_path" if isinstance(quantity, c.OpticalPath) else "stokes"
            return b.BoundRecorded(
                text=text,
                operator=node.operator,
                value=value,
                word=quantity.word,
                column=column,
                stored=self.facts.has_column(column),
                point=None if quantity.point is None else self._bind(quantity.point),
            )
        return b.BoundLength(
            text=text,
            operator=node.operator,
            value=value,
            optical=isinstance(quantity, c.OpticalLength),
        )


def bind(node: c.Criterion, facts: MapFacts, text: str | None = None) -> b.BoundNode:
    """Resolve one criterion against a map."""
    return Binder(facts).bind(node, text)


class _Misfit(Exception):
    """An error that does not know its place in the text yet."""

    def __init__(self, error: CriterionError, needle: str) -> None:
        super().__init__(str(error))
        self.error, self.needle = error, needle

    def located(self, text: str) -> CriterionError:
        start = text.find(self.needle)
        if start < 0:
            return self.error
        carets = mark(text, start, start + len(self.needle))
        return type(self.error)(f"{self.error} (column {start + 1})\n{carets}")


def _event_masks(events: tuple[c.EventSet, ...]) -> b.EventMasks:
    """Masks of the alternatives; single words are merged, they mean any of them anyway."""
    single = 0
    masks: list[tuple[int, ...]] = []
    for words in events:
        if len(words) == 1:
            single |= int(FAMILIES[words[0]])
        else:
            masks.append(tuple(int(FAMILIES[word]) for word in words))
    return ((single,), *masks) if single else tuple(masks)


def _merged(
    matches: list[ObjectMatch], surfaces: b.Bools | None, names: FaceNames
) -> tuple[ObjectMatch, ...]:
    """One table for all names without primitives; primitives of one-primitive faces need none."""
    table = names.table
    objects = np.zeros(len(names.objects) + 1, np.bool_)
    faces = np.zeros(names.n_faces + 1, np.bool_)
    kept: list[ObjectMatch] = []
    if not matches and surfaces is not None:
        return (ObjectMatch(objects, surfaces),)
    for match in matches:
        if match.triangle < 0:
            objects |= match.objects
            faces |= match.faces
            continue
        single = np.append(table.primitive_count == 1, False)
        faces |= match.faces & single
        if (match.faces & ~single).any():
            kept.append(ObjectMatch(match.objects, match.faces & ~single, match.triangle))
    if surfaces is not None:
        # A surface is a property of faces, so whole objects become their faces.
        faces[:-1] |= objects[table.object]
        objects[:] = False
        faces &= surfaces
        kept = [ObjectMatch(item.objects, item.faces & surfaces, item.triangle) for item in kept]
    return (ObjectMatch(objects, faces), *kept)

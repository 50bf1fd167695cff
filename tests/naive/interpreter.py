"""Criteria asked of one ray at a time, row by row, in the plainest words.

The oracle of the query room: it knows rays as lists of Python numbers and looks every name up anew.
It shares the expression tree with the product and the reading of places, and nothing else.
"""

from __future__ import annotations

import math
import operator
from typing import Any

from query.engine.places import parse_place
from raymap.model.directory import Directory
from raymap.model.events import FAMILIES, Event
from tests.naive.path_expression import read_alternatives, tokens_of
from tests.naive.rays import Point, Ray
from tests.query import nodes as c

COMPARE = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


def _name_fits(pattern: str, name: str) -> bool:
    """Wildcards by recursion."""
    if not pattern:
        return not name
    if pattern[0] == "*":
        return _name_fits(pattern[1:], name) or (bool(name) and _name_fits(pattern, name[1:]))
    if pattern[0] == "\\":
        return bool(name) and name[0] == pattern[1] and _name_fits(pattern[2:], name[1:])
    return bool(name) and pattern[0] in ("?", name[0]) and _name_fits(pattern[1:], name[1:])


def _split(pattern: str) -> tuple[str, str | None]:
    place = 0
    last = None
    while place < len(pattern):
        if pattern[place] == "\\":
            place += 1
        elif pattern[place] == ".":
            last = place
        place += 1
    return (pattern, None) if last is None else (pattern[:last], pattern[last + 1 :])


class Interpreter:
    """Answers for one map."""

    def __init__(self, map: Any) -> None:
        self.directory: Directory = map.directory
        self.channel_sets = map.channel_sets
        self.emitted = [int(count) for count in map.emitted]
        self.faces = []  # (object index, names by which the face goes)
        for number, item in enumerate(self.directory.objects):
            for face in item.faces:
                names = [(item.name, face.name)]
                names += [tuple(alias.rsplit(".", 1)) for alias in face.aliases]
                self.faces.append((number, names))

    # Names.

    def at_place(self, pattern: str, point: Point, aliases: bool = True) -> bool:
        if point.object < 0:
            return False
        own = self.directory.objects[point.object].name
        known = [names if aliases else names[:1] for _, names in self.faces]
        face_names = [] if point.face < 0 else known[point.face]
        owner, face = _split(pattern)
        if face is not None and face.startswith("#"):
            return point.face >= 0 and _name_fits(owner, own) and point.triangle == int(face[1:])
        if face is not None and any(
            _name_fits(owner, a) and _name_fits(face, b)
            for _, names in self.faces
            for a, b in names
        ):
            return any(_name_fits(owner, a) and _name_fits(face, b) for a, b in face_names)
        return _name_fits(pattern, own) or any(_name_fits(pattern, a) for a, _ in face_names)

    def detectors(self, patterns: tuple[str, ...]) -> set[int]:
        return {
            index
            for index, detector in enumerate(self.directory.detectors)
            if any(_name_fits(pattern, detector.name) for pattern in patterns)
        }

    # Points.

    def happened(self, events: tuple[c.EventSet, ...], event: int) -> bool:
        return not events or any(
            all(event & int(FAMILIES[word]) for word in words) for words in events
        )

    def point(self, node: c.Criterion, ray: Ray, k: int) -> bool:
        here = ray.points[k]
        if isinstance(node, c.Hit):
            if k == 0 or here.object < 0:
                return False
            named = not node.names or any(self.at_place(name, here) for name in node.names)
            return (
                named
                and self.surface(node.surface, here)
                and self.happened(node.events, here.event)
            )
        if isinstance(node, c.EventAt):
            return self.happened(node.events, here.event)
        return self.logic(node, lambda arg: self.point(arg, ray, k))

    def surface(self, tests: tuple[c.SurfaceTest, ...], here: Point) -> bool:
        if not tests:
            return True
        if here.face < 0:
            return False
        owner, _ = self.faces[here.face]
        first = next(i for i, (number, _) in enumerate(self.faces) if number == owner)
        surface = self.directory.objects[owner].faces[here.face - first].surface
        if surface < 0:
            return False
        entry = self.directory.surfaces[surface]
        parameters = entry.parameters | {"transmits": int(entry.transmits)}
        common = {k: v for k, v in parameters.items() if not isinstance(v, dict)}
        sides = [common] + [common | v for v in parameters.values() if isinstance(v, dict)]
        return any(
            all(
                t.parameter in side and COMPARE[t.operator](side[t.parameter], t.value)
                for t in tests
            )
            for side in sides
        )

    def logic(self, node: c.Criterion, ask: Any) -> bool:
        if isinstance(node, c.Not):
            return not ask(node.arg)
        if isinstance(node, c.And | c.All):
            return all([ask(arg) for arg in node.args])
        if isinstance(node, c.Or):
            return any([ask(arg) for arg in node.args])
        if isinstance(node, c.Xor):
            return sum([ask(arg) for arg in node.args]) % 2 == 1
        raise AssertionError(node)

    # Rays.

    def crosses(self, text: str, ray: Ray) -> bool:
        """Whether some segment of the ray registers at a place, segment by segment."""
        place = parse_place(text, self.directory)
        entry = place.detector
        u, v, center = entry.axis_u, entry.axis_v, entry.center
        n = (
            u[1] * v[2] - u[2] * v[1],
            u[2] * v[0] - u[0] * v[2],
            u[0] * v[1] - u[1] * v[0],
        )
        for number, (a, b) in enumerate(zip(ray.points, ray.points[1:], strict=False)):
            p = [x - y for x, y in zip(a.position, center, strict=True)]
            d = [x - y for x, y in zip(b.position, a.position, strict=True)]
            leaves = number == len(ray.points) - 2 and bool(b.event & int(Event.LEFT_SCENE))
            if not any(d):
                continue
            if entry.kind == "surface":
                times = _meets_sphere(p, d, entry.parameters["sphere_radius"], leaves)
                if place.both_sides and times:
                    return True
                continue
            height, rise = _dot(p, n), _dot(d, n)
            after = rise * math.inf if leaves and rise else height + rise
            if (height < 0.0) == (after < 0.0):
                continue
            q = [x - height / rise * y for x, y in zip(p, d, strict=True)]
            inside = all(
                0.0 <= _dot(q, axis) / size + 0.5 <= 1.0
                for axis, size in zip((u, v), entry.size, strict=True)
            )
            facing = -rise / math.sqrt(_dot(d, d))
            facing = abs(facing) if place.both_sides else facing
            if inside and facing > 0.0 and facing >= place.least_cosine:
                return True
        return False

    def ray(self, node: c.Criterion, ray: Ray) -> bool:
        points = ray.points
        if isinstance(node, c.Hit | c.EventAt | c.All):
            return any(self.point(node, ray, k) for k in range(len(points)))
        if isinstance(node, c.Source):
            name = self.directory.sources[ray.source].name
            return any(_name_fits(pattern, name) for pattern in node.names)
        if isinstance(node, c.Medium):
            names = [self.directory.media[p.medium].name for p in points[:-1] if p.medium >= 0]
            return any(_name_fits(pattern, name) for pattern in node.names for name in names)
        if isinstance(node, c.Detected):
            return any(self.meets(node, m) for p in points for m in p.crossings)
        if isinstance(node, c.Crosses):
            return any(self.crosses(text, ray) for text in node.places)
        if isinstance(node, c.Last):
            return self.point(node.point, ray, len(points) - 1)
        if isinstance(node, c.Then):
            return self.sequence(node.args, ray, -1)
        if isinstance(node, c.Path):
            return self.path(node, ray)
        if isinstance(node, c.Compare):
            return self.compare(node, ray)
        return self.logic(node, lambda arg: self.ray(arg, ray))

    def meets(self, node: c.Detected, crossing: tuple[int, bool, tuple[int, int]]) -> bool:
        detector, registered, uv = crossing
        if detector not in self.detectors(node.names):
            return False
        if not isinstance(node, c.Crossed) and not registered:
            return False
        return not node.regions or any(self.inside(r, detector, uv) for r in node.regions)

    def inside(self, region: c.Region, detector: int, uv: tuple[int, int]) -> bool:
        it = self.directory.detectors[detector]
        x, y = (uv[k] * it.cells[k] / 65535 for k in (0, 1))
        a, b, p, q = region.numbers
        if region.unit == "mm":
            # The origin is the centre, the point is moved instead of the region.
            x = x / it.cells[0] * it.size[0] - it.size[0] / 2
            y = y / it.cells[1] * it.size[1] - it.size[1] / 2
        if region.shape == "rect":
            return a <= x < p and b <= y < q
        return ((x - a) / p) ** 2 + ((y - b) / q) ** 2 <= 1

    def sequence(self, args: tuple[c.Criterion, ...], ray: Ray, after: float) -> bool:
        """Whether the operands can be found in order after place ``after``.

        Point k stands at place k; the m-th of n crossings on its segment at k + (m + 1) / (n + 1).
        """
        if not args:
            return True
        for k, point in enumerate(ray.points):
            places: list[float] = []
            if isinstance(args[0], c.Detected):
                n = len(point.crossings) + 1
                places = [
                    k + (m + 1) / n
                    for m, crossing in enumerate(point.crossings)
                    if self.meets(args[0], crossing)
                ]
            elif self.point(args[0], ray, k):
                places = [float(k)]
            if any(p > after and self.sequence(args[1:], ray, p) for p in places):
                return True
        return False

    # Path expressions: sets of places reached, no automaton.

    def path(self, node: c.Path, ray: Ray) -> bool:
        tree, rest = read_alternatives(tokens_of(node.text))
        assert not rest
        if node.exact:
            tokens: list[tuple[str, int]] = []
            for k, point in enumerate(ray.points):
                tokens.append(("point", k))
                tokens += [("met", m[0]) for m in point.crossings if m[1]]
            return len(tokens) in self.reach(tree, {0}, ray, tokens)
        tokens = [("point", k) for k in range(len(ray.points))]
        return len(tokens) in self.reach(tree, {0}, ray, None)

    def reach(self, tree: Any, places: set[int], ray: Ray, tokens: Any) -> set[int]:
        kind = tree[0]
        if kind == "sequence":
            for part in tree[1]:
                places = self.reach(part, places, ray, tokens)
            return places
        if kind == "either":
            return set().union(*(self.reach(part, places, ray, tokens) for part in tree[1]))
        if kind == "repeat":
            _, part, least, most = tree
            found = set(places) if least == 0 else set()
            number = 0
            seen: list[set[int]] = []
            while number < (most if most is not None else 10**6):
                places = self.reach(part, places, ray, tokens)
                number += 1
                if number >= least:
                    found |= places
                    if not places or places in seen:
                        break
                    seen.append(places)
            return found
        return {end for place in places for end in self.one(tree, place, ray, tokens)}

    def one(self, element: Any, place: int, ray: Ray, tokens: Any) -> set[int]:
        n = len(ray.points)
        if element[0] == "detector":
            wanted = self.detectors((element[1],))
            if tokens is not None:
                ok = (
                    place < len(tokens) and tokens[place][0] == "met" and tokens[place][1] in wanted
                )
                return {place + 1} if ok else set()
            segment = place - 1 if place < n else n - 2
            if place == 0 or segment < 0:
                return set()
            met = ray.points[segment].crossings
            return {place} if any(m[1] and m[0] in wanted for m in met) else set()
        if tokens is not None:
            if place >= len(tokens) or tokens[place][0] != "point":
                return set()
            k = tokens[place][1]
        else:
            k = place
            if k >= n:
                return set()
        return {place + 1} if self.fits(element, k, ray, tokens is not None) else set()

    def fits(self, element: Any, k: int, ray: Ray, exact: bool) -> bool:
        here = ray.points[k]
        if element[0] == "any":
            return True
        _, name, words = element
        if name is None:
            placed = here.object < 0
        elif k == 0:
            placed = _name_fits(name, self.directory.sources[ray.source].name)
        else:
            placed = self.at_place(name, here, aliases=not exact)
        if not placed:
            return False
        if exact:
            return self.events_exact(words, here.event)
        return not words or any(here.event & int(FAMILIES[word]) for word in words)

    def events_exact(self, words: list[str], event: int) -> bool:
        informative = (
            Event.EMITTED
            | Event.DETECTOR_CROSSED
            | Event.DETECTOR_REGISTERED
            | Event.MEDIUM_CHANGED
            | Event.DISPERSIVE_SELECT
            | Event.RIM_HIT
        )
        named = 0
        for word in words:
            if not event & int(FAMILIES[word]):
                return False
            named |= int(FAMILIES[word])
        return event & ~int(informative) & ~named == 0

    # Quantities.

    def compare(self, node: c.Compare, ray: Ray) -> bool:
        compare = COMPARE[node.operator]
        quantity, points = node.quantity, ray.points
        value = node.value
        if isinstance(quantity, c.Count):
            number = sum(self.point(quantity.point, ray, k) for k in range(len(points)))
            return compare(number, value)
        if isinstance(quantity, c.Bounces):
            return compare(max(len(points) - 2, 0), value)
        if isinstance(quantity, c.Wavelength):
            if len(ray.channels) != 1:
                return False
            scale = {"": 1.0, "nm": 1.0, "um": 1000.0}[node.unit]
            return compare(self.channel_sets[0].wavelengths_nm[ray.channels[0]], value * scale)
        if isinstance(quantity, c.Flux):
            source = self.directory.sources[ray.source]
            return compare(source.flux / self.emitted[ray.source] * ray.weight, value)
        scale = {"": 1.0, "mm": 1.0, "cm": 10.0, "deg": 1.0}[node.unit]
        if isinstance(quantity, c.Incidence):
            angles = [
                self.incidence(points, k)
                for k in range(len(points))
                if self.point(quantity.point, ray, k)
            ]
            return any(angle is not None and compare(angle, value * scale) for angle in angles)
        if isinstance(quantity, c.Recorded):
            if quantity.point is None:
                gone = len(points) > 1 and bool(points[-1].event & int(Event.LEFT_SCENE))
                is_path = isinstance(quantity, c.OpticalPath)
                chosen = [len(points) - 1 - gone if is_path else len(points) - 2]
            else:
                chosen = [k for k in range(len(points)) if self.point(quantity.point, ray, k)]
            found = [self.recorded(quantity, points, k) for k in chosen if k >= 0]
            return any(number is not None and compare(number, value * scale) for number in found)
        total = self.length(ray, isinstance(quantity, c.OpticalLength))
        return total is not None and compare(total, value * scale)

    def recorded(self, quantity: c.Recorded, points: list[Point], k: int) -> float | None:
        here = points[k]
        if isinstance(quantity, c.OpticalPath):
            return here.optical_path
        if k == len(points) - 1 or here.stokes is None:
            return None
        s1, s2, s3 = here.stokes
        if isinstance(quantity, c.DegreeOfPolarisation):
            return math.sqrt(s1 * s1 + s2 * s2 + s3 * s3)
        if math.hypot(s1, s2) <= 1e-6:
            return None
        angle = math.degrees(math.atan2(s2, s1)) / 2
        return angle + 180 if angle <= -90 else angle

    def length(self, ray: Ray, optical: bool) -> float | None:
        points = ray.points
        n = len(points) - 1
        if points[-1].event & int(Event.LEFT_SCENE):
            n -= 1
        total = 0.0
        for k in range(n):
            step = math.dist(points[k].position, points[k + 1].position)
            if not optical:
                total += step
                continue
            medium = points[k].medium
            if medium < 0:
                return None
            indices = {self.channel_sets[0].refractive_index[medium][ch] for ch in ray.channels}
            if len(indices) != 1:
                return None
            total += indices.pop() * step
        return total

    def incidence(self, points: list[Point], k: int) -> float | None:
        if k == 0 or points[k].object < 0:
            return None
        d = [a - b for a, b in zip(points[k].position, points[k - 1].position, strict=True)]
        n = points[k].normal
        size = math.sqrt(sum(x * x for x in d)) * math.sqrt(sum(x * x for x in n))
        if size == 0:
            return None
        cosine = abs(sum(a * b for a, b in zip(d, n, strict=True))) / size
        return math.degrees(math.acos(min(cosine, 1.0)))


def _dot(a: Any, b: Any) -> float:
    return float(sum(x * y for x, y in zip(a, b, strict=True)))


def _meets_sphere(p: Any, d: Any, radius: float, leaves: bool) -> list[float]:
    """Where along a segment a sphere about the origin lies."""
    a, b, c0 = _dot(d, d), _dot(p, d), _dot(p, p) - radius**2
    square = b * b - a * c0
    if square <= 0.0:
        return []
    roots = [(-b - math.sqrt(square)) / a, (-b + math.sqrt(square)) / a]
    return [t for t in roots if t > 0.0 and (t <= 1.0 or leaves)]

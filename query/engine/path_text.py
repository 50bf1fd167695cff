"""Itineraries as text that reads back as a path expression."""

from __future__ import annotations

from query.engine.context import PathContext
from query.engine.path_machine import PRINCIPAL
from query.expression.names import PATH_SPECIAL, escape
from query.expression.words import quoted
from raymap.model.directory import Directory
from raymap.model.events import event_names

__all__ = ["exact_criterion", "path_text"]


def _name(name: str) -> str:
    return escape(name, PATH_SPECIAL + "\t\n\r")


class PathNames:
    """Names of a map as path expressions spell them."""

    def __init__(self, directory: Directory) -> None:
        self.sources = [_name(source.name) for source in directory.sources]
        self.objects = [_name(item.name) for item in directory.objects]
        self.detectors = [_name(detector.name) for detector in directory.detectors]
        self.faces = [
            f"{_name(item.name)}.{_name(face.name)}"
            for item in directory.objects
            for face in item.faces
        ]
        self.events: dict[int, str] = {}

    def happened(self, event: int) -> str:
        """``:event,event`` of the principal events, empty where there are none."""
        bits = event & PRINCIPAL
        if bits not in self.events:
            words = event_names(bits)
            self.events[bits] = ":" + ",".join(words) if words else ""
        return self.events[bits]


def path_text(base: PathContext, row: int, names: PathNames, by: str) -> str:
    """The itinerary of one path, at the granularity ``by`` ("face" or "object")."""
    words = []
    begin, end = int(base.offsets[row]), int(base.offsets[row + 1])
    for point in range(begin, end):
        owner, face = int(base.object[point]), int(base.face[point])
        if point == begin:
            name = names.sources[int(base.source[row])]
        elif owner < 0:
            name = ""
        elif by == "face" and face >= 0:
            name = names.faces[face]
        else:
            name = names.objects[owner]
        words.append((name + names.happened(int(base.event[point]))) or ":")
        first, last = int(base.crossing_offsets[point]), int(base.crossing_offsets[point + 1])
        words.extend(
            "@" + names.detectors[int(base.detector[crossing])]
            for crossing in range(first, last)
            if base.registered[crossing]
        )
    return " ".join(words)


def exact_criterion(text: str) -> str:
    """The criterion that selects exactly the rays of a path."""
    return f"path({quoted(text)}, exact)"

"""Paths in words: a short headline of a long itinerary."""

from __future__ import annotations

import re

from raymap.model.wildcards import characters

__all__ = ["headline"]

_MIRRORED = ("specular_reflection", "tir")
_REFLECTED = (*_MIRRORED, "diffuse_reflection", "glossy_reflection")
_MARKS = {"tir": " (total)", "diffuse_reflection": " (diffuse)", "glossy_reflection": " (glossy)"}
_ENDINGS = {
    "surface_absorption": "absorbed",
    "volume_absorption": "absorbed inside",
    "left": "left",
    "depth_limit": "stopped",
    "roulette_kill": "stopped",
    "geometry_error": "geometry error",
}


def _points(path: str) -> list[tuple[str, list[str]]]:
    """(name, event words) of each point; a detector has the name "@…" and no events."""
    found = []
    for word in re.split(r"(?<!\\) ", path):
        name, _, events = _split(word)
        found.append(
            (
                "".join(character for character, _ in characters(name)),
                [e for e in events.split(",") if e],
            )
        )
    return found


def _split(word: str) -> tuple[str, str, str]:
    """Name and events at the first colon that is not escaped."""
    index = re.search(r"(?<!\\):", word)
    if index is None:
        return word, "", ""
    return word[: index.start()], ":", word[index.end() :]


def headline(path: str) -> str:
    """What distinguishes a path: where it was reflected or scattered, and where it ended.

    >>> headline("lamp:emitted L1.front:refracted @eye eye.front:surface_absorption")
    'straight to eye'
    >>> headline("lamp:emitted plate.front:glossy_transmission @eye eye.front:surface_absorption")
    'plate.front (glossy) → eye'
    """
    points = _points(path)
    turns = []
    for name, events in points[1:]:
        for event in events:
            if event in _REFLECTED:
                turns.append(f"{name or 'medium'} ↩{_MARKS.get(event, '')}")
            elif event in ("diffuse_transmission", "glossy_transmission"):
                turns.append(f"{name} ({event.removesuffix('_transmission')})")
            elif event == "volume_scatter":
                turns.append("scattered")
    short = _counted(turns)
    name, events = points[-1]
    ending = next((_ENDINGS[event] for event in events if event in _ENDINGS), "")
    seen = points[-2][0][1:] if len(points) > 1 and points[-2][0].startswith("@") else ""
    if seen:
        end = seen
    elif ending == "left":
        end = "out of the scene"
    else:
        end = f"{name or 'medium'}{ending and ', ' + ending}"
    return f"{' '.join(short)} → {end}" if short else f"straight to {end}"


def _counted(turns: list[str]) -> list[str]:
    """Turns with repetitions of one, or of two that alternate, counted."""
    short: list[str] = []
    at = 0
    while at < len(turns):
        period, times = 1, 1
        for length in (1, 2):
            unit, count = turns[at : at + length], 1
            while turns[at + count * length : at + (count + 1) * length] == unit:
                count += 1
            if count > 1 and length * count > period * times:
                period, times = length, count
        text = " ".join(turns[at : at + period])
        text = f"({text})" if period > 1 else text
        short.append(f"{text} ×{times}" if times > 1 else text)
        at += period * times
    return short

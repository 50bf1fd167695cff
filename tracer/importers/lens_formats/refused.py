"""Lens files that are known and not read: what they are, and what to do."""

from __future__ import annotations

from tracer.importers.lens_format import LensFormat

__all__ = ["KINDS"]

KINDS = (
    LensFormat(
        suffixes=(".zar",),
        title="an archive of OpticStudio",
        remedy="open it there and save the lens as .zmx",
        place=2010,
    ),
    LensFormat(
        suffixes=(".zos",),
        title="a file of OpticStudio that is no text",
        remedy="open it there and save the lens as .zmx",
        place=2020,
    ),
    LensFormat(
        suffixes=(".zmf",),
        title="a catalogue of lenses of OpticStudio",
        remedy="open one there and save the lens as .zmx",
        place=2030,
    ),
    LensFormat(
        suffixes=(".len",),
        title="a lens of CODE V or OSLO that is not understood",
        remedy="save the lens as .seq or .zmx",
        place=2040,
    ),
    LensFormat(
        suffixes=(".roa",),
        title="a lens of ray-optics, which is not understood",
        remedy="save the lens as .zmx or .seq in the program that it comes from",
        place=2050,
    ),
)

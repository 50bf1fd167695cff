"""Shapes of luminous openings that the signs of sizes say in LM-63 and EULUMDAT.

LM-63 gives width (along C90), length (along C0) and height; a negative size is that of something
round. The code was made anew in 2002, and three patterns changed their meaning. Those that an
edition does not define are read as the other editions do, since programs mix them::

    width length height   1986 and 1991        1995                 2002 and 2019
    0     0      0        point                point                point
    +     +      0        rectangle            rectangle            rectangle
    +     +      +        box                  box                  box
    -     0      0        disc                 disc                 (disc)
    -     0      +        upright cylinder     upright cylinder     (upright cylinder)
    -     0      -        (sphere)             sphere               disc or ellipse facing C0
    0     +      -        (tube along C0)      tube along C0        (tube along C0)
    +     0      -        (tube along C90)     tube along C90       (tube along C90)
    -     +      0        ellipse              ellipse              (ellipse)
    +     -      0        (ellipse)            ellipse              (ellipse)
    -     +      +        ellipsoid            upright elliptic     (upright elliptic
    +     -      +        (ellipsoid)          cylinder             cylinder)
    -     +      -        (ellipsoid)          ellipsoid            tube along C0
    +     -      -        (ellipsoid)          ellipsoid            tube along C90
    -     -      0        (disc or ellipse)    (disc or ellipse)    disc or ellipse
    -     -      +        (upright cylinder)   (upright cylinder)   upright cylinder
    -     -      -        (sphere, ellipsoid)  (sphere, ellipsoid)  sphere or ellipsoid

References
----------
ANSI/IES LM-63-19 and IESNA LM-63-02, 5.11, table 1; IESNA LM-63-95; the editions side by side in
G. Ward and others, Radiance, ``ies2rad``.
"""

from __future__ import annotations

import warnings

from tracer.light import Opening, OpeningShape

__all__ = ["OpeningLike", "opening_of_eulumdat", "opening_of_lm63"]

OpeningLike = float | tuple[float, float] | Opening | None

_THIN = 1e-6
"""Share of the longest size that stands for a size of 0 [1]."""

_ROUND: dict[tuple[int, int, int], OpeningShape] = {
    (-1, 0, 0): "ellipse",
    (0, -1, 0): "ellipse",
    (-1, 1, 0): "ellipse",
    (1, -1, 0): "ellipse",
    (-1, -1, 0): "ellipse",
    (-1, 0, 1): "upright cylinder",
    (0, -1, 1): "upright cylinder",
    (-1, 1, 1): "upright cylinder",
    (1, -1, 1): "upright cylinder",
    (-1, -1, 1): "upright cylinder",
    (0, 1, -1): "cylinder along C0",
    (1, 0, -1): "cylinder along C90",
    (-1, -1, -1): "ellipsoid",
}
"""Signs of width, length, height that mean the same in all editions that define them."""

_UNTIL_1991: dict[tuple[int, int, int], OpeningShape] = {
    (-1, 1, 1): "ellipsoid",
    (1, -1, 1): "ellipsoid",
}
_UNTIL_1995: dict[tuple[int, int, int], OpeningShape] = {
    (-1, 0, -1): "ellipsoid",
    (0, -1, -1): "ellipsoid",
    (-1, 1, -1): "ellipsoid",
    (1, -1, -1): "ellipsoid",
}
_FROM_2002: dict[tuple[int, int, int], OpeningShape] = {
    (-1, 0, -1): "cylinder along C0",
    (0, -1, -1): "cylinder along C90",
    (-1, 1, -1): "cylinder along C0",
    (1, -1, -1): "cylinder along C90",
}


def opening_of_lm63(
    name: str, edition: int, width: float, length: float, height: float
) -> OpeningLike:
    """The luminous opening of an LM-63 file.

    Parameters
    ----------
    name : of the file, for messages
    edition : year of LM-63
    width, length, height : as in the file [its unit of length]
    """
    if min(width, length, height) >= 0.0:
        return _angular(length, width, height)
    signs = _sign(width), _sign(length), _sign(height)
    known = dict(_ROUND)
    known |= _FROM_2002 if edition >= 2002 else _UNTIL_1995
    known |= _UNTIL_1991 if edition < 1995 else {}
    along, across, high = abs(length), abs(width), abs(height)
    if signs not in known:
        warnings.warn(
            f"{name}: sizes of the luminous opening {width:g}, {length:g}, {height:g} mean nothing "
            "in LM-63; light starts from a rectangle (a box) of these sizes",
            stacklevel=4,
        )
        return _angular(along, across, high)
    shape = known[signs]
    if shape.startswith("cylinder"):
        # A tube that states one size across is round; one without length is a disc on its edge
        if shape == "cylinder along C0":
            return Opening(shape=shape, size=(along, across or high, high))
        return Opening(shape=shape, size=(along or high, across, high))
    # One diameter stands for both
    along, across = along or across, across or along
    if shape == "ellipse":
        return along if along == across else Opening(shape=shape, size=(along, across, 0.0))
    return Opening(shape=shape, size=(along, across, high))


def opening_of_eulumdat(
    name: str, length: float, width: float, heights: tuple[float, ...]
) -> OpeningLike:
    """The luminous opening of an EULUMDAT file: length along C90, width along C0; width 0 is round.

    Parameters
    ----------
    heights : of the sides that shine, towards C0, C90, C180 and C270
    """
    high = max(0.0, *heights)
    if high > 0.0 and min(heights) != high:
        warnings.warn(
            f"{name}: its luminous sides are {', '.join(f'{height:g}' for height in heights)} mm "
            f"high; light starts from a body {high:g} mm high all round",
            stacklevel=4,
        )
    if length > 0.0 >= width:
        size = (length, length, high)
        return Opening(shape="upright cylinder", size=size) if high > 0.0 else length
    return _angular(max(0.0, width), max(0.0, length), high)


def _angular(along: float, across: float, high: float) -> OpeningLike:
    """A point, rectangle or box; lines are thin rectangles."""
    longest = max(along, across, high)
    if longest == 0.0:
        return None
    least = _THIN * longest
    if high == 0.0:
        return max(along, least), max(across, least)
    return Opening(shape="box", size=(max(along, least), max(across, least), high))


def _sign(size: float) -> int:
    return (size > 0.0) - (size < 0.0)

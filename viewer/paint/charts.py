"""Charts of detectors: false colours with a scale, cross sections, candela diagrams."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from query import DetectorImage, detector_image
from query.answers.images.beams import BeamPlane, beam_of
from query.answers.images.readings import reading_lines, readings
from raymap import RayMap
from raymap.model.errors import RayMapError
from raymap.pictures.files import check_chart, write_chart
from viewer.drawn.falsecolor import COLORMAPS, apply_colormap

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["chart"]

Array = NDArray[np.float64]

_DECADES = 1e-5
"""A logarithmic scale without a lower end goes down to this share of the highest value."""
_PICTURE = (5.6, 4.4)
"""Room for a picture in false colours [inch]."""
_MOST_DRAWN = 1024
"""Cells along either axis of a picture: about as many as it has pixels."""
_COLORS = ("#1f5fa8", "#d9480f")


def chart(
    map: RayMap,
    detector: str,
    criterion: Any = None,
    *,
    out: str | Path,
    bin: int = 1,
    luminous: bool = False,
    log: bool = False,
    low: float | None = None,
    high: float | None = None,
    at: tuple[float, float] | None = None,
    colors: str = "inferno",
    title: str | None = None,
) -> dict[str, Any]:
    """Draw what a selection put on a detector, with axes and a scale.

    Planes, faces and cameras in false colours with cross sections; far fields as a polar diagram
    and over the angle, in the planes C0 and C90, with the angles of the beam.

    Parameters
    ----------
    detector : name
    criterion : text, tree or JSON; None: all rays
    out : .png, .pdf or .svg, and others as they are installed (``raymap kinds chart_formats``)
    bin : join blocks of so many cells by so many, against speckle
    luminous : lux, candela … of a spectral map in watts
    log : a logarithmic scale
    low, high : ends of the scale; by default 0 (of a logarithmic one the least light, or 1e-5 of
        the highest value) and the highest value
    at : place of the cross sections, in the units of the axes; the middle unless given
    colors : one of `viewer.drawn.falsecolor.COLORMAPS`
    title : by default the map's title, the detector and the criterion

    Returns
    -------
    what stands below the chart (`query.answers.images.readings`): flux, peak, mean, evenness,
    angles of the beam

    Raises
    ------
    UnknownName, CriterionError, RayMapError
    MissingExtra
        Matplotlib is not installed.
    """
    check_chart(out)
    if colors not in COLORMAPS:
        raise RayMapError(f"no colour map {colors!r}; there are {', '.join(COLORMAPS)}")
    if (high is not None and high <= (low or 0.0)) or (low is not None and low < 0.0):
        raise RayMapError("the scale must go up: 0 <= low < high")
    figure = _figure()
    image = detector_image(map, detector, criterion, bin=bin)
    asked, name = _quantity(image, luminous)
    is_beam = image.detector.kind == "far_field" and image.measure is not None
    beam = beam_of(image, asked) if is_beam else None
    numbers = readings(image, asked, beam)
    label = f"{name} [{numbers['unit']}]"
    if beam is not None:
        _far_field(figure, beam.planes, label, log, low, high)
    else:
        _false_colors(figure, image, asked, label, (log, low, high), at, colors)
    what = "" if criterion is None else f": {criterion}"
    heading = title if title is not None else f"{map.directory.title} – {detector}{what}"
    figure.suptitle(_cut(heading.removeprefix(" – "), 90), fontsize=11)
    figure.text(0.5, 0.015, _wrapped(reading_lines(numbers)), ha="center", fontsize=9)
    write_chart(figure, out)
    return numbers


def _figure() -> Figure:
    from matplotlib.figure import Figure as NewFigure

    return NewFigure(figsize=(10.0, 5.6))


def _cut(text: str, room: int) -> str:
    return text if len(text) <= room else text[: room - 1] + "…"


def _quantity(image: DetectorImage, luminous: bool) -> tuple[str | None, str]:
    """The quantity that is drawn, None for that in the unit of the map, and what it is called."""
    name = image.density_name
    if name is None:
        return None, "flux per cell"
    luminous_name = {"irradiance": "illuminance", "intensity": "candela", "radiance": "luminance"}
    asked = luminous_name.get(name) if luminous else None
    name = asked or name
    return asked, "intensity" if name == "candela" else name


def _wrapped(lines: list[str], room: int = 130) -> str:
    """Lines of text side by side, as many as fit below a chart."""
    rows = [""]
    for line in lines:
        longer = f"{rows[-1]}   {line}" if rows[-1] else line
        if rows[-1] and len(longer) > room:
            rows.append(line)
        else:
            rows[-1] = longer
    return "\n".join(rows)


def _ends(values: Array, log: bool, low: float | None, high: float | None) -> tuple[float, float]:
    """Ends of the scale."""
    top = high if high is not None else float(values.max())
    top = top if top > 0.0 else 1.0
    if not log:
        return low or 0.0, top
    lit = values[values > 0.0]
    least = max(_DECADES * top, float(lit.min())) if len(lit) else _DECADES * top
    return low or min(least, 0.1 * top), top


def _far_field(
    figure: Figure,
    planes: Sequence[BeamPlane],
    label: str,
    log: bool,
    low: float | None,
    high: float | None,
) -> None:
    """A polar diagram, the axis downwards, and the same curves over the angle."""
    figure.subplots_adjust(left=0.06, right=0.97, bottom=0.18, top=0.84, wspace=0.25)
    polar: Any = figure.add_subplot(1, 2, 1, projection="polar")
    polar.set_theta_zero_location("S")
    plain = figure.add_subplot(1, 2, 2)
    bottom, top = _ends(np.concatenate([plane.values for plane in planes]), log, low, high)
    reach = 1.0
    for plane, color in zip(planes, _COLORS, strict=False):
        polar.plot(np.radians(plane.gamma_deg), plane.values, color=color, label=plane.name)
        plain.plot(plane.gamma_deg, plane.values, color=color, label=plane.name)
        spread = np.maximum(plane.values - plane.se, bottom), plane.values + plane.se
        plain.fill_between(plane.gamma_deg, *spread, color=color, alpha=0.2, lw=0)
        lit = np.abs(plane.gamma_deg[plane.values > 0.002 * top])
        reach = max(reach, 1.1 * float(lit.max())) if len(lit) else reach
    polar.set_ylim(0.0, top)
    polar.set_title(label, fontsize=9)
    polar.tick_params(labelsize=8)
    rings = [top / 4.0 * k for k in (1, 2, 3, 4)]
    polar.set_rticks(rings, [f"{ring:.3g}" for ring in rings])
    widest = min(180.0, reach) if not log else float(np.abs(planes[0].gamma_deg).max())
    plain.set_xlim(-widest, widest)
    _scale(plain, log, bottom, top)
    highest = max(plane.peak[0] for plane in planes)
    plain.axhline(0.5 * highest, color="0.7", lw=0.6, ls="--")
    plain.axhline(0.1 * highest, color="0.7", lw=0.6, ls=":")
    plain.set_xlabel("gamma [deg]")
    plain.set_ylabel(label)
    plain.legend(fontsize=8, frameon=False)


def _scale(axes: Axes, log: bool, bottom: float, top: float) -> None:
    if log:
        axes.set_yscale("log")
        axes.set_ylim(bottom, 1.1 * top)
    else:
        axes.set_ylim(bottom, 1.04 * top)
    axes.grid(alpha=0.25)


def _false_colors(
    figure: Figure,
    image: DetectorImage,
    asked: str | None,
    label: str,
    scale: tuple[bool, float | None, float | None],
    at: tuple[float, float] | None,
    colors: str,
) -> None:
    """The picture upright, a scale beside it, a cross section along either axis."""
    from matplotlib.colors import ListedColormap, LogNorm, Normalize

    density, side = _drawn(image, asked)
    if side > 1:
        label += f", means of {side} × {side} cells"
    width, height = image.detector.size
    n_v, n_u = density.shape
    # Blocks at the far borders may reach beyond the detector
    right, top_edge = (
        (n * side / cells - 0.5) * length
        for n, cells, length in zip((n_u, n_v), image.detector.cells, (width, height), strict=True)
    )
    unit = str(image.detector.parameters.get("size_unit", image.length_unit))
    bottom, top = _ends(density, *scale)
    norm = LogNorm(bottom, top) if scale[0] else Normalize(bottom, top)
    main, beside, below, bar = _panels(figure, width / height)
    table = apply_colormap(np.linspace(0.0, 1.0, 256), colors) / 255.0
    shown = main.imshow(
        np.maximum(density, bottom) if scale[0] else density,
        origin="lower",
        extent=(-width / 2, right, -height / 2, top_edge),
        cmap=ListedColormap(table),
        norm=norm,
        aspect="auto",
        interpolation="nearest",
    )
    figure.colorbar(shown, cax=bar, label=label)
    u, v = at or (0.0, 0.0)
    if abs(u) > width / 2 or abs(v) > height / 2:
        raise RayMapError(
            f"the cross sections at {u:g}, {v:g} lie beside the detector: u goes from "
            f"{-width / 2:g} to {width / 2:g}, v from {-height / 2:g} to {height / 2:g} {unit}"
        )
    main.set_xlim(-width / 2, width / 2)
    main.set_ylim(-height / 2, height / 2)
    main.axhline(v, color="white", lw=0.5, alpha=0.5)
    main.axvline(u, color="white", lw=0.5, alpha=0.5)
    main.set_ylabel(f"v [{unit}]")
    main.tick_params(labelbottom=False)
    cells_u, cells_v = image.detector.cells
    row = min(int((v / height + 0.5) * cells_v) // side, n_v - 1)
    column = min(int((u / width + 0.5) * cells_u) // side, n_u - 1)
    edges = np.linspace(-width / 2, right, n_u + 1)
    below.stairs(density[row], edges, color=_COLORS[0])
    _scale(below, scale[0], bottom, top)
    below.set_xlabel(f"u [{unit}]")
    edges = np.linspace(-height / 2, top_edge, n_v + 1)
    beside.stairs(density[:, column], edges, orientation="horizontal", color=_COLORS[1])
    beside.tick_params(labelleft=False, labelsize=8)
    beside.grid(alpha=0.25)
    if scale[0]:
        beside.set_xscale("log")
    beside.set_xlim(bottom, 1.1 * top if scale[0] else 1.04 * top)
    beside.xaxis.tick_top()


def _drawn(image: DetectorImage, asked: str | None) -> tuple[Array, int]:
    """(n_v, n_u) means over blocks, as many as the picture has pixels for, and their side."""
    lit, side = image.lit, -(-max(image.detector.cells) // _MOST_DRAWN)
    values = lit.quantity(asked)[0]
    if side == 1:
        return lit.spread(values), 1
    if image.measure is None:
        return lit.blocks(values, side) / side**2, side
    sizes = image.measure.sizes.joined(side)
    size = sizes.part(*map(range, sizes.shape))
    flux = lit.blocks(values * lit.size, side)
    return np.divide(flux, size, out=np.zeros_like(flux), where=size > 0.0), side


def _panels(figure: Figure, aspect: float) -> tuple[Axes, Axes, Axes, Axes]:
    """The picture in its true proportions, sections beside and below it, and the scale."""
    width, height = _PICTURE
    if 0.2 < aspect < 5.0:
        width, height = min(width, height * aspect), min(height, width / aspect)
    left, bottom, section, gap = 0.9, 0.95, 1.2, 0.15
    whole = (
        max(6.5, left + width + section + 2 * gap + 1.3),
        bottom + section + gap + height + 0.8,
    )
    left += 0.5 * (whole[0] - (left + width + section + 2 * gap + 1.3))
    figure.set_size_inches(*whole)

    def panel(x: float, y: float, w: float, h: float, **shared: Axes) -> Axes:
        place = (x / whole[0], y / whole[1], w / whole[0], h / whole[1])
        return figure.add_axes(place, **shared)  # type: ignore[call-overload, no-any-return]

    high = bottom + section + gap
    main = panel(left, high, width, height)
    beside = panel(left + width + gap, high, section, height, sharey=main)
    below = panel(left, bottom, width, section, sharex=main)
    return main, beside, below, panel(left + width + section + 2 * gap, high, 0.15, height)

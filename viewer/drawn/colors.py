"""Colours of rays: natural, or by a rule, with the legend that explains them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raymap.model.directory import Directory
from raymap.model.events import ENDINGS, FAMILIES, event_names
from raymap.optics.colorimetry import RGB_LUMINANCE, encode_srgb
from viewer.drawn.falsecolor import PALETTE, apply_colormap, wavelength_rgb
from viewer.drawn.lines import Lines
from viewer.drawn.rays import DrawnRays

__all__ = ["Legend", "LegendEntry", "color_lines", "optical_length"]

Rgb = NDArray[np.uint8]

_GREY = (150, 150, 150)
"""Of what no colour is left for."""

_COUNTED = 20
"""Numbers of reflections with a colour of their own."""

_CURVE = encode_srgb(np.linspace(0, 1, 4096)).astype(np.float32)
"""The sRGB curve by 4096 steps: a look-up beats a power for a million segments."""


@dataclass(frozen=True, kw_only=True)
class LegendEntry:
    """One colour and what it stands for."""

    label: str
    rgb: tuple[int, int, int]


@dataclass(frozen=True, kw_only=True)
class Legend:
    """What the colours of the rays mean; a scale has ``entries`` at equal steps of its range."""

    title: str
    entries: tuple[LegendEntry, ...] = ()
    scale: bool = False


def _by_category(
    values: NDArray[np.integer], labels: dict[int, str], title: str, *, counts_up: bool = False
) -> tuple[Rgb, Legend]:
    """One palette colour per different value, the commonest first; the rest shares a grey.

    ``counts_up`` lists the values of the legend in rising order.
    """
    different, inverse, counts = np.unique(values, return_inverse=True, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    listed, others = order[: len(PALETTE)], order[len(PALETTE) :]
    colors = np.empty((len(different), 3), np.uint8)
    colors[listed] = PALETTE[: len(listed)]
    colors[others] = _GREY
    if counts_up:
        listed = np.sort(listed)
    entries = [
        LegendEntry(label=labels.get(int(different[i]), str(different[i])), rgb=_rgb(colors[i]))
        for i in listed
    ]
    if len(others):
        entries.append(LegendEntry(label=f"{len(others):,} others", rgb=_GREY))
    return colors[inverse], Legend(title=title, entries=tuple(entries))


def _by_count(values: NDArray[np.int64], title: str) -> tuple[Rgb, Legend]:
    """Colours of numbers of events: of a palette while it has enough, else of a scale.

    The scale has a step for each number up to the twelfth colour's, and one for all beyond: numbers
    of reflections are mostly small, and a few rays of light guides have hundreds.
    """
    if len(np.unique(values)) <= len(PALETTE):
        return _by_category(values, {}, title, counts_up=True)
    low, steps = int(values.min()), _COUNTED
    colors = apply_colormap(np.linspace(0.0, 1.0, steps + 1), "turbo")
    places = np.minimum(values - low, steps)
    named = [str(low + step) for step in range(steps)] + [f"{low + steps} and more"]
    entries = tuple(
        LegendEntry(label=label, rgb=_rgb(color))
        for label, color in zip(named, colors, strict=True)
    )
    return colors[places], Legend(title=title, entries=entries)


def _rgb(color: NDArray[np.integer]) -> tuple[int, int, int]:
    return int(color[0]), int(color[1]), int(color[2])


def _by_scale(values: NDArray[np.floating], title: str, *, log: bool = False) -> tuple[Rgb, Legend]:
    """A colour map over the range of the finite values."""
    known = np.isfinite(values) & ((values > 0) | (not log))
    if not known.any():
        grey = np.broadcast_to(np.array([150, 150, 150], np.uint8), (len(values), 3))
        return grey, Legend(title=title)
    plain = np.log10(np.where(known, values, 1.0)) if log else np.where(known, values, 0.0)
    low, high = float(plain[known].min()), float(plain[known].max())
    span = (high - low) or 1.0
    colors = apply_colormap((plain - low) / span, "turbo")
    colors[~known] = 150
    places = np.linspace(0, 1, 5) if high > low else np.zeros(1)
    ticks = [10 ** (low + p * span) if log else low + p * span for p in places]
    steps = apply_colormap(places, "turbo")
    entries = tuple(
        LegendEntry(label=f"{tick:.4g}", rgb=_rgb(step))
        for tick, step in zip(ticks, steps, strict=True)
    )
    return colors, Legend(title=title, entries=entries, scale=True)


def optical_length(rays: DrawnRays) -> NDArray[np.float64]:
    """Sum of index times length over the segments of each ray, without the last one of rays that
    left the scene; a segment of unknown index makes it NaN.

    Returns
    -------
    (n_rays,) float64 [scene units]
    """
    if rays.n_rays == 0:
        return np.zeros(0)
    step = np.zeros(rays.n_records)
    points = rays.position.astype(np.float64)
    step[:-1] = np.linalg.norm(np.diff(points, axis=0), axis=1) * rays.index[:-1]
    last = rays.offsets[1:] - 1
    step[last] = 0
    left = (rays.event[last] & int(FAMILIES["left"])) != 0
    step[(last - 1)[left & (np.diff(rays.offsets) > 1)]] = 0
    return np.add.reduceat(step, rays.offsets[:-1])


def _natural(rays: DrawnRays, dark: bool) -> Rgb:
    """Hue of the light of each segment; brightness only as far as the background needs it."""
    linear = np.clip(rays.rgb, 0, None)
    brightest = np.maximum(linear.max(axis=1, keepdims=True), 1e-9)
    shown = _CURVE[np.rint(linear / brightest * (len(_CURVE) - 1)).astype(np.int16)]
    luma = shown @ np.array(RGB_LUMINANCE, np.float32)
    if dark:
        # Deep blue vanishes on black: mix in white
        white = np.clip((0.36 - luma) / np.maximum(1 - luma, 1e-9), 0, 1)[:, None]
        shown = shown + white * (1 - shown)
    else:
        # Light colours vanish on white: hold the luma down
        shown = shown * np.minimum(1, 0.55 / np.maximum(luma, 1e-9))[:, None]
    return np.asarray(np.rint(shown * 255), np.uint8)


def _reflections(rays: DrawnRays) -> NDArray[np.int64]:
    happened = (rays.event & int(FAMILIES["reflected"])) != 0
    return np.add.reduceat(happened.astype(np.int64), rays.offsets[:-1])


def _per_ray(
    rays: DrawnRays, rule: str, directory: Directory, path_labels: dict[int, str]
) -> tuple[Rgb, Legend]:
    """Colour of each ray by a rule that speaks of whole rays."""
    unit = directory.length_unit
    if rule == "path":
        return _by_category(rays.path, path_labels, "path")
    if rule == "source":
        names = {number: source.name for number, source in enumerate(directory.sources)}
        return _by_category(rays.source, names, "source")
    if rule == "reflections":
        return _by_count(_reflections(rays), "reflections")
    if rule == "ending":
        ending = rays.event[rays.offsets[1:] - 1] & int(ENDINGS)
        names = {
            int(bits): ", ".join(event_names(int(bits))).replace("_", " ")
            for bits in np.unique(ending)
        }
        return _by_category(ending, names, "last event")
    if rule == "flux":
        return _by_scale(rays.flux, f"flux of a ray [{directory.flux_unit}]", log=True)
    if rule == "wavelength":
        return _by_wavelength(rays.wavelength)
    return _by_scale(optical_length(rays), f"optical length [{unit}]")


def _by_wavelength(wavelengths: NDArray[np.float32]) -> tuple[Rgb, Legend]:
    colors = np.full((len(wavelengths), 3), 150, np.uint8)
    known = np.isfinite(wavelengths)
    different = np.unique(wavelengths[known])
    colors[known] = np.rint(wavelength_rgb(wavelengths[known]) * 255)
    picked = different[np.unique(np.linspace(0, len(different) - 1, 8).astype(int))]
    entries = [
        LegendEntry(label=f"{value:g} nm", rgb=_rgb(np.rint(wavelength_rgb(value) * 255)))
        for value in (picked if len(different) else [])
    ]
    if not known.all():
        entries.append(LegendEntry(label="mixed", rgb=(150, 150, 150)))
    return colors, Legend(title="wavelength", entries=tuple(entries))


def color_lines(
    rays: DrawnRays,
    lines: Lines,
    rule: str,
    directory: Directory,
    *,
    opacity: float = 0.5,
    fade: bool = False,
    dark: bool = True,
    path_labels: dict[int, str] | None = None,
) -> tuple[NDArray[np.uint8], Legend]:
    """Colour and opacity of each segment, and their legend.

    Parameters
    ----------
    rays, lines : the rays and their segments
    rule : one of `viewer.drawn.state.COLOR_RULES`
    directory : names and units
    opacity : of each segment, 0 … 1
    fade : multiply it by the flux of the ray over the largest flux
    dark : the background is dark
    path_labels : text of the paths in the legend, by path number

    Returns
    -------
    (n_segments, 4) uint8, Legend
    """
    rgba = np.zeros((len(lines), 4), np.uint8)
    if len(lines) == 0:
        return rgba, Legend(title=rule.replace("_", " "))
    if rule == "natural":
        rgba[:, :3] = _natural(rays, dark)[lines.record]
        legend = Legend(title="natural")
    else:
        colors, legend = _per_ray(rays, rule, directory, path_labels or {})
        rgba[:, :3] = colors[lines.ray]
    alpha = np.full(rays.n_rays, 255 * min(max(opacity, 0.0), 1.0))
    if fade and rays.flux.max() > 0:
        alpha *= rays.flux / rays.flux.max()
    # A visible ray stays visible, however faint
    rgba[:, 3] = np.maximum(np.rint(alpha), 1 if opacity > 0 else 0).astype(np.uint8)[lines.ray]
    return rgba, legend

"""From counted light to watt, lumen and colour: the one place that says what a channel is worth.

A ray of weight w and colour c (shares of its channels, Σ c = 1) of source s, of which N rays were
emitted, carries

========== ============================================
radiant    Φ_W w / N                                [W]
luminous   Φ_W w / N · Σ c_k K_k                   [lm]
========== ============================================

Φ_W is the radiant flux of the source and K_k what one watt of channel k is worth [lm/W]. In a
spectral trace K = 683 V(λ) (CIE 18.2): the shares are shares of radiant power, whatever the unit of
the map. In RGB they are amounts of linear sRGB, of which one watt is 179 lm where R = G = B, as the
Radiance picture format has it (G. Ward, *Real pixels*, Graphics Gems II, 1991).

A map in lumen states Φ_lm = Φ_W Σ c₀ K, with the mean colour c₀ of what the source emits
(`ChannelSet.source_colors`). So the lumens of a ray are Φ_lm w / N · Y(c) / Y(c₀), and they change
with its colour. The factor Y(c) / Y(c₀), 1 everywhere in a map in watt, is called the *worth* of a
ray here.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.model.directory import ChannelSet, Directory
from raymap.model.schema import COLOR_SCALE
from raymap.optics.colorimetry import (
    LUMINOUS_EFFICACY,
    RGB_LUMINANCE,
    channel_display_rgb,
    color_matching,
    into_gamut,
    linear_srgb_to_xyz,
    luminous_efficacy,
)

__all__ = [
    "RGB_EFFICACY",
    "Photometry",
    "channel_efficacy",
    "channel_rgb",
    "channel_xyz",
    "colors_of_codes",
    "displayed",
    "path_sums",
    "ray_weights",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.integer[Any]]

RGB_EFFICACY = 179.0
"""Lumen per watt of white light (R = G = B) in an RGB trace, which knows no wavelengths [lm/W]."""


def channel_efficacy(channel_set: ChannelSet) -> Floats:
    """(n_channels,) luminous efficacy of the light of each channel [lm/W]."""
    if channel_set.kind == "rgb":
        white = np.array(RGB_LUMINANCE)[: channel_set.n_channels]
        return 3.0 * RGB_EFFICACY * white
    if len(channel_set.luminous) == channel_set.n_channels:
        return np.array(channel_set.luminous, np.float64)
    return luminous_efficacy(channel_set.wavelengths_nm)


def channel_xyz(channel_set: ChannelSet) -> Floats:
    """(n_channels, 3) tristimulus values of one watt of each channel, Y in lumen."""
    if channel_set.kind == "rgb":
        return 3.0 * RGB_EFFICACY * linear_srgb_to_xyz(np.eye(3))[: channel_set.n_channels]
    return LUMINOUS_EFFICACY * color_matching(channel_set.wavelengths_nm)


def channel_rgb(channel_set: ChannelSet) -> Floats:
    """(n_channels, 3) linear sRGB of one unit of each channel; parts may be negative.

    Sums over channels are exact; `displayed` brings what is shown into the gamut. Of a spectral
    trace they follow from the wavelengths, unless the map states other colours (false ones, say, of
    infrared light). Ones where nothing is known.
    """
    n = channel_set.n_channels
    if channel_set.kind == "rgb" and n == 3:
        return np.eye(3)
    stated = np.array(channel_set.display_rgb, np.float64).reshape(-1, 3)
    own = channel_display_rgb(channel_set.wavelengths_nm, gamut=False)
    if len(stated) == n and not np.allclose(stated, into_gamut(own), rtol=1e-3, atol=1e-3):
        return stated
    return own if channel_set.kind == "spectral" else np.ones((n, 3))


def displayed(channel_set: ChannelSet, shares: ArrayLike) -> Floats:
    """(..., 3) linear sRGB inside the gamut of mixed light, (..., n_channels).

    The mixture is summed first and brought into the gamut once: colours outside of it get white of
    their own luminance until no part is negative.
    """
    return into_gamut(np.asarray(shares, np.float64) @ channel_rgb(channel_set))


class Photometry:
    """What light in the channels of a map is worth.

    Attributes
    ----------
    unit : flux unit of the map
    efficacy : (n_channels,) lumen per watt of each channel
    emitted_efficacy : (n_sources,) lumen per watt of the light that each source emits; NaN where
        the map does not tell its colour (several channels without ``source_colors``), or where the
        eye sees none of it
    """

    def __init__(self, directory: Directory, channel_set: ChannelSet) -> None:
        self.unit = directory.flux_unit
        self.efficacy = channel_efficacy(channel_set)
        self.fluxes = np.array([item.flux for item in directory.sources], np.float64)
        n_sources, n_channels = len(self.fluxes), channel_set.n_channels
        colors = np.array(channel_set.source_colors, np.float64)
        if colors.shape != (n_sources, n_channels):
            known = 1.0 if n_channels == 1 else np.nan
            colors = np.full((n_sources, n_channels), known)
        emitted = _as_stored(colors) @ self.efficacy
        self.emitted_efficacy: Floats = np.where(emitted > 0.0, emitted, np.nan)

    @cached_property
    def changes(self) -> bool:
        """Whether the worth of light depends on its colour."""
        return self.unit == "lm" and len(self.efficacy) > 1 and bool(self.known.any())

    @cached_property
    def known(self) -> NDArray[np.bool_]:
        """(n_sources,) sources whose colour is known, so that worth follows the colour."""
        known: NDArray[np.bool_] = np.isfinite(self.emitted_efficacy)
        return known

    @cached_property
    def channel_worth(self) -> Floats:
        """(n_sources, n_channels) worth of light of a single channel; 1 in a map in watt.

        Light of a source whose colour is not known is worth its weight, whatever colour it has.
        """
        worth = np.ones((len(self.fluxes), len(self.efficacy)))
        if self.changes:
            worth[self.known] = self.efficacy / self.emitted_efficacy[self.known, None]
        return worth

    @cached_property
    def radiant_fluxes(self) -> Floats:
        """(n_sources,) flux of each source in the currency of `amounts` [W].

        Of a source in lumen whose colour is not known it is the flux in lumen: see `amounts`.
        """
        if self.unit == "W":
            return self.fluxes
        return self.fluxes / np.where(self.known, self.emitted_efficacy, 1.0)

    def worth(self, shares: ArrayLike) -> Floats:
        """(n_sources, n_colors) worth of light with colours (n_colors, n_channels)."""
        return np.asarray(self.channel_worth @ np.asarray(shares, np.float64).T)

    def worth_of_rays(self, source: Ints, codes: Ints, color_table: NDArray[np.uint16]) -> Floats:
        """(n,) worth of light of these sources with these colour codes; 1 in a map in watt."""
        if not self.changes:
            return np.ones(len(source))
        seen = colors_of_codes(color_table, len(self.efficacy)) @ self.efficacy
        return np.where(self.known[source], seen[codes] / self.emitted_efficacy[source], 1.0)

    def amounts(self, shares: ArrayLike) -> Floats:
        """(n_colors, n_channels) watt by channel of a unit of `radiant_fluxes` in these colours.

        They are the shares themselves, but for sources in lumen whose colour is not known: there
        watts are such that the lumens stay what the map says.
        """
        colors = np.asarray(shares, np.float64)
        if self.unit == "W" or self.known.all():
            return colors
        seen = (colors @ self.efficacy)[:, None]
        return np.divide(colors, seen, out=np.zeros_like(colors), where=seen > 0.0)

    def flux_by_channel(self, amounts: Floats) -> Floats:
        """(..., n_channels) flux of each channel in the unit of the map, of amounts in watt."""
        return amounts * self.efficacy if self.unit == "lm" else amounts

    def radiant_factors(self, emitted: Ints) -> Floats:
        """(n_sources,) watt of a ray of weight 1; 0 where a source emitted nothing."""
        sent = np.asarray(emitted, np.float64)
        return np.divide(self.radiant_fluxes, sent, out=np.zeros(len(sent)), where=sent > 0.0)

    def result_factor(self, emitted: Ints) -> float:
        """Watt of one unit of a detector's sums in a map that has no rays for them.

        Sums do not keep sources apart; there the light of each counts with its radiant flux per ray
        over that of all of them.
        """
        lit = np.asarray(emitted) > 0
        return float(self.radiant_fluxes[lit].sum()) / max(float(np.sum(emitted)), 1.0)


def ray_weights(portion: Any, rays: Ints) -> Floats | None:
    """(n,) weight × worth of rays at their ends, by which a source's flux per ray counts.

    Parameters
    ----------
    portion : a `StoredPortion`
    rays : (n,) their places in it

    Returns
    -------
    None where all are 1
    """
    weight: Floats | None = None
    if portion.has_weights:
        weight = portion.column("weight")[rays].astype(np.float64)
    light = portion.map.photometry(portion.channel_set)
    if not light.changes:
        return weight
    source, codes = portion.column("source")[rays], portion.column("last_color")[rays]
    worth: Floats = light.worth_of_rays(source, codes, portion.color_table())
    return worth if weight is None else weight * worth


class LitPaths(Protocol):
    """Paths and the light that took them, as `raymap.encoding.paths.PathDictionary` holds it."""

    @property
    def n_paths(self) -> int: ...
    @property
    def source(self) -> NDArray[Any]: ...
    @property
    def sum_w(self) -> Floats: ...
    @property
    def sum_w2(self) -> Floats: ...
    @property
    def sum_wc(self) -> Sequence[Floats]: ...
    @property
    def sum_wy2(self) -> Floats | None: ...


def path_sums(paths: LitPaths, lights: Sequence[Photometry]) -> tuple[Floats, Floats | None]:
    """Sums of weight × worth of each path, and of its squares: (n_paths,) each.

    ``lights`` is the photometry of each channel set of the map.

    The squares are None where only the rays tell them: in a map in lumen that does not keep them,
    and whose light is not of a single channel at the end of each path.
    """
    if not any(light.changes for light in lights):
        return paths.sum_w, paths.sum_w2
    sums, lit = np.zeros(paths.n_paths), np.zeros(paths.n_paths, np.int64)
    for light, colors in zip(lights, paths.sum_wc, strict=False):
        if colors.shape[1]:
            known = light.known[paths.source]
            emitted = light.emitted_efficacy[paths.source]
            sums += np.where(known, (colors @ light.efficacy) / emitted, colors.sum(axis=1))
            lit += (colors > 0.0).sum(axis=1)
    if paths.sum_wy2 is not None:
        return sums, paths.sum_wy2
    if (lit > 1).any():
        return sums, None
    worth = np.divide(sums, paths.sum_w, out=np.zeros(len(sums)), where=paths.sum_w > 0.0)
    return sums, paths.sum_w2 * worth**2


def _as_stored(colors: Floats) -> Floats:
    """Shares as rays carry them: multiples of 1 / COLOR_SCALE that sum to 1; NaN without light."""
    total = colors.sum(axis=1, keepdims=True)
    scaled = colors / np.where(total > 0.0, total, np.nan) * COLOR_SCALE
    whole = np.floor(scaled)
    # Round down, the rest by largest remainder
    rank = np.argsort(np.argsort(whole - scaled, axis=1, kind="stable"), axis=1, kind="stable")
    rounded: Floats = whole + (rank < COLOR_SCALE - whole.sum(axis=1, keepdims=True))
    return rounded / COLOR_SCALE


def colors_of_codes(color_table: NDArray[np.uint16], n_channels: int) -> Floats:
    """(n_codes, n_channels) shares by colour code: single channels, then the mixed colours."""
    mixed = color_table.astype(np.float64).reshape(-1, n_channels) / COLOR_SCALE
    return np.concatenate((np.eye(n_channels), mixed))

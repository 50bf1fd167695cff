"""Plots of the lens and microscope studies (matplotlib, the ``view`` extra)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.extras import require
from tracer.studies.interference_colors import interference_srgb, srgb_of
from tracer.studies.lenses.cone import AxialCone, MaskedCone
from tracer.studies.lenses.levels import LevelShares
from tracer.studies.lenses.vignetting import Vignetting
from tracer.studies.microscopy.microscope import Conoscopy

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "plot_cones",
    "plot_conoscopy",
    "plot_levels",
    "plot_michel_levy",
    "plot_rings",
    "plot_vignetting",
]

Real = NDArray[np.float64]

_COLORS = ("#0b6e99", "#d1495b", "#2e8b57", "#8a5a9e", "#c9871f", "#555555", "#1a9e96", "#9c2f5f")


def _figure(width: float, height: float, columns: int = 1) -> tuple[Figure, Any]:
    require("matplotlib")
    from matplotlib.figure import Figure as NewFigure

    figure = NewFigure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(1, columns, squeeze=False)[0]
    for ax in axes:
        ax.spines[["top", "right"]].set_visible(False)
    return figure, axes


def plot_levels(
    shares: LevelShares, heights: Real | None = None, by_height: Real | None = None
) -> Figure:
    """Shares by level as bars; beside it, if given, by the height of the ray."""
    both = heights is not None and by_height is not None
    figure, axes = _figure(10.0 if both else 5.4, 4.0, 2 if both else 1)
    levels = np.arange(1, len(shares.share) + 1)
    lit = shares.share > 0.0
    axes[0].bar(levels[lit], shares.share[lit], color=_COLORS[0], width=0.7)
    for level, share in zip(levels[lit], shares.share[lit], strict=True):
        axes[0].text(level, share * 1.25, f"{share:.2g}", ha="center", fontsize=8)
    axes[0].set(
        yscale="log", xlabel="level", ylabel="share of the flux", xticks=levels,
        title="Whole beam", ylim=(0.3 * max(shares.share[lit].min(), 1e-12), 4.0),
    )  # fmt: skip
    if both and heights is not None and by_height is not None:
        for column in range(by_height.shape[1]):
            values = np.where(by_height[:, column] > 0.0, by_height[:, column], np.nan)
            axes[1].plot(
                heights, values, color=_COLORS[column % len(_COLORS)], label=f"{column + 1}"
            )
        axes[1].set(
            yscale="log", xlabel="distance from the axis [mm]", ylabel="share of the ray's flux",
            title="Rays parallel to the axis",
        )  # fmt: skip
        axes[1].legend(title="level", frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def plot_cones(
    distances: Real, cones: dict[int, list[AxialCone]], mask: MaskedCone | None = None
) -> Figure:
    """Half-angle of K by distance and depth, over that of the first depth; a mask off the axis."""
    figure, axes = _figure(10.0 if mask is not None else 5.4, 4.0, 2 if mask is not None else 1)
    first = np.array([cone.half_angle for cone in next(iter(cones.values()))])
    for number, (depth, row) in enumerate(cones.items()):
        angles = np.array([cone.half_angle for cone in row])
        axes[0].plot(
            distances, angles / np.where(first > 0.0, first, np.nan), label=f"{depth}",
            # Cones of several depths often coincide: later ones lie on wider earlier ones.
            color=_COLORS[number % len(_COLORS)], lw=1.2 + 0.8 * (len(cones) - 1 - number),
        )  # fmt: skip
    axes[0].set(
        xlabel="distance of the point from the lens [mm]",
        ylabel=f"half-angle of K / half-angle at depth {next(iter(cones))}",
        title="Point on the axis",
    )
    axes[0].legend(title="depth", frameon=False)
    if mask is not None:
        ax = axes[1]
        side = (mask.x[0], mask.x[-1], mask.y[0], mask.y[-1])
        from matplotlib.colors import ListedColormap

        ax.imshow(
            mask.mask, origin="lower", extent=side, cmap=ListedColormap(["#e8e8e8", _COLORS[0]]),
            interpolation="nearest",
        )  # fmt: skip
        turn = np.linspace(0.0, 2.0 * np.pi, 200)
        ax.plot(
            mask.x[-1] * np.cos(turn), mask.x[-1] * np.sin(turn), color="#222222", lw=1.0,
            clip_on=False,
        )  # fmt: skip
        ax.set(
            xlabel="x in the aperture [mm]", ylabel="y [mm]",
            title=f"Point off the axis, depth {mask.depth}: K in blue", aspect="equal",
        )  # fmt: skip
    return figure


def plot_vignetting(result: Vignetting) -> Figure:
    """What becomes of the rays of a beam, by field angle."""
    figure, axes = _figure(6.0, 4.0)
    rows = {
        "directly transmitted": result.transmitted,
        "flux directly transmitted": result.flux,
        "rim, before the first exit": result.rim_direct,
        "rim, after an inner reflection": result.rim_later,
        "rim, from outside": result.rim_outside,
    }
    for number, (label, values) in enumerate(rows.items()):
        axes[0].plot(
            result.field_deg, values, color=_COLORS[number], label=label,
            ls="--" if label.startswith("flux") else "-",
        )  # fmt: skip
    axes[0].set(xlabel="field angle [deg]", ylabel="share of the beam", ylim=(-0.02, 1.02))
    axes[0].legend(frameon=False, fontsize=9)
    return figure


def plot_rings(r_mm: Real, flux: Real, srgb: Real) -> Figure:
    """Interference rings: their picture, and the flux along a radius."""
    figure, axes = _figure(9.6, 4.0, 2)
    reach = float(r_mm[-1])
    axes[0].imshow(srgb, extent=(-reach, reach, -reach, reach), origin="lower")
    axes[0].set(xlabel="x [mm]", ylabel="y [mm]")
    axes[1].plot(r_mm, flux, color=_COLORS[0])
    axes[1].set(
        xlabel="distance from the contact [mm]", ylabel="reflected share of the flux",
        xlim=(0.0, reach), ylim=(0.0, None),
    )  # fmt: skip
    return figure


def plot_conoscopy(figures: dict[str, Conoscopy], exposure: float = 1.0) -> Figure:
    """Conoscopic figures side by side; coordinates are direction sines."""
    figure, axes = _figure(4.6 * len(figures), 4.6, len(figures))
    for ax, (title, view) in zip(axes, figures.items(), strict=True):
        picture = srgb_of(view.xyz, exposure=exposure)
        picture[~view.inside] = 1.0
        side = (view.s[0], view.s[-1], view.s[0], view.s[-1])
        ax.imshow(picture, origin="lower", extent=side)
        ax.set(xlabel="$s_x$", ylabel="$s_y$", title=title)
    return figure


def plot_michel_levy(
    longest_nm: float = 2200.0, thickest_um: float = 60.0, birefringences: tuple[float, ...] = ()
) -> Figure:
    """The Michel-Lévy chart: colours of path differences, lines of constant birefringence."""
    figure, axes = _figure(10.0, 4.6)
    ax = axes[0]
    path = np.linspace(0.0, longest_nm, 1400)
    colors = np.broadcast_to(interference_srgb(path), (2, path.size, 3))
    ax.imshow(colors, extent=(0.0, longest_nm, 0.0, thickest_um), aspect="auto", origin="lower")
    marks = birefringences or (0.004, 0.009, 0.015, 0.022, 0.03, 0.04, 0.055, 0.08, 0.13, 0.2)
    for value in marks:
        end = thickest_um * 1e3 * value
        # The line leaves the chart at its top or at its right side
        x, y = (end, thickest_um) if end <= longest_nm else (longest_nm, longest_nm / value * 1e-3)
        ax.plot([0.0, x], [0.0, y], color="black", lw=0.8)
        on_top = end <= longest_nm
        ax.annotate(
            f"{value:g}", (x, y), textcoords="offset points",
            xytext=(0, 4) if on_top else (4, -3), ha="center" if on_top else "left", fontsize=9,
        )  # fmt: skip
    ax.axhline(30.0, color="black", lw=0.8, ls=":")
    for order in range(1, int(longest_nm // 551.0) + 1):
        ax.axvline(551.0 * order, color="white", lw=0.8, ls=":")
    ax.set(
        xlim=(0.0, longest_nm), ylim=(0.0, thickest_um), xlabel="path difference [nm]",
        ylabel="thickness [µm]",
    )  # fmt: skip
    ax.text(
        0.5, 1.10, "birefringence", transform=ax.transAxes, ha="center", va="bottom", fontsize=10
    )
    return figure

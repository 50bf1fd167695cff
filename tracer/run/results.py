"""What a trace reports while it runs and when it has ended."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

from tracer.transport.counts import Counts, DetectorCount

__all__ = [
    "OtherChannels",
    "Progress",
    "RecordResult",
    "StoppedLight",
    "UnevenWeights",
    "depth_limit",
    "stopped_notes",
    "uneven_notes",
]

STOPPED_SHARE = 1e-4
"""A larger share of light stopped by a limit is warned about."""


class StoppedLight(UserWarning):
    """A limit stopped more light than can be neglected."""


EVEN_SHARE = 0.1
"""An effective sample size below this share of the rays that arrived is warned about."""
_FEW = 100
_NOTHING = 1e-9


class UnevenWeights(UserWarning):
    """Most of the light on a detector stands in few of the rays that arrived there."""


class OtherChannels(UserWarning):
    """A map is continued in other channels than those of its light so far."""


def depth_limit(depth: int) -> tuple[str, str]:
    """The limit that ``[limits] depth`` sets, and the remedy, in words."""
    return f"the depth limit of {depth}", "raise limits.depth"


def stopped_notes(stopped: float, errors: float, limit: str, remedy: str) -> list[str]:
    """What is said of light that did not end by physics, a line each.

    Parameters
    ----------
    stopped, errors : shares of all light that a limit stopped, and that met faces in a
        wrong order
    limit, remedy : what stopped it, and what to do
    """
    notes = []
    if stopped > STOPPED_SHARE:
        notes.append(f"{limit} stopped {stopped:.3%} of the light; {remedy}")
    if errors > 0.0:
        notes.append(
            f"{errors:.3%} of the light met faces in a wrong order (geometry errors); bodies "
            "overlap or touch, or a sheet stands inside of a crystal: raymap query MAP "
            "'event(geometry_error)' shows where"
        )
    return notes


def uneven_notes(detectors: dict[str, DetectorCount]) -> list[str]:
    """What is said of detectors whose light few rays carry, by their state of polarisation."""
    notes = []
    for name, count in detectors.items():
        effective = float(count.whole.effective)
        if count.total <= _NOTHING * count.whole.source_flux.sum():
            continue
        if count.arrived >= _FEW and effective < EVEN_SHARE * count.arrived:
            notes.append(
                f"detectors.{name}: its light stands in few rays by their polarisation: the error "
                f"is that of {effective:,.0f} equal rays, though {count.arrived:,} arrived; trace "
                "more rays, with [trace] states = 'natural'"
            )
    return notes


@dataclass(frozen=True, kw_only=True)
class Progress:
    """Where a running trace stands."""

    rays: int
    records: int
    seconds: float
    bytes: int
    total_rays: int | None
    total_seconds: float | None


@dataclass(frozen=True, kw_only=True)
class RecordResult:
    """What a trace did.

    Attributes
    ----------
    rays, records, bytes : of this run; ``bytes`` is 0 where no map was written
    seconds : from the first ray to the closed file, compilation excluded
    audit : per source how its rays ended, exclusive; they add up to ``emitted``
    absorbed_by : objects and media with the rays that they absorbed
    fluxes : the same, and what each detector registered, as flux with its standard error
    warnings : one line each
    interrupted : stopped by Ctrl-C; the map is valid
    """

    rays: int
    records: int
    seconds: float
    rays_per_second: float
    bytes: int
    threads: int
    seed: int
    audit: dict[str, dict[str, float]]
    absorbed_by: dict[str, dict[str, float]]
    fluxes: dict[str, Any]
    warnings: list[str] = field(default_factory=list)
    interrupted: bool = False
    counts: Counts = field(repr=False)

    @property
    def detectors(self) -> dict[str, DetectorCount]:
        """Flux by cell of each detector."""
        return self.counts.detectors

    def to_json(self) -> dict[str, Any]:
        """Plain values, without the pictures of the detectors."""
        return {item.name: getattr(self, item.name) for item in fields(self) if item.repr}

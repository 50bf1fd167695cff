"""What a phase function of the scene description is, and those that there are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import SerializationInfo, SerializerFunctionWrapHandler, model_serializer

from raymap.laws.phase import PhaseLaw
from raymap.model.errors import SceneError
from raymap.model.registry import Registry
from raymap.model.unfinished import Unfinished
from tracer.description.asking import asking
from tracer.description.fields import Node

__all__ = ["MOST_ANGLES", "PHASES", "Phase", "tabulated_law"]

Array = NDArray[np.float64]

MOST_ANGLES = 4096
"""Of a phase function that is stored as a table."""

_COARSE = 2.0
"""Degrees between the first angles of a table."""

_ACCURACY = 1e-4
"""By which a table misses the function between its angles, relative to it."""

_FINEST = 1e-6
"""Degrees; angles of a table are no closer."""

_FIRST_KEYS: dict[str, Any] = {"g": 0.0, "gamma": 1.5, "angle_deg": [], "value": []}
"""Keys that every phase function once had; scenes keep the fingerprints of that time."""


class Phase(Node):
    """Where scattered light goes: a density over the cosine of the angle to the way before.

    A kind is a class in a file of its own. It declares its keys, and says its `density`, of which
    a table is made; or, where maps have a form of their own for it, its `stated` law. The azimuth
    is uniform, and all channels scatter alike.
    """

    kind: str

    def density(self, mu: Array) -> Array:
        """The phase function, in any unit.

        Parameters
        ----------
        mu : (n,) cosines of the angle between the ways before and after, -1 .. 1

        Returns
        -------
        density : (n,) in proportion to the flux per solid angle
        """
        raise Unfinished(self, "density")

    def stated(self) -> PhaseLaw:
        """The law that maps state, and by which light is traced.

        Raises
        ------
        SceneError
            the density is negative, not finite, or cannot be made a table
        """
        return tabulated_law(self)

    @model_serializer(mode="wrap")
    def _with_first_keys(
        self, handler: SerializerFunctionWrapHandler, info: SerializationInfo
    ) -> dict[str, Any]:
        given: dict[str, Any] = handler(self)
        return given if info.exclude_unset else _FIRST_KEYS | given


def tabulated_law(phase: Phase) -> PhaseLaw:
    """A phase function as a table over the angle, as fine as it takes.

    Between the angles a table is linear in the cosine. Intervals are halved until the function in
    their middle is met to 1e-4 of its value there, so that its integral, its mean cosine and what
    is drawn from it are as exact as that.

    Raises
    ------
    SceneError
    """
    angles = np.arange(0.0, 180.0 + 0.5 * _COARSE, _COARSE)
    values = _values(phase, angles)
    # Halve every interval whose middle the table misses
    open_ = np.ones(len(angles) - 1, bool)
    while np.any(open_):
        at = np.flatnonzero(open_)
        middle = 0.5 * (angles[at] + angles[at + 1])
        found = _values(phase, middle)
        mu, mu_0, mu_1 = (np.cos(np.radians(a)) for a in (middle, angles[at], angles[at + 1]))
        along = (mu - mu_0) / (mu_1 - mu_0)
        guess = values[at] + along * (values[at + 1] - values[at])
        missed = np.abs(found - guess) > _ACCURACY * np.maximum(found, 1e-9 * values.max())
        missed &= angles[at + 1] - angles[at] > 2.0 * _FINEST
        at, middle, found = at[missed], middle[missed], found[missed]
        if len(angles) + len(at) > MOST_ANGLES:
            raise SceneError(
                f"phase.kind: the {phase.kind} phase function changes so fast with the angle that "
                f"a table of {MOST_ANGLES} angles misses it by more than {_ACCURACY:g} of its value"
            )
        # Both halves of what was missed stay open
        marks = np.zeros(len(open_), bool)
        marks[at] = True
        open_ = np.insert(marks, at + 1, True)
        angles, values = np.insert(angles, at + 1, middle), np.insert(values, at + 1, found)
    largest = float(values.max())
    return PhaseLaw(
        kind="tabulated",
        angle_deg=tuple(angles.tolist()),
        value=tuple((values / largest).tolist()),
    )


def _values(phase: Phase, angle_deg: Array) -> Array:
    mu = np.cos(np.radians(angle_deg))
    with asking(phase, "phase.kind"):
        values = np.broadcast_to(np.asarray(phase.density(mu), np.float64), mu.shape)
    wrong = ~(np.isfinite(values) & (values >= 0.0))
    if np.any(wrong):
        raise SceneError(
            f"phase.kind: the {phase.kind} phase function is {values[wrong][0]:g} at "
            f"{angle_deg[wrong][0]:g} degrees; it must be finite and not negative"
        )
    return values


def _words(kind: type[Phase]) -> Sequence[str]:
    return [str(word) for word in get_args(kind.model_fields["kind"].annotation)]


PHASES: Registry[type[Phase]] = Registry(
    "tracer.phases",
    "tracer.media.phases",
    words=_words,
    of=Phase,
    sort="phase functions of scattering media",
)

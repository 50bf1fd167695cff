"""What all laws of surfaces have in common: they are stored as JSON, and say the shares of light.

A law is an object whose key ``law`` names its form, and whose numbers by channel are lists in the
order of the channels. It says what the light does, not how directions are drawn: that is for who
traces. Refractive indices and wavelengths stand in the channel set that the law belongs to.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import FailFast, Field

from raymap.model.entry import Entry
from raymap.model.errors import FormatError
from raymap.model.unfinished import Unfinished

if TYPE_CHECKING:
    from raymap.laws.jones import JonesRow

__all__ = ["ByChannel", "InChannels", "Law", "Part", "Share", "Shares", "constant"]

F64 = NDArray[np.float64]
Shares = tuple[F64, F64]
"""(n_channels, n_angles) of the flux that goes back, and of that which goes through."""

_ROUNDING = 1e-6
"""By which shares may be off: those of thin films lie on straight lines between the nodes."""
_WHOLE = 1.0 + _ROUNDING

Share = Annotated[float, Field(ge=0.0, le=1.0)]
ByChannel = Annotated[tuple[Share, ...], FailFast()]


class InChannels(Protocol):
    """What laws need to know of a channel set (`raymap.model.directory.ChannelSet`)."""

    @property
    def wavelengths_nm(self) -> Any: ...
    @property
    def refractive_index(self) -> Any: ...


class Part(Entry):
    """A part of a law."""


class Law(Entry):
    """A law of a surface.

    Attributes
    ----------
    law : name of its form
    """

    law: str

    def shares(self, channels: InChannels, n_i: F64, n_o: F64, cos_i: F64) -> Shares:
        """Shares of flux of unpolarised light that go back and through, scattered or not.

        Parameters
        ----------
        channels : that the law belongs to
        n_i, n_o : (n_channels,) indices on the incident side and beyond
        cos_i : (n_angles,) cosines of the angle of incidence

        Returns
        -------
        reflected, transmitted : (n_channels, n_angles)

        Raises
        ------
        ValueError
            Indices are not positive numbers, one per channel, or cosines not within 0 .. 1.
        FormatError
            The law says no shares of light: of other channels, or of numbers that are none.
        """
        n = len(channels.wavelengths_nm)
        n_i, n_o, cos_i = (np.asarray(values, np.float64) for values in (n_i, n_o, cos_i))
        if not (n_i.shape == n_o.shape == (n,) and np.all((n_i > 0.0) & (n_o > 0.0))):
            raise ValueError(
                f"indices of refraction must be positive, one for each of {n} channels"
            )
        if cos_i.ndim != 1 or not np.all((cos_i >= 0.0) & (cos_i <= 1.0)):
            raise ValueError("cosines of angles of incidence lie within 0 and 1")
        # What numbers of a made-up law do is seen by what comes of them
        try:
            with np.errstate(all="ignore"):
                found = self._shares(channels, n_i, n_o, cos_i)
            shape = (n, len(cos_i))
            parts = (*found, found[0] + found[1]) if found[0].shape == found[1].shape else ()
            sound = bool(parts) and all(
                part.shape == shape and np.all((part >= -_ROUNDING) & (part <= _WHOLE))
                for part in parts
            )
        except ArithmeticError:
            # Of complex numbers in compiled loops
            sound = False
        if not sound:
            raise FormatError(
                f"a law of the form {self.law!r} says no shares of light between 0 and 1 for "
                f"each of {n} channels: its numbers were damaged or made up"
            )
        return found

    def jones(self, channels: InChannels) -> JonesRow | None:
        """What it does to polarised light; None where light forgets its polarisation."""
        return None

    def _shares(self, channels: InChannels, n_i: F64, n_o: F64, cos_i: F64) -> Shares:
        """As `shares`, whose arguments and result are checked there."""
        raise Unfinished(self, "_shares")


def constant(values: Sequence[float], cos_i: F64) -> F64:
    """(n_channels, n_angles) of shares that do not depend on the angle."""
    return np.repeat(np.asarray(values, np.float64)[:, None], len(cos_i), axis=1)

"""What all laws of surfaces have in common: they are stored as JSON, and say the shares of light.

A law is an object whose key ``law`` names its form, and whose numbers by channel are lists in the
order of the channels. It says what the light does, not how directions are drawn: that is for who
traces. Refractive indices and wavelengths stand in the channel set that the law belongs to.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import FailFast, Field

from raymap.model.entry import Entry

__all__ = ["ByChannel", "InChannels", "Law", "Part", "Share", "Shares", "constant"]

F64 = NDArray[np.float64]
Shares = tuple[F64, F64]
"""(n_channels, n_angles) of the flux that goes back, and of that which goes through."""

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
        """
        raise NotImplementedError


def constant(values: Sequence[float], cos_i: F64) -> F64:
    """(n_channels, n_angles) of shares that do not depend on the angle."""
    return np.repeat(np.asarray(values, np.float64)[:, None], len(cos_i), axis=1)

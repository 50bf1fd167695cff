"""Sources of kind rays."""

from __future__ import annotations

from typing import Literal

from tracer.sources.model import SourceModel

__all__ = ["RaySource"]


class RaySource(SourceModel):
    """A list of rays of a ``file`` (or ``light``), drawn by their flux or emitted ``in_order``.

    ``flux_from`` says what counts where a file's header states another flux than its rays.
    """

    kind: Literal["rays"] = "rays"
    keys = (
        "file",
        "light",
        "draw",
        "scale",
        "flux_from",
    )

    def check(self) -> None:
        if (self.file is None) == (self.light is None):
            raise ValueError("give a file of rays (or light, in Python)")


KINDS = (RaySource,)

"""Sources of kind picture."""

from __future__ import annotations

from typing import Literal

from tracer.sources.model import SourceModel

__all__ = ["PictureSource"]


class PictureSource(SourceModel):
    """A Lambertian rectangle that emits as a picture ``file`` shows."""

    kind: Literal["picture"] = "picture"
    keys = (
        "size",
        "file",
        "cone_deg",
    )

    def check(self) -> None:
        if self.size is None or self.file is None:
            raise ValueError("a picture source needs a size and a picture file")


KINDS = (PictureSource,)

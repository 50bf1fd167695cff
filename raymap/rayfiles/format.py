"""What a format of ray files is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Protocol

from raymap.model.fileformat import FileFormat
from raymap.rayfiles.rays import FluxFrom, RaySet

__all__ = ["RayFileWriter", "RayFormat", "UnfinishedRayFile"]


class RayFileWriter(Protocol):
    """Takes rays piece by piece; `raymap.rayfiles.create` gives one."""

    def append(self, rays: RaySet) -> None:
        """Write rays, with the columns and units of the set that the file was created for."""


class UnfinishedRayFile(RayFileWriter, Protocol):
    """A writer of a format; `finish` enters counts and totals."""

    def finish(self) -> None: ...


@dataclass(frozen=True, kw_only=True)
class RayFormat(FileFormat):
    """A format of ray files.

    Attributes
    ----------
    read : the rays of a file; its second argument says what counts where the header states another
        flux than the rays carry, the "header" or the "rays"
    writer : to a file opened for writing and seeking, for pieces like a given set; takes the
        version of the header that old programs want. None: such files are not written
    """

    read: Callable[[Path, FluxFrom], RaySet]
    writer: Callable[[BinaryIO, RaySet, int], UnfinishedRayFile] | None = None

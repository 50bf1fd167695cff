"""What a run asks of a way of following light.

A `Trace` is a scene that is ready to be recorded: natural, weighted or polarised light, lenses as
trees. Of a trace and a seed comes an `Engine`, which turns ray numbers into portions. The
run (`tracer.run.recording`) knows nothing else of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from raymap.encoding.encoder import PortionEncoder
from raymap.model.directory import ChannelSet, Directory, DisplayMesh
from raymap.model.portion import Portion
from tracer.compiled import R_RAYS, R_SPLITS

if TYPE_CHECKING:
    from tracer.scene.compile import Compilation
    from tracer.scene.model import Scene
    from tracer.transport.pinhole import Pinholes

__all__ = ["TRANSPORT_LAW", "CompiledTrace", "Engine", "Trace"]


class Engine(Protocol):
    """Traces portions of one scene with one seed; safe to call from many threads."""

    def trace(self, first_ray: int, n_rays: int, *, reuse: bool = False) -> Portion:
        """Trace the rays (the emissions, where they split) first_ray to first_ray + n_rays.

        With ``reuse`` the columns may be views of this thread's buffers, valid until its next call.
        """

    def trace_counted(self, first_ray: int, n_rays: int) -> tuple[Portion, int]:
        """As `trace`, for counting only: records may be left out. Returns also how many there were.

        Kept are the records at which rays end and those with descriptors.
        """


TRANSPORT_LAW = 2
"""Raised whenever the same seed draws other paths; every run of a map says whose draws it holds."""


class Trace(Protocol):
    """A scene that is ready to be recorded; workers on other machines get it pickled.

    Attributes
    ----------
    scene, directory, channel_set, meshes : of the map
    max_branches : rays that an emission may become; emission e has the ray numbers from
        e · max_branches on
    most_rays : of a portion, at most
    limit : what stops light that goes on too long, and the remedy, in words
    parameters : what the map keeps of this run besides what it keeps of every one
    """

    @property
    def scene(self) -> Scene: ...
    @property
    def directory(self) -> Directory: ...
    @property
    def channel_set(self) -> ChannelSet: ...
    @property
    def meshes(self) -> Mapping[int, DisplayMesh]: ...
    @property
    def max_branches(self) -> int: ...
    @property
    def most_rays(self) -> int: ...
    @property
    def limit(self) -> tuple[str, str]: ...
    @property
    def parameters(self) -> Mapping[str, Any]: ...

    def prepared(self, encoder: PortionEncoder | None, threads: int) -> Trace:
        """Refuse or warn of what the scene asks in vain, and compile what will be needed.

        Parameters
        ----------
        encoder : of the map to be written; None where none is

        Raises
        ------
        SceneError
        """

    def engine(self, seed: int) -> Engine:
        """What traces portions."""

    def pinholes(self) -> Pinholes | None:
        """What sums up the pictures of pinholes; None where there are none."""


@dataclass(frozen=True, eq=False)
class CompiledTrace:
    """What traces of a compiled scene have in common."""

    compilation: Compilation

    @property
    def scene(self) -> Scene:
        return self.compilation.scene

    @property
    def directory(self) -> Directory:
        return self.compilation.directory

    @property
    def channel_set(self) -> ChannelSet:
        return self.compilation.channel_set

    @property
    def meshes(self) -> Mapping[int, DisplayMesh]:
        return self.compilation.meshes

    @property
    def max_branches(self) -> int:
        reduction = self.compilation.arrays.reduction
        if reduction is None or reduction.settings[R_SPLITS] <= 0.0:
            return 1
        return int(reduction.settings[R_RAYS])

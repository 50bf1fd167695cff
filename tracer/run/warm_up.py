"""Before the first ray is recorded: compile what is needed, find out where rays mostly go."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raymap.encoding.dictionary import PathMerger
from raymap.encoding.encoder import PortionEncoder
from raymap.jit.compiling import Task, compile_ahead
from raymap.model.directory import ChannelSet, Directory
from raymap.model.events import Event
from raymap.model.portion import Descriptors, Portion
from tracer.compiled import F_KIND, F_OBJECT, F_TRIANGLE
from tracer.geometry.kinds import MESH
from tracer.scene.compile import Compilation
from tracer.transport.tally import Tally
from tracer.transport.wavefront import Wavefront

__all__ = ["compile_trace", "order_faces", "warm_up"]

_RAYS = 1024
_PILOT_RAYS = 1024


def compile_trace(compilation: Compilation, encoder: PortionEncoder | None, threads: int) -> None:
    """Compile what traces, counts and encodes, where the cache of compiled code does not have it.

    Parameters
    ----------
    encoder : of the map to be written; None where none is
    threads : with more than one, another process helps
    """
    directory, channel_set = compilation.directory, compilation.channel_set
    engine = Wavefront(compilation.arrays, 0, meshes=compilation.solids, weighted=True)
    kind = "none"
    if encoder is not None:
        kind = f"{encoder.raw} {encoder.shapes.complete}"
    key = f"{kind} {bool(directory.detectors)} {channel_set.n_channels}"
    arguments = (directory, channel_set, encoder)
    warming = Task(warm_up.__module__, warm_up.__qualname__, arguments, key)
    hits, *others = engine.tasks()
    compile_ahead([hits, warming, *others], processes=threads)


def order_faces(compilation: Compilation) -> Compilation:
    """The scene with the faces that rays mostly meet next in front of the others.

    A few rays are traced to find out, the same for every trace of the scene.
    """
    if not compilation.start_bins.sortable:
        return compilation
    engine = Wavefront(compilation.arrays, 0, meshes=compilation.solids, weighted=True)
    rays = max(64, _PILOT_RAYS // engine.max_branches)
    return compilation.ordered(_faces_met(compilation, engine.trace(0, rays, reuse=True)))


def _faces_met(compilation: Compilation, portion: Portion) -> NDArray[np.int64]:
    """How many rays of each start bin met each analytic face next, (start_bins, faces)."""
    arrays = compilation.arrays
    n_faces, n_bins = len(arrays.face_i), len(arrays.list_of)
    face = _faces_of(arrays.face_i, portion)
    # A segment starts at every record but the last one of a ray
    ends = np.cumsum(portion.records_per_ray)
    goes_on, emitted = np.ones(len(face), bool), np.zeros(len(face), bool)
    goes_on[ends - 1] = False
    emitted[ends - portion.records_per_ray] = True
    start = np.flatnonzero(goes_on)
    axis = compilation.start_bins.axes[face[start]]
    step = portion.position[start + 1] - portion.position[start]
    start_bin = 2 * face[start] + (step[np.arange(len(start)), axis] >= 0.0)
    source = np.repeat(portion.source, portion.records_per_ray).astype(np.int64)
    start_bin[emitted[start]] = 2 * n_faces + source[start[emitted[start]]]
    usable = (start_bin >= 0) & (face[start + 1] >= 0)
    met = np.zeros((n_bins, n_faces), np.int64)
    np.add.at(met, (start_bin[usable], face[start + 1][usable]), 1)
    return met


def _faces_of(face_i: NDArray[np.int64], portion: Portion) -> NDArray[np.int64]:
    """The analytic face at which each record was made, -1 for none, by the name that it carries."""
    analytic = np.flatnonzero(face_i[:, F_KIND] != MESH)
    names = face_i[analytic, F_OBJECT] << 32 | face_i[analytic, F_TRIANGLE]
    order = np.argsort(names, kind="stable")
    names, analytic = names[order], analytic[order]
    own = portion.object.astype(np.int64) << 32 | portion.triangle
    index = np.minimum(np.searchsorted(names, own), len(names) - 1)
    return np.where(names[index] == own, analytic[index], -1)


def warm_up(directory: Directory, channel_set: ChannelSet, encoder: PortionEncoder | None) -> None:
    """Count, encode and merge a few rays that leave the scene at once."""
    crossings, n = (1 if directory.detectors else 0), _RAYS
    end = int(Event.LEFT_SCENE)
    portion = Portion(
        emitted=np.array([n] + [0] * (len(directory.sources) - 1), np.int64),
        source=np.zeros(n, np.int16),
        records_per_ray=np.full(n, 2, np.int32),
        position=np.zeros((2 * n, 3), np.float32),
        normal=np.zeros((2 * n, 3), np.int16),
        object=np.full(2 * n, -1, np.int16),
        triangle=np.full(2 * n, -1, np.int32),
        event=np.tile(np.array([int(Event.EMITTED), end], np.int32), n),
        medium=np.zeros(2 * n, np.int16),
        color_code=np.arange(2 * n, dtype=np.int32) // 2 % channel_set.n_channels,
        color_table=np.zeros((0, channel_set.n_channels), np.uint16),
        descriptor_count=np.tile(np.array([crossings, 0], np.uint16), n),
        descriptors=Descriptors(
            detector=np.zeros(n * crossings, np.int16),
            cell=np.zeros((n * crossings, 2), np.uint16),
            cosine=np.zeros(n * crossings, np.int16),
            uv=np.zeros((n * crossings, 2), np.uint16),
            registered=np.ones(n * crossings, np.bool_),
        ),
        implied_normals=True,
    )
    Tally(directory, channel_set).add(portion)
    if encoder is not None:
        encoded = encoder.encode(portion, 0, [channel_set])
        if encoded.paths is not None:
            PathMerger().add(encoded.paths)

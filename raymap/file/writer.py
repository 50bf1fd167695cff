"""RayMapWriter: append portions to a map, finish it, continue it."""

from __future__ import annotations

import dataclasses
import os
import threading
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.bytes.appender import ChunkAppender
from raymap.bytes.layout import (
    CHANNELS,
    DETECTOR,
    DIRECTORY,
    FILE_HEADER_SIZE,
    PATHS,
    RUN,
    pack_file_header,
)
from raymap.encoding.description import (
    directory_streams,
    pack_channel_set,
    pack_directory,
    pack_run,
)
from raymap.encoding.encoder import EncodedPortion, PortionEncoder
from raymap.encoding.results import DetectorResult, pack_result
from raymap.file.checks import check_portion
from raymap.file.footer import Footer, IndexEntry, pack_footer, pack_merged
from raymap.file.resume import WriterState, resume
from raymap.model.directory import ChannelSet, Directory, DisplayMesh
from raymap.model.errors import InvalidPortion, LimitExceeded, RayMapError
from raymap.model.limits import MAX_CHANNEL_SETS, MAX_DESCRIBED
from raymap.model.portion import Portion

__all__ = ["RayMapWriter"]

_BUFFERED_BYTES = 2**28


class RayMapWriter:
    """Writes one map; one writer at a time, any number of threads of it.

    Use `create` or `append_to` and leave the ``with`` block: normally the map is finished, after an
    exception the portions committed so far are served without a footer.

    Examples
    --------
    >>> with RayMapWriter.create("lamp.raymap", directory) as writer:      # doctest: +SKIP
    ...     writer.add_channel_set(rgb)
    ...     writer.append(portion)
    """

    def __init__(
        self,
        appender: ChunkAppender,
        directory: Directory,
        *,
        raw: bool,
        trusted: bool,
        state: WriterState,
    ) -> None:
        self.path = appender.path
        self.directory = directory
        self._appender = appender
        self._encoder = PortionEncoder(directory, raw=raw)
        self._trusted = trusted
        self._footer = state.footer
        self._merger = state.merger
        self._local_to_global = state.local_to_global
        self._channel_sets = state.channel_sets
        self._version = state.version
        self._described = state.described
        self._results: dict[tuple[int, int], DetectorResult] = {}
        self._pending: dict[int, EncodedPortion] = {}
        self._pending_bytes = 0
        self._turn = threading.Condition()
        self._owner = threading.get_ident()
        self._failure: BaseException | None = None
        self._finished = False
        self._run_first = 0
        self._written = 0
        last = [entry.meta for entry in self._footer.portions]
        self._next_portion = last[-1].number + 1 if last else 0
        self._next_ray = max((meta.last_ray + 1 for meta in last), default=state.first_ray)
        self._run_first = self._next_portion

    # -- opening -----------------------------------------------------------------------------

    @classmethod
    def create(
        cls,
        path: str | os.PathLike[str],
        directory: Directory,
        *,
        meshes: Mapping[int, DisplayMesh] | None = None,
        force: bool = False,
        raw: bool = False,
        trusted: bool = False,
        first_ray: int = 0,
    ) -> RayMapWriter:
        """A new map.

        Parameters
        ----------
        path : of the file; it must not exist unless ``force``
        directory : names, shapes and units of the scene
        meshes : display meshes by object index
        raw : store every stream as it is, for debugging
        trusted : do not check portions on entry
        first_ray : number that the first ray gets, of a shard that begins further on

        Raises
        ------
        MapExists, MapLocked
        """
        appender = ChunkAppender.create(Path(path), force=force)
        try:
            packed = pack_directory(directory, meshes or {})
            appender.append([pack_file_header(), *packed])
            sizes = {FILE_HEADER_SIZE: (appender.end - FILE_HEADER_SIZE, len(packed[0]))}
        except BaseException:
            appender.close()
            Path(path).unlink(missing_ok=True)
            raise
        footer = Footer(chunks=[(FILE_HEADER_SIZE, DIRECTORY)], sizes=sizes)
        state = WriterState(footer=footer, first_ray=first_ray)
        return cls(appender, directory, raw=raw, trusted=trusted, state=state)

    @classmethod
    def append_to(
        cls,
        path: str | os.PathLike[str],
        directory: Directory | None = None,
        *,
        raw: bool = False,
        trusted: bool = False,
    ) -> RayMapWriter:
        """Continue a finished or an interrupted map.

        Parameters
        ----------
        directory : of the scene that will be traced; it must be the map's own scene. None: any.

        Raises
        ------
        SceneMismatch
            The map was recorded from another scene; the message names the difference.
        MapLocked
            Another writer is at work on it.
        """
        appender, own, state = resume(Path(path), directory)
        return cls(appender, own, raw=raw, trusted=trusted, state=state)

    def __enter__(self) -> RayMapWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is None:
            self.finish()
        else:
            self.close()

    # -- what portions speak about -------------------------------------------------------------

    @property
    def channel_sets(self) -> tuple[ChannelSet, ...]:
        """Channel sets of the map by index."""
        return tuple(self._channel_sets)

    @property
    def next_ray(self) -> int:
        """Number that the next ray should get."""
        return self._next_ray

    @property
    def next_portion(self) -> int:
        """Number that the next portion must have."""
        return self._next_portion

    @property
    def bytes_written(self) -> int:
        """Bytes written by this writer."""
        return self._written

    @property
    def runs(self) -> list[dict[str, Any]]:
        """Runs recorded so far, this one included once `start_run` was called."""
        return self._footer.runs

    def add_channel_set(self, channel_set: ChannelSet, *, again: bool = False) -> int:
        """Index of the channel set in the map; an equal one is not stored twice (but ``again``)."""
        with self._turn:
            for number, own in enumerate([] if again else self._channel_sets):
                # A map of an earlier version says nothing of laws; that does not make others of it
                if own in (channel_set, channel_set.model_copy(update={"laws": {}})):
                    return number
            if len(self._channel_sets) >= MAX_CHANNEL_SETS:
                raise LimitExceeded(
                    f"{self.path} has {MAX_CHANNEL_SETS} channel sets, more cannot be numbered: "
                    "write a new map"
                )
            self._describe(CHANNELS, pack_channel_set(channel_set))
            self._channel_sets.append(channel_set)
            return len(self._channel_sets) - 1

    def start_run(
        self, seed: int | None = None, parameters: Mapping[str, Any] | None = None
    ) -> None:
        """Record that a trace begins here: the portions from the next one on belong to it."""
        with self._turn:
            self._write_results()
            run = {
                "seed": seed,
                "parameters": dict(parameters or {}),
                "first_portion": self._next_portion,
                "first_ray": self._next_ray,
            }
            self._describe(RUN, pack_run(run))
            self._footer.runs.append(run)
            self._run_first = self._next_portion

    def copy_run(self, run: Mapping[str, Any]) -> None:
        """Take over a run from another map as it is described there."""
        with self._turn:
            self._describe(RUN, pack_run(run))
            self._footer.runs.append(dict(run))

    def copy_chunk(self, tag: bytes, data: bytes) -> None:
        """Carry along a chunk of another map that this version does not know."""
        with self._turn:
            self._append(tag, [data])

    # -- portions ------------------------------------------------------------------------------

    def encode(self, portion: Portion, number: int) -> EncodedPortion:
        """Encode a portion; pure, to be called on worker threads.

        Raises
        ------
        InvalidPortion, LimitExceeded
            Its arrays contradict each other or the directory.
        """
        if not self._trusted:
            if portion.channel_set >= len(self._channel_sets):
                raise InvalidPortion(
                    f"portion {number} uses channel set {portion.channel_set}, the map has "
                    f"{len(self._channel_sets)}: call add_channel_set first"
                )
            check_portion(portion, self.directory, self._channel_sets[portion.channel_set])
        return self._encoder.encode(portion, number, self._channel_sets)

    def commit(self, encoded: EncodedPortion) -> None:
        """Write an encoded portion when its turn comes.

        Portions are written in number order. A worker thread that is far ahead waits; the thread
        that made the writer never waits, so it may collect results in any order.

        Raises
        ------
        InvalidPortion
            The number was committed before, or ray numbers do not increase.
        RayMapError
            The disk is full, now or for a portion before.
        """
        with self._turn:
            waiting = threading.get_ident() != self._owner
            while (
                waiting
                and self._failure is None
                and encoded.number > self._next_portion
                and self._pending_bytes > _BUFFERED_BYTES
            ):
                self._turn.wait()
            self._check_open()
            if encoded.number < self._next_portion or encoded.number in self._pending:
                raise InvalidPortion(f"portion {encoded.number} was committed before")
            self._pending[encoded.number] = encoded
            self._pending_bytes += encoded.size
            while self._next_portion in self._pending:
                ready = self._pending.pop(self._next_portion)
                self._pending_bytes -= ready.size
                try:
                    self._write_portion(ready)
                except BaseException as error:
                    self._failure = error
                    raise
                finally:
                    self._turn.notify_all()

    def copy_portion(self, encoded: EncodedPortion) -> None:
        """Write a portion of another map next, whatever numbers are missing before it."""
        with self._turn:
            self._check_open()
            self._write_portion(encoded)

    def append(self, portion: Portion) -> None:
        """Encode and commit a portion as the next one; its rays are numbered on from the last."""
        if portion.ray_ids is None and portion.first_ray < self._next_ray:
            portion = dataclasses.replace(portion, first_ray=self._next_ray)
        self.commit(self.encode(portion, self._next_portion))

    def add_detector_result(
        self,
        detector: int,
        sums: NDArray[np.float64],
        sums2: NDArray[np.float64],
        *,
        channel_set: int = 0,
        owned: bool = False,
    ) -> None:
        """Add what a detector counted over portions of this run; may be called repeatedly.

        All results of a run together must cover all its portions; they are written by `finish`.

        Parameters
        ----------
        sums, sums2 : (cells_v, cells_u, n_channels), unnormalised Σ w·c, and the sum over
            emissions of (Σ w·c)²
        owned : they will not be changed until `finish`, so that they need not be copied
        """
        with self._turn:
            cells = self.directory.detectors[detector].cells
            shape = (cells[1], cells[0], self._channel_sets[channel_set].n_channels)
            if sums.shape != shape or sums2.shape != shape:
                raise InvalidPortion(
                    f"result of detector {self.directory.detectors[detector].name!r} has shape "
                    f"{sums.shape}, expected {shape}"
                )
            before = self._results.get((detector, channel_set))
            copy = None if owned else True
            self._results[detector, channel_set] = DetectorResult(
                detector=detector,
                channel_set=channel_set,
                first_portion=self._run_first,
                end_portion=self._run_first,
                sums=sums + before.sums if before else np.array(sums, np.float64, copy=copy),
                sums2=sums2 + before.sums2 if before else np.array(sums2, np.float64, copy=copy),
            )

    # -- the end -------------------------------------------------------------------------------

    def finish(self, statistics: Mapping[str, Any] | None = None) -> None:
        """Write results and footer and close the file; more calls do nothing.

        Raises
        ------
        InvalidPortion
            A portion is missing between those committed.
        """
        with self._turn:
            if self._finished:
                return
            self._check_open()
            if self._pending:
                self.close()
                raise InvalidPortion(
                    f"portion {self._next_portion} was never committed; those before it are served"
                )
            if statistics and self._footer.runs:
                self._footer.runs[-1]["statistics"] = dict(statistics)
            self._footer.channel_sets = [each.model_dump() for each in self._channel_sets]
            try:
                self._write_results()
                self._append(PATHS, pack_merged(self._merger.dictionary(), self._local_to_global))
                directory = directory_streams(self.directory)
                self._written += self._appended(pack_footer(self._footer, directory, self._version))
                self._appender.sync()
            finally:
                self.close()

    def close(self) -> None:
        """Close the file without a footer; what was committed in order is served."""
        with self._turn:
            self._finished = True
            self._failure = self._failure or RayMapError(f"{self.path} is closed for writing")
            self._pending.clear()
            self._appender.close()
            self._turn.notify_all()

    # -- inside --------------------------------------------------------------------------------

    def _check_open(self) -> None:
        if self._failure is not None:
            raise RayMapError(str(self._failure)) from self._failure

    def _append(self, tag: bytes, buffers: list[Any]) -> None:
        self._check_open()
        offset = self._appender.end
        written = self._appended(buffers)
        self._written += written
        self._footer.chunks.append((offset, tag))
        self._footer.sizes[offset] = written, len(buffers[0])

    def _describe(self, tag: bytes, buffers: list[Any]) -> None:
        """Append what the footer will repeat, as far as a footer can hold it."""
        size = sum(len(buffer) for buffer in buffers)
        if self._described + size > MAX_DESCRIBED:
            raise LimitExceeded(
                f"{self.path}: its channel sets and runs take more than {MAX_DESCRIBED} bytes: "
                "write a new map"
            )
        self._append(tag, buffers)
        self._described += size

    def _appended(self, buffers: list[Any]) -> int:
        offset = self._appender.append(buffers)
        return self._appender.end - offset

    def _write_portion(self, encoded: EncodedPortion) -> None:
        meta = encoded.meta
        if not encoded.buffers:
            raise InvalidPortion(f"portion {meta.number} was written before; encode it again")
        if meta.n_rays and meta.first_ray < self._next_ray:
            raise InvalidPortion(
                f"portion {meta.number} begins with ray {meta.first_ray}, but rays up to "
                f"{self._next_ray - 1} are in the map: ray numbers increase from portion to portion"
            )
        offset = self._appender.end
        self._written += self._appended(encoded.buffers)
        encoded.release()
        head_size = encoded.head_size
        self._footer.portions.append(IndexEntry(offset, encoded.size, meta, head_size))
        self._local_to_global.append(
            None if encoded.paths is None else self._merger.add(encoded.paths)
        )
        self._next_portion = meta.number + 1
        self._next_ray = max(self._next_ray, meta.last_ray + 1)

    def _write_results(self) -> None:
        for result in self._results.values():
            covered = dataclasses.replace(result, end_portion=self._next_portion)
            self._append(DETECTOR, pack_result(covered))
        self._results.clear()

"""Maps on object storage and web servers, through fsspec; only the bytes that are needed come over.

The end of a file comes first and in one request: it opens a finished map. Streams come as they
are, each in one request. What is shorter than half a block (headers) comes in blocks, which are
kept: one request for many neighbours.
"""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from typing import Any

from raymap.bytes.address import Address
from raymap.bytes.webbytes import MuchSent, is_web, web_links, web_range, web_size
from raymap.model.errors import FormatError, MissingExtra, NotARayMap, RayMapError

__all__ = ["BLOCK", "RemoteBytes", "file_system", "map_addresses", "upload"]

BLOCK = 2**16
KEPT_BLOCKS = 64
TRIES = 3
LARGEST = 2**62
MOST_AT_ONCE = 2**30
"""Bytes of one request: a server may state any length, and send it."""
_PAUSE = 0.25
_BEFORE_OTHERS = frozenset({"async_wrapper", "dask", "dir", "generic", "reference"})
"""Protocols of fsspec that lead to further addresses, beside caches and archives."""


def file_system(address: Address) -> tuple[Any, str]:
    """The file system of an address, and the path on it.

    Raises
    ------
    MissingExtra
        fsspec, or what it needs for this protocol, is not installed.
    NotARayMap
        No file system goes by this protocol, or it refuses the options.
    """
    try:
        from fsspec.core import url_to_fs
        from fsspec.registry import get_filesystem_class
    except ImportError:
        raise MissingExtra(
            f"{address} needs the package fsspec: pip install 'raymap[remote]'"
        ) from None
    try:
        protocols = address.protocols
        kinds = [get_filesystem_class(protocol) for protocol in protocols]
        _refuse_others(kinds, address)
        found, path = url_to_fs(address.url, **address.options)
    except NotARayMap:
        raise
    except ImportError as error:
        raise MissingExtra(f"{address} cannot be opened: {_line(error)}") from None
    except Exception as error:  # whatever a file system raises about its options
        raise NotARayMap(f"{address} cannot be opened: {_line(error)}") from None
    return found, path


def _refuse_others(kinds: list[type], address: Address) -> None:
    """Refuse file systems that stand before others, before any of them is made.

    Of archives any byte may cost unpacking all before it; caches put whole files, of any length,
    on this disk; references are a stranger's list of further addresses, this machine's files too.
    """
    from fsspec.archive import AbstractArchiveFileSystem
    from fsspec.implementations.cached import CachingFileSystem

    if any(issubclass(kind, AbstractArchiveFileSystem) for kind in kinds):
        raise NotARayMap(f"{address} lies in an archive; unpack it, and open the map itself")
    cached = any(issubclass(kind, CachingFileSystem) for kind in kinds)
    if cached or len(kinds) > 1 or not _BEFORE_OTHERS.isdisjoint(address.protocols):
        raise NotARayMap(
            f"{address} leads to a file through other file systems (a cache, references); open the "
            "map at its own address, of which only the bytes that are needed come over, or copy it"
        )


def map_addresses(folder: Address, suffix: str) -> list[Address] | None:
    """The maps in a folder by name; None where the address is no folder."""
    if folder.suffix == suffix:
        return None
    system, path = file_system(folder)
    try:
        if is_web(system):
            entries: Any = web_links(system, path)
        else:
            entries = system.ls(path, False) if system.isdir(path) else None
        if entries is None or (is_web(system) and not entries):
            return None
        names = [str(entry).rstrip("/").rpartition("/")[2] for entry in entries]
    except Exception as error:
        raise NotARayMap(f"{folder} cannot be listed: {_line(error)}") from None
    chosen = sorted({name.partition("?")[0] for name in names})
    maps = [name for name in chosen if name.endswith(suffix) and not name.startswith(".")]
    if not maps:
        raise NotARayMap(f"folder {folder} holds no ray maps (files that end in {suffix})")
    return [folder / name for name in maps]


def upload(data: bytes, address: Address) -> None:
    """Put a finished file at an address.

    Raises
    ------
    RayMapError
        The file system does not take it.
    """
    system, path = file_system(address)
    try:
        system.makedirs(path.rpartition("/")[0], exist_ok=True)
        system.pipe_file(path, data)
    except Exception as error:
        raise RayMapError(f"{address} cannot be written: {_line(error)}") from None


class RemoteBytes:
    """A file on a file system of fsspec, read in ranges by many threads."""

    distant = True

    def __init__(self, address: Address) -> None:
        self.address = address
        self._system, self._path = file_system(address)
        self._lock = threading.Lock()
        self._blocks: OrderedDict[int, bytes] = OrderedDict()
        self._end: tuple[int, bytes] = (0, b"")
        self._closed = False
        self.bytes_read = 0
        self.requests = 0
        try:
            self._known = self._size()
        except FileNotFoundError:
            raise NotARayMap(f"{address} does not exist") from None
        except Exception as error:
            raise NotARayMap(f"{address} cannot be read: {_line(error)}") from None
        self._open_end()

    def _open_end(self) -> None:
        try:
            self.prefetch(self._known - BLOCK)
        except FormatError as error:
            raise NotARayMap(str(error)) from None

    def prefetch(self, start: int) -> None:
        start = max(0, start)
        kept, data = self._end
        if start < self._known and not (data and kept <= start):
            self._end = start, self._fetch(start, self._known)

    def _size(self) -> int:
        self._system.invalidate_cache()
        if is_web(self._system):
            size = web_size(self._system, self._path)
        else:
            size = self._system.info(self._path).get("size")
        if size is None:
            raise OSError("the server does not say how long it is")
        if not 0 <= int(size) <= LARGEST:
            raise OSError(f"the server says that it has {size} bytes")
        return int(size)

    @property
    def size(self) -> int:
        try:
            size = self._size()
        except Exception as error:
            raise FormatError(f"{self.address} cannot be read: {_line(error)}") from None
        with self._lock:
            if size != self._known:
                # The block at the old end has grown (or another file stands here now)
                last = min(size, self._known) // BLOCK
                for number in [each for each in self._blocks if each >= last]:
                    del self._blocks[number]
                self._end = 0, b""
                self._known = size
        return size

    def read(self, offset: int, length: int) -> bytes:
        if self._closed:
            raise FormatError(f"{self.address} is closed")
        end = min(offset + length, self._known)
        if offset >= end:
            return b""
        start, data = self._end
        if start <= offset and end <= start + len(data):
            return data[offset - start : end - start]
        if end - offset > BLOCK // 2:
            return self._fetch(offset, end)
        first, last = offset // BLOCK, (end - 1) // BLOCK
        data = b"".join(self._block(number) for number in range(first, last + 1))
        return data[offset - first * BLOCK : end - first * BLOCK]

    def close(self) -> None:
        self._closed = True
        with self._lock:
            self._blocks.clear()
            self._end = 0, b""

    def _block(self, number: int) -> bytes:
        """A block, from those kept or in one request."""
        with self._lock:
            if number in self._blocks:
                self._blocks.move_to_end(number)
                return self._blocks[number]
            end = min((number + 1) * BLOCK, self._known)
        data = self._fetch(number * BLOCK, end)
        with self._lock:
            self._blocks[number] = data
            while len(self._blocks) > KEPT_BLOCKS:
                self._blocks.popitem(last=False)
        return data

    def _fetch(self, start: int, end: int) -> bytes:
        """Bytes ``start`` to ``end`` in one request, tried again if the line breaks."""
        for attempt in range(TRIES):
            try:
                data = self._asked(start, end)
                break
            except MuchSent:
                raise FormatError(
                    f"{self.address}: the server sends the whole file where a part of it is asked "
                    "for; use one that serves byte ranges, or copy the map here"
                ) from None
            except Exception as error:  # each file system has errors of its own
                if attempt == TRIES - 1 or isinstance(error, FileNotFoundError | PermissionError):
                    raise FormatError(
                        f"{self.address} cannot be read at byte {start}: {_line(error)}"
                    ) from None
                time.sleep(_PAUSE * 4**attempt)
        with self._lock:
            self.bytes_read += len(data)
            self.requests += 1
        return data

    def _asked(self, start: int, end: int) -> bytes:
        """What one request brings, all of it."""
        if end - start > MOST_AT_ONCE:
            raise OSError(f"{end - start} bytes at once are more than are taken over a network")
        if is_web(self._system):
            data = web_range(self._system, self._path, start, end)
        else:
            data = bytes(self._system.cat_file(self._path, start=start, end=end))
        if len(data) > end - start:
            raise MuchSent
        if len(data) < end - start:
            raise OSError(f"{len(data)} of {end - start} bytes came")
        return data


def _line(error: BaseException) -> str:
    """What an error says, in one line."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__

"""Addresses of maps on other file systems: ``s3://bucket/lens.raymap``, ``https://…``, ``memory://``.

Whatever fsspec knows. Here stand the names only, so that nothing is imported for local files.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

__all__ = ["Address", "place_of"]

_PROTOCOL = re.compile(r"([A-Za-z][A-Za-z0-9+.\-]+(?:::[A-Za-z][A-Za-z0-9+.\-]+)*):(/+)(.*)", re.S)

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9+.\-]+")


@dataclass(frozen=True)
class Address:
    """A file or folder on a file system of fsspec; what `pathlib.Path` is for local files.

    Attributes
    ----------
    url : with its protocol
    options : for the file system (keys, endpoint, headers, …)
    """

    url: str
    options: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)

    @property
    def protocols(self) -> list[str]:
        """Those that it chains, one in most addresses; ``file`` where a link is a path."""
        links = [link.partition("://") for link in self.url.split("::")]
        return [head if slashes or _NAME.fullmatch(head) else "file" for head, slashes, _ in links]

    @property
    def name(self) -> str:
        """The last part, without a query."""
        return self.url.partition("?")[0].rstrip("/").rpartition("/")[2]

    @property
    def suffix(self) -> str:
        return Path(self.name).suffix

    @property
    def stem(self) -> str:
        return Path(self.name).stem

    @property
    def parent(self) -> Address:
        """The folder that holds it."""
        head, _, query = self.url.partition("?")
        above = head.rstrip("/").rpartition("/")[0]
        if above.endswith((":", "/")):
            above = head
        return Address(f"{above}?{query}" if query else above, self.options)

    def __truediv__(self, name: str) -> Address:
        head, _, query = self.url.partition("?")
        below = f"{head.rstrip('/')}/{name}"
        return Address(f"{below}?{query}" if query else below, self.options)

    def __str__(self) -> str:
        return self.url


def place_of(
    path: str | os.PathLike[str] | Address, options: Mapping[str, Any] | None = None
) -> Path | Address:
    """A local path, or an address where the text begins with a protocol.

    A `Path` made of an address has lost a slash (``s3:/bucket``); it is understood, too.
    """
    if isinstance(path, Address):
        return path
    text = os.fspath(path)
    found = _PROTOCOL.fullmatch(text)
    if found is None or (len(found[2]) == 1 and Path(text).exists()):
        return Path(text)
    slashes = "///" if found[1] == "file" and len(found[2]) != 2 else "//"
    url = text if len(found[2]) > 1 else f"{found[1]}:{slashes}{found[3]}"
    return Address(url, dict(options or {}))

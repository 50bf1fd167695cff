"""Bytes from web servers, which may send more than they are asked for, or never end.

fsspec's file system knows addresses, options and redirects; what comes back is taken here piece by
piece, as much as was asked for and no longer than a slow line takes.
"""

from __future__ import annotations

from html.parser import HTMLParser
from typing import Any
from urllib.parse import urljoin, urlsplit

__all__ = ["MuchSent", "is_web", "web_links", "web_range", "web_size"]

LONGEST_LISTING = 2**22
"""Bytes of the page that lists a folder."""
PATIENCE = 60.0
"""Seconds that any answer may take, and that a server may say nothing."""
SLOWEST = 2**14
"""Bytes per second that a server sends at least."""
_PIECE = 2**16


class MuchSent(OSError):
    """A server sends more than it was asked for."""


def is_web(system: Any) -> bool:
    """Whether a file system is that of web servers."""
    protocol = getattr(system, "protocol", ())
    return "http" in ((protocol,) if isinstance(protocol, str) else protocol)


def web_range(system: Any, url: str, start: int, end: int) -> bytes:
    """Bytes ``start`` to ``end`` of a file.

    Raises
    ------
    OSError
        They do not come, not in time, or more than them.
    """
    headers = {"Range": f"bytes={start}-{end - 1}", "Accept-Encoding": "identity"}
    return bytes(_awaited(system, _body, system, url, headers, end - start, most=end - start))


def web_size(system: Any, url: str) -> int | None:
    """Length of a file as the server states it.

    Raises
    ------
    OSError
        There is no such file, or no answer in time.
    """
    size = _awaited(system, system._info, url, most=0).get("size")
    return None if size is None else int(size)


def web_links(system: Any, url: str) -> list[str]:
    """Addresses that a page links to, of what lies directly below it; none where it is no page."""
    headers = {"Accept-Encoding": "identity"}
    try:
        page = _awaited(
            system, _body, system, url, headers, LONGEST_LISTING, "text/html", most=LONGEST_LISTING
        )
    except Exception:  # whatever it is, it is no listing
        return []
    found = _Links()
    found.feed(page.decode(errors="replace"))
    folder = urlsplit(url)._replace(query="", fragment="").geturl().rstrip("/") + "/"
    links = (urljoin(folder, link) for link in found.links)
    below = (link for link in links if link.startswith(folder))
    return [link for link in below if "/" not in link[len(folder) :].partition("?")[0].rstrip("/")]


class _Links(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.links += [value for name, value in attrs if tag == "a" and name == "href" and value]


def _awaited(system: Any, function: Any, *arguments: Any, most: int) -> Any:
    from fsspec.asyn import sync

    return sync(system.loop, function, *arguments, timeout=PATIENCE + most / SLOWEST)


async def _body(system: Any, url: str, headers: dict[str, str], most: int, kind: str = "") -> bytes:
    """What a server answers, of the media type ``kind`` if that is given."""
    from aiohttp import ClientTimeout

    options = dict(system.kwargs)
    options["headers"] = {**options.get("headers", {}), **headers}
    options["timeout"] = ClientTimeout(total=PATIENCE + most / SLOWEST, sock_read=PATIENCE)
    session = await system.set_session()
    async with session.get(system.encode_url(url), **options) as answer:
        if answer.status == 404:
            raise FileNotFoundError(url)
        answer.raise_for_status()
        if kind and not answer.headers.get("Content-Type", kind).startswith(kind):
            raise OSError(f"it is no {kind}")
        data = bytearray()
        async for piece in answer.content.iter_chunked(_PIECE):
            data += piece
            if len(data) > most:
                answer.close()
                raise MuchSent(f"more than {most} bytes come")
        return bytes(data)

"""What a page may send: one schema for its state, the calls that exist, bounds for every message.

A page holds the token, yet what it sends is checked like any input: a message may be made by a
program, by an older page, or by a mistake. Keys of the state that are not in `fields` are ignored;
values that do not fit are refused with one line, and the page gets back what holds.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

from raymap.model.events import FAMILIES
from viewer.app.guard import Guard
from viewer.drawn.state import COLOR_RULES
from viewer.panels.panel import PANELS
from viewer.panels.scene import SIDES
from viewer.panels.values import Reader, Refused, choice, flag, number, text, whole

__all__ = ["MOST_BYTES", "Incoming", "check_call", "fields"]

MOST_BYTES = 2**21
"""Of one message; a saved session has up to 2²⁰."""

_MOST_PENDING = 4
_MOST_PAINTING = 4
"""Pictures that are painted while further calls are taken."""

_MOST_TEXT = 20_000
_MOST_NODES = 256
_MOST_DEPTH = 4
_LARGEST = 1e15
_LONG_TEXTS = {"rm_load": 2**20, "rm_restore": 2**20}
_LOGIN_SECONDS = 10.0


_SHARED: Mapping[str, Reader] = {
    "color": choice(*COLOR_RULES),
    "width": number(0.1, 20),
    "opacity": number(0, 1),
    "fade": flag,
    "body_opacity": number(0, 3),
    "names": flag,
    "dark": flag,
    "section_on": flag,
    "section_side": choice(*SIDES),
    "section_place": number(-_LARGEST, _LARGEST),
    "section_rays": flag,
    "clip_event": choice(*FAMILIES),
    "clip_after": whole(10**6),
    "clip_until": whole(10**6),
    "rays_text": text(64),
}


@cache
def fields() -> Mapping[str, Reader]:
    """Every key of the state that a page may set, and how its value is read."""
    panels = PANELS.kinds()
    found = {**_SHARED, "panel": choice(*(panel.word for panel in panels))}
    for panel in panels:
        found |= panel.incoming
    return found


def check_call(name: str, arguments: Any) -> None:
    """Refuse arguments that are too many, too long, too deep, or no numbers.

    Raises
    ------
    Refused
    """
    if not isinstance(arguments, list):
        raise Refused("a list")
    longest = _LONG_TEXTS.get(name, _MOST_TEXT)
    waiting: list[tuple[Any, int]] = [(arguments, 0)]
    seen = 0
    while waiting:
        value, depth = waiting.pop()
        seen += 1
        if seen > _MOST_NODES or depth > _MOST_DEPTH:
            raise Refused("short lists")
        if isinstance(value, dict):
            waiting.extend((part, depth + 1) for pair in value.items() for part in pair)
        elif isinstance(value, list):
            waiting.extend((part, depth + 1) for part in value)
        elif isinstance(value, str):
            if len(value) > longest:
                raise Refused(f"texts of at most {longest} characters")
        elif isinstance(value, int | float):
            if not math.isfinite(value) or abs(value) > _LARGEST:
                raise Refused(f"numbers of at most {_LARGEST:g}")
        elif value is not None:
            raise Refused("texts and numbers")


class Incoming:
    """Stands between the sockets of one trame server and its state.

    Parameters
    ----------
    server : a trame server that is not yet started
    guard : knows the token
    """

    def __init__(self, server: Any, guard: Guard) -> None:
        self.server, self.guard = server, guard
        self.say: Callable[[str, str], None] = lambda _text, _kind: None
        self._handlers: list[Any] = []
        server.add_protocol_to_configure(
            lambda root: root.registerLinkProtocol(_make_login(guard, self._close))
        )

    def bind(self, web_server: Any) -> None:
        """Take the place of what trame would do with messages."""
        self._handlers = list(web_server._ws_handlers)
        for handler in self._handlers:
            protocol = handler.getServerProtocol()
            handler.unchunkers = _make_unchunkers()
            handler.functionMap = {
                "trame.state.get": (protocol, lambda protocol, *_: protocol.get_server_state()),
                "trame.state.update": (protocol, self._update),
                "trame.trigger": (protocol, self._trigger),
                "trame.lifecycle.update": (protocol, lambda *_: None),
                "trame.error.client": (protocol, self._note_error),
            }
            handler.onCompleteMessage = _well_formed(handler.onCompleteMessage)

    def sockets(self) -> int:
        """How many are open that said no token yet."""
        return sum(
            len(handler.connections) - len(handler.authentified_client_ids)
            for handler in self._handlers
        )

    def all_sockets(self) -> int:
        """How many are open."""
        return sum(len(handler.connections) for handler in self._handlers)

    async def _close(self, client_id: str) -> None:
        """Close a socket that said no token."""
        for handler in self._handlers:
            socket = handler.connections.get(client_id)
            if socket is not None and not handler.isClientAuthenticated(client_id):
                await socket.close()

    # -- what a page may ask ---------------------------------------------------------------------

    def _update(self, protocol: Any, changes: Any = None, *_: Any, **__: Any) -> None:
        """Take the fields that are known and fit."""
        taken, wrong = [], {}
        for change in changes[:_MOST_NODES] if isinstance(changes, list) else ():
            key = change.get("key") if isinstance(change, dict) else None
            if not isinstance(key, str) or key not in fields():
                continue
            try:
                taken.append({"key": key, "value": fields()[key](change.get("value"))})
            except Refused as error:
                wrong[key] = str(error)
        if taken:
            protocol.update_state(taken)
        for key, expected in wrong.items():
            self.say(f"{key.replace('_', ' ')} must be {expected}", "error")
        if wrong:
            # The page shows again what holds
            protocol.force_push_state(*wrong)

    async def _trigger(
        self, protocol: Any, name: Any = None, args: Any = None, kwargs: Any = None, *_: Any
    ) -> Any:
        """Call what exists, with arguments within bounds."""
        known = isinstance(name, str) and name.startswith("rm_")
        if not known or self.server.controller.trigger_fn(name) is None or kwargs:
            self.say("the page asked for what this version does not have: reload it", "error")
            return None
        try:
            check_call(name, args)
        except Refused as error:
            self.say(f"what the page sends must be {error}", "error")
            return None
        return await protocol.trigger(name, args, {})

    def _note_error(self, _: Any, message: Any = "", *__: Any) -> None:
        """A mistake of the page's own scripts."""
        line = " ".join(str(message)[:300].split())
        self.say(f"the page stumbled: {line}", "error")


def _make_login(guard: Guard, close: Callable[[str], Any]) -> Any:
    """Lets in sockets whose request carried token or cookie, or that say the token."""
    from wslink.websocket import LinkProtocol

    class Login(LinkProtocol):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__()
            self.known: set[str] = set()

        def onConnect(self, request: Any, client_id: str) -> None:
            if guard.knows(request):
                self.known.add(client_id)
            loop = asyncio.get_running_loop()
            loop.call_later(_LOGIN_SECONDS, lambda: loop.create_task(close(client_id)))

        def onClose(self, client_id: str) -> None:
            self.known.discard(client_id)

        async def validateToken(self, token: Any, client_id: str) -> bool:
            return client_id in self.known or guard.is_token(token)

    return Login()


def _make_unchunkers() -> dict[str, Any]:
    """Pieces of messages by socket: few at a time, none large; wslink would take 4 GB."""
    from wslink.chunking import UnChunker

    class Pieces(UnChunker):  # type: ignore[misc]
        def set_max_message_size(self, size: int) -> None:
            super().set_max_message_size(min(size, MOST_BYTES))

        def process_chunk(self, chunk: bytes) -> Any:
            try:
                if len(self.pending_messages) > _MOST_PENDING:
                    raise Refused("too many messages at once")
                return super().process_chunk(chunk)
            except Exception:
                # Ends this socket without a word of trame's in the terminal
                raise ConnectionResetError("a message that is none") from None

    class Unchunkers(dict[str, Any]):
        def __setitem__(self, client_id: str, _: Any) -> None:
            super().__setitem__(client_id, Pieces())

    return Unchunkers()


def _well_formed(take: Callable[[Any, str], Any]) -> Callable[[Any, str], Any]:
    """Passes over messages that are no calls.

    A socket's calls are answered one after the other, but for pictures: what comes behind one may
    say that it is no longer wanted.
    """
    painting: set[asyncio.Task[Any]] = set()

    def done(task: asyncio.Task[Any]) -> None:
        painting.discard(task)
        if not task.cancelled():
            # A page that was closed meanwhile gets no answer
            task.exception()

    async def check(message: Any, client_id: str) -> None:
        if not isinstance(message, dict):
            return
        texts = (message.get("id"), message.get("method"))
        arguments = message.get("args", [])
        tables = isinstance(message.get("kwargs", {}), dict)
        if not (isinstance(arguments, list) and tables):
            return
        if not all(isinstance(text, str) and len(text) < 200 for text in texts):
            return
        message["kwargs"] = {}
        picture = texts[1] == "trame.trigger" and arguments[:1] == ["rm_frame"]
        if picture and len(painting) < _MOST_PAINTING:
            task = asyncio.get_running_loop().create_task(take(message, client_id))
            painting.add(task)
            task.add_done_callback(done)
        else:
            await take(message, client_id)

    return check

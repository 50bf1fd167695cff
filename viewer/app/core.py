"""What all parts of the application share: session, page, workers, messages, the running search."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Literal

from raymap.model.errors import CriterionError, RayMapError
from viewer.app.history import History
from viewer.app.inquiry import Inquiry, criterion_error
from viewer.app.session import Session
from viewer.drawn.state import ViewState, state_from_json, state_to_address
from viewer.panels.panel import PANELS, known_panel
from viewer.panels.saved_criteria import CriterionRegistry
from viewer.panels.scene import section_fields

if TYPE_CHECKING:
    from raymap.file.reader import RayMap
    from viewer.drawn.bodies import Body

__all__ = ["CLIP", "LOOK", "RAY_STEPS", "REFRESH_SECONDS", "SECTION", "Core", "Render"]

RAY_STEPS = (50, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000, 200_000)

LOOK = ("color", "width", "opacity", "fade", "body_opacity", "names", "dark")
"""Fields of the page that change the picture alone."""

SECTION = ("section_on", "section_side", "section_place", "section_rays")
CLIP = ("clip_event", "clip_after", "clip_until")

ANSWERING = ("frame", "hover", "scene", "chunk", "offer")
"""Coroutines whose answer the page waits for."""

Render = Literal["auto", "client", "server"]
"""Who draws the scene."""

MOST_TASKS = 64
"""What pages asked for and is not yet done."""

MOST_MESSAGE = 500
"""Characters of a message on the page."""

REFRESH_SECONDS = 2.0
"""How often a map that is still recorded is looked at again."""


class Core:
    """One map on the pages of one browser; several tabs of it share the session.

    Parameters
    ----------
    server : a trame server that is not yet started
    ray_map : an open map
    state : where to begin
    registry : recent and saved criteria; the user's own unless given
    bodies : of the scene, where another application has loaded them
    render : who draws the scene: the page, this program, or the faster of them
    """

    def __init__(
        self,
        server: Any,
        ray_map: RayMap,
        state: ViewState | None = None,
        *,
        registry: CriterionRegistry | None = None,
        bodies: Sequence[Body] | None = None,
        render: Render = "auto",
    ) -> None:
        self.server, self.page, self.render = server, server.state, render
        self.session = Session(ray_map, state, bodies)
        self.history = History(self.session.state)
        self.inquiry = Inquiry(self.session)
        self.questions = self._questions()
        self.registry = registry or CriterionRegistry.of_user()
        self._painting = ThreadPoolExecutor(1, "paint")
        self._asking = ThreadPoolExecutor(2, "ask")
        self._tasks: set[asyncio.Task[Any]] = set()
        self._closed = False
        self.stopping = threading.Event()
        self._number = 0
        self._progress = 0.0
        self._size = (900, 700)
        self.quiet = False
        self._damage_told = 0
        self._told = (0, False)
        server.raymap_incoming.say = self.say

    def _questions(self) -> dict[str, Any]:
        """What the panels ask with, nothing asked yet."""
        return {panel.word: panel.questions(self.session) for panel in PANELS.kinds()}

    def _guarded(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Turn refused requests into messages on the page; the server goes on.

        A page's requests are taken one after the other, so what takes a while and answers nothing
        is done beside them: a long search can still be stopped.
        """

        async def contained(work: Any) -> Any:
            try:
                return await work
            except RayMapError as error:
                self.say(str(error), "error")
            except Exception as error:
                # Whatever a page may send, or a file may do, it ends here
                self.say(f"this cannot be done ({type(error).__name__}: {error})", "error")
            return None

        async def call(*arguments: Any, **_: Any) -> Any:
            async def work() -> Any:
                result = function(*arguments)
                return await result if asyncio.iscoroutine(result) else result

            if len(self._tasks) >= MOST_TASKS:
                self.say("so much is under way that this was left out: wait a moment", "error")
                return None
            if asyncio.iscoroutinefunction(function) and function.__name__ not in ANSWERING:
                self._spawn(contained(work()))
                return None
            return await contained(work())

        return call

    def close(self) -> None:
        """End running searches."""
        self._closed = True
        self.stopping.set()
        for task in self._tasks:
            task.cancel()
        self._painting.shutdown(wait=False, cancel_futures=True)
        self._asking.shutdown(wait=False, cancel_futures=True)

    def _spawn(self, work: Any) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def ask(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """The answer of a function, while the page goes on."""
        return await self._in(self._asking, function, *arguments)

    async def paint(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """The same for painting, one after the other."""
        return await self._in(self._painting, function, *arguments)

    async def _in(
        self, pool: ThreadPoolExecutor, function: Callable[..., Any], *arguments: Any
    ) -> Any:
        if self._closed:
            # What is still under way has nobody to answer
            raise asyncio.CancelledError
        return await asyncio.get_running_loop().run_in_executor(pool, function, *arguments)

    # -- messages --------------------------------------------------------------------------------

    def say(self, text: str, kind: str = "note") -> None:
        """Show a message in the page, in one line; the same one only once."""
        text = text if len(text) <= MOST_MESSAGE else f"{text[:MOST_MESSAGE]}…"
        with self.page:
            others = [item for item in self.page.messages if item["text"] != text]
            key = int(time.monotonic() * 1e6)
            self.page.messages = [*others[-2:], {"key": key, "text": text, "kind": kind}]

    def dismiss(self, key: int) -> None:
        """Close a message."""
        self.page.messages = [item for item in self.page.messages if item["key"] != key]

    def hello(self) -> None:
        """A tab was opened."""
        handlers = getattr(getattr(self.server, "_server", None), "_ws_handlers", ())
        tabs = sum(len(handler.connections) for handler in handlers)
        if tabs > 1:
            self.say(f"This session is open in {tabs} tabs; all of them show the same.")

    def _tell_damage(self) -> None:
        """Say once what could not be read."""
        damage = self.session.map.damage
        if len(damage) > self._damage_told:
            lost = ", ".join(
                f"portion {item.portion}" if item.portion is not None else f"bytes at {item.offset}"
                for item in damage[:3]
            )
            more = f" and {len(damage) - 3} more" if len(damage) > 3 else ""
            self.say(
                f"The map is damaged: {lost}{more} cannot be read and are left out "
                f"({damage[-1].reason}). `raymap repair` saves the rest.",
                "error",
            )
        self._damage_told = len(damage)

    # -- state of the page -----------------------------------------------------------------------

    def _push(self) -> None:
        """Show the whole state in the page."""
        self._told = self._extent()
        state, ray_map = self.session.state, self.session.map
        self.quiet = True
        step = sum(1 for number in RAY_STEPS if number < state.rays)
        count = f"{ray_map.rays:,} rays"
        with self.page:
            self.page.update(
                {
                    **{name: getattr(state, name) for name in LOOK},
                    **section_fields(state, ray_map.directory),
                    **self.followed(),
                    "criterion": state.criterion, "panel": known_panel(state.panel),
                    "clip_event": state.clip.event, "clip_after": state.clip.after,
                    "clip_until": state.clip.until,
                    "ray_step": min(step, len(RAY_STEPS) - 1), "rays_text": f"{state.rays:,}",
                    "objects": self.session.objects(),
                    "parallel": self._parallel(),
                    "up": state.up,
                    "map_name": ray_map.path.name, "map_title": str(ray_map.path),
                    "map_rays": count, "recording": not ray_map.finished,
                }
            )  # fmt: skip
        self.quiet = False

    def _parallel(self) -> bool:
        camera = self.session.state.camera
        return camera is None or camera.parallel

    def followed(self) -> dict[str, Any]:
        """What the panels' fields repeat of what the session shows."""
        return {
            name: value for panel in PANELS.kinds() for name, value in panel.follow(self).items()
        }

    def repaint(self, **fields: Any) -> None:
        """Show a new picture, and the session in the address."""
        with self.page:
            self.page.update(fields)
            self.page.version += 1
            self.settled()
            self.page.parallel = self._parallel()
            self.page.up = self.session.state.up

    def settled(self) -> None:
        """A state is shown: put it into the address and among the steps to go back to."""
        self.history.note(self.session.state, time.monotonic())
        self.page.address = state_to_address(self.session.state)
        self.page.can_undo, self.page.can_redo = self.history.can_undo, self.history.can_redo

    def undo(self) -> None:
        """Show what was shown before."""
        self._go(self.history.undo(self.session.state))

    def redo(self) -> None:
        """Show again what was undone last."""
        self._go(self.history.redo(self.session.state))

    def _go(self, state: ViewState) -> None:
        before, self.session.state = self.session.state, state
        if state == before:
            return
        self._push()
        if (state.criterion, state.paths) != (before.criterion, before.paths):
            self.page.criterion_error = None
            self._spawn(self._answer())
        else:
            self.repaint(**self.inquiry.drawn())

    def change(self, **changes: Any) -> bool:
        """Take changes from the page, checked as a saved session would be."""
        merged = asdict(self.session.state)
        merged.update({name: _plain(value) for name, value in changes.items()})
        checked = state_from_json(merged)
        return self.session.update(**{name: getattr(checked, name) for name in changes})

    def _restart(self, state: ViewState) -> None:
        self.session.state = state
        self.session.chosen = None
        self.questions = self._questions()
        self._push()
        self._spawn(self._answer())

    # -- searching -------------------------------------------------------------------------------

    def cancel(self) -> None:
        """Stop the running search."""
        self.stopping.set()

    def _note_progress(self, progress: Any) -> None:
        self._progress = float(progress.fraction)

    async def _follow(self, number: int) -> None:
        """Show the progress of a search that takes a while."""
        while number == self._number:
            await asyncio.sleep(0.25)
            with self.page:
                self.page.progress = max(0.03, self._progress)

    async def _answer(self) -> None:
        """Answer the criterion: rays, picture, table, images; a newer question ends this one."""
        self.stopping.set()
        cancel = self.stopping = threading.Event()
        self._number += 1
        number = self._number
        self._progress = 0.0
        with self.page:
            self.page.update({"searching": True, "progress": 0.0})
        self._spawn(self._follow(number))
        try:
            fields = await self.ask(self.inquiry.draw, cancel.is_set, self._early())
            if number != self._number:
                return
            self.repaint(**fields)
            fields = await self.ask(self.inquiry.answer, cancel.is_set, self._note_progress)
            if number != self._number:
                return
            with self.page:
                self.page.update({**fields, "criterion_error": None})
            await self.fill_panel(cancel)
        except CriterionError as error:
            if number == self._number:
                with self.page:
                    self.page.criterion_error = criterion_error(error)
        except (RayMapError, OSError, ValueError, LookupError) as error:
            if number == self._number:
                self.say(str(error).partition("\n")[0], "error")
        finally:
            if number == self._number:
                self._number += 1
                with self.page:
                    self.page.update(
                        {
                            "searching": False,
                            "panel_busy": False,
                            "answered": self.page.answered + 1,
                        }
                    )
                self._tell_damage()

    async def fill_panel(self, cancel: threading.Event, panel: str | None = None) -> None:
        """What the open panel shows of the selection."""
        asked = self._number
        questions = await PANELS[known_panel(panel or self.session.state.panel)].fill(self, cancel)
        with self.page:
            self.page.panel_busy = bool(questions)
        for question in questions:
            fields = await self.ask(question)
            if cancel.is_set() and asked != self._number:
                return
            with self.page:
                self.page.update(fields)
        with self.page:
            self.page.panel_busy = False

    async def redraw(self) -> None:
        """Other rays of the same selection."""
        with self.page:
            self.page.searching = True
        try:
            fields = await self.ask(self.inquiry.draw, self.stopping.is_set, self._early())
        finally:
            with self.page:
                self.page.searching = False
        if fields:
            self.repaint(**fields)

    def _early(self) -> Callable[[dict[str, Any]], None]:
        """Shows a picture with the first rays, called from a worker."""
        loop = asyncio.get_running_loop()
        return lambda fields: _ignore(loop.call_soon_threadsafe(lambda: self.repaint(**fields)))

    async def _watch(self) -> None:
        """Take in what is recorded meanwhile."""
        # Another browser's application may look at the same map: what counts is what this one told
        while not self._told[1]:
            await asyncio.sleep(REFRESH_SECONDS)
            try:
                await self.ask(self.session.map.refresh)
            except (RayMapError, OSError) as error:
                self.say(f"the map cannot be read any more: {error}", "error")
                return
            if self._extent() != self._told:
                self._push()
                if not self.page.searching:
                    await self._answer()

    def _extent(self) -> tuple[int, bool]:
        """What changes while the map grows."""
        return self.session.map.rays, self.session.map.finished

    async def set_criterion(self, text: str) -> None:
        """A new criterion, from the editor, a panel or a list."""
        raise NotImplementedError

    async def open_ray(self, text: str, point: int | None = None) -> None:
        """A ray was chosen, by its number: panels that show one open it."""
        for panel in PANELS.kinds():
            if panel.ray is not None:
                await panel.ray(self, text, point)


def _ignore(_: object) -> None:
    return None


def _plain(value: Any) -> Any:
    return asdict(value) if hasattr(value, "__dataclass_fields__") else value

"""What a panel of the application is: markup, fields, actions, and how it is filled.

Panels stand as tabs beside the scene. Ours are the modules of `viewer.panels` that declare one in
``KINDS``; other distributions add theirs under the entry-point group ``raymap.panels``.
"""

from __future__ import annotations

import threading
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from raymap.model.directory import Detector
from raymap.model.registry import Registry
from viewer.panels.values import Reader

__all__ = ["PANELS", "Application", "Panel", "Question", "Session", "known_panel"]

Question = Callable[[], dict[str, Any]]


class Session(Protocol):
    """What is shown of a map (`viewer.app.session.Session`).

    Attributes
    ----------
    map : the open map
    state : what is shown, an immutable `viewer.drawn.state.ViewState`
    drawing : the rays of the selection that are drawn
    chosen : the ray that stands out in the scene, or None
    path_names : short names of paths by their criteria, for the legend
    """

    map: Any
    state: Any
    drawing: Any
    chosen: Any
    path_names: dict[str, str]

    def update(self, **changes: Any) -> bool:
        """Change fields of the state; whether it is another now."""

    def detector(self) -> Detector | None:
        """The detector that is shown; None where the map has none."""


class Application(Protocol):
    """What panels may ask of the application (`viewer.app.page.Application`).

    Attributes
    ----------
    page : the fields of the page; assign them within ``with application.page:``
    session : what is shown of the map
    questions : what each panel asks with, by its word
    registry : recent and saved criteria
    quiet : the application itself sets fields at the moment: nobody at the page changed them
    stopping : is set when the running search is to end
    """

    page: Any
    questions: dict[str, Any]
    registry: Any
    quiet: bool
    stopping: threading.Event

    @property
    def session(self) -> Session: ...

    async def ask(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a function in a worker thread."""

    async def set_criterion(self, text: str) -> None:
        """Another criterion, answered at once."""

    async def open_ray(self, text: str, point: int | None = None) -> None:
        """A ray was chosen, by its number: every panel does with it what it says as ``ray``."""

    async def fill_panel(self, cancel: threading.Event, panel: str | None = None) -> None:
        """Ask the questions of the open panel, or of a named one, anew."""

    async def redraw(self) -> None:
        """Read the rays to draw anew."""

    def repaint(self, **fields: Any) -> None:
        """Fields of the page, and a new picture."""

    def change(self, **changes: Any) -> bool:
        """Changes of the session's state, checked; whether it is another now."""


async def _nothing(application: Application, cancel: threading.Event) -> Sequence[Question]:
    return ()


@dataclass(frozen=True, kw_only=True)
class Panel:
    """A tab of the application.

    Attributes
    ----------
    word : by which session and page know it
    title : on its tab
    place : among the tabs, from the lowest
    markup : its inside, in the template language of Vue; it sees all fields of the page and calls
        ``trigger('rm_NAME', [arguments])``
    css : a further class of its outermost element
    fields : what its fields are at first
    follow : fields that repeat what the session shows, told anew whenever that is another
    questions : makes the object that asks for it and remembers the answers, one for a session
    incoming : fields that the page may set, and how their values are read
    actions : called by the page, by NAME: functions of the application and the arguments
    changes : called after the page has set one of some fields: functions of the application
    fill : asked when the panel is open and the selection is another: questions that are answered
        one after the other in a worker thread, as fields of the page
    ray : called when a ray is chosen, as in the scene: with its number, and a point of it or None
    """

    word: str
    title: str
    place: float = 1000.0
    markup: Callable[[], str]
    css: str = ""
    fields: Callable[[Application], dict[str, Any]] = lambda application: {}
    follow: Callable[[Application], dict[str, Any]] = lambda application: {}
    questions: Callable[[Session], Any] = lambda session: None
    incoming: Mapping[str, Reader] = field(default_factory=dict)
    actions: Mapping[str, Callable[..., Any]] = field(default_factory=dict)
    changes: Mapping[tuple[str, ...], Callable[[Application], Awaitable[None]]] = field(
        default_factory=dict
    )
    fill: Callable[[Application, threading.Event], Awaitable[Sequence[Question]]] = _nothing
    ray: Callable[[Application, str, int | None], Awaitable[None]] | None = None

    def on_page(self) -> str:
        """The markup with the element that shows it while its tab is chosen."""
        kinds = " ".join(("rm-panel", self.css)).strip()
        return (
            f'<div class="{kinds}" v-if="panel === \'{self.word}\'" '
            f'data-testid="panel-{self.word}">\n{self.markup()}</div>'
        )


PANELS: Registry[Panel] = Registry(
    "raymap.panels",
    "viewer.panels",
    words=lambda panel: (panel.word,),
    of=Panel,
    sort="panels of the application",
)
"""Panels by word."""


def known_panel(word: str) -> str:
    """The panel of a session; the first one where a session names a panel that is not here."""
    return word if word in PANELS else PANELS.kinds()[0].word

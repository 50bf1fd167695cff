"""The application in a tab of a browser, driven as a person would.

Screenshots are kept in ``build/screenshots``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

SHOTS = Path(__file__).parent.parent.parent / "build" / "screenshots"

WINDOW = {"viewport": {"width": 1440, "height": 900}, "accept_downloads": True}


class Page:
    """A tab, with the waits that a person does by looking.

    Parameters
    ----------
    browser : of Playwright
    url : to open
    context : cookies and all else of the browser whose tab it is; by default a new browser
    """

    def __init__(self, browser: Any, url: str, context: Any = None) -> None:
        self._shared = context is not None
        self.context = context or browser.new_context(**WINDOW)
        self.tab = self.context.new_page()
        self.errors: list[str] = []
        self.hosts: set[str] = set()
        self.tab.on("pageerror", lambda error: self.errors.append(str(error)))
        # What the content security policy stops is said on the console
        self.tab.on("console", self._note)
        self.tab.on("request", lambda request: self.hosts.add(request.url.split("/")[2]))
        self.tab.set_default_timeout(60_000)
        self.tab.goto(url)
        self.settle()

    def _note(self, message: Any) -> None:
        # trame looks for a launcher first; there is none
        if message.type == "error" and "/paraview/" not in message.location["url"]:
            self.errors.append(message.text)

    def settle(self) -> None:
        """Wait until the answer is there and painted."""
        self.tab.wait_for_function(
            """() => {
                const app = document.querySelector('[data-testid=app]');
                const view = document.querySelector('[data-testid=view]');
                return app && view && app.dataset.searching === 'false'
                    && Number(app.dataset.answered) > 0 && view.dataset.busy === '0'
                    && view.dataset.painted === view.dataset.version;
            }""",
            timeout=90_000,
        )

    def get(self, name: str) -> Any:
        return self.tab.get_by_test_id(name)

    def text(self, name: str) -> str:
        return str(self.get(name).inner_text())

    def wait_text(self, name: str, part: str) -> None:
        self.tab.wait_for_function(
            "([name, part]) => document.querySelector(`[data-testid=${name}]`)"
            "?.innerText.includes(part)",
            arg=[name, part],
        )

    def ask(self, criterion: str) -> None:
        """Type a criterion and wait for its answer."""
        before = self.get("app").get_attribute("data-answered")
        self.get("criterion").fill(criterion)
        self.get("criterion").press("Enter")
        self.tab.wait_for_function(
            "before => document.querySelector('[data-testid=app]').dataset.answered !== before",
            arg=before,
        )
        self.settle()

    def show(self, panel: str) -> None:
        self.get(f"tab-{panel}").click()
        self.get(f"panel-{panel}").wait_for()

    def shot(self, name: str) -> None:
        SHOTS.mkdir(parents=True, exist_ok=True)
        self.tab.screenshot(path=SHOTS / f"{name}.png")

    def close(self) -> None:
        self.tab.close()
        if not self._shared:
            self.context.close()

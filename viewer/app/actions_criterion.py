"""What the page asks of the criterion: the editor, and saved sessions."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from raymap.model.errors import RayMapError
from raymap.model.giventext import json_value
from viewer.app.core import Core
from viewer.app.inquiry import criterion_error
from viewer.drawn.answers import check_criterion
from viewer.drawn.state import StateError, state_from_address, state_from_json, state_to_address
from viewer.panels.completion import complete
from viewer.panels.tree import criterion_tree, demanded_detector

__all__ = ["CriterionActions"]


class CriterionActions(Core):
    """The editor's text; whatever changes the criterion ends in `set_criterion`."""

    def restore(self, text: str) -> None:
        """Take the session of an address."""
        if text and text != state_to_address(self.session.state):
            self._restart(state_from_address(str(text)))

    def load(self, text: str) -> None:
        """Take the session of a file that was opened in the page."""
        try:
            values = json_value(text)
        except ValueError:
            raise StateError("this file is not a saved session (not JSON)") from None
        self._restart(state_from_json(values))

    def complete(self, text: str, cursor: int) -> dict[str, Any]:
        """Proposals for the editor."""
        start, found = complete(str(text), int(cursor), self.session.map.directory)
        return {"from": start, "items": [asdict(item) for item in found]}

    async def set_criterion(self, text: str) -> None:
        """A new criterion, from the editor, the tree or a list."""
        text = str(text).strip()
        if text == self.session.state.criterion and self.page.criterion_error is None:
            return
        try:
            check_criterion(self.session.map, text)
        except RayMapError as error:
            with self.page:
                self.page.criterion_error = criterion_error(error)
            return
        names = [entry.name for entry in self.session.map.directory.detectors]
        shown = self.session.detector()
        asked = demanded_detector(criterion_tree(text), names) or (shown and shown.name)
        self.session.update(criterion=text, paths=(), detector=asked)
        with self.page:
            self.page.update(
                {
                    **self.followed(),
                    "criterion": text,
                    "criterion_error": None,
                }
            )
        await self._answer()
        self.registry.use(text)
        with self.page:
            self.page.update(self.followed())

"""What the page asks of the criterion: the editor, the tree, lists, saved sessions."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

from raymap.model.errors import RayMapError
from viewer.app.core import Core
from viewer.app.inquiry import criterion_error
from viewer.drawn.answers import check_criterion
from viewer.drawn.state import StateError, state_from_address, state_from_json, state_to_address
from viewer.panels.completion import complete
from viewer.panels.tree import (
    add_node,
    count_node,
    criterion_tree,
    demanded_detector,
    make_atom,
    negate_node,
    remove_node,
    set_group,
    tree_text,
)

__all__ = ["CriterionActions"]


class CriterionActions(Core):
    """Text and tree of the criterion edit each other; both end in `set_criterion`."""

    def restore(self, text: str) -> None:
        """Take the session of an address."""
        if text and text != state_to_address(self.session.state):
            self._restart(state_from_address(str(text)))

    def load(self, text: str) -> None:
        """Take the session of a file that was opened in the page."""
        try:
            values = json.loads(text)
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
        shown = self.inquiry.detector_name()
        asked = demanded_detector(criterion_tree(text), self.page.detectors) or shown
        if asked != shown:
            self.inquiry.place = None
        self.session.update(criterion=text, paths=(), detector=asked)
        with self.page:
            self.page.update(
                {
                    "criterion": text,
                    "detector": asked,
                    "criterion_error": None,
                    "tree_place": None,
                    "region": self._region(),
                }
            )
        await self._answer()
        self.shelf.use(text)
        with self.page:
            self.page.update(self.shelf.fields())

    async def edit_tree(self, action: str, key: str, value: str) -> None:
        """Edit one node of the tree."""
        tree = criterion_tree(self.session.state.criterion)
        place = _place(key)
        if tree is None:
            return
        if action == "remove":
            new = remove_node(tree, place)
        elif action == "not":
            new = negate_node(tree, place)
        elif action == "group":
            new = set_group(tree, place, str(value))
        else:
            compare, number = str(value).split(" ")
            new = count_node(tree, place, compare, int(number))
        await self.set_criterion(tree_text(new))

    async def add_atom(self, join: str, kind: str, name: str, event: str) -> None:
        """Add a condition to the chosen line of the tree."""
        tree = criterion_tree(self.session.state.criterion)
        place = _place(self.page.tree_place or "") if tree is not None else ()
        atom = make_atom(str(kind), str(name), str(event))
        await self.set_criterion(tree_text(add_node(tree, place, atom, str(join))))

    def use_shelf(self, action: str, name: str) -> None:
        """Save or forget a criterion."""
        if action == "save":
            self.shelf.save(str(name), self.session.state.criterion)
        else:
            self.shelf.forget(str(name))
        with self.page:
            self.page.update(self.shelf.fields())


def _place(key: str) -> tuple[int, ...]:
    return tuple(int(part) for part in str(key).split(".") if part)

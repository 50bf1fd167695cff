"""The criterion panel: the expression as a tree to build with the mouse, recent and saved ones."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any

from query.expression.arguments import Events, Names
from query.expression.names import escape
from raymap.model.directory import Directory
from raymap.model.errors import RayMapError
from raymap.model.events import FAMILIES
from viewer.drawn.answers import count_rays
from viewer.panels.panel import Application, Panel, Question, Session
from viewer.panels.tree import (
    GROUPS,
    TreeRow,
    add_node,
    count_node,
    criterion_tree,
    make_atom,
    mouse_kinds,
    negate_node,
    remove_node,
    set_group,
    tree_rows,
    tree_text,
)
from viewer.panels.values import Refused, choice, maybe, text, whole
from viewer.templates import template

__all__ = ["KINDS", "CriterionQuestions", "choices"]


def choices(directory: Directory) -> dict[str, Any]:
    """Lists of names that conditions are built from."""

    def names(values: list[str], special: str = "*?\\") -> list[dict[str, str]]:
        return [{"title": name, "value": escape(name, special)} for name in values]

    objects = names([item.name for item in directory.objects], "*?.\\#")
    faces = [
        {
            "title": f"{item.name}.{face.name}",
            "value": f"{escape(item.name)}.{escape(face.name)}",
        }
        for item in directory.objects
        for face in item.faces
        if len(item.faces) > 1
    ]
    of: dict[str, list[dict[str, str]]] = {
        "place": [{"title": "any surface", "value": "*"}, *objects, *faces],
        "detector": names([entry.name for entry in directory.detectors]),
        "source": names([entry.name for entry in directory.sources]),
        "medium": names([entry.name for entry in directory.media]),
    }
    kinds = mouse_kinds()
    lists = {
        kind.word: of[argument.of]
        for kind in kinds
        for argument in kind.arguments
        if isinstance(argument, Names)
    }
    families = ["reflected", "refracted", "transmitted", "scattered", "absorbed"]
    return {
        "atom_choices": lists,
        "atom_names": {kind: (found[0]["value"] if found else "") for kind, found in lists.items()},
        "atom_kinds": [{"value": kind.word, "title": kind.phrase} for kind in kinds],
        "atom_happens": [
            kind.word for kind in kinds if any(isinstance(a, Events) for a in kind.arguments)
        ],
        "atom_events": families + [word for word in FAMILIES if word not in families],
        "groups": [{"value": key, "title": title} for key, title in GROUPS.items()],
    }


def tree_fields(rows: list[TreeRow], counts: dict[str, str]) -> list[dict[str, Any]]:
    """The tree for the page; ``counts`` says how many rays satisfy each text."""
    return [
        {
            "key": ".".join(map(str, row.place)),
            "depth": len(row.place),
            "label": row.label,
            "kind": row.kind,
            "operator": row.operator,
            "text": row.text,
            "rays": counts.get(row.text, ""),
        }
        for row in rows
    ]


class CriterionQuestions:
    """Counts the rays of each part of a session's criterion."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.told: str | None = None

    def tree(self, cancel: Callable[[], bool]) -> list[dict[str, Any]]:
        """The criterion as a tree with the number of rays of each node."""
        rows = tree_rows(criterion_tree(self.session.state.criterion))
        counts: dict[str, str] = {}
        for row in rows:
            if cancel():
                break
            try:
                found = count_rays(self.session.map, row.text, cancel=cancel)
                counts[row.text] = f"{found.matched:,}"
            except RayMapError:
                counts[row.text] = ""
        return tree_fields(rows, counts)

    def plain_tree(self) -> list[dict[str, Any]]:
        """The criterion as a tree, not yet counted."""
        return tree_fields(tree_rows(criterion_tree(self.session.state.criterion)), {})


def _questions(app: Application) -> CriterionQuestions:
    found: CriterionQuestions = app.questions["criterion"]
    return found


async def edit_tree(app: Application, action: str, key: str, value: str) -> None:
    """Edit one node of the tree."""
    tree = criterion_tree(app.session.state.criterion)
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
    await app.set_criterion(tree_text(new))


async def add_atom(app: Application, join: str, kind: str, name: str, event: str) -> None:
    """Add a condition to the chosen line of the tree."""
    tree = criterion_tree(app.session.state.criterion)
    place = _place(app.page.tree_place or "") if tree is not None else ()
    atom = make_atom(str(kind), str(name), str(event))
    await app.set_criterion(tree_text(add_node(tree, place, atom, str(join))))


def change_saved(app: Application, action: str, name: str) -> None:
    """Save or forget a criterion."""
    if action == "save":
        app.registry.save(str(name), app.session.state.criterion)
    else:
        app.registry.forget(str(name))
    with app.page:
        app.page.update(app.registry.fields())


def _place(key: str) -> tuple[int, ...]:
    return tuple(int(part) for part in str(key).split(".") if part)


def _kind(value: Any) -> str:
    chosen: str = choice(*(kind.word for kind in mouse_kinds()))(value)
    return chosen


def _names(value: Any) -> dict[str, str]:
    if not isinstance(value, dict) or not set(value) <= {kind.word for kind in mouse_kinds()}:
        raise Refused("a name for each kind of condition")
    return {key: text(4096)(name) for key, name in value.items()}


def _follow(app: Application) -> dict[str, Any]:
    asked, criterion = _questions(app), app.session.state.criterion
    same, asked.told = asked.told == criterion, criterion
    registry: dict[str, Any] = app.registry.fields()
    # The chosen line was one of another tree
    return registry if same else registry | {"tree_place": None}


async def _fill(app: Application, cancel: threading.Event) -> Sequence[Question]:
    with app.page:
        app.page.tree = _questions(app).plain_tree()
    return [lambda: {"tree": _questions(app).tree(cancel.is_set)}]


KINDS = (
    Panel(
        word="criterion",
        title="Criterion",
        place=10,
        markup=lambda: template("criterion"),
        fields=lambda app: {
            "tree": [],
            "tree_place": None,
            "atom_kind": "hit",
            "atom_event": "reflected",
            "count_compare": ">=",
            "count_value": 2,
            "save_name": "",
            **choices(app.session.map.directory),
        },
        follow=_follow,
        questions=CriterionQuestions,
        incoming={
            "tree_place": maybe(text(1000, r"[0-9.]*")),
            "atom_kind": _kind,
            "atom_names": _names,
            "atom_event": text(64),
            "count_compare": choice("==", ">=", "<=", ">", "<", "!="),
            "count_value": whole(10**9),
        },
        actions={"tree": edit_tree, "add": add_atom, "saved": change_saved},
        fill=_fill,
    ),
)

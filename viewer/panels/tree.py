"""A criterion as a tree to edit with the mouse; each edit gives the text of the new criterion.

Nodes are addressed by the places on the way to them: () is the root, (0, 1) the second child of
the first. The tree itself is the JSON form of criteria.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from query import from_json, parse
from query.expression.arguments import Events, Names
from query.expression.atom import Condition
from query.expression.names import escape
from query.expression.registry import ATOMS
from raymap.model.directory import Detector
from raymap.model.errors import CriterionError
from raymap.optics.cells import cells_by_angle
from viewer.drawn.state import Region

__all__ = [
    "GROUPS",
    "TreeRow",
    "add_node",
    "count_node",
    "criterion_region",
    "criterion_tree",
    "demanded_detector",
    "make_atom",
    "mouse_kinds",
    "negate_node",
    "region_values",
    "remove_node",
    "set_group",
    "tree_rows",
    "tree_text",
    "with_region",
]

Tree = dict[str, Any]
Place = tuple[int, ...]

GROUPS: dict[str, str] = {"and": "all of", "or": "any of", "xor": "one of", "then": "in this order"}
"""Words of the groups in the tree."""


@dataclass(frozen=True, kw_only=True)
class TreeRow:
    """One line of the tree.

    Attributes
    ----------
    place : of the node
    label : what it says
    kind : "group", "not", "count" or "atom"
    operator : key of `GROUPS` for a group
    text : the node as a criterion of its own
    """

    place: Place
    label: str
    kind: str
    operator: str
    text: str


def criterion_tree(text: str) -> Tree | None:
    """The tree of a criterion; None of an empty one.

    Raises
    ------
    CriterionError
    """
    return parse(text).to_json() if text.strip() else None


def tree_text(tree: Tree | None) -> str:
    """The criterion of a tree."""
    return "" if tree is None else str(from_json(tree))


def _children(tree: Tree) -> list[Tree]:
    if "of" in tree:
        return [tree["of"]]
    children: list[Tree] = tree.get("args", [])
    return children


def _node(tree: Tree, place: Sequence[int]) -> Tree:
    for step in place:
        children = _children(tree)
        if not 0 <= step < len(children):
            raise CriterionError("this part of the criterion is gone")
        tree = children[step]
    return tree


def tree_rows(tree: Tree | None) -> list[TreeRow]:
    """The tree line by line, parents before children."""
    rows: list[TreeRow] = []

    def visit(node: Tree, place: Place) -> None:
        op = str(node["op"])
        text = tree_text(node)
        kind, label = "atom", text
        if op in GROUPS:
            kind, label = "group", GROUPS[op]
        elif op == "not":
            kind, label = "not", "not"
        elif "of" in node:
            unit = node.get("unit", "")
            kind = "count"
            label = f"{node['quantity']} {node['compare']} {node['value']:g}{unit and ' ' + unit}"
        elif op == "last":
            kind, label = "count", "ended where"
        rows.append(
            TreeRow(place=place, label=label, kind=kind, operator=op if kind == "group" else "",
                    text=text)
        )  # fmt: skip
        if kind != "atom":
            for number, child in enumerate(_children(node)):
                visit(child, (*place, number))

    if tree is not None:
        visit(tree, ())
    return rows


def _put(tree: Tree, place: Place, node: Tree) -> Tree:
    """The tree with another node at a place."""
    if not place:
        return node
    tree = copy.deepcopy(tree)
    parent = _node(tree, place[:-1])
    if "of" in parent:
        parent["of"] = node
    else:
        parent["args"][place[-1]] = node
    return tree


def add_node(tree: Tree | None, place: Place, atom: Tree, operator: str = "and") -> Tree:
    """Join a condition to the node at a place: as a member of a group that joins in this way, else
    in a new group with the node."""
    if tree is None:
        return atom
    node = _node(tree, place)
    if node["op"] == operator:
        return _put(tree, place, {**node, "args": [*node["args"], atom]})
    return _put(tree, place, {"op": operator, "args": [node, atom]})


def remove_node(tree: Tree, place: Place) -> Tree | None:
    """Take a node away; a group of one becomes that one, a ``not`` or count of nothing goes too."""
    if not place:
        return None
    parent = _node(tree, place[:-1])
    if parent["op"] not in GROUPS and parent["op"] != "all":
        return remove_node(tree, place[:-1])
    _node(tree, place)
    left = [child for number, child in enumerate(parent["args"]) if number != place[-1]]
    if not left:
        return remove_node(tree, place[:-1])
    return _put(tree, place[:-1], left[0] if len(left) == 1 else {**parent, "args": left})


def negate_node(tree: Tree, place: Place) -> Tree:
    """Put ``not`` before a node, or take it away."""
    node = _node(tree, place)
    if node["op"] == "not":
        return _put(tree, place, node["args"][0])
    return _put(tree, place, {"op": "not", "args": [node]})


def set_group(tree: Tree, place: Place, operator: str) -> Tree:
    """Change how a group joins its members."""
    node = _node(tree, place)
    if node["op"] not in GROUPS or operator not in GROUPS:
        raise CriterionError(f"{operator!r} joins no conditions")
    return _put(tree, place, {**node, "op": operator})


def count_node(tree: Tree, place: Place, compare: str, value: int) -> Tree:
    """Ask how often a node happens along the ray: ``count(node) >= 2``; again changes the bound."""
    node = _node(tree, place)
    inner = node["of"] if node.get("quantity") == "count" else node
    return _put(
        tree,
        place,
        {"op": "compare", "quantity": "count", "of": inner, "compare": compare, "value": value},
    )


def mouse_kinds() -> list[type[Condition]]:
    """Conditions that are built with the mouse: they say how they begin."""
    return [kind for kind in ATOMS.kinds() if getattr(kind, "phrase", "")]


def make_atom(kind: str, name: str = "*", event: str = "") -> Tree:
    """A condition from what was chosen in lists.

    Parameters
    ----------
    kind : word of one of `mouse_kinds`
    name : of a source, object, face, detector or medium, where the condition takes one
    event : word of an event, where it takes one; empty for any
    """
    known = {found.word: found for found in mouse_kinds()}
    if kind not in known:
        raise CriterionError(f"{kind!r} is none of the conditions: {', '.join(known)}")
    tree: Tree = {"op": kind}
    for argument in known[kind].arguments:
        if isinstance(argument, Names):
            tree[argument.name] = [name]
        elif isinstance(argument, Events) and (event or not argument.optional):
            tree[argument.name] = [event or "reflected"]
    return tree


def _region_place(tree: Tree | None, detector: Detector) -> int | None:
    """Which member of the outermost ``and`` asks for a region of a detector; -1 is the root."""
    unit = _region_unit(detector)

    def asks(node: Tree) -> bool:
        regions = node.get("regions", [])
        named = node["op"] == "detected" and node["names"] == [escape(detector.name, "*?\\")]
        return named and len(regions) == 1 and regions[0].get("unit", "") in ("", unit)

    if tree is None:
        return None
    if asks(tree):
        return -1
    if tree["op"] == "and":
        return next((k for k, node in enumerate(tree["args"]) if asks(node)), None)
    return None


def _region_unit(detector: Detector) -> str:
    """Unit in which a drawn region is written: of a far field degrees of C and gamma, else none."""
    return "" if cells_by_angle(detector) is None else "deg"


def demanded_detector(tree: Tree | None, detectors: Sequence[str]) -> str | None:
    """The one detector that every ray of a criterion must have met, if it names just one."""
    nodes = [] if tree is None else tree["args"] if tree["op"] == "and" else [tree]
    patterns = {
        pattern
        for node in nodes
        if node["op"] in ("detected", "crossed")
        for pattern in node["names"]
    }
    named = [name for name in detectors if escape(name, "*?\\") in patterns]
    return named[0] if len(patterns) == len(named) == 1 else None


def criterion_region(tree: Tree | None, detector: Detector) -> Region | None:
    """The region of a detector that a criterion demands, if it is one that the mouse can draw.

    Returns
    -------
    its values are in cells
    """
    place = _region_place(tree, detector)
    if place is None or tree is None:
        return None
    node = tree if place < 0 else tree["args"][place]
    region = dict(node["regions"][0])
    unit = region.pop("unit", "")
    [(shape, numbers)] = region.items()
    cells = [float(number) for number in numbers]
    angles = cells_by_angle(detector)
    if unit and angles is not None:
        for k in range(4):
            per_degree, zero = angles[k % 2]
            is_place = k < 2 or shape == "rect"
            cells[k] = cells[k] * per_degree + (zero if is_place else 0.0)
    return Region(shape=shape, values=(cells[0], cells[1], cells[2], cells[3]))


def region_values(region: Region, detector: Detector) -> tuple[float, ...]:
    """Values of a region in cells as criteria write them: of a far field C and gamma [deg]."""
    angles = cells_by_angle(detector)
    if angles is None:
        return region.values
    degrees = []
    for k, value in enumerate(region.values):
        per_degree, zero = angles[k % 2]
        is_place = k < 2 or region.shape == "rect"
        degrees.append((value - (zero if is_place else 0.0)) / per_degree)
    return tuple(float(f"{value:.6g}") for value in degrees)


def with_region(tree: Tree | None, detector: Detector, region: Region | None) -> Tree | None:
    """Demand a region of a detector instead of the one before, or none any more.

    Parameters
    ----------
    region : its values are in cells
    """
    place = _region_place(tree, detector)
    if tree is not None and place is not None:
        tree = remove_node(tree, () if place < 0 else (place,))
    if region is None:
        return tree
    said: Tree = {region.shape: list(region_values(region, detector))}
    unit = _region_unit(detector)
    if unit:
        said["unit"] = unit
    atom = {"op": "detected", "names": [escape(detector.name, "*?\\")], "regions": [said]}
    return add_node(tree, (), atom)

"""Editing a criterion with the mouse gives the criterion that a person would write."""

from __future__ import annotations

import pytest

from raymap import Detector
from raymap.model.errors import CriterionError
from viewer.drawn.state import Region
from viewer.panels.tree import (
    add_node,
    count_node,
    criterion_region,
    criterion_tree,
    demanded_detector,
    make_atom,
    negate_node,
    region_values,
    remove_node,
    set_group,
    tree_rows,
    tree_text,
    with_region,
)

TEXT = 'count(hit("L*", reflected)) == 2 & !event(scattered) & (detected("a") | detected("b"))'


def edit(text, function, *arguments) -> str:
    return tree_text(function(criterion_tree(text), *arguments))


def test_rows_show_the_expression() -> None:
    rows = tree_rows(criterion_tree(TEXT))
    assert [(row.place, row.kind, row.label) for row in rows] == [
        ((), "group", "all of"),
        ((0,), "count", "count == 2"),
        ((0, 0), "atom", 'hit("L*", reflected)'),
        ((1,), "not", "not"),
        ((1, 0), "atom", "event(scattered)"),
        ((2,), "group", "any of"),
        ((2, 0), "atom", 'detected("a")'),
        ((2, 1), "atom", 'detected("b")'),
    ]
    assert tree_rows(None) == []


def test_conditions_are_added() -> None:
    atom = make_atom("hit", "L1.back", "reflected")
    assert tree_text(add_node(None, (), atom)) == 'hit("L1.back", reflected)'
    assert edit('detected("a")', add_node, (), atom) == 'detected("a") & hit("L1.back", reflected)'
    assert edit(TEXT, add_node, (2,), make_atom("detected", "c"), "or").endswith(
        '(detected("a") | detected("b") | detected("c"))'
    )
    assert edit('hit("a") & hit("b")', add_node, (), atom, "or") == (
        'hit("a") & hit("b") | hit("L1.back", reflected)'
    )
    ordered = edit('hit("L2.front", reflected)', add_node, (), atom, "then")
    assert ordered == 'hit("L2.front", reflected) -> hit("L1.back", reflected)'


@pytest.mark.parametrize(
    ("kind", "name", "event", "text"),
    [
        ("source", "lamp", "", 'source("lamp")'),
        ("hit", "*", "", 'hit("*")'),
        ("hit", "L1", "absorbed", 'hit("L1", absorbed)'),
        ("event", "ignored", "tir", "event(tir)"),
        ("medium", "glass", "", 'medium("glass")'),
        ("crossed", "gate", "", 'crossed("gate")'),
    ],
)
def test_atoms_are_made_from_lists(kind: str, name: str, event: str, text: str) -> None:
    assert tree_text(make_atom(kind, name, event)) == text


def test_conditions_are_removed() -> None:
    assert edit(TEXT, remove_node, (1, 0)) == (
        'count(hit("L*", reflected)) == 2 & (detected("a") | detected("b"))'
    )
    assert edit(TEXT, remove_node, (2, 0)).endswith('& detected("b")')
    assert edit('hit("L1")', remove_node, ()) == ""
    assert edit('!hit("L1")', remove_node, (0,)) == ""
    assert edit("count(event(tir)) > 1", remove_node, (0,)) == ""


def test_conditions_are_negated_and_back() -> None:
    once = edit(TEXT, negate_node, (2,))
    assert once.endswith('& !(detected("a") | detected("b"))')
    assert edit(once, negate_node, (2,)) == str(TEXT)


def test_groups_change_their_word() -> None:
    assert edit('hit("a") & hit("b")', set_group, (), "then") == 'hit("a") -> hit("b")'
    with pytest.raises(CriterionError):
        edit('hit("a")', set_group, (), "or")


def test_points_are_counted_and_the_bound_is_changed() -> None:
    once = edit('hit("L*", reflected)', count_node, (), ">=", 2)
    assert once == 'count(hit("L*", reflected)) >= 2'
    assert edit(once, count_node, (), "==", 4) == 'count(hit("L*", reflected)) == 4'
    with pytest.raises(CriterionError):
        tree_text(count_node(criterion_tree('detected("a")') or {}, (), ">=", 2))


def test_places_that_are_gone_are_refused() -> None:
    with pytest.raises(CriterionError, match="gone"):
        edit(TEXT, negate_node, (7,))


SENSOR, A, B, C = (Detector(name=name, cells=(50, 50)) for name in ("sensor", "a", "b", "c"))
# Of 72 x 45 cells, 5° of C and 2° of gamma each, gamma from 10° on
FAR = Detector(
    name="far", kind="far_field", cells=(72, 45), parameters={"gamma_deg": (10.0, 100.0)}
)
RECT = Region(shape="rect", values=(1.0, 2.0, 30.5, 40.0))
DISC = Region(shape="ellipse", values=(10.0, 10.0, 5.0, 4.0))


@pytest.mark.parametrize("text", ["", 'hit("L1")', 'hit("L1") | hit("L2")', TEXT])
def test_a_drawn_region_joins_the_criterion_and_leaves_it(text: str) -> None:
    tree = criterion_tree(text)
    one = with_region(tree, SENSOR, RECT)
    assert criterion_region(one, SENSOR) == RECT
    assert tree_text(one).endswith('detected("sensor", rect(1, 2, 30.5, 40))')
    two = with_region(criterion_tree(tree_text(one)), SENSOR, DISC)
    assert criterion_region(two, SENSOR) == DISC
    assert tree_text(two).count('detected("sensor"') == 1
    assert tree_text(with_region(two, SENSOR, None)) == tree_text(tree)


def test_regions_of_other_detectors_and_with_units_are_let_alone() -> None:
    tree = criterion_tree(
        'detected("a", rect(0, 0, 5, 5)) & detected("b", rect(0 mm, 0 mm, 1 mm, 1 mm))'
    )
    assert criterion_region(tree, A) == Region(shape="rect", values=(0, 0, 5, 5))
    assert criterion_region(tree, B) is None
    assert criterion_region(tree, C) is None
    assert criterion_region(criterion_tree('!detected("a", rect(0, 0, 5, 5))'), A) is None


def test_names_with_wildcards_in_them_are_escaped() -> None:
    starred = Detector(name="a*b", cells=(50, 50))
    tree = with_region(None, starred, RECT)
    assert "a\\*b" in tree_text(tree)
    assert criterion_region(tree, starred) == RECT


@pytest.mark.parametrize(
    ("text", "detector"),
    [
        ('detected("a")', "a"),
        ('hit("L1") & crossed("b*", rect(0, 0, 1, 1))', None),
        ('hit("L1") & detected("b", rect(0, 0, 1, 1)) & detected("b")', "b"),
        ('detected("a") & detected("b")', None),
        ('detected("a", "b")', None),
        ('!detected("a")', None),
        ("", None),
    ],
)
def test_the_detector_that_a_criterion_demands(text: str, detector: str | None) -> None:
    assert demanded_detector(criterion_tree(text), ["a", "b", "bb"]) == detector


@pytest.mark.parametrize(
    ("region", "text"),
    [
        # Cells 0 to 18 of C are 0° to 90°, 5 to 15 of gamma 20° to 40°
        (
            Region(shape="rect", values=(0.0, 5.0, 18.0, 15.0)),
            'detected("far", rect(0 deg, 20 deg, 90 deg, 40 deg))',
        ),
        (
            Region(shape="ellipse", values=(36.0, 25.0, 2.0, 2.5)),
            'detected("far", ellipse(180 deg, 60 deg, 10 deg, 5 deg))',
        ),
    ],
)
def test_a_region_drawn_on_a_far_field_is_c_and_gamma(region: Region, text: str) -> None:
    tree = with_region(criterion_tree('hit("L1")'), FAR, region)
    assert tree_text(tree) == f'hit("L1") & {text}'
    # As drawn, as written, and in cells by hand it is drawn at the same place
    assert criterion_region(tree, FAR) == region
    assert criterion_region(criterion_tree(text), FAR) == region
    assert region_values(region, FAR)[:2] == ((0, 20) if region.shape == "rect" else (180, 60))
    cells = criterion_tree('detected("far", rect(1, 2, 3, 4))')
    assert criterion_region(cells, FAR) == Region(shape="rect", values=(1, 2, 3, 4))
    assert tree_text(with_region(cells, FAR, region)) == text

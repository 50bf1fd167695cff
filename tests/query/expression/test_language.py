"""Reading, printing, refusing: what people write and what they are told."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import query
from query import Event, all_, count, detected, event, hit, parse, wavelength
from query.engine.bind import MapFacts, bind
from query.expression.automaton import parse_path
from query.expression.json_form import from_json
from raymap.model.errors import CriterionError, UnknownName
from tests.query import nodes as c
from tests.query.random_maps import make_channel_set, make_directory


def facts() -> MapFacts:
    import numpy as np

    return MapFacts(
        directory=make_directory(),
        channel_sets=[make_channel_set()],
        emitted=np.array([100, 200]),
    )


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ('!hit("a") & hit("b")', '(!hit("a")) & hit("b")'),
        ('hit("a") | hit("b") & hit("c")', 'hit("a") | (hit("b") & hit("c"))'),
        ('hit("a") ^ hit("b") | hit("c")', '(hit("a") ^ hit("b")) | hit("c")'),
        ('hit("a") & hit("b") ^ hit("c")', '(hit("a") & hit("b")) ^ hit("c")'),
        ('hit("a") -> hit("b") & event(left)', '(hit("a") -> hit("b")) & event(left)'),
        ('!hit("a") -> hit("b")', '(!hit("a")) -> hit("b")'),
        ('!count(hit("a")) == 2', '!(count(hit("a")) == 2)'),
        ('2 <= count(hit("a"))', 'count(hit("a")) >= 2'),
        ('~hit("a") ∩ ¬hit("b") ∪ hit("c")', '!hit("a") & !hit("b") | hit("c")'),
        ('not hit("a") and hit("b") or hit("c")', '!hit("a") & hit("b") | hit("c")'),
        ('hit("a") → hit("b")', 'hit("a") -> hit("b")'),
        ("wavelength ≤ 500nm", "wavelength <= 500 nm"),
        ("last(absorbed)", "last(event(absorbed))"),
        ('all(hit("a"), reflected)', 'all(hit("a"), event(reflected))'),
        ('hit( "a" ,reflected )', 'hit("a", reflected)'),
        ("all()", "all"),
    ],
)
def test_spellings_of_one_tree(text: str, same: str) -> None:
    assert parse(text) == parse(same)


def test_python_builds_the_same_trees() -> None:
    text = 'count(hit("L1.back", specular_reflection)) >= 2 & detected("sensor")'
    own = (count(hit("L1.back", Event.SPECULAR_REFLECTION)) >= 2) & detected("sensor")
    assert own == parse(text)
    assert (wavelength < "500 nm") == parse("wavelength < 500 nm")
    assert (count(hit("a")) >= 2) == parse('count(hit("a")) >= 2')
    assert hit("a").then(detected("b")) == parse('hit("a") -> detected("b")')
    assert hit("a", all_("reflected", "rim")) == parse('hit("a", all(reflected, rim))')
    assert hit("a", Event.TIR | Event.SPECULAR_REFLECTION).events == (
        ("specular_reflection",),
        ("tir",),
    )
    assert hit("a", "reflected") == parse('hit("a", reflected)')
    assert all_() == parse("all")


@pytest.mark.parametrize(
    "careless",
    [
        lambda: hit("a") and hit("b"),
        lambda: not hit("a"),
        lambda: bool(count(hit("a"))),
        lambda: hit("a") & count(hit("b")),
        lambda: 1 < count(hit("a")) < 3,
    ],
)
def test_truth_values_are_refused_with_advice(careless: Any) -> None:
    with pytest.raises(TypeError, match=r"~|compare"):
        careless()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('hit("L1"', r"never closed.*column 4"),
        ('hit("L1"))', r"closes nothing"),
        ('hit("L1', r"quotation mark is never closed"),
        ('hit("L1") &', r"ends too early"),
        ("hit(L1)", r"names of things stand in quotes"),
        ('hitt("L1")', r"did you mean hit"),
        ("event(reflectd)", r"nearest: reflected"),
        ('count(hit("L1"))', r"compare it"),
        ('count(detected("s")) > 1', r"takes a point condition"),
        ('detected("s", rect(1, 2, 3))', r"four numbers"),
        ('detected("s", rect(1 mm, 2, 3, 4))', r"one unit"),
        ("wavelength > 5 foo", r"unknown unit 'foo'; units are nm um .* deg .* W .* lm"),
        ("wavelength", r"is a number"),
        ('"L1"', r"is not a criterion"),
        ("reflected", r"write event\(reflected\)"),
        ('path("a (b")', r"never closed"),
        ('path("a b*c)")', r"closes nothing"),
        ('path("a L1:nonsense")', r"no event is called"),
        ('path("a b.c{2}")', r"cannot read|quantifiers"),
        ("", r"empty"),
        ('hit("a") # note', r"unexpected '#'"),
        ("wavelength > 1e999", r"too large"),
        ('path("a (.{999}){999}")', r"more than 4096 elements"),
    ],
)
def test_errors_say_where_and_what_instead(text: str, message: str) -> None:
    with pytest.raises(CriterionError, match=message):
        parse(text)


def test_carets_stand_under_the_place() -> None:
    with pytest.raises(CriterionError) as caught:
        parse('hit("L1") & hti("L2")')
    _, line, carets = str(caught.value).splitlines()
    assert line[carets.index("^") : carets.rindex("^") + 1] == 'hti("L2")'


def test_deep_nesting_is_an_error_and_no_crash() -> None:
    with pytest.raises(CriterionError, match="deeper"):
        parse("(" * 5000 + 'hit("a")' + ")" * 5000)
    with pytest.raises(CriterionError, match="deeper"):
        parse("!" * 5000 + 'hit("a")')
    tree: Any = {"op": "event", "events": ["left"]}
    for _ in range(5000):
        tree = {"op": "not", "args": [tree]}
    with pytest.raises(CriterionError, match="deeper"):
        from_json(tree)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('hit("L3")', r'no object or face of this map is called "L3"; nearest: L2, L1'),
        ('hit("L1.bak")', r"faces of L1: front, back, rim"),
        ('hit("L2.#9")', r"has no primitive #9"),
        ('source("lamb")', r"nearest: lamp"),
        ('detected("screeen")', r"nearest: screen"),
        ('medium("glas_1")', r"nearest: glass_1"),
        ("hit(rough > 1)", r"nearest: roughness"),
        ('path("lamb .*")', r"begins with the source"),
        ('path("lamp L9 .*")', r'"L9"'),
        ('path("lamp L2.front .*", exact)', r"goes by its own: L1.back"),
        ("length > 3 deg", r"a length is measured in"),
        ("bounces > 3 mm", r"takes no unit"),
        ("flux > 1 lm", r"the flux of this map is measured in"),
        ('detected("screen", rect(0 deg, 0 deg, 1 deg, 1 deg))', r"a length is measured in"),
    ],
)
def test_names_and_units_that_do_not_fit_the_map(text: str, message: str) -> None:
    with pytest.raises(CriterionError, match=message) as caught:
        bind(parse(text), facts(), text)
    assert "^" in str(caught.value)
    if "nearest" in message:
        assert isinstance(caught.value, UnknownName)


def test_a_map_in_an_unknown_unit_takes_numbers_without_units() -> None:
    known = facts()
    strange = known.directory.model_copy(update={"length_unit": "furlong"})
    other = dataclasses.replace(known, directory=strange)
    bind(parse("length > 3"), other)
    for text in ("length > 3 mm", 'detected("screen", rect(0 mm, 0 mm, 1 mm, 1 mm))'):
        with pytest.raises(CriterionError, match="'furlong', is not known"):
            bind(parse(text), other, text)


def test_errors_of_python_trees_show_the_printed_text() -> None:
    with pytest.raises(UnknownName, match=r"\^\^\^\^"):
        bind(hit("L1") & hit("LL"), facts())


def test_names_are_taken_literally_or_as_patterns() -> None:
    def faces(text: str) -> list[bool]:
        [place] = bind(parse(text), facts()).places  # type: ignore[attr-defined]
        return [bool(x) for x in [*place.objects[:-1], *place.faces[:-1]]]

    whole = {"L1": 0, "L2": 1, "mesh.a": 2, "wall": 3, "eye": 4}
    # The interface that L1 and L2 share is reached by both names.
    assert faces('hit("L1.back")') == faces('hit("L2.front")')
    assert faces('hit("L2")')[whole["L2"]]
    assert faces('hit("L2")')[5 + 1]
    assert faces('hit("mesh.a")') == faces(r'hit("mesh\.a")')
    assert faces('hit("?1")') == faces('hit("L1")')
    with pytest.raises(UnknownName):
        faces('hit("l1")')
    with pytest.raises(UnknownName):
        faces(r'hit("L\*")')


@given(st.text(max_size=60))
def test_any_text_is_read_or_refused(text: str) -> None:
    try:
        tree = parse(text)
    except CriterionError:
        return
    assert parse(str(tree)) == tree


@given(st.text(alphabet='lamp L1.:@()|*+?{},2 \\"', max_size=25))
def test_any_path_expression_is_read_or_refused(text: str) -> None:
    try:
        tree = c.Path(text)
    except CriterionError:
        return
    assert parse(str(tree)) == tree


@given(st.lists(st.text(min_size=1, max_size=8), min_size=1, max_size=2))
def test_any_name_survives_printing(names: list[str]) -> None:
    tree = c.Hit(tuple(names))
    assert parse(str(tree)) == tree
    assert from_json(tree.to_json()) == tree


def test_json_that_does_not_fit_is_refused() -> None:
    for tree, message in (
        ({"op": "hitt"}, "known: and"),
        ({"op": "hit", "names": ["a"], "colour": 1}, "unknown keys: colour"),
        ({"op": "and", "args": [{"op": "hit", "names": ["a"]}]}, "two or more"),
        ({"op": "hit", "names": "a"}, "wrong type"),
        ([], "must be an object"),
        ({"op": "compare", "quantity": "count", "compare": ">", "value": 1}, "of is missing"),
    ):
        with pytest.raises(CriterionError, match=message):
            from_json(tree)


def test_public_names_resolve() -> None:
    assert sorted(query.__all__) == sorted(set(query.__all__))
    for name in query.__all__:
        assert getattr(query, name) is not None
    assert not callable(getattr(query, "nonsense", None))


def test_events_of_python_and_text_agree() -> None:
    assert event("absorbed") == event(Event.SURFACE_ABSORPTION | Event.VOLUME_ABSORPTION)


def test_surface_parameters_stand_on_sides_and_vary_with_wavelength() -> None:
    from query.engine.surface_parameters import passes, sides_of

    sides = sides_of(
        {
            "reflectance": {"rgb": [0.1, 0.5, 0.9]},
            "front": {"roughness": 0.3, "n": 1.5},
            "back": {"roughness": 0.7, "n": 1.2},
            "scatter": {"index": {"wavelength_nm": [400, 700], "value": [1.2, 1.4]}},
            "kind": "paint",
            "hidden": True,
        }
    )

    def ask(*tests: tuple[str, str, float]) -> bool:
        return any(passes(side, [c.SurfaceTest(*test) for test in tests]) for side in sides)

    assert ask(("reflectance", "<", 0.2))
    assert ask(("reflectance", ">", 0.8))
    assert not ask(("reflectance", ">", 0.95))
    assert ask(("roughness", ">", 0.5), ("n", "<", 1.3))
    # Both must hold on the same side.
    assert not ask(("roughness", ">", 0.5), ("n", ">", 1.3))
    assert ask(("scatter.index", ">", 1.3))
    assert ask(("index", ">", 1.3), ("reflectance", "<", 0.2))
    assert not ask(("kind", "==", 0))
    assert not ask(("hidden", "==", 1))


def test_expressions_with_choices_are_bounded_and_plain_ones_may_be_long():
    """A row of points is one state after another; choices keep many states alive at a time."""
    assert len(parse_path("lamp " + "box " * 4000).elements) == 4001
    with pytest.raises(CriterionError, match="it may have 512"):
        parse_path("lamp " + "(.* box){300}")

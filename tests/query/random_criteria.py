"""Hypothesis strategies for criteria over the random maps."""

from __future__ import annotations

from hypothesis import strategies as st

from tests.query import nodes as c

OPERATORS = st.sampled_from(["==", "!=", "<", "<=", ">", ">="])
PLACES = st.sampled_from(
    [
        "L1", "L2", "L*", "*", "?1", "wall", "eye", "mesh\\.a", "L1.front", "L2.front", "L1.back",
        "*.rim", "L2.*", "mesh\\.a.skin", "mesh\\.a.#7", "L2.#2", "L1.#0", "*.#1", "mesh.a",
    ]
)  # fmt: skip
WORDS = st.sampled_from(
    [
        "reflected", "refracted", "transmitted", "scattered", "absorbed", "left", "tir",
        "medium_changed", "rim", "volume_scatter", "surface_absorption", "emitted", "polariser",
        "geometry_error", "specular_reflection",
    ]
)  # fmt: skip
EVENT_SETS = st.one_of(
    WORDS.map(lambda word: (word,)), st.tuples(WORDS, WORDS).map(lambda pair: pair)
)
EVENTS = st.lists(EVENT_SETS, max_size=2).map(tuple)
TESTS = st.builds(
    c.SurfaceTest,
    st.sampled_from(["roughness", "n", "loss"]),
    OPERATORS,
    st.sampled_from([0, 0.3, 0.9, 1.5, 1.6]),
)
HITS = st.one_of(
    st.builds(c.Hit, st.lists(PLACES, min_size=1, max_size=2).map(tuple), st.just(()), EVENTS),
    st.builds(
        c.Hit,
        st.lists(PLACES, max_size=1).map(tuple),
        st.lists(TESTS, min_size=1, max_size=2).map(tuple),
        EVENTS,
    ),
)
HAPPENED = st.builds(c.EventAt, st.lists(EVENT_SETS, min_size=1, max_size=2).map(tuple))


def _grow_points(inner: st.SearchStrategy[c.Criterion]) -> st.SearchStrategy[c.Criterion]:
    several = st.lists(inner, min_size=2, max_size=3).map(tuple)
    return st.one_of(
        st.builds(c.Not, inner),
        st.builds(c.And, several),
        st.builds(c.Or, several),
        st.builds(c.Xor, several),
        st.builds(c.All, several),
    )


POINTS = st.recursive(st.one_of(HITS, HAPPENED, st.just(c.All())), _grow_points, max_leaves=4)

REGIONS = st.one_of(
    st.builds(
        lambda numbers, unit: c.Region("rect", numbers, unit),
        st.tuples(*[st.sampled_from([-3, -0.5, 0, 1, 2.5, 4, 8])] * 4),
        st.sampled_from(["", "mm"]),
    ),
    st.builds(
        lambda centre, radii, unit: c.Region("ellipse", (*centre, *radii), unit),
        st.tuples(*[st.sampled_from([-1, 0, 2.5, 4])] * 2),
        st.tuples(*[st.sampled_from([0.5, 2, 3.5])] * 2),
        st.sampled_from(["", "mm"]),
    ),
)
CROSSINGS = st.builds(
    lambda kind, names, regions: kind(names, regions),
    st.sampled_from([c.Detected, c.Crossed]),
    st.lists(st.sampled_from(["screen", "eye", "*", "s*"]), min_size=1, max_size=2).map(tuple),
    st.lists(REGIONS, max_size=2).map(tuple),
)
SEQUENCES = st.builds(
    c.Then, st.lists(st.one_of(POINTS, CROSSINGS), min_size=2, max_size=4).map(tuple)
)

_FIRST = st.sampled_from(["lamp", "sun", "*", "l?mp", "."])
_ELEMENT = st.one_of(
    st.sampled_from([".", ".*", ".+", ".?", ".{1,2}", "@screen", "@eye", "@*"]),
    st.sampled_from([":left", ":volume_scatter", ":absorbed,left"]),
    st.builds(
        lambda name, words: name + (":" + ",".join(words) if words else ""),
        PLACES,
        st.lists(WORDS, max_size=2),
    ),
)
_BODY = st.recursive(
    st.lists(_ELEMENT, min_size=1, max_size=3).map(" ".join),
    lambda inner: st.one_of(
        st.builds(
            lambda body, mark: f"({body}){mark}",
            inner,
            st.sampled_from(["", "*", "+", "?", "{2}", "{1,}", "{0,2}"]),
        ),
        st.builds(lambda a, b: f"({a} | {b})", inner, inner),
        st.builds(lambda a, b: f"{a} {b}", inner, inner),
    ),
    max_leaves=4,
)
PATHS = st.builds(
    # Second names of shared faces are refused in exact expressions.
    lambda first, body, end, exact: c.Path(
        f"{first} {body} {end}".strip(), exact and "L2.front" not in body
    ),
    _FIRST,
    _BODY,
    st.sampled_from(["", ".*", ".* @eye", "@screen"]),
    st.booleans(),
)

QUANTITIES = st.one_of(
    st.builds(
        lambda point, op, value: c.Compare(c.Count(point), op, value),
        POINTS,
        OPERATORS,
        st.sampled_from([0, 1, 2, 3, 1.5]),
    ),
    st.builds(
        lambda op, v: c.Compare(c.Bounces(), op, v), OPERATORS, st.sampled_from([0, 1, 2, 3])
    ),
    st.builds(
        lambda op, v: c.Compare(c.Wavelength(), op, *v),
        OPERATORS,
        st.sampled_from([(550, ""), (500, "nm"), (0.65, "um"), (900, "nm")]),
    ),
    st.builds(
        lambda op, v: c.Compare(c.Length(), op, *v),
        OPERATORS,
        st.sampled_from([(0, ""), (15.25, "mm"), (2.5, "cm")]),
    ),
    st.builds(
        lambda op, v: c.Compare(c.OpticalLength(), op, v), OPERATORS, st.sampled_from([0, 20.5])
    ),
    st.builds(
        lambda op, v: c.Compare(c.Flux(), op, v), OPERATORS, st.sampled_from([0, 0.013, 0.05])
    ),
    st.builds(
        lambda point, op, v: c.Compare(c.Incidence(point), op, v, "deg"),
        POINTS,
        OPERATORS,
        st.sampled_from([10.5, 45.5, 80.5]),
    ),
)
RECORDED = st.builds(
    lambda kind, point, op, v: c.Compare(kind[0](point), op, *v(kind)),
    st.sampled_from(
        [
            (c.DegreeOfPolarisation, [0, 0.37, 1]),
            (c.AngleOfPolarisation, [-30.5, 0, 45.25, 90]),
            (c.OpticalPath, [0, 10.25, 15]),
        ]
    ),
    st.one_of(st.none(), POINTS),
    OPERATORS,
    st.integers(0, 11).map(lambda k: lambda kind: (kind[1][k % len(kind[1])], "")),
)
LEAVES = st.one_of(
    POINTS,
    CROSSINGS,
    SEQUENCES,
    PATHS,
    QUANTITIES,
    RECORDED,
    st.builds(c.Source, st.lists(st.sampled_from(["lamp", "sun", "*"]), min_size=1).map(tuple)),
    st.builds(c.Medium, st.lists(st.sampled_from(["air", "glass_?"]), min_size=1).map(tuple)),
    st.builds(c.Last, POINTS),
)


def _grow(inner: st.SearchStrategy[c.Criterion]) -> st.SearchStrategy[c.Criterion]:
    several = st.lists(inner, min_size=2, max_size=3).map(tuple)
    return st.one_of(
        st.builds(c.Not, inner),
        st.builds(c.And, several),
        st.builds(c.Or, several),
        st.builds(c.Xor, several),
    )


CRITERIA = st.recursive(LEAVES, _grow, max_leaves=5)

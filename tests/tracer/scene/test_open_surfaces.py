"""Open surfaces that lie on one another: which light meets, and what is said of the other."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from raymap.model.events import Event
from tests.examples import examples
from tests.tracer.transport.tracing import Trace, assert_share, compiled, trace
from tracer.description.fields import Placed
from tracer.geometry.shapes import Annulus, Polygon, Rectangle, Shape
from tracer.scene.arrangement.open_surfaces import HiddenSurface, open_surfaces_overlap

SUN = """
[surfaces.white]
kind = "lambertian"
reflectance = 0.5
[surfaces.diffuser]
kind = "lambertian"
reflectance = 0.1
transmittance = 0.6
[surfaces.filter]
kind = "filter"
transmittance = 0.5
[surfaces.clear]
kind = "dielectric"
[sources.sun]
kind = "collimated"
position = [0.01, 0.02, 90]
direction = [0, 0, -1]
diameter = 1
"""
TURN = (23.0, 31.0, 17.0)
FRAME = Placed(rotation=TURN).frame()[1]


def open_surface(
    name: str, surface: str, shape: str, place: tuple[float, float] = (0.0, 0.0)
) -> str:
    """An open surface in one plane of no axis, moved within it."""
    position = (FRAME[:, :2] @ np.array(place)).tolist()
    return (
        f'[bodies.{name}]\nkind = "{shape.split()[0]}"\n{shape.split(" ", 1)[1]}\n'
        f'surface = "{surface}"\nposition = {position}\nrotation = {list(TURN)}\n'
    )


SQUARE, DISC, TUBE = (
    "rectangle size = [8, 8]",
    "disc outer = 3",
    "cylinder radius = 3\nlength = 8\nopen = true",
)


def met(found: Trace) -> set[str]:
    names = [item.name for item in found.compilation.directory.objects]
    return {names[k] for k in np.unique(found.portion.object) if k >= 0}


PAIRS = {
    "a disc on a square": (SQUARE, DISC),
    "a square on a disc": (DISC, SQUARE),
    "two squares": (SQUARE, SQUARE),
    "two tubes": (TUBE, TUBE),
}


@pytest.mark.parametrize("pair", PAIRS)
def test_light_meets_the_one_named_first_and_never_the_other(pair: str) -> None:
    first, second = PAIRS[pair]
    scene = SUN + open_surface("first", "diffuser", first) + open_surface("second", "white", second)
    with pytest.warns(HiddenSurface, match="'first' lies on 'second'.*leave a micrometre"):
        found = trace(scene, 40_000)
    if pair == "two tubes":
        assert met(found) == {"first"}
        return
    # Near the middle both are there; whoever leaves the first one comes back to neither
    assert met(found) == {"first"}
    assert np.all(found.portion.records_per_ray <= 3)
    assert_share(found.endings(Event.SURFACE_ABSORPTION), 40_000, 0.3)
    assert found.count(Event.GEOMETRY_ERROR) == 0


def test_open_surfaces_a_micrometre_apart_act_both() -> None:
    scene = SUN + open_surface("first", "filter", SQUARE)
    apart = (FRAME[:, 2] * -1e-3).tolist()
    scene += (
        '[bodies.second]\nkind = "rectangle"\nsize = [8, 8]\nsurface = "filter"\n'
        f"position = {apart}\nrotation = {list(TURN)}\n"
    )
    both = trace(scene, 40_000)
    alone = trace(SUN + open_surface("first", "filter", SQUARE), 40_000)
    assert met(both) == {"first", "second"}
    left_alone, left = alone.endings(Event.LEFT_SCENE), both.endings(Event.LEFT_SCENE)
    assert left < 0.9 * left_alone


def test_beyond_the_edge_of_one_surface_light_meets_the_other() -> None:
    scene = SUN.replace("diameter = 1", "diameter = 7.5")
    scene += open_surface("first", "absorber", "disc outer = 1") + open_surface(
        "second", "white", SQUARE
    )
    with pytest.warns(HiddenSurface):
        found = trace(scene, 40_000)
    assert met(found) == {"first", "second"}
    # The disc hides its projection, an ellipse, in the beam's disc
    share = abs(FRAME[2, 2]) / 3.75**2
    assert_share(found.ended_on("first"), 40_000, share)


def test_a_detector_on_a_wall_sees_all_that_reaches_it() -> None:
    position, axis, up = (x.tolist() for x in (0 * FRAME[:, 0], FRAME[:, 2], FRAME[:, 1]))
    scene = SUN + open_surface("wall", "white", SQUARE)
    scene += (
        f'[detectors.screen]\nkind = "plane"\nblocking = true\nsize = [4, 4]\ncells = [4, 4]\n'
        f"position = {position}\nlooks = {axis}\nup = {up}\n"
    )
    found = trace(scene, 20_000)
    assert met(found) == {"screen"}


SILENT = {
    "tiles side by side": open_surface("a", "white", "rectangle size = [2, 2]")
    + open_surface("b", "absorber", "rectangle size = [2, 2]", (2.0, 0.0))
    + open_surface("c", "clear", "rectangle size = [4, 2]", (1.0, 2.0)),
    "a disc in the hole of a ring": open_surface("a", "white", "disc outer = 2")
    + open_surface("b", "absorber", "ring inner = 2\nouter = 4"),
    "two stops alike": open_surface("a", "absorber", "ring inner = 2\nouter = 4")
    + open_surface("b", "absorber", "ring inner = 1\nouter = 3"),
    "a black box on a table": open_surface("table", "white", SQUARE)
    + open_surface("box", "absorber", "box size = [2, 2, 2]").replace(
        "position = [0.0, 0.0, 0.0]", f"position = {FRAME[:, 2].tolist()}"
    ),
}


@pytest.mark.parametrize("case", SILENT)
def test_where_nothing_is_lost_nothing_is_said(case: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        compiled(SUN + SILENT[case])


def test_many_hidden_surfaces_are_one_line() -> None:
    dots = "".join(
        open_surface(f"dot{k}", "white", "disc outer = 0.1", (0.3 * k, 0.0)) for k in range(9)
    )
    with pytest.warns(HiddenSurface, match="'dot0', 'dot1', 'dot2' and 6 more") as caught:
        compiled(SUN + open_surface("table", "absorber", SQUARE) + dots)
    assert len(caught) == 1


@st.composite
def flats(draw: st.DrawFn) -> Shape:
    """Flat faces in one tilted plane."""
    number = st.floats(-2.0, 2.0)
    origin = FRAME[:, :2] @ np.array([draw(number), draw(number)])
    size = st.floats(0.2, 2.0)
    kind = draw(st.sampled_from(["disc", "ring", "rectangle", "polygon"]))
    angle = draw(st.floats(0.0, 6.0))
    u = FRAME[:, 0] * np.cos(angle) + FRAME[:, 1] * np.sin(angle)
    v = np.cross(FRAME[:, 2], u)
    if kind == "rectangle":
        return Rectangle(origin, u, v, (draw(size), draw(size)))
    if kind == "polygon":
        turns = np.sort([draw(st.floats(0.0, 0.9)) + k for k in range(5)]) * 2.0 * np.pi / 5
        r = draw(size)
        return Polygon(origin + r * (np.outer(np.cos(turns), u) + np.outer(np.sin(turns), v)))
    inner = draw(size) if kind == "ring" else 0.0
    return Annulus(origin, FRAME[:, 2], inner, inner + draw(size))


def covers(shape: Shape, places: np.ndarray) -> np.ndarray:
    """Which places of the plane lie on a face."""
    if isinstance(shape, Annulus):
        r = np.linalg.norm(places - shape.origin, axis=1)
        return (r >= shape.inner) & (r <= shape.outer)
    corners = shape.corners() if isinstance(shape, Rectangle) else shape.vertices
    inside = np.ones(len(places), bool)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        inside &= (places - a) @ np.cross(shape.normal, b - a) >= 0.0
    return inside


GRID = np.stack(np.meshgrid(*2 * [np.linspace(-6.0, 6.0, 241)]), -1).reshape(-1, 2) @ FRAME[:, :2].T


@settings(max_examples=examples(300))
@given(flats(), flats())
def test_overlap_is_what_a_grid_of_places_says(one: Shape, other: Shape) -> None:
    both = int(np.count_nonzero(covers(one, GRID) & covers(other, GRID)))
    said, reversed_ = open_surfaces_overlap([one, other], [other, one], 1e-9).tolist()
    assert said == reversed_
    if both:
        assert said
    # A face across a ring's hole may lie in hole and ring or beside both: only overlap is promised
    elif not any(isinstance(shape, Annulus) and shape.inner > 0.0 for shape in (one, other)):
        assert not open_surfaces_overlap([one], [other], 0.25)[0]

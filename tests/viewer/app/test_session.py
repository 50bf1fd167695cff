"""The session and its questions, without a page."""

from __future__ import annotations

import base64
import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import query
import raymap
from query import select
from query.answers.images.readings import reading_lines, readings
from raymap.model.errors import RayNotFound
from tests.viewer.small_map import CELLS, write_map
from viewer.app.inquiry import Inquiry, criterion_error
from viewer.app.session import Session
from viewer.drawn.answers import (
    count_rays,
    detector_image,
    draw_rays,
    ghost_matrix,
    join_criteria,
    path_of_ray,
    path_table,
    read_one,
)
from viewer.drawn.state import Section, ViewState, state_from_json, state_to_json
from viewer.panels.criterion import CriterionQuestions, choices
from viewer.panels.detector import DetectorQuestions
from viewer.panels.paths import GHOSTS, PathQuestions
from viewer.panels.report import ReportQuestions
from viewer.panels.saved_criteria import CriterionRegistry
from viewer.panels.scene import section_fields, section_of
from viewer.panels.tree import make_atom, tree_text

W, H = 320, 240
GHOST = 'count(hit("L1", reflected)) == 2 & detected("sensor")'


def never() -> bool:
    return False


@pytest.fixture
def session(small_map: raymap.RayMap) -> Session:
    made = Session(small_map, ViewState(rays=200))
    made.drawing = draw_rays(small_map, "", 200)
    return made


def decode(data: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(data)))


def test_drawn_rays_satisfy_the_criterion_and_more_only_add(small_map: raymap.RayMap) -> None:
    matched = set(select(small_map, GHOST).ray_ids.tolist())
    few, many = (set(draw_rays(small_map, GHOST, n).rays.ray_ids.tolist()) for n in (10, 10**6))
    assert few < many == matched
    again = draw_rays(small_map, GHOST, 10).rays.ray_ids
    assert set(again.tolist()) == few


def test_every_source_is_drawn(small_map: raymap.RayMap) -> None:
    assert set(draw_rays(small_map, "", 20).rays.source.tolist()) == {0, 1}


def test_paths_shown_alone_are_told_apart(small_map: raymap.RayMap) -> None:
    rows = path_table(small_map, GHOST, by="face", top=9)
    paths = [(row["criterion"], row["path"]) for row in rows]
    drawing = draw_rays(small_map, GHOST, 1000, paths=paths)
    assert np.bincount(drawing.rays.path).tolist() == [row["rays"] for row in rows]
    assert drawing.labels == {number: row["path"] for number, row in enumerate(rows)}


def test_previews_come_while_reading(
    small_map: raymap.RayMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("viewer.drawn.answers.PREVIEW_SECONDS", -1.0)
    seen: list[int] = []
    drawing = draw_rays(small_map, "", 10**6, preview=lambda rays: seen.append(rays.n_rays))
    assert seen == sorted(seen)
    assert 0 < seen[-1] < drawing.rays.n_rays == small_map.rays


def test_a_path_of_a_ray_selects_it(small_map: raymap.RayMap) -> None:
    for ray in (0, 57, 1199):
        found = select(small_map, path_of_ray(small_map, ray)).ray_ids
        assert ray in found
        paths = read_one(small_map, ray).path
        assert all(read_one(small_map, int(other)).path == paths for other in found[:5])


def test_the_ghost_matrix_leads_to_its_rays(session: Session) -> None:
    questions = PathQuestions(session)
    session.update(criterion='detected("sensor")')
    assert "svg" in questions.ghosts(never)["ghost_matrix"]
    [[criterion]] = questions.pairs
    found = ghost_matrix(session.map, 'detected("sensor")')
    assert not isinstance(found, str)
    assert count_rays(session.map, criterion).flux == pytest.approx(found.flux.sum())
    nothing = ghost_matrix(session.map, 'hit("tube")')
    assert isinstance(nothing, str)
    assert "no ghosts: no ray of the selection was reflected exactly twice" in nothing
    session.update(criterion='hit("tube")')
    said = questions.ghosts(never)
    assert (said["ghost_matrix"], said["ghost_reason"]) == ("", nothing)
    assert said["ghost_note"] == "no ghosts of two reflections"


def test_detector_images_hold_the_flux(small_map: raymap.RayMap) -> None:
    for text in ("", GHOST):
        image = detector_image(small_map, "sensor", text)
        assert image.flux.shape == (CELLS[1], CELLS[0])
        whole = count_rays(small_map, join_criteria(text, 'detected("sensor")'))
        assert image.total == pytest.approx(whole.flux)


def test_the_mouse_moves_the_camera(session: Session) -> None:
    session.move(W, H)
    start = session.camera(W, H)
    session.move(W, H, turn=(30, 10))
    assert session.camera(W, H).position != start.position
    session.look("side", W, H)
    assert session.camera(W, H).position == pytest.approx(start.position)
    session.look("perspective", W, H)
    assert not session.camera(W, H).parallel
    before = session.state
    session.move(W, H, turn=(float("nan"), 0))
    session.move(W, H, enlarge=1e30)
    assert session.state == before


def test_another_axis_points_upward(session: Session) -> None:
    session.look("up", W, H)
    assert session.state.up == "z"
    session.look("side", W, H)
    assert session.state.camera is not None
    assert session.state.camera.view_up == (0.0, 0.0, 1.0)
    assert state_from_json(state_to_json(session.state)) == session.state
    session.look("up", W, H)
    session.look("up", W, H)
    assert session.state.up == "y"


def test_picking_finds_the_ray_that_is_drawn_there(session: Session) -> None:
    from viewer.drawn.camera import view_matrix

    shown = session.shown()
    matrix = view_matrix(session.camera(W, H), W, H, 1.0)
    hits = 0
    for segment in range(0, len(shown.lines), 37):
        middle = shown.lines.segments[segment].mean(axis=0)
        x, y, _, w = matrix @ np.append(middle, 1.0)
        if not (0 < x / w < W and 0 < y / w < H):
            continue
        found = session.pick(x / w, y / w, W, H)
        assert found.ray is not None
        hits += found.ray[0] == shown.rays.ray_ids[shown.lines.ray[segment]]
        assert found.words.startswith(f"ray {found.ray[0]} from ")
    assert hits > 3
    assert session.pick(1, H - 1, W, H).ray is None


def test_pointing_at_a_body_names_its_face(session: Session) -> None:
    session.drawing = draw_rays(session.map, 'source("star") & source("lamp")', 10)
    session.update(hidden=("tube",))
    camera = session.camera(W, H)
    assert camera.parallel
    # From the side the rim of the lens faces the camera
    from viewer.drawn.camera import view_matrix

    x, y, _, _ = view_matrix(camera, W, H, 1.0) @ np.array([0, 8.0, 2.0, 1.0])
    assert session.pick(x, y, W, H).face == session.pick(x, y, W, H).words == "L1.rim"
    assert session.pick(2, 2, W, H).words == ""


def test_frames_follow_the_state(session: Session) -> None:
    plain = decode(session.frame(W, H, 1.0, coarse=False)).astype(int)
    assert plain.shape == (H, W, 3)
    for change in (
        {"dark": False},
        {"color": "source"},
        {"hidden": ("L1", "tube", "sensor")},
        {"section": Section(on=True)},
        {"names": True},
        {"width": 4.0},
    ):
        before = session.state
        session.update(**change)
        other = decode(session.frame(W, H, 1.0, coarse=False)).astype(int)
        assert np.abs(other - plain).mean() > 0.05, change
        session.state = before
    again = decode(session.frame(W, H, 1.0, coarse=False)).astype(int)
    np.testing.assert_array_equal(again, plain)
    assert decode(session.frame(W, H, 2.0, coarse=False)).shape == (2 * H, 2 * W, 3)


def test_a_chosen_ray_and_point_stand_out(session: Session) -> None:
    plain = decode(session.picture(W, H)).astype(int)
    session.chosen = read_one(session.map, int(session.drawing.rays.ray_ids[3]))
    ray = decode(session.picture(W, H)).astype(int)
    session.update(point=1)
    point = decode(session.picture(W, H)).astype(int)
    assert 0 < (ray != plain).any(axis=2).mean() < 0.1
    red = (point[..., 0] > 200) & (point[..., 1] < 140) & (point != ray).any(axis=2)
    assert red.sum() > 10


def test_objects_are_listed_and_changed(session: Session) -> None:
    session.toggle_object("tube")
    session.set_opacity("L1", 0.7)
    rows = {row["name"]: row for row in session.objects()}
    assert not rows["tube"]["visible"]
    assert rows["L1"]["opacity"] == pytest.approx(0.7)
    session.toggle_object("tube")
    assert session.state.hidden == ()


def test_the_answer_is_that_of_the_query(session: Session) -> None:
    inquiry = Inquiry(session)
    session.update(criterion=GHOST)
    found = select(session.map, GHOST)
    fields = inquiry.answer(never, lambda progress: None)
    assert fields["answer_text"].startswith(f"{found.matched:,} of {session.map.rays:,} rays")
    assert f"{found.flux:.4g}" in fields["answer_flux"]
    tree = CriterionQuestions(session).tree(never)
    assert tree[0]["rays"] == f"{found.matched:,}"
    session.update(criterion='hit("L1") & hit("tube") & detected("sensor")')
    nothing = inquiry.answer(never, lambda progress: None)
    assert "0 of" in nothing["answer_text"]
    assert "below" in nothing["answer_flux"]


def test_the_panels_are_filled(session: Session) -> None:
    paths, report = PathQuestions(session), ReportQuestions(session)
    session.update(criterion=GHOST, binning=1)
    table = paths.paths("face", False, "flux", never)["path_table"]
    assert table
    assert all("sensor" in row["path"] for row in table)
    assert paths.paths("object", True, "rays", never)["path_table"]
    assert "svg" in paths.ghosts(never)["ghost_matrix"]
    fields = DetectorQuestions(session).look_at_detector(never)
    assert fields["detector_cells"] == list(CELLS)
    for key in ("image_selected", "image_full"):
        pixels = decode(base64.b64decode(fields[key].partition(",")[2]))
        assert pixels.shape == (CELLS[1], CELLS[0], 3)
    # The same numbers as in charts
    facts = dict(fields["detector_facts"])
    for criterion, words in ((GHOST, "selected"), (None, "in all")):
        image = query.detector_image(session.map, "sensor", criterion)
        numbers = readings(image, "irradiance")
        lines = reading_lines(numbers)
        assert f"{lines[1].removeprefix('peak ')} {words}" in facts["Peak"]
        mean = next(line for line in lines if line.startswith("mean "))
        assert f"{mean.removeprefix('mean ')} {words}" in facts["Mean"]
    assert "±" in fields["image_peaks"][0]
    assert report.read_report(5)["report"]["facts"][0] == ["Ray", "5"]
    session.update(ray=5, point=1)
    point = report.point_fields()["report_point"]
    assert dict(point["facts"])["Place"] == "L1.front"
    assert "svg" in point["spectrum"]
    with pytest.raises(RayNotFound):
        report.read_report(10**9)


def test_next_and_previous_go_through_the_drawn_rays(session: Session) -> None:
    report = ReportQuestions(session)
    ids = sorted(session.drawing.rays.ray_ids.tolist())
    walked = []
    for _ in range(len(ids)):
        step = report.neighbour(1)
        assert step is not None
        walked.append(step)
        session.update(ray=step)
    assert walked == ids
    assert report.neighbour(1) == ids[0]
    assert report.neighbour(-1) == ids[-2]


def test_ghosts_are_two_mirror_like_reflections(small_map: raymap.RayMap) -> None:
    assert count_rays(small_map, GHOSTS).matched == count_rays(small_map, GHOST).matched


def test_errors_keep_their_carets(small_map: raymap.RayMap) -> None:
    with pytest.raises(raymap.CriterionError) as caught:
        count_rays(small_map, 'hit("L1"')
    error = criterion_error(caught.value)
    assert "^" in error["caret"]
    assert "\n" not in error["message"]


def test_a_map_without_meshes_or_detections_is_shown(tmp_path: Path) -> None:
    path = write_map(tmp_path / "bare.raymap", portions=1, rays=60, meshes=False, detect=False)
    with raymap.open(path) as ray_map:
        session = Session(ray_map, ViewState(criterion='hit("L1")'))
        inquiry = Inquiry(session)
        inquiry.draw(never)
        assert decode(session.frame(W, H, 1.0, coarse=False)).std() > 1
        fields = DetectorQuestions(session).look_at_detector(never)
        assert fields["detector_note"] == "No ray of the map reaches this detector."
        assert [row["drawn"] for row in session.objects()] == [False] * 3


def test_an_empty_unfinished_map_is_shown(tmp_path: Path) -> None:
    path = write_map(tmp_path / "begun.raymap", portions=0, finish=False)
    with raymap.open(path) as ray_map:
        session = Session(ray_map)
        inquiry = Inquiry(session)
        inquiry.draw(never)
        inquiry.answer(never, lambda progress: None)
        PathQuestions(session).paths("face", False, "flux", never)
        DetectorQuestions(session).look_at_detector(never)
        assert decode(session.frame(W, H, 1.0, coarse=False)).shape == (H, W, 3)
        assert ReportQuestions(session).neighbour(1) is None


def test_sections_of_the_controls_read_back(small_map: raymap.RayMap) -> None:
    for side in ("+x", "-y", "+z"):
        section = section_of(side, 3.5, on=True, rays=False)
        fields = section_fields(ViewState(section=section), small_map.directory)
        assert fields["section_side"] == side
        assert fields["section_place"] == pytest.approx(3.5)


def test_choices_make_criteria_that_bind(small_map: raymap.RayMap) -> None:
    lists = choices(small_map.directory)["atom_choices"]
    for kind, names in lists.items():
        for name in names:
            count_rays(small_map, tree_text(make_atom(kind, name["value"])))


def test_recent_and_saved_criteria_are_kept(tmp_path: Path) -> None:
    registry = CriterionRegistry(tmp_path / "deep" / "criteria.json")
    for text in ("a", "b", "a", ""):
        registry.use(text)
    registry.save("mine", "c")
    again = CriterionRegistry(tmp_path / "deep" / "criteria.json")
    assert again.recent == ["a", "b"]
    assert again.saved == {"mine": "c"}
    again.forget("mine")
    assert CriterionRegistry(again.path).saved == {}
    again.path.write_text("[1, 2", encoding="utf-8")
    assert CriterionRegistry(again.path).recent == []
    CriterionRegistry(Path("/proc/nowhere/criteria.json")).use("x")

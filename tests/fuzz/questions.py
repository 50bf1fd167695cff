"""What is asked of a map whose values were changed: everything that the product answers."""

from __future__ import annotations

import contextlib
import random
import warnings
from collections.abc import Callable
from pathlib import Path

import raymap
from query import (
    DetectorImage,
    audit,
    compare,
    detector_image,
    detector_images,
    explain,
    ghost_matrix,
    ghost_table,
    illuminated,
    parse,
    path_table,
    rays_at,
    report,
    select,
    sweep,
)
from query.answers.images.image_files import write_image
from query.answers.images.readings import readings
from raymap.file.repair import repair

__all__ = ["ask"]

Question = Callable[[raymap.RayMap, Path], object]

_CRITERIA = tuple(
    parse(text)
    for text in (
        'hit("*", reflected)',
        'detected("sensor", rect(0 mm, 0 mm, 1 mm, 2 mm))',
        'detected("sky", rect(0 deg, 0 deg, 90 deg, 20 deg))',
        'detected("eye", rect(-5 deg, -5 deg, 5 deg, 5 deg))',
        'hit("*", reflectance > 0.1)',
        "length > 10",
        'incidence(hit("*")) < 30 deg',
        "wavelength > 500 nm",
        'detected("*", rect(0, 0, 1, 2))',
        'hit("*") -> crossed("*")',
        'path("* (.)* @* .*")',
        'count(hit("*")) >= 2',
        'last(hit("*")) & medium("*")',
        "flux > 0.001 W",
        'hit("*.#0")',
        "optical_length > 3",
        'source("l*") & !detected("sensor")',
        'detected("sensor", ellipse(0, 0, 20, 10))',
        'detected("sensor", ellipse(0, 0, 1e-320, 1e200))',
        "bounces > 1",
    )
)


def _every_column(ray_map: raymap.RayMap, _: Path) -> None:
    for portion in ray_map.portions:
        portion.segments()
        portion.read()


def _results(ray_map: raymap.RayMap, _: Path) -> None:
    for detector in ray_map.directory.detectors:
        for channel_set in range(len(ray_map.channel_sets)):
            ray_map.detector_result(detector.name, channel_set)


def _report(ray_map: raymap.RayMap, _: Path) -> None:
    for portion in ray_map.portions:
        for ray in portion.ray_ids()[:2].tolist():
            report(ray_map, ray)


def _places(ray_map: raymap.RayMap, _: Path) -> None:
    found = select(ray_map, None, threads=1)
    for place in ("sensor", "lens"):
        for rays in rays_at(found, place):
            len(rays.position)


def _copy(ray_map: raymap.RayMap, folder: Path) -> None:
    for portion in ray_map.portions[:1]:
        raymap.copy_selection(ray_map, portion.ray_ids()[::2], folder / "copy.raymap", force=True)


def _repaired(ray_map: raymap.RayMap, folder: Path) -> None:
    repair(ray_map, folder / "repaired.raymap", force=True)


def _pictures(ray_map: raymap.RayMap, folder: Path) -> None:
    for detector in ray_map.directory.detectors:
        with contextlib.suppress(raymap.RayMapError):
            _picture(detector_image(ray_map, detector.name, threads=1), folder)


def _picture(image: DetectorImage, folder: Path) -> None:
    image.srgb()
    image.calmer()
    for suffix in (".csv", ".exr", ".png"):
        write_image(image, folder / f"picture{suffix}")
    if image.measure is not None:
        readings(image)


def _luminaire(ray_map: raymap.RayMap, folder: Path) -> None:
    write_image(detector_image(ray_map, "sky", threads=1), folder / "sky.ies")


def _table(ray_map: raymap.RayMap, _: Path) -> None:
    table = path_table(ray_map, None, threads=1)
    table.rows(3)


def _drawn(ray_map: raymap.RayMap, folder: Path) -> None:
    from viewer.export.files import export_3d
    from viewer.paint.rendering import NothingDrawn, picture

    with contextlib.suppress(raymap.RayMapError), warnings.catch_warnings():
        warnings.simplefilter("ignore", NothingDrawn)
        picture(ray_map, rays=20, size=(64, 48))
    for suffix in (".glb", ".vtp", ".dxf"):
        with contextlib.suppress(raymap.RayMapError):
            export_3d(ray_map, folder / f"drawn{suffix}", rays=20, force=True)


def _in_application(ray_map: raymap.RayMap, _: Path) -> None:
    from viewer.app.inquiry import Inquiry
    from viewer.app.session import Session
    from viewer.drawn.state import ViewState
    from viewer.panels.criterion import CriterionQuestions
    from viewer.panels.detector import DetectorQuestions
    from viewer.panels.paths import PathQuestions
    from viewer.panels.report import ReportQuestions

    session = Session(ray_map, ViewState(rays=20))
    inquiry = Inquiry(session)
    tree, paths = CriterionQuestions(session), PathQuestions(session)
    detector, report = DetectorQuestions(session), ReportQuestions(session)

    def never() -> bool:
        return False

    asked: tuple[Callable[[], object], ...] = (
        lambda: inquiry.draw(never, lambda drawn: None),
        lambda: inquiry.answer(never, lambda part: None),
        lambda: tree.tree(never),
        lambda: paths.paths("face", False, "flux", never),
        lambda: paths.paths("object", True, "rays", never),
        lambda: paths.ghosts(never),
        lambda: detector.look_at_detector(never),
        lambda: report.read_report(0),
        report.point_fields,
        session.legend,
        session.objects,
        lambda: session.frame(64, 48, 1.0, coarse=False),
        lambda: session.pick(32, 24, 64, 48),
        lambda: session.scene(64, 48).message({}),
    )
    for question in asked:
        with contextlib.suppress(raymap.RayMapError):
            question()


_DEAR: tuple[Question, ...] = (
    _every_column,
    _results,
    _report,
    _places,
    _copy,
    _repaired,
    _table,
    _pictures,
    _luminaire,
    _drawn,
    _drawn,
    _in_application,
    lambda ray_map, _: ray_map.meshes,
    lambda ray_map, _: path_table(ray_map, 'hit("lens")', by="object", threads=1).rows(),
    lambda ray_map, _: detector_images(ray_map, "sensor", {"all": None, "few": "length > 1"}),
    lambda ray_map, _: detector_images(ray_map, "sky", {"all": None}, threads=1),
    lambda ray_map, _: illuminated(ray_map, "sensor", threads=1),
    lambda ray_map, _: audit(ray_map, threads=1),
    lambda ray_map, _: explain(ray_map, 'hit("*") & length > 10', threads=1),
    lambda ray_map, _: ghost_table(ray_map, "sensor", threads=1),
    lambda ray_map, _: ghost_matrix(ray_map, "sensor", threads=1),
    lambda ray_map, _: sweep(ray_map, "sensor", threads=1),
    lambda ray_map, _: compare(ray_map, ray_map, threads=1),
    lambda ray_map, folder: raymap.export(ray_map, folder / "out.csv", force=True),
    lambda ray_map, folder: raymap.export(ray_map, folder / "out.parquet", rows="rays", force=True),
)


def ask(ray_map: raymap.RayMap, dice: random.Random, folder: Path) -> None:
    """Ask some of the usual questions and one or two that cost more.

    Only the project's own errors are let go.
    """
    questions: list[Question] = [
        lambda ray_map, _, criterion=criterion: select(ray_map, criterion, threads=1).ray_ids
        for criterion in dice.sample(_CRITERIA, 3)
    ]
    questions += dice.sample(_DEAR, 2)
    for question in questions:
        try:
            question(ray_map, folder)
        except raymap.RayMapError:
            continue

"""The report panel: one ray point by point, with the spectrum of its segments."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from raymap.model.errors import RayMapError
from raymap.optics.colorimetry import encode_srgb
from viewer.drawn.answers import path_of_ray, ray_report, read_one
from viewer.drawn.state import StateError
from viewer.paint.plots import bars
from viewer.panels.panel import Application, Panel, Question, Session
from viewer.templates import template

__all__ = ["KINDS", "ReportQuestions", "point_fields", "report_fields"]


def _number(value: Any, unit: str = "") -> str:
    if value is None:
        return "–"
    return f"{float(value):.6g}{unit and ' ' + unit}"


def _vector(values: Sequence[float] | None, digits: int = 4) -> str:
    if values is None:
        return "–"
    return ", ".join(f"{float(value):.{digits}f}" for value in values)


def _place(point: Mapping[str, Any]) -> str:
    """Object and face of a point, or where it is otherwise."""
    if point.get("object"):
        face = point.get("face")
        return f"{point['object']}.{face}" if face else str(point["object"])
    events = list(point.get("events") or [])
    if "emitted" in events:
        return "source"
    return "left the scene" if "left" in events else "in a medium"


def _color(point: Mapping[str, Any]) -> str:
    """CSS colour of the segment that starts at a point; no light, no colour."""
    rgb = point.get("color")
    if rgb is None or max(rgb, default=0) <= 0:
        return "transparent"
    parts = (round(255 * part) for part in encode_srgb(np.array(rgb) / max(rgb)).tolist())
    return "rgb({}, {}, {})".format(*parts)


def report_fields(report: Mapping[str, Any], unit: str) -> dict[str, Any]:
    """The whole report for the page."""
    points = []
    for number, point in enumerate(report["points"]):
        events = ", ".join(str(word).replace("_", " ") for word in point.get("events") or [])
        points.append(
            {
                "number": number,
                "place": _place(point),
                "events": events,
                "length": _number(point.get("length"), unit) if point.get("length") else "",
                "medium": point.get("medium") or "",
                "color": _color(point),
            }
        )
    facts = [["Ray", f"{report['ray_id']}"], ["Source", str(report["source"])]]
    flux_unit = str(dict(report.get("units") or {}).get("flux", ""))
    for key, title, of in (
        ("flux", "Flux", flux_unit),
        ("weight", "Weight", ""),
        ("length", "Length", unit),
    ):
        if report.get(key) is not None:
            facts.append([title, _number(report[key], of)])
    return {"facts": facts, "points": points}


def point_fields(
    report: Mapping[str, Any],
    number: int,
    unit: str,
    labels: Sequence[str],
    wavelengths_nm: Sequence[float] | None,
) -> dict[str, Any] | None:
    """One point with everything the report knows of it.

    Parameters
    ----------
    labels : of the channels
    wavelengths_nm : of the channels of a spectral map, None of an RGB map
    """
    if not 0 <= number < len(report["points"]):
        return None
    point = report["points"][number]
    facts = [
        ["Place", _place(point)],
        ["Position", f"{_vector(point.get('position'))} {unit}"],
        ["Events", ", ".join(str(e).replace("_", " ") for e in point.get("events") or []) or "–"],
    ]
    if point.get("triangle") not in (None, -1):
        facts.append(["Primitive", str(point["triangle"])])
    if point.get("normal") is not None and any(point["normal"]):
        facts.append(["Normal", _vector(point["normal"], 5)])
    if point.get("incidence_deg") is not None:
        facts.append(["Incidence", _number(point["incidence_deg"], "°")])
    if point.get("surface"):
        surface = point["surface"]
        name = surface.get("name") if isinstance(surface, Mapping) else surface
        facts.append(["Surface", str(name)])
    if point.get("length"):
        facts.append(["Length", _number(point["length"], unit)])
        facts.append(["Medium", str(point.get("medium") or "unknown")])
        facts.append(["Index", _text(point.get("refractive_index"))])
        for name, value in dict(point.get("medium_parameters") or {}).items():
            facts.append([f"  {str(name).replace('_', ' ')}", _text(value)])
    for crossing in point.get("detectors") or []:
        facts.append(["Detector", _crossing(crossing)])
    spectrum = [float(value) for value in dict(point.get("spectrum") or {}).values()]
    plot = ""
    if spectrum and point.get("length"):
        caption = "light of the segment"
        plot = bars(labels, spectrum, wavelengths_nm=wavelengths_nm, caption=caption)
    return {"facts": facts, "spectrum": plot}


def _text(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, Mapping):
        return ", ".join(f"{name}: {_text(item)}" for name, item in value.items())
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        return ", ".join(_text(item) for item in value)
    return str(value)


def _crossing(crossing: Any) -> str:
    """One crossing of a detector in words."""
    if not isinstance(crossing, Mapping):
        return str(crossing)
    words = [str(crossing.get("detector", crossing.get("name", "")))]
    if "cell" in crossing:
        words.append(f"cell {_text(crossing['cell'])}")
    if "registered" in crossing:
        words.append("registered" if crossing["registered"] else "not registered")
    if crossing.get("cosine") is not None:
        words.append(f"cosine {_text(crossing['cosine'])}")
    return ", ".join(words)


class ReportQuestions:
    """Asks for the report of a session's chosen ray."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.report: dict[str, Any] | None = None

    def read_report(self, ray_id: int) -> dict[str, Any]:
        """The report of one ray.

        Raises
        ------
        RayNotFound
        """
        self.report = ray_report(self.session.map, ray_id)
        self.session.chosen = read_one(self.session.map, ray_id)
        unit = self.session.map.directory.length_unit
        return {"report": report_fields(self.report, unit), "ray_text": str(ray_id)}

    def point_fields(self) -> dict[str, Any]:
        """The chosen point of the report."""
        point = self.session.state.point
        if self.report is None or point is None:
            return {"report_point": None, "point": point}
        ray_map = self.session.map
        index, _ = ray_map.find_ray(int(self.report["ray_id"]))
        channels = ray_map.channel_sets[ray_map.portions[index].channel_set]
        spectral = channels.wavelengths_nm if channels.kind == "spectral" else None
        labels = [label.removesuffix(" nm") for label in channels.labels]
        fields = point_fields(self.report, point, ray_map.directory.length_unit, labels, spectral)
        return {"report_point": fields, "point": point if fields is not None else None}

    def neighbour(self, step: int) -> int | None:
        """The next or previous drawn ray of the selection."""
        ids = np.sort(self.session.drawing.rays.ray_ids)
        if len(ids) == 0:
            return None
        current = self.session.state.ray
        if current is None:
            return int(ids[0] if step > 0 else ids[-1])
        place = int(np.searchsorted(ids, current, "right" if step > 0 else "left"))
        place = place if step > 0 else place - 1
        return int(ids[place % len(ids)])


def _questions(app: Application) -> ReportQuestions:
    found: ReportQuestions = app.questions["report"]
    return found


async def open_ray(app: Application, text: str, point: int | None = None) -> None:
    """Open the report of a ray by its number."""
    try:
        number = int(str(text).strip().replace(",", ""))
    except ValueError:
        with app.page:
            app.page.report_error = f"{text!r} is no ray number"
        return
    try:
        fields = await app.ask(_questions(app).read_report, number)
    except RayMapError as error:
        with app.page:
            app.page.report_error = str(error)
        return
    app.quiet = True
    app.session.update(ray=number, point=0 if point is None else point, panel="report")
    app.repaint(**fields, **_questions(app).point_fields(), report_error="", panel="report")
    app.quiet = False


async def step_ray(app: Application, step: int) -> None:
    """The next or the previous ray."""
    number = _questions(app).neighbour(int(step))
    if number is not None:
        await open_ray(app, str(number))


def choose_point(app: Application, point: int) -> None:
    """A point of the report, marked in the scene."""
    points = len(app.page.report["points"]) if app.page.report else 0
    if not 0 <= int(point) < points:
        raise StateError(f"the report has {points} points")
    app.session.update(point=int(point))
    app.repaint(**_questions(app).point_fields())


async def select_path_of_ray(app: Application) -> None:
    """All rays that took the path of this one."""
    if app.session.state.ray is not None:
        ray_map, number = app.session.map, app.session.state.ray
        await app.set_criterion(await app.ask(path_of_ray, ray_map, number))


def _follow(app: Application) -> dict[str, Any]:
    state = app.session.state
    fields: dict[str, Any] = {"point": state.point}
    return fields if state.ray is not None else fields | dict(_NO_RAY)


async def _fill(app: Application, cancel: threading.Event) -> Sequence[Question]:
    state = app.session.state
    if state.ray is not None and _questions(app).report is None:
        await open_ray(app, str(state.ray), state.point)
    return ()


_NO_RAY = {"report": None, "report_error": "", "report_point": None, "ray_text": ""}

KINDS = (
    Panel(
        word="report",
        title="Report",
        place=40,
        markup=lambda: template("report"),
        fields=lambda app: dict(_NO_RAY),
        follow=_follow,
        questions=ReportQuestions,
        actions={
            "ray": open_ray,
            "step_ray": step_ray,
            "point": choose_point,
            "same_path": select_path_of_ray,
        },
        fill=_fill,
        ray=open_ray,
    ),
)

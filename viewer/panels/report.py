"""The report panel: one ray point by point, with the spectrum of its segments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from raymap.optics.colorimetry import encode_srgb
from viewer.paint.plots import bars

__all__ = ["point_fields", "report_fields"]


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
    for meeting in point.get("detectors") or []:
        facts.append(["Detector", _meeting(meeting)])
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


def _meeting(meeting: Any) -> str:
    """One meeting with a detector in words."""
    if not isinstance(meeting, Mapping):
        return str(meeting)
    words = [str(meeting.get("detector", meeting.get("name", "")))]
    if "cell" in meeting:
        words.append(f"cell {_text(meeting['cell'])}")
    if "registered" in meeting:
        words.append("registered" if meeting["registered"] else "not registered")
    if meeting.get("cosine") is not None:
        words.append(f"cosine {_text(meeting['cosine'])}")
    return ", ".join(words)

"""What `raymap check` prints: a scene in a dozen lines, whatever its size."""

from __future__ import annotations

from typing import Any

__all__ = ["check_lines"]

_SHOWN = 12
"""Names of one kind that are written out; of more the first ones and the last."""

_PLAIN = (
    "scene", "title", "length_unit", "sources", "bodies", "media", "detectors", "channels",
    "design",
)  # fmt: skip
_LENGTHS = (
    "efl", "bfl", "entrance_pupil", "entrance_diameter", "exit_pupil", "exit_diameter",
)  # fmt: skip


def check_lines(report: dict[str, Any]) -> list[str]:
    """The report of `tracer.studies.lens.examine`, line by line.

    Bodies of one kind with the same faces share a line, which names the faces as criteria do.
    """
    title = f": {report['title']}" if report["title"] else ""
    lines = [f"{report['scene']} can be traced{title}"]
    lines += [f"sources: {_names(report['sources'])}"]
    groups: dict[str, list[str]] = {}
    for name, text in report["bodies"].items():
        groups.setdefault(text, []).append(name)
    lines += [f"bodies: {len(report['bodies'])}"]
    lines += [f"  {text}: {_names(names)}" for text, names in groups.items()]
    for key in ("media", "detectors", "channels"):
        lines += [f"{key}: {_names(report[key])}"]
    units = dict.fromkeys(_LENGTHS, f" {report['length_unit']}") | {"wavelength_nm": " nm"}
    for key, value in report.items():
        if key not in _PLAIN and value is not None:
            name = key.removesuffix("_nm").replace("_", " ")
            lines.append(f"{name}: {_value(value)}{units.get(key, '')}")
    if "design" in report:
        lines += _design(report["design"])
    return lines


def _names(names: list[str]) -> str:
    if len(names) <= _SHOWN:
        return ", ".join(names) or "none"
    return f"{', '.join(names[: _SHOWN - 2])} … {names[-1]} ({len(names)})"


def _value(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _design(design: dict[str, Any]) -> list[str]:
    """The numbers of a lens file, and what its surfaces became."""
    lines = ["design, in the order of its surfaces:"]
    lines += [f"  {key}: {_value(v)}" for key, v in design.items() if isinstance(v, float)]
    return lines + [f"  surface {number}: {face}" for number, face in design["faces"].items()]
